"""Values of one gauge in another, so that a truth and a fit can be compared value by value."""

from collections.abc import Mapping, Sequence

import numpy as np

from axcomp.ident.fit.joint import JointFit


def in_gauge(
    fit: JointFit,
    values: Sequence[np.ndarray],
    datum: Mapping[str, float] | None = None,
) -> tuple[list[np.ndarray], dict[str, float]]:
    """Return other values of the same parts, moved to the gauge of a fit; the sum stays.

    Args:
        fit: Whose gauge.
        values: One array per part.
        datum: Constant of each axis in mm or °; 0 where not given.
    """
    result = [np.asarray(each, float) for each in values]
    constants = {}
    for axis, fitted in fit.fits.items():
        known = fitted.known
        design = known.design
        own = [k for k, part in enumerate(fit.parts) if part.effect.axis == axis]
        theta = np.zeros(design.size)
        theta[design.datum] = (datum or {}).get(axis, 0.0)
        for number in own:
            theta[fit.parts[number].places] = result[number]
        theta = known.rules.project(theta)
        constants[axis] = float(theta[design.datum])
        for number in own:
            result[number] = theta[fit.parts[number].places]
    return result, constants
