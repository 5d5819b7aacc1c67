"""What can be wrong with signals, so that nothing can be made of them."""

from ..errors import FoundError


class SignalError(FoundError):
    """Signals do not fit together or are too short: what was found and expected."""


def check_lengths(what: str, *sizes: int, least: int) -> None:
    """Raise where signals differ in length or have fewer than `least` samples.

    Raises:
        SignalError: Naming the lengths.
    """
    if len(set(sizes)) > 1:
        found = f"{' and '.join(map(str, sizes))} samples"
        raise SignalError(what, found, "as many of each")
    if sizes[0] < least:
        raise SignalError(what, f"{sizes[0]} samples", f"at least {least}")
