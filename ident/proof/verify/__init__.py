"""A controller's log against its lists: what it does with each compensation.

Each compensation is a *channel* that gives what is added along the motion of the log, also
under changes that a controller may make (`Change`). The search compares such hypotheses by how
well they explain what was logged, the noise being estimated, and what each costs (a description
length); the judge puts the best into words.

Read `_verify` (the whole, and a clock that is off), `_lists` and `_log` (what is to
be explained), `_channel` (each compensation has its own in `kinds`), `_hypothesis` (with
its words), `_scan` and `_search`, `_judge`. The `doctor` explains measurements by the same search.
"""

from ._channel import (
    AbstractChannel as AbstractChannel,
    Change as Change,
    LogRows as LogRows,
    Parts as Parts,
    TableChannel as TableChannel,
    Way as Way,
    ways_of as ways_of,
)
from ._hypothesis import (
    FAULT as FAULT,
    Hypothesis as Hypothesis,
    fault_words as fault_words,
)
from ._judge import (
    Verdict as Verdict,
    reversal_words as reversal_words,
    worst_of as worst_of,
)
from ._lists import turns_in_log as turns_in_log
from ._log import LogMotion as LogMotion, Target as Target
from ._search import Found as Found, search as search
from ._verify import Verification as Verification, verify_log as verify_log
