"""What cannot be carried between a list and a model."""

from ...data.errors import AxcompError


class ExchangeError(AxcompError, ValueError):
    """A list that has no model, or a model that no list can hold."""

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(where, found, expected)
        self.where, self.found, self.expected = where, found, expected

    def __str__(self) -> str:
        return f"{self.where}: found {self.found}, expected {self.expected}"
