"""Fits that share a group: identified together, then written and proven like any other.

Read `_group` (from plans to drafts), `_recording` (what was measured), `_share` (what one fit
gets of it) and `_proof`. They take long to load: a job of one table starts sooner without.
"""
