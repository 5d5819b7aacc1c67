"""Robust regression on few columns.

For curves (thermal line, backlash, acceleration events) what the fit of a table is for tables:
`iterate` is the robust loop (residuals at a value → loss → pseudo-readings → solve), the
singular values of the design decide what the readings determine, and the covariance is that of
the estimate under residuals that drift (`_drift`).
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ._drift import DriftNoise, find_drift, scatter_of_sums
from ._errors import FitError
from ._loss import choose_loss

_PASSES = 60
"""Robust passes at most."""
TIGHT, LOOSE = 1e-3, 1e-2
"""Last move of any fitted value, in scales, at which the robust passes end."""
_FREE_PASSES = 20
"""Passes after which a reading that was rejected once stays out."""
_MAGNITUDES = 10
"""Passes of least magnitudes, which only begin."""
SINGULAR = 1e-9
"""Size of a combination of scaled columns, in that of the largest, from which on it is 0."""
_EXACT = 1e-6
"""Smallest scatter relative to the spread of the readings."""
_MEMBER = 0.3
"""Share of a column in a direction without information from which it is named."""
_LEAST_FREE = 3.0
"""Independent readings that are granted to a drift, however slow."""
_BELIEF = 2.0
"""Readings that a scatter known beforehand counts for."""


@dataclasses.dataclass(frozen=True)
class Regression:
    """A fitted model; from the robust passes alone its covariance is 0.

    Attributes:
        coefficients: One per column, then one per non-linear parameter; 0 where undetermined.
        noise: How the residuals scatter, wild ones left out.
        residual: Reading − fit per row.
        pseudo: Pseudo-residuals that led to the coefficients, 0 where wild.
        share: Weight that the loss left each reading, 0 to 1.
        wild: Readings that the loss rejected outright.
        converged: Whether the robust passes converged.
        covariance: Of the coefficients, drift of the residuals counted in; infinite on the
            diagonal where undetermined.
        independent: Number of independent readings of the same total scatter that would leave
            the same uncertainty, per coefficient; the rows kept where nothing drifts.
        undetermined: Coefficients that the readings that were kept do not determine.
    """

    coefficients: Float[np.ndarray, " k"]
    noise: DriftNoise
    residual: Float[np.ndarray, " t"]
    pseudo: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    converged: bool
    covariance: Float[np.ndarray, "k k"]
    independent: Float[np.ndarray, " k"]
    undetermined: Bool[np.ndarray, " k"]

    @property
    def standard_deviation(self) -> Float[np.ndarray, " k"]:
        """Of the coefficients; infinite where undetermined."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def iterate(
    start: Float[np.ndarray, " p"],
    residual_at: Callable[[np.ndarray], np.ndarray],
    solve: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    known: Float[np.ndarray, " t"],
    size: int,
    floor: float,
    loss: str = "student",
    tolerance: float = TIGHT,
) -> Regression:
    """Return where the robust passes end: coefficients, residuals and weights.

    Args:
        start: Where to begin.
        residual_at: Reading − fit at a value.
        solve: Least squares from a value, its pseudo-residuals and which readings are out.
        known: Weights of the readings.
        size: Number of parameters.
        floor: Smallest scale to believe in.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        tolerance: Move in scales at which the passes end.

    Raises:
        FitError: If the loss rejects all but as many readings as there are parameters.
    """
    count, root = len(known), np.sqrt(known)
    inflation = float(np.sqrt(count / max(count - size, 1)))
    out = np.zeros(count, bool)
    value, residual = start, residual_at(start)
    step = 0
    while True:
        step += 1
        chosen = choose_loss(loss, residual * root, inflation, floor)
        ratio = residual * root / chosen.scale
        wild = chosen.wild(ratio) | out
        good = int((~wild).sum())
        if wild.any() and good <= size:
            msg = "the readings that agree with each other are too few to fit."
            raise FitError(msg)
        slope = np.where(wild, 0.0, chosen.slope(ratio))
        steepness = max(float(slope.sum()) / max(good, 1), 0.1)
        pseudo = np.where(wild, 0.0, residual * chosen.share(ratio) / steepness)
        value = solve(value, pseudo, wild)
        before, residual = residual, residual_at(value)
        move = float(np.abs((residual - before) * root).max())
        still = move <= tolerance * chosen.scale or (loss == "gauss" and step > 1)
        if still or step == _PASSES:
            return Regression(
                coefficients=value,
                noise=DriftNoise(chosen.scale),
                residual=residual,
                pseudo=pseudo,
                share=np.where(wild, 0.0, chosen.share(residual * root / chosen.scale)),
                wild=wild,
                converged=still,
                covariance=np.zeros((len(value), len(value))),
                independent=np.full(len(value), float(count)),
                undetermined=np.zeros(len(value), bool),
            )
        if step > _FREE_PASSES:
            # Readings at the very edge must not let the passes go round in circles.
            out = wild


def regress(
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    *,
    time: Float[np.ndarray, " t"] | None = None,
    weight: Float[np.ndarray, " t"] | None = None,
    names: Sequence[str] = (),
    loss: str = "student",
    quick: bool = False,
    noise: float | None = None,
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
        quick: Coefficients only: covariance and drift are left out (hold-out folds).
        noise: Scatter of a reading of weight 1 as it is known beforehand, of readings that are
            independent: counts as two readings, lets as many unknowns be fitted as there are
            readings, and columns that cannot be separated are undetermined, not refused.

    Raises:
        FitError: If the columns cannot be separated or there are too few readings.
    """
    count, size = columns.shape
    known = np.ones(count) if weight is None else np.asarray(weight, float)
    root = np.sqrt(known)
    scale = np.sqrt(np.square(columns * root[:, None]).sum(axis=0))
    design = columns / np.where(scale > 0, scale, 1.0)
    scale = np.where(scale > 0, scale, 1.0)
    if noise is not None:
        size = _spectrum(design * root[:, None])[0].shape[1]
    if count < size or (count == size and noise is None):
        msg = f"{count} readings for {size} unknowns, expected more than {size}."
        raise FitError(msg)
    if noise is None:
        refuse_confounded(columns * root[:, None], names)
    inverses: dict[bytes, Float[np.ndarray, "k k"]] = {}

    def solve(
        value: Float[np.ndarray, " k"],
        pseudo: Float[np.ndarray, " t"],
        wild: Bool[np.ndarray, " t"],
    ) -> Float[np.ndarray, " k"]:
        kept, readings = known * ~wild, wild.tobytes()
        if readings not in inverses:
            inverses.clear()
            seen, _ = _spectrum(np.sqrt(kept)[:, None] * design)
            inverses[readings] = seen @ seen.T
        return np.asarray(value + inverses[readings] @ (design.T @ (kept * pseudo)))

    found = iterate(
        _least_magnitudes(design * root[:, None], target * root, loss),
        lambda value: target - design @ value,
        solve,
        known,
        size,
        least_scale(target, noise),
        loss,
        LOOSE if quick else TIGHT,
    )
    found = dataclasses.replace(found, coefficients=found.coefficients / scale)
    if quick:
        return found
    return with_covariance(found, design, scale, known, time, noise)


def with_covariance(
    result: Regression,
    design: Float[np.ndarray, "t k"],
    scale: Float[np.ndarray, " k"],
    known: Float[np.ndarray, " t"],
    time: Float[np.ndarray, " t"] | None,
    belief: float | None = None,
) -> Regression:
    """Return the result with covariance, drift and what is not determined."""
    rows = ~result.wild
    clock = np.arange(len(rows), dtype=float) if time is None else np.asarray(time)
    weight, part, pseudo = known[rows], design[rows], result.pseudo[rows]
    seen, unseen = _spectrum(np.sqrt(weight)[:, None] * part)
    lacking = (np.abs(unseen) > SINGULAR**0.5).any(axis=1)
    # The likelihood needs as many columns as the readings see.
    own = part @ seen
    if belief is None:
        noise = find_drift(clock[rows], own, pseudo, weight)
    else:
        # Known beforehand: counts as a few readings.
        square = float((weight * pseudo**2).sum()) + _BELIEF * belief**2
        free = float(rows.sum() - own.shape[1]) + _BELIEF
        noise = DriftNoise(float(np.sqrt(square / max(free, 1.0))))
    inverse = seen @ seen.T
    scatter = scatter_of_sums(noise, clock[rows], part, weight)
    covariance = inverse @ scatter @ inverse / np.outer(scale, scale)
    plain = (noise.white**2 + noise.drift**2) * np.diag(inverse) / scale**2
    swell = np.diag(covariance) / np.maximum(plain, 1e-300)
    independent = float(rows.sum()) / np.maximum(swell, 1.0)
    if noise.drift > 0:
        # The variances themselves rest on as many readings: the variance of Student's t.
        free = np.maximum(independent, _LEAST_FREE)
        heavy = np.sqrt(free / (free - 2.0))
        covariance = covariance * np.outer(heavy, heavy)
    covariance[lacking, :] = covariance[:, lacking] = 0.0
    covariance[lacking, lacking] = np.inf
    return dataclasses.replace(
        result,
        coefficients=np.where(lacking, 0.0, result.coefficients),
        covariance=covariance,
        noise=noise,
        independent=np.where(lacking, 0.0, independent),
        undetermined=lacking,
    )


def _spectrum(
    design: Float[np.ndarray, "t k"],
) -> tuple[Float[np.ndarray, "k r"], Float[np.ndarray, "k n"]]:
    """Return combinations of columns of about length 1: those that the readings see, and others.

    The first make orthonormal columns: their products with themselves are the inverse of the
    normal matrix, 0 for what the readings do not see.
    """
    size = design.shape[1]
    _, values, right = np.linalg.svd(np.linalg.qr(design, mode="r"))
    values = np.append(values, np.zeros(size - len(values)))
    seen = values > SINGULAR * max(float(values[0]), 1e-300)
    return right[seen].T / values[seen], right[~seen].T


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
    _, null = _spectrum(columns / scale)
    if not null.shape[1]:
        return
    weak = np.abs(null[:, 0])
    members = [called[k] for k in np.flatnonzero(weak > _MEMBER * weak.max())]
    msg = f"the readings cannot tell apart {', '.join(members)}."
    raise FitError(msg)


def _least_magnitudes(
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


def least_scale(target: Float[np.ndarray, " t"], noise: float | None = None) -> float:
    """Return the smallest scale of residuals to believe in."""
    spread = float(np.ptp(np.quantile(target, (0.05, 0.95))))
    floor = max(_EXACT * spread, 1e-12, 0.1 * (noise or 0.0))
    different = np.unique(target)
    if 1 < len(different) < 0.3 * len(target):
        # A coarse instrument repeats itself; that is no proof of its accuracy.
        floor = max(floor, float(np.median(np.diff(different))) / np.sqrt(12.0))
    return floor
