"""A job that writes itself: from measurement files to a commented job with its questions.

`new_job` (`_job`) reads the files, asks `_columns` what their columns mean and `_fits` which
compensation they suit, and writes a job; what the files do not tell stands there as a question
with its possible answers (`_text`).
"""

from ._job import NewJob as NewJob, new_job as new_job
from ._text import (
    OPTIONAL as OPTIONAL,
    Question as Question,
    open_question as open_question,
)
