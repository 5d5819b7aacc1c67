"""The job file: what it says, what is wrong with it, and the files that it names.

Read `_schema` (its keys), `_load` (a `Job`, with the lists that its axes have: `_existing`),
then `_checks` and `_faults` (what is wrong, with line and nearest key). `_document` writes the
reference of all keys; `_found_fits` makes a job of the fits that were found.
"""
