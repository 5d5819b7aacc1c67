"""The errors that users meet: one line each, never a traceback on the command line."""


class AxcompError(Exception):
    """Input that cannot be used; the message says where, what was found, what was expected.

    Subclasses pass all their fields to ``super().__init__`` so that they survive
    pickling through process pools, and build the sentence in ``__str__``.
    """


class UsageError(AxcompError):
    """The command line itself is wrong: exit status 2."""
