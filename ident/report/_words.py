"""What a fit found, in sentences: the verdict, and how the table was made."""

import dataclasses

import numpy as np

from ..job import ErrorFigures, FitResult
from ._damping import damped_wavelengths
from ._readings import Readings
from ._scale import Scale, count, grouped, number, percent, place
from ._second import SecondMeasurement


@dataclasses.dataclass(frozen=True)
class Verdict:
    """One sentence on a fit; ``level`` is good, warn or bad."""

    level: str
    sentence: str


def verdict_of(
    fit: FitResult, scale: Scale, second: SecondMeasurement | None
) -> Verdict:
    """Return the verdict that stands at the top of a fit's section."""
    failed = [check for check in fit.gate if not check.passed]
    loud = [remark for remark in fit.remarks if remark.level == "error"]
    numbers = _fall(fit, scale)
    if failed:
        names = ", ".join(
            f"{check.name.replace('_', ' ')} {check.value:.4g} {check.unit} "
            f"(limit {check.limit:.4g})"
            for check in failed
        )
        return Verdict("bad", f"Do not load: the gate stopped this list. {names}.")
    if loud:
        return Verdict("bad", f"Do not load yet: {loud[0].message}")
    before, after = fit.error.get("before"), fit.error.get("predicted")
    if before and after and after.sound.rms >= 0.98 * before.sound.rms:
        return Verdict("warn", f"This list would not help: {numbers}.")
    if second is None and fit.verified_by is None:
        return Verdict(
            "good",
            f"Ready to load: {numbers}. Computed; not yet verified by a second "
            "measurement.",
        )
    if second is None:
        return Verdict(
            "good", f"Ready to load: {numbers}; verified by {fit.verified_by}."
        )
    return _verified(fit, scale, second, numbers)


def _verified(
    fit: FitResult, scale: Scale, second: SecondMeasurement, numbers: str
) -> Verdict:
    seen = second.figures.sound.rms
    before = fit.error["before"].sound.rms
    after = fit.error["predicted"].sound.rms
    found = (
        f"a second measurement with the list active ({second.name}) found "
        f"{number(seen * scale.factor)} {scale.error} rms"
    )
    if seen >= 0.98 * before:
        return Verdict(
            "bad", f"Take the list out again: {found}, no better than before."
        )
    if seen > 1.5 * after:
        return Verdict("warn", f"Better, but less than predicted: {numbers}; {found}.")
    return Verdict("good", f"Verified: {numbers}; {found}.")


def _fall(fit: FitResult, scale: Scale) -> str:
    before, after = fit.error.get("before"), fit.error.get("predicted")
    unit = scale.error
    if before is None:
        return "nothing was predicted"
    before = before.sound
    start = f"the error of {fit.axis} is {_size(before, scale)}"
    if after is None:
        return f"{start}; nothing was predicted"
    after = after.sound
    end = f"{number(after.rms * scale.factor)} {unit} rms (largest "
    end += f"{number(after.max * scale.factor)} {unit})"
    if before.rms > 0 and after.rms < before.rms:
        return (
            f"on readings that the fit did not see, the error of {fit.axis} falls from "
            f"{_size(before, scale)} to {end}, by {percent(1 - after.rms / before.rms)}"
        )
    return f"{start}, and {end} are predicted with the list"


def _size(figures: ErrorFigures, scale: Scale) -> str:
    return (
        f"{number(figures.rms * scale.factor)} {scale.error} rms (largest "
        f"{number(figures.max * scale.factor)} {scale.error})"
    )


def how_it_was_made(
    fit: FitResult, readings: Readings, scale: Scale
) -> list[tuple[str, str]]:
    """Return pairs of a heading and a plain sentence on how the table was found."""
    own = fit.fit
    unit = scale.error
    facts = [
        (
            "Noise",
            f"A single reading scatters by {number(own.noise * scale.factor)} {unit} "
            "(1 sd) about the table, wild readings left out.",
        ),
        ("Wild readings", _loss(own.loss, readings)),
        ("Smoothness", smoothness_sentence(fit, scale)),
        (
            "Rounding",
            f"Rounding to whole list units moves the table by at most "
            f"{number(fit.rounding * scale.factor)} {unit}.",
        ),
    ]
    if fit.cycles is not None:
        facts.append(
            (
                "Reversal",
                f"The jump between the two directions is spread over {fit.cycles} "
                "cycles (n_backlash_cyc, P-AXIS-00243).",
            )
        )
    suspects = []
    if own.suspect_nodes:
        nodes = ", ".join(_node_places(fit, scale)[:12])
        suspects.append(
            f"The readings at {count(len(own.suspect_nodes), 'node')} contradict their "
            f"surroundings: {nodes}."
        )
    if own.suspect_runs:
        runs = ", ".join(str(run) for run in own.suspect_runs)
        suspects.append(f"Contradicts the other runs: run {runs}.")
    if suspects:
        facts.append(("Suspect", " ".join(suspects)))
    facts.append(("The fit itself", _fit_message(own.message, own.converged)))
    return facts


def _fit_message(message: str, converged: bool) -> str:
    text = message.strip()
    if text and text[-1] not in ".!?":
        text += "."
    if converged:
        return text or "The iterations reached their tolerance."
    return f"The iterations did NOT reach their tolerance. {text}".strip()


def _loss(loss: str, readings: Readings) -> str:
    wild = int(readings.wild.sum())
    how = {
        "student": "Readings far from the others count less (Student's t)",
        "huber": "Readings far from the others count less (Huber)",
        "gauss": "All readings count fully (Gauss)",
    }.get(loss, f"Loss {loss}")
    if not wild:
        return f"{how}; none of {grouped(readings.size)} was rejected as wild."
    were = "was" if wild == 1 else "were"
    return (
        f"{how}; {grouped(wild)} of {grouped(readings.size)} "
        f"({percent(wild / readings.size)}) {were} rejected as wild and "
        "had no influence."
    )


def smoothness_sentence(fit: FitResult, scale: Scale) -> str:
    """Say which details of the error the table follows and which it treats as noise."""
    weights = fit.fit.smoothness
    if not any(weight > 0 for weight in weights.values()):
        return "None: every node rests on its own readings (smoothness 0)."
    parts = []
    for master, wavelength in damped_wavelengths(fit).items():
        axis = fit.masters[master]
        if wavelength is None:
            parts.append(
                f"along {axis} every detail that the nodes can hold is followed"
            )
        else:
            parts.append(
                f"along {axis} waves of the error shorter than about "
                f"{wavelength:.3g} {scale.position} are damped to less than half, "
                "longer ones are followed"
            )
    named = ", ".join(f"{name}: {weight:.3g}" for name, weight in weights.items())
    if not parts:
        return f"Weights of the prior relative to 1/noise²: {named}."
    text = "; ".join(parts)
    weights_named = f"Weights of the prior relative to 1/noise²: {named}."
    return f"{text[0].upper()}{text[1:]}. {weights_named}"


def _node_places(fit: FitResult, scale: Scale) -> list[str]:
    """Return the places of the suspect nodes in words."""
    layout = fit.fit.layout
    places = []
    for flat in fit.fit.suspect_nodes:
        index = np.unravel_index(flat, layout.shape)[-len(layout.nodes) :]
        spots = [
            f"{master} = {place(float(nodes[int(at)]))}"
            for master, nodes, at in zip(
                fit.masters, layout.nodes, reversed(index), strict=True
            )
        ]
        places.append(" ".join(spots) + f" {scale.position}")
    return places


@dataclasses.dataclass(frozen=True)
class WildRow:
    """One rejected reading, ready to print."""

    row: str
    where: str
    run: str
    error: str


def wild_rows(
    fit: FitResult, readings: Readings, scale: Scale, limit: int = 12
) -> list[WildRow]:
    """Return the largest rejected readings, at most ``limit``."""
    rows = np.flatnonzero(readings.wild)
    rows = rows[np.argsort(-np.abs(readings.before[rows]), kind="stable")][:limit]
    found = []
    for row in rows.tolist():
        spots = zip(fit.masters, readings.positions[row], strict=True)
        where = ", ".join(f"{name} = {place(float(at))}" for name, at in spots)
        direction = {1: ", moving +", -1: ", moving −"}.get(
            int(readings.direction[row]), ""
        )
        run = "" if readings.run is None else str(int(readings.run[row]))
        found.append(
            WildRow(
                grouped(row + 1),
                f"{where} {scale.position}{direction}",
                run,
                f"{number(float(readings.before[row]), signed=True)} {scale.error}",
            )
        )
    return found
