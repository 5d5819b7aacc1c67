"""What keeps a batch from running or going on."""

from ...data.errors import AxcompError


class BatchError(AxcompError, RuntimeError):
    """A batch that cannot start or go on: where, what was found and what was expected."""

    def __init__(self, where: str, reason: str) -> None:
        super().__init__(where, reason)
        self.where, self.reason = where, reason

    def __str__(self) -> str:
        return f"{self.where}: {self.reason}"
