"""Linear fits of few columns: robust, with standard deviations that know of drift.

For curves (thermal line, backlash, acceleration events) what `fit_table` is for tables: wild
readings are set aside by the same losses, and the covariance is that of the estimate under
residuals that remember (`_drift`).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ._drift import DriftNoise, find_drift, scatter_of_sums
from ._errors import FitError
from ._loss import Loss, choose_loss

_PASSES = 60
"""Robust passes at most."""
_SETTLED, _ROUGHLY = 1e-3, 1e-2
"""Last move of any fitted value, in scales, at which the robust passes end."""
_MAGNITUDES = 10
"""Passes of least magnitudes, which only begin."""
_EXACT = 1e-6
"""Smallest scatter relative to the spread of the readings."""
_SINGULAR = 1e-9
"""Singular value of scaled columns below which they do not tell each other apart."""
_MEMBER = 0.3
"""Share of a column in a direction without information from which it is named."""
_LEAST_FREE = 3.0
"""Independent readings that are granted to a drift, however slow."""


@dataclasses.dataclass(frozen=True)
class Regression:
    """A fitted linear model.

    Attributes:
        coefficients: One per column.
        covariance: Of the coefficients, drift of the residuals counted in.
        noise: How the residuals scatter, wild ones left out.
        residual: Reading − fit per row.
        share: Weight that the loss left each reading, 0 to 1.
        wild: Readings that the loss rejected outright.
        independent: Number of independent readings of the same total scatter that would leave
            the same uncertainty, per coefficient; the rows kept where nothing drifts.
        converged: Whether the robust passes settled.
    """

    coefficients: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]
    noise: DriftNoise
    residual: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    independent: Float[np.ndarray, " k"]
    converged: bool

    @property
    def standard_deviation(self) -> Float[np.ndarray, " k"]:
        """Of the coefficients."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def regress(
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    *,
    time: Float[np.ndarray, " t"] | None = None,
    weight: Float[np.ndarray, " t"] | None = None,
    names: Sequence[str] = (),
    loss: str = "student",
    drifting: bool = True,
    quick: bool = False,
) -> Regression:
    r"""Return the factors of columns that explain readings.

    M-estimate through pseudo-readings; covariance $A^{-1} X^T W \Sigma W X A^{-1}$ with
    $A = X^T W X$ and the $\Sigma$ of `DriftNoise`, fitted to the pseudo-residuals. The estimate
    itself does not lean on the drift model, only its standard deviation does.

    Args:
        columns: Known functions per reading.
        target: Readings.
        time: Of each reading; None = in the order of the rows, one per unit.
        weight: Known relative weights (1/variance ratio), or None.
        names: Of the columns, for messages.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        drifting: Look for drift in the residuals; false where readings are independent.
        quick: Coefficients only: covariance and drift are left out (hold-out folds).

    Raises:
        FitError: If the columns cannot be told apart or there are too few readings.
    """
    count, size = columns.shape
    known = np.ones(count) if weight is None else np.asarray(weight, float)
    if count <= size:
        msg = f"{count} readings for {size} unknowns, expected more than {size}."
        raise FitError(msg)
    scale = np.sqrt((known[:, None] * columns**2).sum(axis=0))
    refuse_confounded(columns * np.sqrt(known)[:, None], names)
    design = columns / scale
    settled = _ROUGHLY if quick else _SETTLED
    last, converged = _robust(design, target, known, loss, settled)
    residual = target - design @ last.value
    ratio = residual * np.sqrt(known) / last.loss.scale
    result = Regression(
        coefficients=last.value / scale,
        covariance=np.zeros((size, size)),
        noise=DriftNoise(last.loss.scale),
        residual=residual,
        share=np.where(last.wild, 0.0, last.loss.share(ratio)),
        wild=last.wild,
        independent=np.full(size, float(count)),
        converged=converged,
    )
    if quick:
        return result
    rows = ~last.wild
    clock = np.arange(count, dtype=float) if time is None else np.asarray(time, float)
    parts = (clock[rows], design[rows], last.pseudo[rows], known[rows])
    noise = find_drift(*parts) if drifting else _white(*parts[1:])
    inverse = np.linalg.inv(last.normal)
    scatter = scatter_of_sums(noise, clock[rows], design[rows], known[rows])
    covariance = inverse @ scatter @ inverse / np.outer(scale, scale)
    plain = (noise.white**2 + noise.drift**2) * np.diag(inverse) / scale**2
    swell = np.diag(covariance) / np.maximum(plain, 1e-300)
    independent = float(rows.sum()) / np.maximum(swell, 1.0)
    if noise.drift > 0:
        # The variances themselves rest on as many readings: the variance of Student's t.
        free = np.maximum(independent, _LEAST_FREE)
        heavy = np.sqrt(free / (free - 2.0))
        covariance = covariance * np.outer(heavy, heavy)
    return dataclasses.replace(
        result, covariance=covariance, noise=noise, independent=independent
    )


@dataclasses.dataclass(frozen=True)
class _Pass:
    """Where the robust passes stand."""

    value: Float[np.ndarray, " k"]
    loss: Loss
    wild: Bool[np.ndarray, " t"]
    pseudo: Float[np.ndarray, " t"]
    normal: Float[np.ndarray, "k k"]
    move: float


def _robust(
    design: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    known: Float[np.ndarray, " t"],
    loss: str,
    settled: float,
) -> tuple[_Pass, bool]:
    """Return the last robust pass, and whether the passes settled."""
    root, floor = np.sqrt(known), _floor(target)
    none = np.zeros(len(target), bool)
    value = _start(design * root[:, None], target * root, loss)
    current = _pass(design, target, known, loss, floor, value, none)
    for step in range(1, _PASSES):
        if current.move <= settled * current.loss.scale or loss == "gauss":
            return current, True
        # Readings at the very edge must not let the passes go round in circles.
        out = current.wild if step > 20 else none
        current = _pass(design, target, known, loss, floor, current.value, out)
    return current, False


def _pass(
    design: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    known: Float[np.ndarray, " t"],
    loss: str,
    floor: float,
    value: Float[np.ndarray, " k"],
    out: Bool[np.ndarray, " t"],
) -> _Pass:
    """Return one step from ``value``: pseudo-readings, then least squares on them."""
    count, size = design.shape
    root = np.sqrt(known)
    residual = target - design @ value
    inflation = float(np.sqrt(count / (count - size)))
    chosen = choose_loss(loss, residual * root, inflation, floor)
    ratio = residual * root / chosen.scale
    wild = chosen.wild(ratio) | out
    kept = known * ~wild
    slope = np.where(wild, 0.0, chosen.slope(ratio))
    steepness = max(float(slope.sum()) / max(int((~wild).sum()), 1), 0.1)
    pseudo = np.where(wild, 0.0, residual * chosen.share(ratio) / steepness)
    normal = design.T @ (kept[:, None] * design)
    if int((~wild).sum()) <= size or np.linalg.cond(normal) > _SINGULAR**-2:
        msg = "the readings that agree with each other are too few to fit."
        raise FitError(msg)
    move = np.linalg.solve(normal, design.T @ (kept * pseudo))
    largest = float(np.abs(design @ move * root).max())
    return _Pass(value + move, chosen, wild, pseudo, normal, largest)


def refuse_confounded(
    columns: Float[np.ndarray, "t k"], names: Sequence[str] = ()
) -> None:
    """Refuse columns that the readings cannot tell apart.

    Raises:
        FitError: Naming the columns between which a shift changes nothing.
    """
    scale = np.sqrt(np.square(columns).sum(axis=0))
    called = [
        names[k] if k < len(names) else f"column {k + 1}" for k in range(len(scale))
    ]
    for k in np.flatnonzero(scale == 0.0):
        msg = f"no reading tells {called[int(k)]}: it is 0 in all of them."
        raise FitError(msg)
    _, singular, vectors = np.linalg.svd(columns / scale, full_matrices=False)
    if singular[-1] > _SINGULAR * singular[0]:
        return
    weak = np.abs(vectors[-1])
    members = [called[k] for k in np.flatnonzero(weak > _MEMBER * weak.max())]
    msg = f"the readings cannot tell apart {', '.join(members)}."
    raise FitError(msg)


def _start(
    design: Float[np.ndarray, "t k"], target: Float[np.ndarray, " t"], loss: str
) -> Float[np.ndarray, " k"]:
    """Return least squares, or least magnitudes where wild readings are expected."""
    value = np.linalg.lstsq(design, target, rcond=None)[0]
    if loss == "gauss":
        return np.asarray(value)
    for _ in range(_MAGNITUDES):
        size = np.abs(target - design @ value)
        least = max(0.05 * float(np.median(size)), 1e-300)
        weighted = design / np.maximum(size, least)[:, None]
        value = np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0]
    return np.asarray(value)


def _floor(target: Float[np.ndarray, " t"]) -> float:
    """Return the smallest scale of residuals to believe in."""
    spread = float(np.ptp(np.quantile(target, (0.05, 0.95))))
    floor = max(_EXACT * spread, 1e-12)
    different = np.unique(target)
    if 1 < len(different) < 0.3 * len(target):
        # A coarse instrument repeats itself; that is no proof of its accuracy.
        floor = max(floor, float(np.median(np.diff(different))) / np.sqrt(12.0))
    return floor


def _white(
    design: Float[np.ndarray, "t k"],
    pseudo: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
) -> DriftNoise:
    free = max(len(pseudo) - design.shape[1], 1)
    return DriftNoise(float(np.sqrt((weight * pseudo**2).sum() / free)))
