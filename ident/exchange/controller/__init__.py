"""The controller of a whole machine: its lists, run along a motion.

Read `_motion`, `_events` (what happens at the controller meanwhile) and `_simulate` (lists →
`PositionController`, which is run for a machine, or for all that acts on one axis).
"""
