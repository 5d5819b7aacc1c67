"""A thermal line of X fitted to arrays: readings of its sensors, and what is asked for."""

import tempfile
from pathlib import Path

import numpy as np

from axcomp.ident.fit.joint import JointData
from axcomp.ident.job import load_job
from axcomp.ident.kinds.temperature._draft import TemperatureDraft
from axcomp.ident.kinds.temperature._line import TemperatureFit
from axcomp.ident.readings import Tables

JOB = """
[axes.X]
number = 1
[measurements.warm]
file = "warm.csv"
remove = "none"
[[fits]]
compensation = "temperature"
axis = "X"
measurement = "warm"
"""


def readings(
    error: np.ndarray,
    *temperatures: np.ndarray,
    position: np.ndarray | None = None,
    time: np.ndarray | None = None,
) -> JointData:
    """Return errors of X with sensors ``"1"``, ``"2"``, …."""
    return JointData(
        position={} if position is None else {"X": position},
        error={"X": error},
        temperature={str(k): warm for k, warm in enumerate(temperatures, 1)},
        time=time,
    )


def fitted(
    data: JointData,
    *,
    offset: str | None = "1",
    coefficient: str | None = "1",
    law: tuple[str | int, str | int] | None = None,
    reference: float | None = None,
    lag: float | str = "auto",
) -> TemperatureFit:
    """Return the line of two sensors, as a job asks for it that leaves the rest open."""
    sensors = {"offset": offset, "coefficient": coefficient}
    sensors = {name: sensor for name, sensor in sensors.items() if sensor is not None}
    columns = {"X.error": data.error["X"]}
    columns |= {f"{axis}.position": place for axis, place in data.position.items()}
    columns |= {f"temperature.{k}": warm for k, warm in data.temperature.items()}
    if data.time is not None:
        columns["time"] = data.time
    keys = [f"sensors = {_table(sensors)}", f"lag = {lag!r}"]
    if law is not None:
        laws: dict[str, str | int] = {"offset": law[0], "coefficient": law[1]}
        keys.append(f"law = {_table({k: laws[k] for k in sensors})}")
    if reference is not None:
        keys.append(f"reference = {reference}")
    with tempfile.TemporaryDirectory() as folder:
        rows = np.column_stack(list(columns.values()))
        name = Path(folder, "warm.csv")
        heads = ",".join(columns)
        np.savetxt(name, rows, "%.17g", ",", header=heads, comments="")
        path = Path(folder, "job.toml")
        path.write_text(JOB + "\n".join(keys))
        job = load_job(path)
        tables = Tables(job)
        (fit,) = job.spec.fits
        draft = fit.kind.planner.plan(tables, 0, fit).fit_single(tables, {})
    assert isinstance(draft, TemperatureDraft)
    return draft.found


def _table(values: dict[str, str] | dict[str, str | int]) -> str:
    """Return values as a table of TOML."""
    return "{ " + ", ".join(f"{k} = {v!r}" for k, v in values.items()) + " }"
