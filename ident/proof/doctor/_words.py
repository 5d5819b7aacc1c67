"""What the doctor says, for the person at the machine."""

from collections.abc import Mapping

from ._cases import Case


def sentence_of(
    verdict: str,
    best: Case,
    shares: Mapping[str, float],
    factor: float,
    *,
    blind: float | None,
    unit: str,
    axis: str,
    other: str,
) -> str:
    """Return the sentence on one compensation.

    Args:
        verdict: Word of the interface.
        best: Explanation that it stands for.
        shares: Probability by word.
        factor: What fits best, of the offset that the list gives.
        blind: Shift that these readings cannot tell from none, in the unit of lengths.
        unit: Of lengths.
        axis: Name of the axis.
        other: Name of the axis on which it acts instead, if it does.
    """
    value = best.value
    match verdict:
        case "right":
            return "right: the list adds what it says"
        case "sign":
            if value is not None and value != -1.0:
                return f"added with opposite sign and {-value:g} times as large"
            return "added with opposite sign"
        case "unit":
            assert value is not None
            way = "larger" if value > 1.0 else "smaller"
            return f"unit is ten times {way}"
        case "twice":
            return "applied twice"
        case "shift":
            assert value is not None
            way = "further" if value > 0 else "back"
            return f"table applied {abs(value):.1f} {unit} {way}"
        case "wrong axis":
            if best.note == "axis":
                return f"acts on {other} instead of {axis}"
            if best.note == "master":
                return "follows another master: masters swapped"
            return (
                f"does nothing to {axis}: it acts on another axis, follows another"
                " master, or is not active"
            )
    if blind is not None:
        return (
            f"cannot tell: right, or shifted by up to {blind:.1f} {unit}: these readings"
            " do not show the difference; measure at more places, or with less noise"
        )
    return _doubt(shares, factor)


def _doubt(shares: Mapping[str, float], factor: float) -> str:
    """Return why nothing can be said."""
    likely = sorted(shares, key=lambda word: -shares[word])
    if likely[0] == "cannot tell":
        if abs(factor) < 0.3:
            return (
                "cannot tell: it does nothing to any axis that was measured; is it"
                " active?"
            )
        return (
            f"cannot tell: what it does is {factor:.2g} times what the list says, which"
            " no single fault explains"
        )
    named = [
        f"{word} {100 * shares[word]:.0f} %"
        for word in likely[:3]
        if shares[word] > 0.005 and word != "cannot tell"
    ]
    return (
        f"cannot tell: {', '.join(named)}; measure again with more readings, or with"
        " less noise"
    )
