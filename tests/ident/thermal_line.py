"""A thermal line of X fitted to arrays: readings of its sensors, and what is asked for."""

import numpy as np

from axcomp.ident.fit.joint import JointData, Temperature
from axcomp.ident.kinds.temperature._fit import fit_temperature
from axcomp.ident.kinds.temperature._line import TemperatureFit


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
    lag: float | str = "fit",
) -> TemperatureFit:
    """Return the line of two sensors, as a job asks for it that leaves the rest open."""
    laws = ("offset", "coefficient")
    sensors = {
        name: sensor
        for name, sensor in zip(laws, (offset, coefficient), strict=True)
        if sensor is not None
    }
    middle = 0.0
    if "X" in data.position:
        place = data.position["X"]
        middle = 0.5 * float(place.min() + place.max())
    line = Temperature(
        "X",
        sensors,
        reference=middle if reference is None else reference,
        law={} if law is None else dict(zip(laws, law, strict=True)),
        lag=lag,
    )
    return fit_temperature(data, line, meet=reference is None)
