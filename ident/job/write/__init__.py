"""From drafts to files: `_lists` of each axis, `_loadsheet` and `_first_run` beside them.

`_output` is the folder: whole files or none, and no failed list that looks valid.
"""
