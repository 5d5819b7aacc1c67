"""Friction from constant speeds: plateau averages with their errors, fitted by weight."""

import dataclasses

import numpy as np

from ...core._errors import FitError
from ._inverse import fit_problem
from ._plateaus import Plateaus
from ._problem import Known, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples
from ._structure import AbstractStructure
from ._structures import Stribeck

_FLOOR = 1e-3
"""Least standard deviation of a plateau relative to the median one: none decides alone."""


def fit_static(
    plateaus: Plateaus,
    structure: AbstractStructure | None = None,
    *,
    known: Known | None = None,
    smoothness: float | None = None,
) -> FrictionFit:
    """Fit a friction law to averages over constant speeds, each weighed by its own error.

    Plateaus scatter by more than their own noise (position, temperature): where the law
    leaves more than the errors say, standard deviations grow with it; they never shrink.

    Args:
        plateaus: Averages per plateau.
        structure: Kind of law; Stribeck with exponent 2 where left out.
        known: Gain, and the offset where it need not be fitted.
        smoothness: As for `fit_inverse`.

    Raises:
        FitError: If there are fewer plateaus than parameters, or their errors are unknown.
    """
    spread = plateaus.standard_deviation
    if not np.isfinite(spread).all() or (spread < 0).any():
        msg = "plateaus: standard deviations must be numbers >= 0."
        raise FitError(msg)
    structure = Stribeck() if structure is None else structure
    known = Known() if known is None else known
    typical = float(np.median(spread))
    if typical == 0:
        typical = 1e-6 * float(np.abs(plateaus.current).max())
    spread = np.maximum(spread, _FLOOR * typical)
    samples = DriveSamples(
        time=np.arange(float(len(spread))),
        velocity=plateaus.velocity,
        current=plateaus.current,
        moving=plateaus.velocity != 0,
    )
    problem = dataclasses.replace(
        make_problem(samples, structure, known, 1),
        sigma=spread / typical,
        least_noise=abs(known.gain) * typical,
    )
    fit = fit_problem(problem, "gauss", smoothness, "static fit to plateaus")
    ahead = int((plateaus.velocity > 0).sum())
    back = int((plateaus.velocity < 0).sum())
    remark = f"{ahead} plateaus in positive and {back} in negative direction."
    return dataclasses.replace(fit, remarks=(*fit.remarks, remark))
