"""What events and tests of a crosstalk say of themselves, in sentences."""

import numpy as np

from ...kinds.crosstalk.effect import BRANCHES, SAFE_TESTS, CrosstalkFit
from .._result import Remark


def remarks_of_fit(fit: CrosstalkFit) -> list[Remark]:
    """Return what must be known of events and tests."""
    counts = np.bincount(
        [event.branch for event in fit.events], minlength=len(BRANCHES)
    )
    remarks = []
    if fit.directions == "unknown":
        missing = " or ".join(BRANCHES[k] for k in np.flatnonzero(counts == 0))
        words = (
            f"No event shows {missing}: whether the directions differ cannot be told,"
            " and nothing is known there."
        )
        remarks.append(Remark("warning", words))
    elif fit.directions != "given":
        words = {
            "differ": "The values differ by the direction of motion.",
            "alike": "The values are alike in both directions.",
        }[fit.directions]
        remarks.append(Remark("info", words))
    parts = ", ".join(
        f"{count} of {name}" for count, name in zip(counts, BRANCHES, strict=True)
    )
    remarks.append(Remark("info", f"{len(fit.events)} events: {parts}."))
    wild = sum(event.wild for event in fit.events)
    if wild:
        words = f"{wild} events contradict the others and were left out."
        remarks.append(Remark("warning", words))
    lacking = fit.support == 0
    empty = [BRANCHES[k] for k in np.flatnonzero(lacking.all(axis=1))]
    if empty:
        words = (
            f"Nothing is known for {' and '.join(empty)}: the entries of a test are"
            " written all four or not at all, so no test can be written."
        )
        return [*remarks, Remark("error", words)]
    for number in np.flatnonzero(lacking.any(axis=0)):
        place = ", ".join(f"{value:g}" for value in fit.points[number])
        names = [BRANCHES[k] for k in np.flatnonzero(lacking[:, number])]
        words = (
            f"The test at ({place}) mm is left out: no event for {' and '.join(names)}."
        )
        remarks.append(Remark("error", words))
    if len(fit.points) > SAFE_TESTS:
        words = f"{len(fit.points)} tests: one statement of the manuals allows fewer than 15."
        remarks.append(Remark("info", words))
    return remarks
