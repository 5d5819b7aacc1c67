"""The errors that users meet: one line each, never a traceback on the command line."""


class AxcompError(Exception):
    """Input that cannot be used; the message says where, what was found, what was expected.

    Subclasses pass all their fields to ``super().__init__`` so that they survive
    pickling through process pools, and build the sentence in ``__str__``.
    """


class FoundError(AxcompError, ValueError):
    """Something else than what is needed: where, what was found, what was expected."""

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(where, found, expected)
        self.where, self.found, self.expected = where, found, expected

    def __str__(self) -> str:
        return f"{self.where}: found {self.found}, expected {self.expected}"


class SourceError(AxcompError):
    """A file, folder or question that cannot be used: which, and why."""

    def __init__(self, source: str, reason: str) -> None:
        super().__init__(source, reason)
        self.source, self.reason = source, reason

    def __str__(self) -> str:
        return f"{self.source}: {self.reason}"


class UsageError(AxcompError):
    """The command line itself is wrong: exit status 2."""
