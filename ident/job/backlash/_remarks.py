"""What the user must know of a backlash."""

from ...fit.backlash import BacklashFit
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
    remarks += [Remark("warning", words) for words in found.warnings]
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
