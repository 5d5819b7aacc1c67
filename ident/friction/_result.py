"""A fitted law: what the rows say of it, how far each number is known, and what is not told."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.signals import NORMAL, median
from ...models import AbstractFriction
from ..core import rooted
from ._equation import Equation
from ._samples import Trace
from ._structures import GAUSS, SUFFIXES, AbstractStructure, Shape, Stribeck
from ._weights import Rows, View, ridged

_ONE_WAY = "no motion in this direction was recorded"
_LEVEL = "only its sum with a constant load is seen"
_CONFUSED = "the motion does not tell it from the others"
_VAGUE_WORDS = "its share of the current is not told apart from the others'"
_VAGUE = 0.3
"""Standard deviation of a column's contribution, as a share of the load, that says nothing."""
_IN_NULL = 1e-3
"""Share of a parameter in a direction that no row tells, to be unknown with it."""
_LARGEST_LEVERAGE = 0.9
_LARGEST_LAG = 0.1
"""Longest lag as a share of the rows."""
_STRONGEST = 0.97
"""Autocorrelation that a first-order model is taken to have at most."""
_EXPONENTS = 0.5
"""Standard deviation of the logarithm of an exponent that is assumed: those of machines lie
between 0.5 and 2 and seldom beyond."""
OTHER = 3.0
"""Standard deviations by which an exponent must differ from the assumed to be another one."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class FrictionFit:
    """A fitted friction law with what is known about it.

    Attributes:
        equation: What was solved, by the kind of law that the data carry.
        state: Linear factors as fitted: inertia, offset, loads where fitted, then those of the
            law, before a gauge parts level and offset.
        shape: Logarithms of the law's non-linear parameters.
        rows: Derivatives of the load by ``state`` and ``shape``, and the load without what
            is known.
        share: Weight that each row had, 0 to 1.
        prior: Precision of ``state`` and ``shape`` by smoothness, relative to 1/noise².
        converged: Whether the search for the law's shape ended.
        at_bound: Which shapes ended at the edge of what the data could tell.
        missing: What the data do not carry of the law that was asked for: name → reason.
        method: How it was found, in words.
        given: The covariance, where it is not that of the rows.
        assumed: Whether the law's exponent was assumed where the rows ask for no other.
    """

    equation: Equation
    state: Float[np.ndarray, " n"]
    shape: Shape
    rows: Rows
    share: Float[np.ndarray, " s"]
    prior: Float[np.ndarray, "m m"]
    converged: bool
    at_bound: Bool[np.ndarray, " h"]
    missing: Mapping[str, str] = dataclasses.field(default_factory=dict)
    method: str = "inverse dynamic fit"
    given: Float[np.ndarray, "m m"] | None = None
    assumed: bool = False

    @property
    def structure(self) -> AbstractStructure:
        """Which kind of law."""
        return self.equation.structure

    @property
    def inertia(self) -> float | None:
        """In drive units per mm/s², where it was known."""
        return self.equation.recording.inertia

    @property
    def normal(self) -> Float[np.ndarray, "m m"]:
        """Normal matrix of ``state`` and ``shape``, without the prior."""
        return np.asarray(self.rows.sums[:, :-1])

    @cached_property
    def error(self) -> Float[np.ndarray, " s"]:
        """Load − fit of every row."""
        columns = self.rows.right[:, : len(self.state)]
        return np.asarray(self.rows.target - columns @ self.state)

    @property
    def residual(self) -> Trace:
        """Load − fit per row in motion, after filtering, in drive units."""
        return np.asarray(self.error[self.equation.recording.usable])

    @cached_property
    def noise(self) -> float:
        """Robust standard deviation of the residual."""
        residual, unknowns = self.residual, len(self.state) + len(self.shape)
        freedom = max(len(residual) - unknowns, 1)
        inflation = float(np.sqrt(len(residual) / freedom))
        return NORMAL * median(np.abs(residual)) * inflation

    @property
    def relative_error(self) -> float:
        """RMS of the residual over RMS of the load, over all rows in motion."""
        size = float(np.sqrt(np.mean(self.residual**2)))
        return size / self.equation.recording.load_size

    @property
    def count(self) -> int:
        """Rows that counted."""
        return int(np.count_nonzero(self.share))

    @property
    def message(self) -> str:
        """One sentence on how the fit went."""
        rows = int(self.equation.recording.usable.sum())
        return (
            f"{self.structure.words}: {'converged' if self.converged else 'did not converge'},"
            f" {rows - self.count} of {rows} samples rejected as wild."
        )

    @property
    def loads(self) -> tuple[float, float]:
        """Inertia in drive units per mm/s², fitted or known, and the constant load."""
        names, linear, _ = self.equation.reading
        values = dict(zip(names, linear @ self.state, strict=True))
        return values.get("inertia", self.inertia or 0.0), values["offset"]

    @cached_property
    def state_covariance(self) -> Float[np.ndarray, "m m"]:
        """Of ``state`` and ``shape`` together, directions without information left out.

        Neighbouring rows resemble each other (`score_covariance`); residuals are divided by
        1 − leverage (HC3: J. G. MacKinnon, H. White, J. Econometrics 29, 1985). A robust
        variance below that of independent noise is not believed.
        """
        if self.given is not None:
            return self.given
        rows, normal, prior = self.rows.left, self.normal, self.prior
        root, _ = rooted(normal + prior)
        inverse = root @ root.T
        leverage = np.einsum("sk,sk->s", rows @ inverse, self.rows.right)
        inflated = self.error / np.clip(1.0 - leverage, 1.0 - _LARGEST_LEVERAGE, 1.0)
        freedom = max(self.count - len(inverse), 1)
        noise = float((self.share * inflated) @ inflated) / freedom
        white = self.noise**2 * prior
        piece = self.equation.recording.piece
        inner = score_covariance(rows * inflated[:, None], piece)
        robust = inverse @ (inner + white) @ inverse
        independent = inverse @ (noise * normal + white) @ inverse
        stated, least = np.diag(robust), np.diag(independent)
        factor = np.sqrt(np.maximum(least / np.where(stated > 0, stated, np.inf), 1.0))
        return np.asarray(robust * np.outer(factor, factor))

    @cached_property
    def factors(self) -> Float[np.ndarray, " k"]:
        """Linear factors of the law, in the order of `AbstractStructure.names`."""
        return np.asarray(self.equation.reading[2] @ self.state)

    @property
    def law_covariance(self) -> Float[np.ndarray, "p p"]:
        """Of ``factors`` and ``shape``."""
        count, fixed = len(self.state), len(self.equation.fixed_names)
        law = np.eye(count + len(self.shape))[fixed:]
        law[: count - fixed, :count] = self.equation.reading[2]
        return np.asarray(law @ self.state_covariance @ law.T)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of all parameters, determined or not."""
        return (*self.equation.reading[0], *self.structure.shapes)

    @cached_property
    def _jacobian(self) -> Float[np.ndarray, "r m"]:
        """Derivatives of all parameters by ``state`` and ``shape``."""
        linear, count = self.equation.reading[1], len(self.state)
        result = np.zeros((len(self.names), count + len(self.shape)))
        result[: len(linear), :count] = linear
        result[len(linear) :, count:] = np.diag(np.exp(self.shape))
        return result

    @cached_property
    def _exponent(self) -> tuple[Float[np.ndarray, " m"], float, float]:
        """How ``state`` and ``shape`` follow an exponent that is none of `GAUSS`.

        And the step of its logarithm that the rows ask for, and the variance of this step.
        """
        free = self.equation.under(Stribeck(self.structure.directional))
        shape = np.append(self.shape, np.log(GAUSS))
        column = free.slopes(shape, self.state)[:, -1:]
        rows = View(free, self.share, shape).rows(np.hstack([self.rows.right, column]))
        inverse = ridged(rows.sums[:, :-1], np.eye(rows.right.shape[1])[-1])
        steps = rows.left @ inverse * self.error  # what each row adds
        variance = score_covariance(steps[:, None], self.equation.recording.piece)[0, 0]
        return inverse[:-1] / inverse[-1], float(steps.sum()), float(variance)

    @property
    def asks_for_exponent(self) -> bool:
        """Whether the rows ask for an exponent other than the assumed one (score test)."""
        _, step, variance = self._exponent
        return step**2 > OTHER**2 * variance

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Those determined or known, by name, in drive units over mm/s and mm/s²."""
        values = [*self.equation.reading[1] @ self.state, *np.exp(self.shape)]
        known = {} if self.inertia is None else {"inertia": self.inertia}
        return self._determined(values) | known

    @cached_property
    def standard_deviations(self) -> dict[str, float]:
        """Of the same."""
        inner = self.state_covariance
        if self.assumed and self.given is None:
            # An exponent is as uncertain as `_EXPONENTS`, or as far off as it may be without
            # being asked for where that is less; the others follow it as in a fit.
            follow, _, variance = self._exponent
            precision = _EXPONENTS**-2 + 1.0 / max(OTHER**2 * variance, 1e-300)
            inner = inner + np.outer(follow, follow) / precision
        variances = np.diag(self._jacobian @ inner @ self._jacobian.T)
        return self._determined(np.sqrt(variances))

    def _determined(self, numbers: Iterable[float]) -> dict[str, float]:
        """Return numbers of parameters by name, of those that are determined."""
        named = zip(self.names, numbers, strict=True)
        return {name: float(x) for name, x in named if name not in self.undetermined}

    @cached_property
    def undetermined(self) -> dict[str, str]:
        """What the data cannot say: name → reason."""
        equation, count = self.equation, len(self.state)
        recorded = equation.recording.samples.directions
        size = np.sqrt(np.diag(self.normal) / max(self.share.sum(), 1e-300))
        sd = np.sqrt(np.diag(self.state_covariance)) * size
        columns = equation.fixed_names + equation.structure.names
        vague = {
            name.replace("drop", "breakaway")
            for name, deviation in zip(columns, sd, strict=False)
            if deviation > _VAGUE * equation.recording.load_size
        }
        size = np.where(size > 0, size, 1.0)
        _, null = rooted((self.normal + self.prior)[:count, :count])
        null = null / np.abs(null * size[:count, None]).max(axis=0)
        reach = np.abs(self._jacobian[:, :count] @ null).max(axis=1, initial=0.0)
        hidden = reach > _IN_NULL * np.abs(self._jacobian / size).max(axis=1)
        reasons = dict(self.missing)
        for name, unknown in zip(self.names, hidden, strict=True):
            if name in reasons:
                continue
            if name.endswith(SUFFIXES) and not recorded[name.endswith(SUFFIXES[1])]:
                reasons[name] = _ONE_WAY
            elif not all(recorded) and (
                unknown or (self.structure.directional and name == "offset")
            ):
                reasons[name] = _LEVEL
            elif unknown:
                reasons[name] = _CONFUSED
            elif name in vague:
                reasons[name] = _VAGUE_WORDS
        return reasons

    @property
    def has_law(self) -> bool:
        """Whether the level of friction is told from a constant load."""
        kinds = zip(self.structure.factors, self.structure.levels, strict=True)
        levels = tuple(name for name, is_one in kinds if is_one)
        return not any(name.startswith(levels) for name in self.undetermined)

    @property
    def gauges(self) -> tuple[str, ...]:
        """Sentences on what can only be told together."""
        structure, offset = self.structure, self.loads[1]
        recorded = self.equation.recording.samples.directions
        if not structure.directional and all(recorded):
            return ()
        mean = structure.levels / structure.levels.sum()
        levels = self.factors.reshape(structure.ways, -1) @ mean
        parts = [f"level⁺ + offset = {levels[0] + offset:.4g}"] * recorded[0]
        parts += [f"level⁻ − offset = {levels[-1] - offset:.4g}"] * recorded[1]
        rule = "; the offset is chosen so that both levels are equal"
        return (
            "A constant load and the levels of friction cannot be told apart in motion:"
            f" only {' and '.join(parts)} are seen{rule * all(recorded)}.",
        )

    @cached_property
    def law(self) -> AbstractFriction | None:
        """Current over velocity without the offset, in drive units; None without `has_law`."""
        if not self.has_law:
            return None
        factors = self.factors.reshape(self.structure.ways, -1)
        return self.structure.law(factors, self.shape)

    def friction(self, velocity: Float[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
        """Return the friction at velocities in mm/s, in drive units."""
        return friction_of([self], velocity)[:, 0]

    def slopes(self, velocity: Float[np.ndarray, " v"]) -> Float[np.ndarray, "v p"]:
        """Return the derivatives of the friction by ``factors`` and ``shape``."""
        structure, shapes = self.structure, self.shape[None]
        last = structure.falling(np.abs(velocity), shapes)[1:, 0].T
        factors = self.factors.reshape(structure.ways, -1)[:, -1]
        by_shape = (factors @ structure.signs(velocity))[:, None] * last
        return np.hstack([structure.columns(velocity, shapes)[0], by_shape])


def friction_of(
    fits: Sequence[FrictionFit], velocity: Float[np.ndarray, " v"]
) -> Float[np.ndarray, "v n"]:
    """Return the friction of several laws of one kind, as `FrictionFit.friction` does."""
    factors = np.stack([fit.factors for fit in fits])
    shapes = np.stack([fit.shape for fit in fits])
    return fits[0].structure.friction(velocity, factors, shapes)


def lag_of(scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]) -> int:
    """Return over how many rows scores resemble each other (Andrews' rule, Bartlett weights).

    Source: D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance
    matrix estimation, Econometrica 59(3), 1991.

    Args:
        scores: Per row, in order; rows left out have zeros.
        piece: Stretch of even time steps; no lag reaches from one to the next.
    """
    same = (piece[1:] == piece[:-1]) * 1.0
    size = np.einsum("tk,tk->k", scores, scores)
    products = same @ (scores[1:] * scores[:-1])
    used = size > 0
    rho = np.clip(products / np.where(used, size, 1.0), 0.0, _STRONGEST)
    weights = used / (1 - rho) ** 4
    alpha = (4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2) * weights).sum()
    alpha /= max(float(weights.sum()), 1.0)
    best = 1.1447 * (alpha * len(scores)) ** (1 / 3)
    return int(min(best, _LARGEST_LAG * len(scores)))


def score_covariance(
    scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]
) -> Float[np.ndarray, "k k"]:
    """Return the covariance of the sum of scores; arguments as of `lag_of`."""
    lag = lag_of(scores, piece)
    # Bartlett's weights are what sums over a sliding window give. Pieces are set apart by
    # as many empty rows as the window is long.
    edges = np.flatnonzero(np.diff(piece)) + 1
    gap = np.zeros((lag + 1, scores.shape[1]))
    parts = [block for part in np.split(scores, edges) for block in (part, gap)]
    total = np.cumsum(np.concatenate([gap, *parts]), axis=0)
    window = total[lag + 1 :] - total[: -lag - 1]
    return np.asarray(window.T @ window / (lag + 1))
