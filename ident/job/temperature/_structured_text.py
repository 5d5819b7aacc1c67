"""The law as IEC 61131-3 Structured Text for the PLC of the machine.

Two function blocks: the law, which is arithmetic alone, and around it the access to the
objects of the CNC by ADS ([001] p.22 to 23: TEMPC in the GEO task, port 551, group 16#120300).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._plc_names import plain_name
from ._access_text import access_block, declare, sensor_inputs
from ._table import ThermalLaw

_BEYOND = 40.0
"""K outside the measured temperatures from which a reading is that of a broken sensor."""


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
    name = plain_name(program.axis)
    inputs = [(each.input, ascii_comment(each.name)) for each in program.sensors]
    return "\n".join(
        [
            *_head(program, name),
            "",
            *_law_block(program, name),
            "",
            *access_block(name, program.number, inputs, round(program.position * 1e4)),
            "",
        ]
    )


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


def _head(program: PlcProgram, name: str) -> list[str]:
    low, high = program.law.temperature[[0, -1]]
    title = ascii_comment(program.title)
    axis = ascii_comment(program.axis)
    return [
        f"(* Temperature compensation of axis {axis}, written by axcomp.",
        f"   Job: {title}",
        "",
        "   line(T, s) = offset_0(T) + coefficient(T) * (s - position_0)",
        f"   The CNC {'adds it to' if program.sign > 0 else 'takes it off'} the position:"
        f" it is the measured deviation{' with the other sign' * (program.sign > 0)}.",
        "",
        f"   Measured from {low:.2f} to {high:.2f} degC; outside, the nearest value is",
        f"   held. Nothing is corrected at {program.zero:.2f} degC, the state of the axis",
        "   list, so that a machine whose program never ran is not wrong. A PLC that",
        "   stops leaves its last values in the CNC: switch the compensation off then",
        "   (COMP OFF TEMP) before the temperature has changed.",
        "",
        f"   Call FB_TempComp_{name} in every cycle of one PLC task. It needs the",
        "   library Tc2_System (ADSREAD, ADSWRITE). *)",
    ]


def _law_block(program: PlcProgram, name: str) -> list[str]:
    law, last = program.law, len(program.law.temperature) - 1
    offset_rate, slope_rate = program.rates
    lines = [
        "(* The law alone: temperatures in, parameters out. No access to the CNC. *)",
        f"FUNCTION_BLOCK FB_TempCompLaw_{name}",
        "VAR_INPUT",
    ]
    for each in program.sensors:
        lines += sensor_inputs(each.input, ascii_comment(each.name))
    lines += [
        declare("CycleTime : LREAL;", "time between two calls in s"),
        declare("Active : BOOL;", "TEMPC::f_is_active: homed and switched on"),
        declare("Preset : BOOL;", "TRUE: take over the two values below"),
        declare("PresetOffset0 : DINT;", "what the CNC has, 0.1 um"),
        declare("PresetCoefficient : LREAL;", "what the CNC has, um/m"),
        "END_VAR",
        "VAR_OUTPUT",
        declare("Offset0 : DINT;", "for TEMPC::offset_0 in 0.1 um"),
        declare("Coefficient : LREAL;", "for TEMPC::coefficient in um/m"),
        declare("Holding : BOOL;", "TRUE: a sensor failed, the values are held"),
        "END_VAR",
        "VAR",
    ]
    for each in program.sensors:
        lines += [
            declare(f"Structure{each.word} : LREAL;", "temperature of the structure"),
            declare(f"Known{each.word} : BOOL;", "it has been set"),
        ]
    lines += [
        declare("Index : INT;", "row of the table below the temperature"),
        declare("Inside : LREAL;", "temperature within the measured range, degC"),
        declare("Share : LREAL;", "way from that row to the next"),
        declare("Wanted : LREAL;", "what the table says"),
        declare("Most : LREAL;", "largest change in one call"),
        declare("OffsetNow : LREAL;", "0.1 um"),
        declare("CoefficientNow : LREAL;", "um/m"),
        "END_VAR",
        "VAR CONSTANT",
        f"    LAST_ROW : INT := {last};",
        f"    TEMPERATURES : ARRAY[0..{last}] OF LREAL := [  (* degC *)",
        *_array(law.temperature, 4),
        f"    OFFSETS : ARRAY[0..{last}] OF LREAL := [  (* 0.1 um *)",
        *_array(law.offset * 1e4, 2),
        f"    COEFFICIENTS : ARRAY[0..{last}] OF LREAL := [  (* um/m *)",
        *_array(law.coefficient, 4),
        declare(f"LOWEST : LREAL := {law.temperature[0] - _BEYOND:.1f};",
                "degC; a sensor below it has failed"),
        declare(f"HIGHEST : LREAL := {law.temperature[-1] + _BEYOND:.1f};",
                "degC; a sensor above it has failed"),
        declare(f"OFFSET_RATE : LREAL := {offset_rate * 1e4:.6f};",
                "largest change, 0.1 um per s"),
        declare(f"COEFFICIENT_RATE : LREAL := {slope_rate:.6f};",
                "largest change, um/m per s"),
    ]  # fmt: skip
    lines += [
        declare(
            f"LAG_{each.word.upper()} : LREAL := {each.lag:.1f};",
            "the structure follows its sensor so late, s",
        )
        for each in program.sensors
    ]
    lines += ["END_VAR", "", *_holding(program), "IF NOT Holding THEN"]
    for each in program.sensors:
        lines += _lag(each)
    lines += [
        "END_IF;",
        "",
        "IF Preset THEN",
        "    (* After a start of the PLC: go on from what the CNC has, without a step. *)",
        "    OffsetNow := DINT_TO_LREAL(PresetOffset0);",
        "    CoefficientNow := PresetCoefficient;",
        "ELSIF NOT Holding THEN",
        "    (* While it is not active, the values may be right at once: the CNC spreads",
        "       switching over temp_comp_n_cycles. *)",
    ]
    lines += _look_up(program.sensors[program.offset], "OFFSET", "OffsetNow")
    lines += _look_up(
        program.sensors[program.coefficient], "COEFFICIENT", "CoefficientNow"
    )
    return [
        *lines,
        "END_IF;",
        "",
        "Offset0 := LREAL_TO_DINT(OffsetNow);",
        "Coefficient := CoefficientNow;",
        "END_FUNCTION_BLOCK",
    ]


def _array(values: Float[np.ndarray, " n"], digits: int) -> list[str]:
    numbers = [f"{value:.{digits}f}" for value in values]
    return [
        *(f"        {number}," for number in numbers[:-1]),
        f"        {numbers[-1]}];",
    ]


def _holding(program: PlcProgram) -> list[str]:
    sound = [
        f"{each.input}Ok AND ({each.input} >= LOWEST) AND ({each.input} <= HIGHEST)"
        for each in program.sensors
    ]
    lines = [
        "(* A value that is no number compares as FALSE, and is held off as well. *)",
        f"Holding := NOT ({sound[0]}",
    ]
    lines += [f"    AND {each}" for each in sound[1:]]
    lines[-1] += ");"
    return lines


def _lag(sensor: PlcSensor) -> list[str]:
    word = sensor.word
    return [
        f"    IF NOT Known{word} THEN",
        f"        Structure{word} := {sensor.input};",
        f"        Known{word} := TRUE;",
        "    END_IF;",
        f"    Structure{word} := Structure{word} + ({sensor.input} - Structure{word})",
        f"        * CycleTime / (LAG_{word.upper()} + CycleTime);",
    ]


def _look_up(sensor: PlcSensor, table: str, value: str) -> list[str]:
    temperature = f"Structure{sensor.word}"
    return [
        f"    Inside := LIMIT(TEMPERATURES[0], {temperature}, TEMPERATURES[LAST_ROW]);",
        "    Index := 0;",
        "    WHILE (Index < LAST_ROW - 1) AND (Inside > TEMPERATURES[Index + 1]) DO",
        "        Index := Index + 1;",
        "    END_WHILE;",
        "    Share := (Inside - TEMPERATURES[Index])",
        "        / (TEMPERATURES[Index + 1] - TEMPERATURES[Index]);",
        f"    Wanted := {table}S[Index]",
        f"        + Share * ({table}S[Index + 1] - {table}S[Index]);",
        "    IF Active THEN",
        f"        Most := {table}_RATE * CycleTime;",
        f"        {value} := LIMIT({value} - Most, Wanted, {value} + Most);",
        "    ELSE",
        f"        {value} := Wanted;",
        "    END_IF;",
    ]
