"""What is wrong with a job file, and where."""

from ...data.errors import AxcompError


class JobError(AxcompError, ValueError):
    """A job that cannot be run: where in the job file, what was found and expected."""

    def __init__(self, source: str, line: int | None, reason: str) -> None:
        super().__init__(source, line, reason)
        self.source, self.line, self.reason = source, line, reason

    def __str__(self) -> str:
        where = self.source if self.line is None else f"{self.source}:{self.line}"
        return f"{where}: {self.reason}"


class OutputError(AxcompError, OSError):
    """A folder or file that cannot be written."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(path, reason)
        self.path, self.reason = path, reason

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"
