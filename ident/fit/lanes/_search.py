"""Smoothness by evidence for many small tables in lockstep.

Two weights per lane, of second and of fourth differences, as logarithms relative to the
density of the readings (`.._logs`). Without fourth differences the evidence is scanned and
refined along one line; with them it has a valley of its own, descended into from two scans.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .._logs import HIGH, LEAST, LOW
from ._solve import Problems, cholesky
from ._stack import Bends, dot, times

_SCAN = np.log(np.logspace(-6, 8, 15))
_WIDTH = 0.4
"""Step in a logarithm for slopes and curvatures."""
_STEPS, _RADIUS, _GAIN = 10, 3.0, 5e-3
"""Newton steps at most, the largest one, and the gain in evidence at which they end."""
_BOUNDS = np.array([LEAST[:2], HIGH[:2]])

Logs = Float[np.ndarray, "k c 2"]


@dataclasses.dataclass(frozen=True)
class _Evidence:
    """Minus twice the restricted log-likelihood, run effects eliminated."""

    normal: Float[np.ndarray, "k p p"]
    vector: Float[np.ndarray, "k p"]
    square: Float[np.ndarray, " k"]
    values: Float[np.ndarray, "k s n"]
    free: Float[np.ndarray, " k"]
    density: Float[np.ndarray, " k"]
    logdet: Float[np.ndarray, " k"]
    bends: Bends

    @classmethod
    def of(cls, problems: Problems) -> "_Evidence":
        stack, size = problems.stack, problems.stack.size
        normal, vector = problems.normal[:, :size, :size], problems.vector[:, :size]
        square, logdet = problems.square, np.zeros(len(vector))
        if stack.effects:
            own = problems.normal[:, size:, size:]
            across = problems.normal[:, :size, size:]
            lower, _ = cholesky(own)
            root = np.linalg.inv(lower)
            # Half of the elimination: its square is what the effects take away.
            half = np.matmul(across, root.transpose(0, 2, 1))
            moved = times(root, problems.vector[:, size:])
            normal = normal - np.matmul(half, half.transpose(0, 2, 1))
            vector = vector - times(half, moved)
            square = square - dot(moved, moved)
            logdet = _logdet(lower)
        return cls(
            np.ascontiguousarray(normal),
            np.ascontiguousarray(vector),
            square,
            stack.tables(problems.unknowns),
            problems.free,
            stack.density(problems.normal),
            logdet,
            stack.bends,
        )

    def take(self, lanes: Int[np.ndarray, " k"]) -> "_Evidence":
        parts = {
            field.name: getattr(self, field.name)[lanes]
            for field in dataclasses.fields(self)[:-1]
        }
        return _Evidence(**parts, bends=self.bends.take(lanes))

    def __call__(self, logs: Logs) -> Float[np.ndarray, "k c"]:
        """Return the evidence of several weights per lane; smaller is better."""
        weights = weights_of(logs, self.density[:, None])
        first, second = weights[..., 0], weights[..., 1]
        grams = self.bends.grams[:, None]
        pull = (
            first[..., None, None] * grams[:, :, 0]
            + second[..., None, None] * grams[:, :, 1]
        )
        branches, nodes = self.values.shape[1:]
        matrix = np.repeat(self.normal[:, None], logs.shape[1], axis=1)
        for branch in range(branches):
            own = slice(branch * nodes, (branch + 1) * nodes)
            matrix[:, :, own, own] += pull
        values = self.values[:, None]
        right = self.vector[:, None] - np.matmul(values, pull).reshape(
            *logs.shape[:2], -1
        )
        lower, sound = cholesky(matrix)
        matrix[~sound] = np.eye(matrix.shape[-1])
        step = np.linalg.solve(matrix, right[..., None])[..., 0]
        square = self.square[:, None] - 2.0 * dot(self.vector[:, None], step)
        square += dot(step, np.matmul(step, self.normal))
        square = np.maximum(square, 0.0)
        there = values + step.reshape(*step.shape[:2], branches, nodes)
        for part, weight in ((self.bends.second, first), (self.bends.fourth, second)):
            rows = np.matmul(there, part[:, None].transpose(0, 1, 3, 2))
            rows = rows.reshape(*step.shape[:2], -1)
            square = square + weight * dot(rows, rows)
        noise = np.log(np.maximum(square / self.free[:, None], 1e-300))
        result = self.free[:, None] * noise + _logdet(lower) + self.logdet[:, None]
        reduced = self.bends.reduced[:, None]
        inner, known = cholesky(
            first[..., None, None] * reduced[:, :, 0]
            + second[..., None, None] * reduced[:, :, 1]
        )
        result -= branches * (_logdet(inner) + self.bends.constant[:, None])
        return np.where(sound & known & np.isfinite(result), result, 1e30)


def weights_of(
    logs: Float[np.ndarray, "*k 2"], density: Float[np.ndarray, "*#k"]
) -> Float[np.ndarray, "*k 2"]:
    """Return the weights; fourth differences at the lower end are left out."""
    result = np.asarray(np.exp(logs) * density[..., None])
    result[..., 1][logs[..., 1] <= LOW + 1e-9] = 0.0
    return result


def _logdet(lower: Float[np.ndarray, "*k m m"]) -> Float[np.ndarray, "*k"]:
    return np.asarray(
        2.0 * np.log(np.diagonal(lower, axis1=-2, axis2=-1).copy()).sum(axis=-1)
    )


def choose_weights(
    problems: Problems, near: Float[np.ndarray, "k 2"] | None = None
) -> tuple[Float[np.ndarray, "k 2"], Bool[np.ndarray, " k"]]:
    """Return the weights with the best evidence, and which lanes have any.

    Args:
        problems: Sums about a current estimate.
        near: Weights that an earlier search found for nearly the same sums.
    """
    evidence = _Evidence.of(problems)
    starts = _far_starts(evidence) if near is None else _near_starts(evidence, near)
    best, cost = _descended(evidence, starts[0], np.array([True, False]))
    if problems.stack.bends.fourth.shape[1]:
        for start in starts[1:]:
            other, theirs = _descended(evidence, start, np.array([True, True]))
            better = theirs < cost
            best[better], cost[better] = other[better], theirs[better]
        # Fourth differences that are not worth their place go.
        without = best.copy()
        without[:, 1] = LOW
        own = evidence(without[:, None])[:, 0]
        best[own < cost] = without[own < cost]
        cost = np.minimum(own, cost)
    return weights_of(best, evidence.density), cost < 1e30


def _far_starts(evidence: _Evidence) -> list[Float[np.ndarray, "k 2"]]:
    """Return the best of three scans: without fourth differences, and twice with them."""
    lines = [np.stack([_SCAN, np.full(len(_SCAN), LOW)], axis=-1)]
    for lift, slope in ((np.log(10.0), 1.0), (0.0, 2.0)):
        line = np.stack([_SCAN[::2], lift + slope * _SCAN[::2]], axis=-1)
        lines.append(np.clip(line, *_BOUNDS))
    count = len(evidence.square)
    costs = [evidence(np.repeat(line[None], count, axis=0)) for line in lines]
    return [
        line[np.argmin(cost, axis=1)] for line, cost in zip(lines, costs, strict=True)
    ]


def _near_starts(
    evidence: _Evidence, near: Float[np.ndarray, "k 2"]
) -> list[Float[np.ndarray, "k 2"]]:
    """Return the earlier weights, without and with fourth differences."""
    logs = np.log(np.maximum(near / evidence.density[:, None], 1e-300))
    logs = np.clip(logs, *_BOUNDS)
    plain = logs.copy()
    plain[:, 1] = LOW
    return [plain, logs]


def _descended(
    evidence: _Evidence,
    start: Float[np.ndarray, "k 2"],
    alive: Bool[np.ndarray, " 2"],
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
    """Return where Newton steps within the bounds end, and the evidence there."""
    free = np.flatnonzero(alive)
    stencil = np.array(_STENCIL[len(free)])
    moves = np.zeros((len(stencil), 2))
    moves[:, free] = _WIDTH * stencil
    lower = _BOUNDS[0] + np.where(alive, _WIDTH + 1e-6, 0.0)
    upper = _BOUNDS[1] - np.where(alive, _WIDTH, 0.0)
    place = np.clip(start, lower, upper)
    place[:, ~alive] = start[:, ~alive]
    best, cost = place.copy(), np.full(len(place), np.inf)
    radius = np.full(len(place), _RADIUS)
    step = np.zeros_like(place)
    going = np.arange(len(place))
    part = evidence
    for _ in range(_STEPS):
        values = part(place[going][:, None] + moves)
        nearest = np.argmin(values, axis=1)
        least = values[np.arange(len(going)), nearest]
        worse = values[:, 0] > cost[going]
        best_here = least < cost[going]
        slope, curvature = _model(values, len(free))
        # Back to the best place with half the way, or on from here.
        radius[going[worse]] *= 0.3
        at = np.flatnonzero(~worse)
        step[np.ix_(going[at], free)] = _newton(
            slope[at], curvature[at],
            place[going[at]][:, free], lower[free], upper[free],
        )  # fmt: skip
        seen = np.flatnonzero(best_here)
        best[going[seen]] = place[going[seen]] + moves[nearest[seen]]
        cost[going[seen]] = least[seen]
        length = np.abs(step[going]).max(axis=1)
        short = np.minimum(1.0, radius[going] / np.maximum(length, 1e-12))
        gain = np.abs((slope * step[going][:, free]).sum(axis=1)) * short
        base = np.where(worse[:, None], best[going], place[going])
        target = base.copy()
        moved = base + short[:, None] * step[going]
        target[:, free] = np.clip(moved, lower, upper)[:, free]
        still = np.abs(target - base).max(axis=1) > 1e-3
        place[going] = target
        keep = still & (gain > _GAIN)
        if not keep.any():
            break
        if not keep.all():
            going, part = going[keep], part.take(np.flatnonzero(keep))
    return best, cost


_STENCIL: dict[int, list[tuple[float, ...]]] = {
    1: [(0.0,), (1.0,), (-1.0,)],
    2: [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0)],
}
"""Places around a point, in steps, from which slope and curvature follow."""


def _model(
    values: Float[np.ndarray, "k c"], free: int
) -> tuple[Float[np.ndarray, "k f"], Float[np.ndarray, "k f f"]]:
    """Return slope and curvature from values on the stencil."""
    middle = values[:, 0]
    slope = np.empty((len(values), free))
    curvature = np.empty((len(values), free, free))
    for k in range(free):
        ahead, back = values[:, 1 + 2 * k], values[:, 2 + 2 * k]
        slope[:, k] = (ahead - back) / (2.0 * _WIDTH)
        curvature[:, k, k] = (ahead - 2.0 * middle + back) / _WIDTH**2
    if free == 2:
        mixed = values[:, 5] - values[:, 1] - values[:, 3] + middle
        curvature[:, 0, 1] = curvature[:, 1, 0] = mixed / _WIDTH**2
    return slope, curvature


def _newton(
    slope: Float[np.ndarray, "k f"],
    curvature: Float[np.ndarray, "k f f"],
    place: Float[np.ndarray, "k f"],
    lower: Float[np.ndarray, " f"],
    upper: Float[np.ndarray, " f"],
) -> Float[np.ndarray, "k f"]:
    """Return downhill steps; a weight that its bound holds back does not move."""
    held = ((place <= lower) & (slope > 0)) | ((place >= upper) & (slope < 0))
    slope = np.where(held, 0.0, slope)
    both = held[:, :, None] | held[:, None, :]
    matrix = np.where(both, 0.0, curvature) + held[:, :, None] * np.eye(held.shape[1])
    values, vectors = np.linalg.eigh(matrix)
    # Where the evidence bends the wrong way, go downhill as far as it bends.
    size = np.maximum(np.abs(values), 0.05)
    along = times(vectors.transpose(0, 2, 1), slope)
    return np.asarray(-times(vectors, along / size))
