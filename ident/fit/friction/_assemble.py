"""From factors of columns to the parameters that users read."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ._determined import VAGUE, directions_seen, lost, sentences, vague_columns
from ._problem import Problem
from ._result import FrictionFit
from ._separable import Solution
from ._solve import Solved
from ._structure import WAYS

_ONE_WAY = "no motion in this direction was recorded"
_LEVEL = "only its sum with a constant load is seen"


def _gauge(problem: Problem, solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return factors and map after splitting the levels per direction from the offset.

    Seen in motion are level⁺ + offset and level⁻ − offset only. The offset is chosen so that
    the mean levels of both directions are equal.
    """
    fixed = len(problem.fixed_names)
    structure = problem.structure
    one = structure.levels()
    width = len(one)
    total = len(solution.factors) + len(solution.shape)
    offset = np.zeros(total)
    mean = one / one.sum()
    offset[fixed : fixed + width] = 0.5 * mean
    offset[fixed + width : fixed + 2 * width] = -0.5 * mean
    shift = np.eye(total)
    shift[fixed : fixed + width] -= np.outer(one, offset)
    shift[fixed + width : fixed + 2 * width] += np.outer(one, offset)
    return offset, shift


@dataclasses.dataclass(frozen=True)
class _Named:
    """Parameters as users read them, determined or not.

    Attributes:
        names: One word each.
        values: In load units.
        jacobian: With respect to linear factors and shape, as fitted.
        own: Factors of the law, level and offset parted.
        inner: Their derivative, and that of the shape, likewise.
        split: Whether level and offset had to be parted.
        seen: Whether motion in positive and in negative direction was recorded.
        undetermined: What the data cannot say: name → reason.
        has_law: Whether the level of friction is told from a constant load.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "r k"]
    own: Float[np.ndarray, " f"]
    inner: Float[np.ndarray, "p k"]
    split: bool
    seen: tuple[bool, bool]
    undetermined: dict[str, str]
    has_law: bool


def _named(
    solved: Solved, load: Float[np.ndarray, "1"], moving: Bool[np.ndarray, " t"]
) -> _Named:
    """Return what a fit to some rows says, and what it does not.

    Args:
        solved: The fit.
        load: Root mean square of the load over its rows.
        moving: Samples in motion behind them.
    """
    problem, solution = solved.problem, solved.solution
    structure, fixed_names = problem.structure, problem.fixed_names
    fixed = len(fixed_names)
    count = len(solution.factors)
    state = np.concatenate([solution.factors, solution.shape])
    split = structure.directional and problem.known.offset is None
    unit = np.eye(len(state))
    own, inner = solution.factors[fixed:], unit[fixed:]
    names, rows = list(fixed_names), [*unit[:fixed]]
    if split:
        offset, shift = _gauge(problem, solution)
        names.append("offset")
        rows.append(offset)
        own = (shift @ state)[fixed:count]
        inner = np.concatenate([shift[fixed:count], unit[count:]])
    reported = structure.reported(own, solution.shape)
    jacobian = np.concatenate(
        [np.array(rows).reshape(-1, len(state)), reported.jacobian @ inner]
    )
    names += reported.names
    values = np.concatenate([[row @ state for row in rows], reported.values])
    undetermined = dict(solved.missing)
    null = np.zeros((len(state), solution.null.shape[1]))
    null[:count] = solution.null
    gone = lost(jacobian, null, solution.column_size)
    columns = fixed_names + structure.names
    unknown = vague_columns(problem, [solution], load)[0].tolist()
    vague = {name for name, one in zip(columns, unknown, strict=True) if one}
    seen = directions_seen(problem, moving)
    for name, is_lost in zip(names, gone, strict=True):
        factor = name.replace("breakaway", "drop")
        if name.endswith(WAYS) and not seen[WAYS.index("_" + name.split("_")[-1])]:
            undetermined.setdefault(name, _ONE_WAY)
        elif is_lost and not all(seen):
            undetermined.setdefault(name, _LEVEL)
        elif is_lost:
            undetermined.setdefault(name, "the motion does not tell it from the others")
        elif factor in vague or name in vague:
            undetermined.setdefault(name, VAGUE)
        elif split and name == "offset" and not all(seen):
            undetermined.setdefault(name, _LEVEL)
    has_law = not any(
        name.removesuffix(WAYS[0]).removesuffix(WAYS[1]) in structure.level_names
        for name in reported.names
        if name in undetermined
    )
    return _Named(
        tuple(names), values, jacobian, own, inner, split, seen, undetermined, has_law
    )


def law_factors(
    solved: Sequence[Solved],
    use: Float[np.ndarray, "w s"],
    moving: Bool[np.ndarray, "w t"],
) -> list[Float[np.ndarray, " f"] | None]:
    """Return the factors of laws fitted to choices of rows, level and offset parted.

    Args:
        solved: The fits of one equation, with their covariances.
        use: 1 where a fit used a row, else 0.
        moving: Samples in motion behind these.

    Returns:
        None where its rows do not tell the level of friction.
    """
    problem = solved[0].problem
    structure, fixed = problem.structure, len(problem.fixed_names)
    levels = fixed + np.flatnonzero(np.tile(structure.levels(), structure.ways))
    load = np.sqrt(use @ np.square(problem.load) / use.sum(axis=1))
    vague = vague_columns(problem, [each.solution for each in solved], load)
    unknown = np.asarray(vague[:, levels].any(axis=1))
    parted = structure.directional and problem.known.offset is None
    found: list[Float[np.ndarray, " f"] | None] = []
    for number, each in enumerate(solved):
        solution = each.solution
        if solution.null.shape[1] or not all(directions_seen(problem, moving[number])):
            named = _named(each, load[number : number + 1], moving[number])
            found.append(named.own if named.has_law else None)
        elif unknown[number]:
            # Every direction of the factors is seen: a level can only be vague.
            found.append(None)
        else:
            factors = solution.factors
            if parted:
                state = np.concatenate([factors, solution.shape])
                factors = _gauge(problem, solution)[1] @ state
            found.append(np.asarray(factors[fixed : len(solution.factors)]))
    return found


def assemble(solved: Solved, method: str) -> FrictionFit:
    """Return the result of a fit to all rows."""
    problem, solution = solved.problem, solved.solution
    structure = problem.structure
    used = problem.usable
    load, residual, share = (
        each[used] for each in (problem.load, solution.residual, solution.share)
    )
    size = np.sqrt(np.mean(np.square(load), keepdims=True))
    named = _named(solved, size, problem.samples.in_motion)
    names, values, undetermined = named.names, named.values, dict(named.undetermined)
    jacobian, own, inner = named.jacobian, named.own, named.inner
    covariance = jacobian @ solution.covariance @ jacobian.T
    open_ = np.array([name in undetermined for name in names], bool)
    values = np.where(open_, np.nan, values)
    covariance = np.where(open_[:, None] | open_[None], np.nan, covariance)
    sd = np.sqrt(np.diag(covariance))
    good = [place for place in range(len(names)) if not open_[place]]
    return FrictionFit(
        method=method,
        structure=structure,
        has_law=named.has_law,
        parameters={names[place]: float(values[place]) for place in good}
        | _given(problem),
        standard_deviations={names[place]: float(sd[place]) for place in good},
        names=names,
        values=values,
        covariance=covariance,
        undetermined=undetermined,
        gauges=_gauges(problem, solution, named.split, named.seen),
        remarks=sentences(problem),
        noise=solution.loss.scale,
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(load)),
        residual=residual,
        share=share,
        index=problem.lowpass.centres[used],
        count=int(np.count_nonzero(share)),
        lag=solution.lag,
        passes=solution.passes,
        converged=solution.converged,
        message=_message(solved, share),
        known=problem.known,
        decimate=problem.lowpass.factor,
        state=solution.factors,
        state_covariance=solution.covariance,
        factors=own,
        shape=solution.shape,
        law_covariance=inner @ solution.covariance @ inner.T,
    )


def _given(problem: Problem) -> dict[str, float]:
    known = problem.known
    return {
        name: value
        for name, value in (("inertia", known.inertia), ("offset", known.offset))
        if value is not None
    }


def _gauges(
    problem: Problem, solution: Solution, split: bool, seen: tuple[bool, bool]
) -> tuple[str, ...]:
    structure, fixed = problem.structure, len(problem.fixed_names)
    if not split and (all(seen) or not problem.fits_offset):
        return ()
    found = []
    one = structure.levels()
    one /= one.sum()
    if split:
        ahead = one @ solution.factors[fixed : fixed + len(one)]
        back = one @ solution.factors[fixed + len(one) : fixed + 2 * len(one)]
        parts = []
        if seen[0]:
            parts.append(f"level⁺ + offset = {ahead:.4g}")
        if seen[1]:
            parts.append(f"level⁻ − offset = {back:.4g}")
        found.append(
            "A constant load and a difference of the Coulomb levels of both directions "
            "cannot be told apart in motion: only "
            + " and ".join(parts)
            + " are seen"
            + (
                "; the offset is chosen so that both levels are equal."
                if all(seen)
                else "."
            )
        )
    else:
        place = problem.fixed_names.index("offset")
        sign = 1.0 if seen[0] else -1.0
        level = one @ solution.factors[fixed:] + sign * solution.factors[place]
        way = "+" if seen[0] else "−"
        found.append(f"Seen is only Coulomb level {way} offset = {level:.4g}.")
    return tuple(found)


def _message(solved: Solved, share: Float[np.ndarray, " t"]) -> str:
    solution, total = solved.solution, len(share)
    wild = total - int(np.count_nonzero(share))
    words = "converged" if solution.converged else "did not settle"
    return (
        f"{solved.problem.structure.words}: {words} after {solution.passes} passes, "
        f"{wild} of {total} samples rejected as wild."
    )
