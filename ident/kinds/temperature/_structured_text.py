"""The law as a program for the PLC of the machine, in Structured Text (IEC 61131-3).

Two function blocks: the law, which is arithmetic alone, and around it the access to the
objects of the CNC by ADS ([001] p.22 to 23: TEMPC in the GEO task, port 551, group
16#120300). Both stand in ``program.st.jinja``; the same text comes as one ``.st`` file and
as the ``.TcPOU`` files that TwinCAT XAE takes into a project.
"""

import dataclasses
import functools
import uuid
from collections.abc import Sequence
from importlib import resources
from typing import Any

import jinja2
import numpy as np
from jaxtyping import Float

from ._law import ThermalLaw
from .keys import block_names, plain_name

_BEYOND = 40.0
"""K outside the measured temperatures from which a reading is that of a broken sensor."""
_PROGRAM, _OBJECT = "program.st.jinja", "pou.TcPOU.jinja"
_ID = uuid.UUID("8e0d8a0e-6a53-4c43-9d0f-5c7a3f0b6d11")
"""Name space of the ids of objects: the same block of an axis keeps its id."""


@dataclasses.dataclass(frozen=True)
class PlcSensor:
    """A sensor as the PLC program takes it.

    Attributes:
        name: In the job.
        lag: Time constant of the structure behind it in s; 0 = none.
        word: Its part of the names of variables.
    """

    name: str
    lag: float
    word: str

    @property
    def input(self) -> str:
        """Name of the input that takes its temperature."""
        return f"Temp{self.word}"


@dataclasses.dataclass(frozen=True)
class PlcProgram:
    """What the PLC program of an axis holds.

    Attributes:
        axis: Name in the job.
        number: Of the axis.
        title: Of the job, for the first comment.
        law: In the sign of the entries.
        position: Reference position in mm.
        zero: Temperature at which nothing is corrected, in °C.
        sensors: All that the law follows.
        offset: Which of them moves the offset, and
        coefficient: the coefficient.
        rates: What may change per second: offset in mm, coefficient in µm/m.
        sign: With which the CNC adds the line to the position, +1 or −1.
    """

    axis: str
    number: int
    title: str
    law: ThermalLaw
    position: float
    zero: float
    sensors: Sequence[PlcSensor]
    offset: int
    coefficient: int
    rates: tuple[float, float]
    sign: int = 1


def structured_text(program: PlcProgram) -> str:
    """Return the PLC program, in ASCII."""
    return str(_parts(program))


def plc_objects(program: PlcProgram) -> dict[str, str]:
    """Return each function block as XAE imports it: XML by name of the block.

    The comment at the head of the program stands before the block that is called.
    """
    parts: Any = _parts(program)
    law, access = block_names(program.axis)
    texts = {
        law: (parts.law_declaration(), parts.law_body()),
        access: (
            f"{parts.head()}\n{parts.access_declaration()}",
            parts.access_body(),
        ),
    }
    template = _templates().get_template(_OBJECT)
    return {
        name: template.render(
            name=name, id=uuid.uuid5(_ID, name), declaration=declaration, body=body
        )
        for name, (declaration, body) in texts.items()
    }


def plc_sensors(names: Sequence[str], lags: Sequence[float]) -> tuple[PlcSensor, ...]:
    """Return sensors with names of variables that differ, whatever they are called."""
    several = len(names) > 1
    return tuple(
        # The PLC knows no difference between upper and lower case.
        PlcSensor(
            name, lag, f"{k + 1 if several else ''}{plain_name(name).capitalize()}"
        )
        for k, (name, lag) in enumerate(zip(names, lags, strict=True))
    )


def ascii_comment(text: str) -> str:
    """Return a text that may stand in a comment of the PLC program."""
    plain = text.encode("ascii", "replace").decode()
    printable = "".join(sign if sign.isprintable() else " " for sign in plain)
    return printable.replace("(*", "(").replace("*)", ")")


@functools.cache
def _templates() -> jinja2.Environment:
    folder = resources.files("axcomp.ident.kinds.temperature")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(
            lambda name: folder.joinpath(name).read_text("utf-8")
        ),
        autoescape=False,  # no HTML; the comments are made safe, CDATA is closed by no text
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["declare"] = _declare
    return environment


def _parts(program: PlcProgram) -> jinja2.environment.TemplateModule:
    """Return the program; its parts are functions of the module."""
    return _templates().get_template(_PROGRAM).make_module(_variables(program))


def _declare(variable: str, comment: str) -> str:
    """Return the line of a variable with its comment, in a column."""
    return f"    {variable:<34}(* {comment} *)"


def _variables(program: PlcProgram) -> dict[str, Any]:
    """Return what the template is filled with, in the units of the PLC."""
    law, sensors = program.law, program.sensors
    low, high = (float(end) for end in law.temperature[[0, -1]])
    offset_rate, coefficient_rate = program.rates
    return {
        "axis": ascii_comment(program.axis),
        "name": plain_name(program.axis),
        "title": ascii_comment(program.title),
        "number": program.number,
        "sign": program.sign,
        "position": round(program.position * 1e4),
        "zero": program.zero,
        "low": low,
        "high": high,
        "lowest": low - _BEYOND,
        "highest": high + _BEYOND,
        "last": len(law.temperature) - 1,
        "temperatures": _numbers(law.temperature, 4),
        "offsets": _numbers(law.offset * 1e4, 2),
        "coefficients": _numbers(law.coefficient, 4),
        "offset_rate": offset_rate * 1e4,
        "coefficient_rate": coefficient_rate,
        "sensors": [
            {
                "input": one.input,
                "comment": ascii_comment(one.name),
                "word": one.word,
                "lag": one.lag,
            }
            for one in sensors
        ],
        "offset_word": sensors[program.offset].word,
        "coefficient_word": sensors[program.coefficient].word,
    }


def _numbers(values: Float[np.ndarray, " n"], digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]
