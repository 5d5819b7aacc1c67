"""What cannot be carried between a list and a model."""

from ...data.errors import FoundError


class ExchangeError(FoundError):
    """A list that has no model, or a model that no list can hold."""
