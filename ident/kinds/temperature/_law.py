"""The law over the temperature: its table and program for the PLC.

The program is Structured Text (IEC 61131-3) in ``program.st.jinja``: the law, which is
arithmetic alone, and around it the access to the objects of the CNC by ADS ([001] p.22 to 23:
TEMPC in the GEO task, port 551, group 16#120300). The same text comes as one ``.st`` file and as
the ``.TcPOU`` files that TwinCAT XAE takes into a project.
"""

import dataclasses
import uuid
from collections.abc import Mapping
from typing import Any

import jinja2
import numpy as np
from jaxtyping import Float

from ..._templates import templates
from ._line import TemperatureFit
from .entries import COLUMNS, SENSORS
from .keys import block_names, plain_name

_SAME = 1e-3
"""K within which two rows are one."""
RATE = 0.001
"""mm/s: 60 µm in a minute, faster than structures move and slower than any path minds."""
_IDLE = 1.0
"""µm/m per s, for a coefficient that is to be 0."""
_ID = uuid.UUID("8e0d8a0e-6a53-4c43-9d0f-5c7a3f0b6d11")
"""Name space of the ids of objects: the same block of an axis keeps its id."""


@dataclasses.dataclass(frozen=True)
class ThermalLaw:
    """Parameters of the line over the temperature, in the sign of the entries.

    Linear between the rows, held outside. With two sensors each column follows its own.

    Attributes:
        temperature: In °C, ascending.
        offset: In mm (P-AXIS-00273).
        coefficient: In µm/m (P-AXIS-00274).
        offset_deviation: Standard deviation in mm.
        coefficient_deviation: In µm/m.
    """

    temperature: Float[np.ndarray, " n"]
    offset: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    offset_deviation: Float[np.ndarray, " n"]
    coefficient_deviation: Float[np.ndarray, " n"]

    @property
    def columns(self) -> dict[str, Float[np.ndarray, " n"]]:
        """The table as the PLC has it: °C, mm, µm/m."""
        values = self.temperature, self.offset, self.coefficient
        return dict(zip(COLUMNS, values, strict=True))

    @property
    def deviations(self) -> dict[str, Float[np.ndarray, " n"]]:
        """Standard deviations of its parameters, in their units."""
        values = self.offset_deviation, self.coefficient_deviation
        return dict(zip(COLUMNS[1:], values, strict=True))

    def csv(self, offset_sensor: str, coefficient_sensor: str) -> str:
        """Return the table as CSV; it names the sensors where they are two."""
        rows = zip(*self.columns.values(), strict=True)
        lines = [f"{warm:.4f},{offset:.6f},{slope:.4f}" for warm, offset, slope in rows]
        head = [*COLUMNS]
        if offset_sensor != coefficient_sensor:
            head += SENSORS
            lines = [f"{line},{offset_sensor},{coefficient_sensor}" for line in lines]
        return "\n".join([",".join(head), *lines]) + "\n"

    def largest(self, distance: Float[np.ndarray, " p"]) -> tuple[float, float, int]:
        """Return the largest correction in mm, its temperature in °C, and where.

        Args:
            distance: Places in mm from the reference position.
        """
        offset = self.offset[:, None] + 1e-6 * np.outer(self.coefficient, distance)
        row, place = np.unravel_index(int(np.argmax(np.abs(offset))), offset.shape)
        return abs(float(offset[row, place])), float(self.temperature[row]), int(place)


def thermal_law(fit: TemperatureFit, zero: float, sign: int) -> ThermalLaw:
    """Return the law that takes the error of a line away; the sign is that of offset per Δs.

    Where the temperature in °C at which it is zero lies inside, that is a row of its own.
    """
    nodes = np.concatenate([law.temperature for law in fit.moving])
    if nodes.min() < zero < nodes.max():
        nodes = np.append(nodes, zero)
    rows = np.unique(np.round(nodes, 4))
    rows = rows[np.append(True, np.diff(rows) > _SAME)]
    offset, slope = fit.offset, fit.coefficient
    none = np.zeros(len(rows))
    coefficient = none if slope is None else -sign * 1e6 * slope.at(rows)
    return ThermalLaw(
        temperature=rows,
        # 1 nm and 0.1 nm over a metre: far below the unit of the controller.
        offset=np.round(-sign * offset.at(rows), 6) + 0.0,
        coefficient=np.round(coefficient, 4) + 0.0,
        offset_deviation=offset.deviation_at(rows),
        coefficient_deviation=none if slope is None else 1e6 * slope.deviation_at(rows),
    )


def rates(distance: Float[np.ndarray, " p"]) -> tuple[float, float]:
    """Return what the PLC may change per second: offset in mm, coefficient in µm/m.

    Both together move the farthest position with `RATE` at most. Neither is 0: what an
    earlier program left in the controller must be able to go.

    Args:
        distance: Places in mm from the reference position; one: there is no coefficient.
    """
    if len(distance) == 1:
        return RATE, _IDLE
    return 0.5 * RATE, 0.5 * RATE / (1e-6 * max(float(np.abs(distance).max()), 1.0))


def structured_text(program: Mapping[str, Any]) -> str:
    """Return the PLC program, in ASCII.

    Args:
        program: What the template names: axis, its number, title of the job, law, position
            of the reference in mm, zero (°C at which nothing is corrected), sensors (lag of
            the structure behind each in s, by name), those of offset and coefficient, rates
            per second, and the sign with which the CNC adds the line.
    """
    return str(_parts(program))


def plc_objects(program: Mapping[str, Any]) -> dict[str, str]:
    """Return each function block as XAE imports it: XML by name of the block.

    The comment at the head of the program stands before the block that is called.
    """
    parts: Any = _parts(program)
    law, access = block_names(program["axis"])
    head = f"{parts.head()}\n{parts.access_declaration()}"
    texts = {
        law: (parts.law_declaration(), parts.law_body()),
        access: (head, parts.access_body()),
    }
    template = templates(__package__ or "").get_template("pou.TcPOU.jinja")
    return {
        name: template.render(
            name=name, id=uuid.uuid5(_ID, name), declaration=declaration, body=body
        )
        for name, (declaration, body) in texts.items()
    }


def _parts(program: Mapping[str, Any]) -> jinja2.environment.TemplateModule:
    """Return the program; its parts are functions of the module."""
    lags = program["sensors"]
    # Names of variables that differ: the PLC knows no upper and lower case.
    words = {
        name: f"{k if len(lags) > 1 else ''}{plain_name(name).capitalize()}"
        for k, name in enumerate(lags, 1)
    }
    sensors = [
        {"name": name, "word": word, "input": f"Temp{word}", "lag": lags[name]}
        for name, word in words.items()
    ]
    values = {
        **program,
        "name": plain_name(program["axis"]),
        "sensors": sensors,
        "offset_word": words[program["offset"]],
        "coefficient_word": words[program["coefficient"]],
    }
    template = templates(__package__ or "").get_template("program.st.jinja")
    return template.make_module(values)
