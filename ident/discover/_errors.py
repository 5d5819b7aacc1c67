"""Why nothing can be looked for."""

from ...data.errors import AxcompError


class DiscoverError(AxcompError, ValueError):
    """Measurements in which no compensation can be looked for: where, found, expected."""

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(where, found, expected)
        self.where, self.found, self.expected = where, found, expected

    def __str__(self) -> str:
        return f"{self.where}: found {self.found}, expected {self.expected}"
