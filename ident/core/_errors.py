"""Why a fit is refused."""

from ...data.errors import AxcompError


class FitError(AxcompError, ValueError):
    """The readings cannot determine what was asked for; the message says what is missing."""


NOT_DETERMINED = (
    "the readings do not determine the table: too few different places in it."
)
"""What a factor that does not exist means to the user."""

NOT_LEFT_OUT = (
    "without some of its readings the rest does not determine the table, so that nothing"
    " could be proven: take fewer nodes, or read more places, or each of them again."
)
"""The same, where readings were held out."""
