"""`axcomp demo`: the command in `_command`, the machine and its jobs in `_run`.

`_files` is what it leaves to be read; its jobs and texts lie in this folder.
"""
