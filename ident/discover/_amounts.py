"""How large a part of the error is, in mm or °, as a share, and in words."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ._select import Selection
from ._terms import Term


def sizes_of(selection: Selection) -> dict[Term, float]:
    """Return the contribution of each chosen term, mm or ° rms."""
    pairs = zip(selection.design.terms, selection.chosen, strict=True)
    return {
        term: float(np.sqrt(np.mean(selection.part(g) ** 2)))
        for g, (term, on) in enumerate(pairs)
        if on
    }


def clean_error(selection: Selection) -> Float[np.ndarray, " t"]:
    """Return the error without the zeros of the instruments and without wild readings."""
    error = selection.view.error.copy()
    reach = 6.0 * selection.noise
    explained = error - selection.residual
    error = np.clip(error, explained - reach, explained + reach)
    for number in np.unique(selection.view.data.source):
        own = selection.view.data.source == number
        error[own] -= error[own].mean()
    return np.asarray(error)


def _course(selection: Selection, terms: Sequence[Term]) -> Float[np.ndarray, " t"]:
    """Return what some terms contribute to each reading."""
    index = [selection.design.terms.index(term) for term in terms]
    return np.asarray(np.sum([selection.part(g) for g in index], axis=0))


def size_of(selection: Selection, terms: Sequence[Term]) -> tuple[float, float]:
    """Return rms and share of the mean square of the error."""
    course, error = _course(selection, terms), clean_error(selection)
    whole = float(np.mean(error**2)) or 1.0
    share = float(np.clip(np.mean(course * error) / whole, 0.0, 1.0))
    return float(np.sqrt(np.mean(course**2))), share


def stability_of(selection: Selection, terms: Sequence[Term]) -> float:
    """Return the share of resamples in which all of some terms were selected."""
    index = [selection.design.terms.index(term) for term in terms]
    return float(min(selection.frequency[index]))


def amount(rms: float, unit: str) -> str:
    """Return a length or angle as a person writes it."""
    return f"{1e3 * rms:.2g} µm" if unit == "mm" else f"{1e3 * rms:.2g} m°"
