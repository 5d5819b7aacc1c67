"""Why a fit is refused."""

from ...data.errors import AxcompError


class FitError(AxcompError, ValueError):
    """The readings cannot determine what was asked for; the message says what is missing."""
