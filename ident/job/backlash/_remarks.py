"""What the user must know of a backlash."""

from ...kinds.backlash.effect import BacklashFit
from .._result import Remark
from ._recording import Recording


def remarks_of(
    recording: Recording, found: BacklashFit, known: bool, active: bool
) -> list[Remark]:
    """Return all remarks.

    Args:
        recording: What was measured.
        found: The estimate.
        known: An axis list says in which direction the axis is right.
        active: Whether backlash was active while measuring.
    """
    remarks = list(recording.remarks)
    if not found.significant:
        remarks.append(
            Remark(
                "warning",
                recording.in_unit(
                    f"No backlash shows: {1e3 * found.width:.2f} µm ±"
                    f" {1e3 * found.standard_deviation:.2f} µm is less than 3 standard"
                    " deviations. Nothing is written."
                ),
            )
        )
    else:
        remarks.append(Remark("info", f"{found.kind.capitalize()}."))
    remarks += [
        Remark("warning", recording.in_unit(words)) for words in _warnings(found)
    ]
    if not known and found.significant:
        remarks.append(
            Remark(
                "warning",
                "The axis is taken as right when it moves in positive direction"
                " (anwahl_losekomp 1), since no axis list says otherwise. Where it"
                " was referenced or its tables were measured moving the other way,"
                " 2 is right; the wrong one shifts all positions by the width.",
            )
        )
    if active:
        remarks.append(
            Remark(
                "info",
                "Backlash was active while measuring: the new size is old + what"
                " was left.",
            )
        )
    return remarks


def _warnings(found: BacklashFit) -> list[str]:
    """Return what must be known before the width is used, lengths in µm."""
    words = []
    if found.drift is not None:
        drift, width = found.drift
        words.append(
            f"The readings drift by {1e3 * drift:.1f} µm within a run, which counts as"
            f" backlash: with the drift taken off it is {1e3 * width:.1f} µm."
        )
    if found.delay_gain is not None:
        words.append(
            "All reversals run at one speed: a delay of 0.1 ms between the instruments"
            f" would count as {0.1 * found.delay_gain:.2g} µm of backlash, and nothing"
            " here tells them apart."
        )
    along = found.dependence
    if along is not None and along.significant:
        words.append(
            f"The backlash changes along the axis by {1e3 * along.variation:.1f} µm rms"
            f" ({1e3 * along.slope:+.1f} µm from one end to the other): one number"
            " cannot take it away, a bilateral leadscrew table is the better answer."
        )
    return words
