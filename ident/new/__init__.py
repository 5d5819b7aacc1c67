"""A job that writes itself: from measurement files to a commented job with its questions.

`new_job` (`_job`) reads the files, asks `_columns` what their columns mean (by their names:
`_names`) and `_fits` which compensation they suit. `_write` gathers what the job says, and
``job.toml.jinja`` is the job; what the files do not tell stands there as a question with its
possible answers (`_text`).
"""

from ._job import NewJob as NewJob, new_job as new_job
from ._text import (
    OPTIONAL as OPTIONAL,
    Question as Question,
    open_question as open_question,
)
