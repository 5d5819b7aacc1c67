"""Which compensations a machine asks for, axis by axis."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from ..fit import one_blas_thread
from ._axis import AxisFindings, examine_axis
from ._drive import DriveFindings, examine_drive
from ._errors import DiscoverError
from ._observed import Observed
from ._result import Discovery

_LEAST = 20
"""Readings of an axis, below which nothing can be told from chance."""


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
        progress: Told what goes on.

    Raises:
        DiscoverError: If there is no error and no current of any axis, or too little.
    """
    tell = progress or (lambda _: None)
    errors = [axis for axis in axes if _readings(observed.error, axis)]
    currents = [axis for axis in axes if _readings(observed.current, axis)]
    if not errors and not currents:
        expected = "an error or a current of at least one axis"
        raise DiscoverError(source, "no measured error and no current", expected)
    parts: list[AxisFindings | DriveFindings] = []
    with one_blas_thread():
        for axis in errors:
            count = _readings(observed.error, axis)
            if count < _LEAST:
                found = f"{count} readings of the error of {axis}"
                raise DiscoverError(source, found, f"at least {_LEAST}")
            tell(f"examining the error of {axis}")
            parts.append(examine_axis(observed, axis, axes))
        for axis in currents:
            tell(f"examining the current of {axis}")
            parts.append(examine_drive(observed, axis))
    return Discovery(
        tuple(part.summary for part in parts if part.summary is not None),
        tuple(one for part in parts for one in part.found),
        tuple(one for part in parts for one in part.rejected),
        tuple(one for part in parts for one in part.unexplained),
        tuple(
            one
            for part in parts
            if isinstance(part, AxisFindings)
            for one in part.drifts
        ),
    )


def _readings(channel: Mapping[str, Float[np.ndarray, " t"]], axis: str) -> int:
    values = channel.get(axis)
    return 0 if values is None else int(np.isfinite(values).sum())
