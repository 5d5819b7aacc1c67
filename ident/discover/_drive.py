"""Which friction a drive shows in its current, and what of it a list can hold."""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Bool, Float

from ._basis import waves
from ._evidence import Variances, estimate_variances, log_evidence
from ._observed import Observed
from ._result import AxisSummary, Found, Rejected, Unexplained
from ._rough import scatter_of
from ._stability import selection_frequency
from ._sums import Design, block_sums, design_of
from ._terms import FRICTION, Kind, Term
from ._trace import Trace, trace_of

_KNEES = (0.01, 0.03, 0.08, 0.2)
"""Stribeck velocities that are tried, as shares of the fastest speed."""
_PLACES = 12
_LEAST = 0.01
"""Share of the rms of the current from which on a term counts."""
_STABLE = 0.8
_TAIL = 4.0
_PASSES = 4
_EVEN = 0.05
"""Spread of the speeds, relative to their mean, below which there is but one."""


@dataclasses.dataclass(frozen=True)
class DriveFindings:
    """What the current of one axis shows."""

    summary: AxisSummary | None
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    unexplained: tuple[Unexplained, ...]


def examine_drive(observed: Observed, axis: str) -> DriveFindings:
    """Return which laws of friction the current of an axis shows.

    Args:
        observed: All that was measured.
        axis: With a measured current.
    """
    trace = trace_of(observed, axis)
    if isinstance(trace, str):
        nothing = Rejected(
            "friction", axis, (), None, f"could not be looked for: {trace}"
        )
        return DriveFindings(None, (), (nothing,), ())
    design = _design(trace, axis)
    chosen, variances, frequency, noise = _select(trace, design)
    parts = {
        term: design.columns[:, design.slices[g]] @ variances.values[design.slices[g]]
        for g, term in enumerate(design.terms)
        if chosen[g]
    }
    size = float(np.sqrt(np.mean(trace.current**2)))
    summary = AxisSummary(axis, "current", len(trace.current), size, noise, trace.unit)
    share = {term: _share(part, trace.current) for term, part in parts.items()}
    rms = {term: float(np.sqrt(np.mean(part**2))) for term, part in parts.items()}
    often = dict(zip(design.terms, frequency, strict=True))
    law = [term for term in parts if term.kind in FRICTION]
    found = []
    unexplained = list(_doubts(trace, axis, law, share, rms))
    if law and not unexplained:
        names = [_LAWS[term.kind] for term in law]
        whole = np.sum([parts[term] for term in law], axis=0)
        weight = _share(whole, trace.current)
        sentence = (
            f"friction of {axis}: {', '.join(names)};"
            f" {float(np.sqrt(np.mean(whole**2))):.3g} rms, {weight:.0%} of the current."
        )
        found.append(
            Found(
                "friction",
                axis,
                (),
                None,
                weight,
                float(np.sqrt(np.mean(whole**2))),
                float(min(often[term] for term in law)),
                trace.unit,
                {},
                None,
                sentence,
            )
        )
    for term in parts:
        if term.kind in _BEYOND:
            values = variances.values[design.slices[design.terms.index(term)]]
            words = _beyond_words(trace, term, values)
            unexplained.append(
                Unexplained(
                    axis,
                    term.words,
                    (),
                    rms[term],
                    share[term],
                    trace.unit,
                    "the kernel cannot express this",
                    words,
                )
            )
    rejected = []
    if not law:
        reason = "nothing of it in the current"
        rejected.append(Rejected("friction", axis, (), None, reason))
    return DriveFindings(summary, tuple(found), tuple(rejected), tuple(unexplained))


def _design(trace: Trace, axis: str) -> Design:
    """Return the features of every law, each scaled to an rms of one."""
    way, v = trace.way, trace.velocity / trace.fast
    features: dict[Term, np.ndarray] = {
        Term(Kind.INERTIA, axis): trace.acceleration[:, None],
        Term(Kind.COULOMB, axis): way[:, None],
        Term(Kind.VISCOUS, axis): v[:, None],
        Term(Kind.DRAG, axis): (v * np.abs(v))[:, None],
        Term(Kind.VISCOUS_WAY, axis): np.abs(v)[:, None],
    }
    low, high = float(trace.position.min()), float(trace.position.max())
    if high > low:
        count = min(_PLACES, len(v) // 100)
        place = waves((trace.position - low) / (high - low), count, False)
        features[Term(Kind.LOAD_PLACE, axis)] = place
        features[Term(Kind.COULOMB_PLACE, axis)] = way[:, None] * place
    for name, values in trace.temperature.items():
        warm = (values - values.mean()) / values.std()
        features[Term(Kind.COULOMB_HEAT, axis, (), name)] = (way * warm)[:, None]
    knee = _knee(trace, features)
    slow = way * np.exp(-((v / knee) ** 2))
    features[Term(Kind.STRIBECK, axis)] = slow[:, None]
    blocks = []
    for term, block in features.items():
        if block.shape[1] == 1:
            block = block / (float(np.sqrt(np.mean(block**2))) or 1.0)
        features[term] = block
        blocks.append(block)
    constant = np.ones((len(v), 1))
    return design_of(tuple(features), blocks, (constant,))


def _knee(trace: Trace, features: Mapping[Term, np.ndarray]) -> float:
    """Return the Stribeck velocity that suits best, as share of the fastest."""
    base = np.concatenate([*features.values(), np.ones((len(trace.way), 1))], axis=1)
    base = base / np.maximum(np.sqrt(np.mean(base**2, axis=0)), 1e-300)
    v = trace.velocity / trace.fast
    one = np.zeros(len(v), dtype=np.int64)
    best, level = _KNEES[0], -np.inf
    for knee in _KNEES:
        slow = trace.way * np.exp(-((v / knee) ** 2))
        columns = np.concatenate([base, slow[:, None]], axis=1)
        slices = [slice(k, k + 1) for k in range(columns.shape[1])]
        sums = block_sums(columns, trace.current, np.ones(len(v)), one).total()
        least = 1e-4 * float(np.sqrt(np.mean(trace.current**2)))
        found = log_evidence(sums, slices, estimate_variances(sums, slices, least))
        if found > level:
            best, level = knee, found
    return best


def _select(
    trace: Trace, design: Design
) -> tuple[Bool[np.ndarray, " g"], Variances, Float[np.ndarray, " g"], float]:
    """Return which terms the current shows, their coefficients and the noise."""
    current, weight = trace.current, np.ones(len(trace.current))
    least = _LEAST * float(np.sqrt(np.mean(current**2)))
    terms = len(design.terms)
    noise = scatter_of(current)
    sums = block_sums(design.columns, current, weight, trace.block)
    variances = estimate_variances(sums.total(), design.slices, 0.1 * least)
    for _ in range(_PASSES):
        left = current - design.columns @ variances.values
        noise = scatter_of(left)
        weight = (_TAIL + 1.0) / (_TAIL + (left / noise) ** 2)
        sums = block_sums(design.columns, current, weight, trace.block)
        variances = estimate_variances(sums.total(), design.slices, 0.1 * least)
    frequency = selection_frequency(sums, design.slices, variances, terms, least)
    chosen = frequency >= _STABLE
    keep = np.ones(design.groups, dtype=bool)
    keep[:terms] = chosen
    alone = dataclasses.replace(variances, group=np.where(keep, variances.group, 0.0))
    settled = estimate_variances(sums.total(), design.slices, 0.1 * least, alone)
    left = current - design.columns @ settled.values
    return chosen, settled, frequency, scatter_of(left)


def _share(part: Float[np.ndarray, " t"], whole: Float[np.ndarray, " t"]) -> float:
    square = float(np.mean(whole**2)) or 1.0
    return float(np.clip(np.mean(part * whole) / square, 0.0, 1.0))


def _doubts(
    trace: Trace,
    axis: str,
    law: list[Term],
    share: Mapping[Term, float],
    rms: Mapping[Term, float],
) -> Iterator[Unexplained]:
    """Yield what the motion cannot tell apart."""
    ways = np.unique(trace.way)
    speeds = np.abs(trace.velocity)
    cruise = speeds[speeds > 0.5 * trace.fast]
    size = max(rms.values(), default=0.0)
    weight = max(share.values(), default=0.0)
    if len(ways) < 2:
        yield Unexplained(
            axis, f"friction or constant load of {axis}", (), size, weight, trace.unit,
            "the data cannot tell",
            f"The data cannot tell: friction or constant load of {axis}, which moves in one"
            " direction only. Record both.",
        )  # fmt: skip
    elif (
        law
        and np.mean(speeds > 0.9 * trace.fast) > 0.97
        and (np.std(cruise) < _EVEN * np.mean(cruise))
    ):
        yield Unexplained(
            axis, f"Coulomb or viscous friction of {axis}", (), size, weight, trace.unit,
            "the data cannot tell",
            f"The data cannot tell: Coulomb or viscous friction of {axis}, which moves at"
            f" {np.mean(cruise):.3g}/s only. Record other speeds too.",
        )  # fmt: skip


_LAWS = {
    Kind.COULOMB: "Coulomb",
    Kind.VISCOUS: "viscous",
    Kind.DRAG: "square of the velocity",
    Kind.STRIBECK: "Stribeck",
}
_BEYOND = {
    Kind.VISCOUS_WAY: "a friction list has one curve for both directions.",
    Kind.LOAD_PLACE: "weight or cogging is no friction, and a list has no position.",
    Kind.COULOMB_PLACE: "a friction list knows the velocity only.",
    Kind.COULOMB_HEAT: "a friction list knows the velocity only. Record it warm.",
}


def _beyond_words(trace: Trace, term: Term, values: Float[np.ndarray, " k"]) -> str:
    text = f"{term.words[0].upper()}{term.words[1:]}"
    if term.kind is Kind.VISCOUS_WAY:
        size = float(np.sqrt(np.mean(trace.velocity**2)))
        steeper = "forwards" if values[0] > 0 else "backwards"
        text += f", steeper {steeper} by {2.0 * abs(values[0]) / size:.3g}"
        text += " per unit of velocity"
    return f"{text}: {_BEYOND[term.kind]}"
