"""What a job found, as data: `_result` of a fit, `_job_result` of all, with ``result.json``.

`_verdict` says what is known of a list, and by what; `_second` what a second measurement shows.
"""
