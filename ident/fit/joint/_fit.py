"""The joint estimator: readings of several axes in, all effects with uncertainty out."""

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...core import FitError, cores, one_blas_thread
from .._table import TOO_MANY
from ._axis import AxisFit, fit_axis
from ._design import design_of
from ._effect import AbstractEffect
from ._gauge import Unheld
from ._identified import Identified, identified
from ._result import (
    Identifiability,
    JointFit,
    Options,
    Smoothness,
)
from ._words import confusions_of, gauges_of


def fit_joint(
    data: JointData,
    effects: Sequence[AbstractEffect],
    *,
    loss: str = "student",
    smoothness: Smoothness = "auto",
    drift: int = 0,
    use: Bool[np.ndarray, " t"] | None = None,
) -> JointFit:
    r"""Fit any stack of effects on one or several axes together.

    Per compensated axis $e = d + \sum_k X_k \theta_k + \text{run} + \varepsilon$ with a
    constant $d$ (the datum): tables as Gaussian fields as in `fit_table`, all smoothness
    weights by the evidence of all effects together, robust by pseudo-readings. What may be
    moved between effects without changing the sum is fixed by rules that do not depend on the
    errors (`JointFit.gauges`); what the data cannot tell is marked (`JointFit.confusions`), its
    standard deviations are infinite, and the rest is as good as ever.

    Args:
        data: Readings; rows that lack what an axis needs are left out for that axis.
        effects: What to fit; each at most once.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` is least squares.
        smoothness: ``"auto"``: by evidence; a number: weight of the squared second
            differences of all tables, relative to 1/noise²; or the weights of an earlier fit by
            name of the effect (`Part.smoothness`).
        drift: Pieces of the drift of each run; 0 = an offset per run only, and that only
            where there are several runs. Between the knots of these pieces the reference
            wanders as far as the readings say, by evidence: a walk of one variance per second.
        use: Rows to fit; None = all. The others serve as history of lags only.

    Raises:
        FitError: If an input is missing, or the readings do not determine the effects.
    """
    placed = [effect.placed(data) for effect in effects]
    return _fit(data, placed, Options(loss, smoothness, drift), use, {})


def refit_joint(
    fit: JointFit, data: JointData, *, use: Bool[np.ndarray, " t"] | None = None
) -> JointFit:
    """Fit the same effects again to some of the rows: folds of a hold-out.

    Smoothness, lags, loss and drift are those of ``fit``; noise and values are estimated anew.
    What the readings tell, gauges and rules are taken over.

    Args:
        fit: Of all rows, by `fit_joint`.
        data: Its readings.
        use: Rows to fit now; None = all.

    Raises:
        FitError: If these rows do not determine the effects.
    """
    known = {axis: own.known for axis, own in fit.fits.items()}
    return _fit(data, [part.effect for part in fit.parts], fit.options, use, known)


def held_out_errors(
    fit: JointFit, data: JointData, groups: Int[np.ndarray, " t"], *, runs: bool = False
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return each error less the sum that is fitted without its group, by axis in mm or °.

    Fitted by `refit_joint`. Where the readings of the other groups do not determine the
    effects, their median is all that they predict.

    Args:
        fit: Of all rows, by `fit_joint`.
        data: Its readings.
        groups: What is left out together: the run, or the block of each row.
        runs: As for `JointFit.predict`.
    """
    result = {axis: np.full(len(data), np.nan) for axis in fit.axes}
    for group in np.unique(groups):
        out = groups == group
        try:
            predicted = refit_joint(fit, data, use=~out).predict(data, runs=runs)
        except FitError:
            known = {axis: data.error[axis][~out] for axis in fit.axes}
            known = {axis: error[np.isfinite(error)] for axis, error in known.items()}
            predicted = {
                axis: np.full(len(data), np.median(error) if error.size else 0.0)
                for axis, error in known.items()
            }
        for axis, left in result.items():
            left[out] = (data.error[axis] - predicted[axis])[out]
    return result


def examine_design(
    data: JointData,
    effects: Sequence[AbstractEffect],
    *,
    drift: int = 0,
    use: Bool[np.ndarray, " t"] | None = None,
) -> Identifiability:
    """Return what these rows can tell of effects, whatever was or will be measured.

    Looks at positions, directions, accelerations, temperatures, times and runs only. Of the
    errors it uses where there are any (rows without are left out); with no error of an axis
    recorded at all, every row counts: a planned measurement can be examined.

    Args:
        data: Rows, measured or planned.
        effects: What is to be fitted.
        drift: Pieces of the drift of each run, as for `fit_joint`.
        use: Rows that may be used; None = all.

    Raises:
        FitError: If an input is missing or no row is complete.
    """
    placed = [effect.placed(data) for effect in effects]
    with one_blas_thread():
        axes = [
            identified(design, Unheld.of(design), data, drift)
            for axis, own in _by_axis(placed).items()
            for design in [design_of(axis, own, data, drift, use, axis in data.error)]
        ]
        gauges = tuple(gauge for known in axes for gauge in gauges_of(known))
    share = {
        effect.name: known.share_of(effect.name)
        for known in axes
        for effect in known.design.effects
    }
    return Identifiability(
        tuple(share[effect.name] for effect in placed),
        gauges,
        tuple(each for known in axes for each in confusions_of(known)),
    )


def _by_axis(effects: Sequence[AbstractEffect]) -> dict[str, list[AbstractEffect]]:
    """Return the effects of each compensated axis.

    Raises:
        FitError: If there is none, or the same one twice.
    """
    if not effects:
        msg = "found no effects, expected one at least."
        raise FitError(msg)
    result: dict[str, list[AbstractEffect]] = {}
    names: set[str] = set()
    for effect in effects:
        if effect.name in names:
            msg = f"found the {effect.name} twice, expected each effect once."
            raise FitError(msg)
        names.add(effect.name)
        result.setdefault(effect.axis, []).append(effect)
    return result


def _fit(
    data: JointData,
    placed: Sequence[AbstractEffect],
    options: Options,
    use: Bool[np.ndarray, " t"] | None,
    like: Mapping[str, Identified],
) -> JointFit:
    groups = _by_axis(placed)

    def one(axis: str) -> AxisFit:
        found = fit_axis(axis, groups[axis], data, options, use, like.get(axis))
        wild = float((~found.active).mean())
        if options.loss == "student" and wild > TOO_MANY:
            # So many that agree with each other: not they are at fault.
            mild = dataclasses.replace(options, loss="huber")
            return fit_axis(axis, groups[axis], data, mild, use, like.get(axis))
        return found

    with one_blas_thread():
        # Axes share no unknowns; their matrix products leave the interpreter free. The
        # largest first, so that none is left alone at the end.
        size = {axis: sum(each.size for each in own) for axis, own in groups.items()}
        order = sorted(groups, key=lambda axis: -size[axis])
        with ThreadPoolExecutor(min(len(groups), cores())) as pool:
            found = dict(zip(order, pool.map(one, order), strict=True))
        fits = {axis: found[axis] for axis in groups}
        parts = {part.name: part for fit in fits.values() for part in fit.parts()}
        known = {axis: fit.known for axis, fit in fits.items()}
        runs = {axis: fit.runs() for axis, fit in fits.items()}
        gauges = tuple(each for own in known.values() for each in gauges_of(own))
    weights = {k: own for fit in fits.values() for k, own in fit.smoothness().items()}
    messages = [
        (f"Axis {axis}: " if len(fits) > 1 else "")
        + fit.estimate.message(len(fit.left))
        for axis, fit in fits.items()
    ]
    return JointFit(
        parts=tuple(parts[effect.name] for effect in placed),
        noise={axis: fit.estimate.noise for axis, fit in fits.items()},
        residual={a: fit.over_rows(fit.left, np.nan) for a, fit in fits.items()},
        share={axis: fit.over_rows(fit.share, 0.0) for axis, fit in fits.items()},
        wild={axis: fit.over_rows(~fit.active, False) for axis, fit in fits.items()},
        runs=runs,
        run_curves={axis: fit.curves() for axis, fit in fits.items()},
        gauges=gauges,
        confusions=tuple(each for own in known.values() for each in confusions_of(own)),
        converged=all(fit.estimate.converged for fit in fits.values()),
        message=" ".join(messages),
        fits=fits,
        options=dataclasses.replace(options, smoothness=weights),
    )
