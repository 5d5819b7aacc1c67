"""The joint estimator: readings of several axes in, all effects with uncertainty out."""

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, Float

from ...core._threads import cores, one_blas_thread
from ._axis import AxisFit, Smoothness, fit_axis, weights_by_name
from ._data import JointData
from ._effect import AbstractEffect
from ._prepare import Prepared, by_axis
from ._report import curves_of, part_of, report_of
from ._result import AbstractAlignment, JointFit, Part

_TOO_MANY = 0.1
"""Share of wild readings from which on not the readings are at fault but the effects."""


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
    return _fit(data, placed, _Options(loss, smoothness, drift), use, {})


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
    align = fit.align
    assert isinstance(align, Alignment)
    options = dataclasses.replace(align.options, smoothness=align.smoothness)
    return _fit(data, [part.effect for part in fit.parts], options, use, align.axes)


@dataclasses.dataclass(frozen=True)
class _Options:
    """How to fit."""

    loss: str
    smoothness: Smoothness
    drift: int


def _fit(
    data: JointData,
    placed: Sequence[AbstractEffect],
    options: _Options,
    use: Bool[np.ndarray, " t"] | None,
    like: Mapping[str, Prepared],
) -> JointFit:
    groups = by_axis(placed)

    def one(axis: str) -> AxisFit:
        own = [placed[number] for number in groups[axis]]

        def with_loss(loss: str) -> AxisFit:
            return fit_axis(
                axis,
                own,
                data,
                loss=loss,
                smoothness=options.smoothness,
                drift=options.drift,
                use=use,
                like=like.get(axis),
            )

        found = with_loss(options.loss)
        wild = float((~found.active).mean())
        if options.loss == "student" and wild > _TOO_MANY:
            # So many that agree with each other: not they are at fault.
            return with_loss("huber")
        return found

    with one_blas_thread():
        # Axes share no unknowns; their matrix products leave the interpreter free.
        workers = max(min(len(groups), cores()), 1)
        # The largest first, so that none is left alone at the end.
        size = {a: sum(placed[n].size for n in groups[a]) for a in groups}
        order = sorted(groups, key=lambda axis: -size[axis])
        with ThreadPoolExecutor(workers) as pool:
            found = dict(zip(order, pool.map(one, order), strict=True))
        fits = {axis: found[axis] for axis in groups}
        return _result(data, groups, fits, options)


@dataclasses.dataclass(frozen=True)
class Alignment(AbstractAlignment):
    """The rules of all axes.

    Attributes:
        groups: Numbers of the effects of each axis.
        axes: Columns and rules of each axis.
        options: Of the fit.
        smoothness: Weights of each table and of the drift, by name.
    """

    groups: Mapping[str, Sequence[int]]
    axes: Mapping[str, Prepared]
    options: _Options
    smoothness: Mapping[str, Mapping[str, float]]

    def moved(
        self, values: Sequence[Float[np.ndarray, " _p"]], datum: Mapping[str, float]
    ) -> tuple[list[Float[np.ndarray, " _p"]], dict[str, float]]:
        """See `AbstractAlignment`."""
        result = [np.asarray(each, float) for each in values]
        constants = {}
        for axis, ready in self.axes.items():
            design = ready.design
            theta = np.zeros(design.size)
            theta[design.datum] = datum.get(axis, 0.0)
            for place, number in enumerate(self.groups[axis]):
                theta[design.places_of(place)] = result[number]
            theta = ready.rules.project(theta)
            constants[axis] = float(theta[design.datum])
            for place, number in enumerate(self.groups[axis]):
                result[number] = theta[design.places_of(place)]
        return result, constants


def _result(
    data: JointData,
    groups: Mapping[str, Sequence[int]],
    fits: Mapping[str, AxisFit],
    options: _Options,
) -> JointFit:
    parts: dict[int, Part] = {}
    reports = {axis: report_of(data, fit) for axis, fit in fits.items()}
    for axis, fit in fits.items():
        for place, number in enumerate(groups[axis]):
            parts[number] = part_of(data, fit, reports[axis], place)
    messages = [
        f"Axis {axis}: {report.message}" if len(fits) > 1 else report.message
        for axis, report in reports.items()
    ]
    return JointFit(
        parts=tuple(parts[number] for number in sorted(parts)),
        datum={axis: report.datum for axis, report in reports.items()},
        noise={axis: report.noise for axis, report in reports.items()},
        residual={axis: report.residual for axis, report in reports.items()},
        share={axis: report.share for axis, report in reports.items()},
        wild={axis: report.wild for axis, report in reports.items()},
        runs={axis: report.runs for axis, report in reports.items()},
        run_curves={axis: curves_of(fit) for axis, fit in fits.items()},
        gauges=tuple(each for fit in fits.values() for each in fit.ready.gauges),
        confusions=tuple(
            each for fit in fits.values() for each in fit.ready.confusions
        ),
        converged=all(fit.settled for fit in fits.values()),
        message=" ".join(messages),
        align=Alignment(
            groups,
            {axis: fit.ready for axis, fit in fits.items()},
            options,
            {
                name: each
                for fit in fits.values()
                for name, each in weights_by_name(fit).items()
            },
        ),
    )
