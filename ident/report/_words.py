"""What a fit found, in sentences: the verdict, and how the table was made."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from ..job import TableResult
from ._damping import damped_wavelengths
from ._readings import Readings
from ._scale import Scale, count, grouped, number, percent, place


def how_it_was_made(
    fit: TableResult, readings: Readings, scale: Scale
) -> Iterator[tuple[str, str]]:
    """Return pairs of a heading and a plain sentence on how the table was found."""
    own = fit.fit
    unit = scale.error
    noise = (
        f"A single reading scatters by {number(own.noise * scale.factor)} {unit} "
        "(1 sd) about the table, wild readings left out."
    )
    if own.line_offset:
        # The scatter that is seen, and what one probing cannot show of it.
        seen = np.sqrt(own.noise**2 - own.line_offset**2)
        noise = (
            f"A single reading scatters by {number(seen * scale.factor)} {unit} (1 sd) about "
            "a smooth surface, wild readings left out. An offset of every line of readings, "
            f"{number(own.line_offset * scale.factor)} {unit} (1 sd), is assumed on top: one "
            "probing cannot show it. Probe twice to know."
        )
    yield ("Noise", noise)
    yield ("Wild readings", _loss(own.loss, readings))
    yield ("Smoothness", smoothness_sentence(fit, scale))
    yield (
        "Rounding",
        f"Rounding to whole list units moves the table by at most "
        f"{number(fit.rounding * scale.factor)} {unit}.",
    )
    if fit.streamed is not None and fit.streamed.every > 1:
        shown = (
            f"{grouped(fit.readings)} readings were read in pieces, and the table and the "
            "errors above rest on all of them. What is drawn of single readings, and said of "
            f"slices and cells, is one reading in {grouped(fit.streamed.every)} "
            f"({grouped(readings.size)})."
        )
        yield ("Shown", shown)
    if fit.cycles is not None:
        yield (
            "Reversal",
            f"The jump between the two directions is spread over {fit.cycles} "
            "cycles (n_backlash_cyc, P-AXIS-00243).",
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
        yield ("Suspect", " ".join(suspects))
    yield ("The fit itself", _fit_message(own.message, own.converged))


def _fit_message(message: str, converged: bool) -> str:
    text = message.strip()
    if text and text[-1] not in ".!?":
        text += "."
    if converged:
        return text or "The iterations reached their tolerance."
    return f"The iterations did NOT reach their tolerance. {text}".strip()


def _loss(loss: str, readings: Readings) -> str:
    wild, size = readings.total_wild, readings.total
    how = {
        "student": "Readings far from the others count less (Student's t)",
        "huber": "Readings far from the others count less (Huber)",
        "gauss": "All readings count fully (Gauss)",
    }.get(loss, f"Loss {loss}")
    if not wild:
        return f"{how}; none of {grouped(size)} was rejected as wild."
    were = "was" if wild == 1 else "were"
    return (
        f"{how}; {grouped(wild)} of {grouped(size)} "
        f"({percent(wild / size)}) {were} rejected as wild and "
        "had no influence."
    )


def smoothness_sentence(fit: TableResult, scale: Scale) -> str:
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


def _node_places(fit: TableResult, scale: Scale) -> list[str]:
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
    fit: TableResult, readings: Readings, scale: Scale, limit: int = 12
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
                grouped(
                    (row if fit.streamed is None else int(readings.order[row])) + 1
                ),
                f"{where} {scale.position}{direction}",
                run,
                f"{number(float(readings.before[row]), signed=True)} {scale.error}",
            )
        )
    return found
