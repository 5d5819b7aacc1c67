"""The job file: what it says, what is wrong with it, and the files that it names.

Read `_schema` (its keys), `_load` (a `Job`, with the lists that its axes have), then `_checks`
and `_faults` (what is wrong, with line and nearest key). `_found_fits` makes a job of the fits
that were found.
"""
