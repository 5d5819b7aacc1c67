"""Why a fit is refused."""

from ...data.errors import AxcompError


class FitError(AxcompError, ValueError):
    """The readings cannot determine what was asked for; the message says what is missing."""


NOT_DETERMINED = (
    "the readings do not determine the table: too few different places in it."
)
"""What a factor that does not exist means to the user."""
