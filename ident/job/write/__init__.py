"""From drafts to files: `_lists` of each axis, `_loadsheet` for who loads them.

`_output` is the folder: whole files or none, and no failed list that looks valid.
"""
