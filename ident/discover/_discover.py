"""Which compensations a machine asks for, axis by axis and drive by drive."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..core import one_blas_thread, regress
from ._axis import examine_axis
from ._columns import Columns
from ._data import (
    AxisSummary,
    DiscoverError,
    Discovery,
    Found,
    Observed,
    Rejected,
    Unexplained,
)
from ._doubts import evidence_of
from ._select import Selection, Worth, select_terms
from ._terms import Kind, Term
from ._view import friction_terms, view_of

_LEAST = 20
"""Readings of an axis, below which nothing can be told from chance."""
_SLOW = 2e-3
"""Share of the fastest speed below which friction is not kinetic."""
_MOVING = 200
"""Readings of a moving drive, below which its friction is not looked for."""
_WORTH = Worth(unit=0.0, of_noise=0.0, of_size=0.01)
"""Share of the rms of the current from which on a term counts."""
_EVEN = 0.05
"""Spread of the speeds, relative to their mean, below which there is but one."""


def discover(
    observed: Observed,
    axes: tuple[str, ...],
    *,
    source: str = "job",
    progress: Callable[[str], None] | None = None,
) -> Discovery:
    """Return which compensations the measurements of a machine ask for.

    Terms of every compensation and of what the controller has none for are fitted
    together to the error of each axis; those that come back in resamples, are large
    enough to be written and are not contained in others are named.

    Args:
        observed: All that was measured.
        axes: Names of all axes of the machine.
        source: For messages.
        progress: Called with what goes on.

    Raises:
        DiscoverError: If there is no error and no current of any axis, or too little.
    """
    counts = {
        (channel, axis): int(np.isfinite(values[axis]).sum())
        for channel, values in (
            ("error", observed.error),
            ("current", observed.current),
        )
        for axis in axes
        if axis in values
    }
    if not any(counts.values()):
        expected = "an error or a current of at least one axis"
        raise DiscoverError(source, "no measured error and no current", expected)
    parts: list[Discovery] = []
    with one_blas_thread():
        for (channel, axis), count in counts.items():
            if channel == "error" and 0 < count < _LEAST:
                found = f"{count} readings of the error of {axis}"
                raise DiscoverError(source, found, f"at least {_LEAST}")
            if count and progress is not None:
                progress(f"examining the {channel} of {axis}")
            if count and channel == "error":
                parts.append(examine_axis(observed, axis, axes))
            elif count:
                parts.append(examine_drive(observed, axis))
    return Discovery(
        tuple(one for part in parts for one in part.axes),
        tuple(one for part in parts for one in part.found),
        tuple(one for part in parts for one in part.rejected),
        tuple(one for part in parts for one in part.unexplained),
        tuple(one for part in parts for one in part.drifts),
    )


def examine_drive(observed: Observed, axis: str) -> Discovery:
    """Return which laws of friction the current of an axis shows.

    Args:
        observed: All that was measured.
        axis: With a measured current.
    """
    rows = _moving_rows(observed, axis)
    if isinstance(rows, str):
        why = f"could not be looked for: {rows}"
        return Discovery((), rejected=(Rejected("friction", axis, (), None, why),))
    columns = Columns(view_of(observed, axis, rows, "current"), drifting=False)
    terms, slow = friction_terms(columns.view)
    evidence = evidence_of(columns, terms, _WORTH)
    terms.append(max(slow, key=lambda each: evidence((each,))))
    chosen = select_terms(columns, terms, _WORTH)
    current = columns.view.data.current[axis]
    size = float(np.sqrt(np.mean(current**2)))
    summary = AxisSummary(axis, "current", len(current), size, chosen.noise, "")
    parts = {term: chosen.part(term) for term in chosen.terms}
    law = [term for term in parts if term.facts.compensation == "friction"]
    whole = np.asarray(np.sum([parts[term] for term in law], axis=0))
    unexplained = list(_doubts(chosen, axis, bool(law), [*parts.values()], current))
    found = []
    if law and not unexplained:
        rms, share = _size(whole, current)
        sentence = (
            f"friction of {axis}: {', '.join(term.words for term in law)};"
            f" {rms:.3g} rms, {share:.0%} of the current."
        )
        found = [
            Found(
                "friction", axis, (), None, share, rms, chosen.stability_of(law), "", {},
                None, sentence,
            )
        ]  # fmt: skip
    for term, part in parts.items():
        if term.facts.why:
            rms, share = _size(part, current)
            text = term.start
            if term.kind is Kind.VISCOUS_WAY:
                text += _steeper(chosen, term, current)
            unexplained.append(
                Unexplained(
                    axis, term.words, (), rms, share, "", "the kernel cannot express this",
                    f"{text}: {term.facts.why}",
                )
            )  # fmt: skip
    nothing = Rejected("friction", axis, (), None, "nothing of it in the current")
    return Discovery(
        (summary,), tuple(found), () if law else (nothing,), tuple(unexplained)
    )


def _steeper(chosen: Selection, term: Term, current: Float[np.ndarray, " t"]) -> str:
    """Return by how much one direction is steeper, all laws of one column beside it."""
    blocks = [chosen.columns.of(each) for each in chosen.terms]
    own = chosen.columns.of(term)
    laws = [block for block in blocks if block.shape[1] == 1 and block is not own]
    fit = regress(np.hstack([own, *laws, np.ones((len(own), 1))]), current, quick=True)
    size = float(np.sqrt(np.mean(chosen.view.data.velocity[term.axis] ** 2)))
    slope = float(fit.coefficients[0]) / size
    way = "forwards" if slope > 0 else "backwards"
    return f", steeper {way} by {2.0 * abs(slope):.3g} per unit of velocity"


def _moving_rows(observed: Observed, axis: str) -> Bool[np.ndarray, " t"] | str:
    """Return the rows in which a drive moves, or why there are none."""
    for channel in ("velocity", "acceleration", "position"):
        if axis not in getattr(observed, channel):
            return f"no {channel} of {axis} was recorded, nor time to derive it from"
    velocity = observed.velocity[axis]
    known = np.isfinite(observed.current[axis] + velocity)
    known &= np.isfinite(observed.acceleration[axis] + observed.position[axis])
    if not known.any():
        return f"current and motion of {axis} were never recorded together"
    rows = known & (np.abs(velocity) > _SLOW * np.max(np.abs(velocity[known])))
    if rows.sum() < _MOVING:
        return f"{axis} moves in {rows.sum()} readings of its current only"
    return np.asarray(rows)


def _size(
    part: Float[np.ndarray, " t"], whole: Float[np.ndarray, " t"]
) -> tuple[float, float]:
    """Return the rms of a part of the current, and its share of the mean square."""
    share = float(np.mean(part * whole)) / (float(np.mean(whole**2)) or 1.0)
    return float(np.sqrt(np.mean(part**2))), float(np.clip(share, 0.0, 1.0))


def _doubts(
    chosen: Selection,
    axis: str,
    law: bool,
    parts: Sequence[Float[np.ndarray, " t"]],
    current: Float[np.ndarray, " t"],
) -> Iterator[Unexplained]:
    """Yield what the motion cannot tell apart."""
    velocity = chosen.view.data.velocity[axis]
    speeds = np.abs(velocity)
    cruise = speeds[speeds > 0.5 * speeds.max()]
    sizes = [_size(part, current) for part in parts]
    rms, share = (max((each[k] for each in sizes), default=0.0) for k in (0, 1))
    one_speed = np.mean(speeds > 0.9 * speeds.max()) > 0.97
    if len(np.unique(np.sign(velocity))) < 2:
        what = f"friction or constant load of {axis}"
        why = "which moves in one direction only. Record both."
    elif law and one_speed and np.std(cruise) < _EVEN * np.mean(cruise):
        what = f"Coulomb or viscous friction of {axis}"
        why = f"which moves at {np.mean(cruise):.3g}/s only. Record other speeds too."
    else:
        return
    sentence = f"The data cannot tell: {what}, {why}"
    yield Unexplained(axis, what, (), rms, share, "", "the data cannot tell", sentence)
