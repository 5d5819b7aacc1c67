"""What a fit takes from its measurements, and lengths at the reference temperature."""

import dataclasses
from typing import Literal

import numpy as np

from ...data.measurements import Measurement, reduce_length
from ..exchange import AbstractTable
from ..kinds._keys import FitSpec, TableSpec
from ._load import Job


@dataclasses.dataclass(frozen=True)
class Wanted:
    """What a fit takes from its measurements.

    Attributes:
        masters: Axes whose positions it needs, master 1 first.
        direction: ``needed``, ``welcome`` or ``no``.
        lengths: The error is one of length along the axis itself, so that it grows with
            the temperature of the scale.
    """

    masters: tuple[str, ...]
    direction: Literal["needed", "welcome", "no"]
    lengths: bool


def wanted_by(fit: TableSpec, table: AbstractTable) -> Wanted:
    """Return what a table fit takes from its measurements."""
    way: Literal["needed", "welcome", "no"] = "welcome" if fit.lengths else "no"
    return Wanted(fit.over, "needed" if table.branches == 2 else way, fit.lengths)


def reduced_to_reference(
    job: Job,
    name: str,
    measured: Measurement,
    wanted: Wanted,
    positions: np.ndarray,
    error: np.ndarray,
) -> tuple[np.ndarray, float | None]:
    """Return errors of length at the reference temperature, and their largest change.

    None where there was nothing to reduce.

    Args:
        job: The job.
        name: Of the measurement, whose specification states an expansion.
        measured: The measurement.
        wanted: Whether it is about lengths.
        positions: Of the masters, the axis itself first.
        error: As measured.
    """
    spec = job.spec.measurements[name]
    assert spec.expansion is not None
    if not wanted.lengths or spec.already_compensated:
        return error, None
    given = spec.material_temperature
    assert given is not None  # `find_fault` has seen to it
    warmth: float | np.ndarray
    if isinstance(given, str):
        warmth = measured.require(temperature_role(given), "as material_temperature")
    else:
        warmth = float(given)
    at = spec.datum.at if spec.datum is not None else 0.0
    datum = at if isinstance(at, float | int) else at[0]
    reduced = reduce_length(
        error,
        positions[:, 0],
        expansion=spec.expansion,
        material_temperature=warmth,
        reference_temperature=spec.reference_temperature,
        datum=float(datum),
    )
    return reduced, float(np.max(np.abs(reduced - error)))


def temperature_role(name: str) -> str:
    """Return the role of a sensor that a job names with or without its kind."""
    return name if name.startswith("temperature.") else f"temperature.{name}"


def words_of_reference(
    job: Job, name: str, fit: FitSpec, wanted: Wanted, change: float | None
) -> str:
    """Say what was done about the temperature; ``change`` is that of `reduced_to_reference`."""
    spec = job.spec.measurements[name]
    if not wanted.lengths:
        return (
            f"expansion of measurement {name!r} concerns lengths along an axis; the"
            f" error of {fit.axis} over other axes is taken as it is."
        )
    if spec.already_compensated or change is None:
        degrees = f"{spec.reference_temperature:g} °C"
        return f"Measurement {name!r} refers to {degrees} as it is."
    return (
        f"Measurement {name!r} was reduced to {spec.reference_temperature:g} °C; that"
        f" changed readings by up to {1e3 * change:.1f} µm."
    )


def at_reference(
    job: Job,
    name: str,
    measured: Measurement,
    fit: FitSpec,
    wanted: Wanted,
    positions: np.ndarray,
    error: np.ndarray,
) -> tuple[np.ndarray, str]:
    """Return `reduced_to_reference`, and what was done in words."""
    reduced, change = reduced_to_reference(
        job, name, measured, wanted, positions, error
    )
    return reduced, words_of_reference(job, name, fit, wanted, change)
