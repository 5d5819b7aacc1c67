"""A plane, cross or leadscrew table from its keys to its draft.

Read `_fitting` (a plan, then its readings fitted), `_plan` and `_layout` (which table is
written, over which nodes), `_readings`, `_ends` (what readings leave open), `_draft` (the fitted
table, its gate and its proof), `_remarks`, `_passes` (what the passes of a log share, and what
both ways differ by) and `_trend` (whose a constant and a slope are). Logs too large for memory go
another way from the readings to the draft: `_log_readings`, `_log_draft`.
"""
