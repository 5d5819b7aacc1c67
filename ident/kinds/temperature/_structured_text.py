"""The law as a program for the PLC of the machine, in Structured Text (IEC 61131-3).

Two function blocks: the law, which is arithmetic alone, and around it the access to the
objects of the CNC by ADS ([001] p.22 to 23: TEMPC in the GEO task, port 551, group
16#120300). Both stand in ``program.st.jinja``; the same text comes as one ``.st`` file and
as the ``.TcPOU`` files that TwinCAT XAE takes into a project.
"""

import dataclasses
import functools
import uuid
from collections.abc import Mapping
from importlib import resources
from typing import Any

import jinja2

from ._law import ThermalLaw
from .keys import block_names, plain_name

_ID = uuid.UUID("8e0d8a0e-6a53-4c43-9d0f-5c7a3f0b6d11")
"""Name space of the ids of objects: the same block of an axis keeps its id."""


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
        sensors: Lag of the structure behind each sensor in s, by its name.
        offset: Sensor that moves the offset, and
        coefficient: the one that moves the coefficient.
        rates: What may change per second: offset in mm, coefficient in µm/m.
        sign: With which the CNC adds the line to the position, +1 or −1.
    """

    axis: str
    number: int
    title: str
    law: ThermalLaw
    position: float
    zero: float
    sensors: Mapping[str, float]
    offset: str
    coefficient: str
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
    head = f"{parts.head()}\n{parts.access_declaration()}"
    texts = {
        law: (parts.law_declaration(), parts.law_body()),
        access: (head, parts.access_body()),
    }
    template = _templates().get_template("pou.TcPOU.jinja")
    return {
        name: template.render(
            name=name, id=uuid.uuid5(_ID, name), declaration=declaration, body=body
        )
        for name, (declaration, body) in texts.items()
    }


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
    environment.filters |= {"ascii": _ascii, "declare": _declare}
    return environment


def _parts(program: PlcProgram) -> jinja2.environment.TemplateModule:
    """Return the program; its parts are functions of the module."""
    several = len(program.sensors) > 1
    # Names of variables that differ: the PLC knows no upper and lower case.
    words = {
        name: f"{k if several else ''}{plain_name(name).capitalize()}"
        for k, name in enumerate(program.sensors, 1)
    }
    sensors = [
        {
            "name": name,
            "word": word,
            "input": f"Temp{word}",
            "lag": program.sensors[name],
        }
        for name, word in words.items()
    ]
    values = vars(program) | {
        "name": plain_name(program.axis),
        "sensors": sensors,
        "offset_word": words[program.offset],
        "coefficient_word": words[program.coefficient],
    }
    return _templates().get_template("program.st.jinja").make_module(values)


def _declare(variable: str, comment: str) -> str:
    """Return the line of a variable with its comment, in a column."""
    return f"    {variable:<34}(* {comment} *)"


def _ascii(text: str) -> str:
    """Return a text that may stand in a comment of the PLC program."""
    plain = text.encode("ascii", "replace").decode()
    printable = "".join(sign if sign.isprintable() else " " for sign in plain)
    return printable.replace("(*", "(").replace("*)", ")")
