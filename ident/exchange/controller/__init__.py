"""The controller of a whole machine: its lists, run along a motion.

Read `_controller` (lists → `PositionController`), `_motion`, `_events` (what happens at the
controller meanwhile) and `_simulate` (a machine, or all that acts on one axis).
"""
