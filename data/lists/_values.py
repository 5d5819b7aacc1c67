"""Values of list entries, from their text.

One reading for everybody: typed access and the checker must agree on what a number is.
"""

import re

_INTEGER = re.compile(r"-?[0-9]+", re.ASCII)
_REAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LONGEST = 40
"""Digits that any type could hold, with room; longer ones would be slow to convert."""
_LONGEST_REAL = 400
"""Characters that a finite number may take; longer ones would be slow to convert."""

INTEGER_LIMITS: dict[str, tuple[int, int]] = {
    "BOOLEAN": (0, 1),
    "UNS08": (0, 2**8 - 1),
    "UNS16": (0, 2**16 - 1),
    "UNS32": (0, 2**32 - 1),
    "SGN16": (-(2**15), 2**15 - 1),
    "SGN32": (-(2**31), 2**31 - 1),
    "SGN64": (-(2**63), 2**63 - 1),
}
"""Smallest and largest value of each integer type of the kernel."""

BITS: dict[str, int] = {
    "BACKLASH": 0x1,
    "LEAD": 0x2,
    "TEMP": 0x4,
    "CROSS": 0x8,
    "PLANE": 0x10,
}
"""Identifiers of P-AXIS-00465, TF5200 functional description 1.51, p. 98."""


def parse_integer(text: str) -> int | None:
    """Return the decimal integer that the text is, or None.

    Decimal digits with an optional minus only: no sign ``+``, hexadecimal or exponent
    (semantics S-08). The value is as large as it stands; types are checked elsewhere.
    """
    if _INTEGER.fullmatch(text) is None:
        return None
    digits = text.lstrip("-").lstrip("0")
    if len(digits) > _LONGEST:
        # Outside every type either way; int() refuses thousands of digits.
        digits = "9" * _LONGEST
    value = int(digits or "0")
    return -value if text.startswith("-") else value


def parse_boolean(text: str) -> bool | None:
    """Return the truth value of 0, 1, TRUE, FALSE in any case, or None."""
    return {"0": False, "1": True, "false": False, "true": True}.get(text.lower())


def parse_real(text: str) -> float | None:
    """Return the finite number that the text is, or None."""
    if len(text) > _LONGEST_REAL or _REAL.fullmatch(text) is None:
        return None
    value = float(text)
    return value if abs(value) <= 1.7976931348623157e308 else None


def parse_bits(text: str) -> int | None:
    """Return the bits that the text names, or None.

    Identifiers joined by ``|``, a decimal or a ``0x`` number (semantics S-51).
    """
    bits = 0
    for part in text.split("|"):
        word = part.strip()
        if word.upper() in BITS:
            bits |= BITS[word.upper()]
        elif re.fullmatch(r"0[xX][0-9a-fA-F]{1,16}", word):
            bits |= int(word, 16)
        elif (value := parse_integer(word)) is not None and value >= 0:
            bits |= value
        else:
            return None
    return bits
