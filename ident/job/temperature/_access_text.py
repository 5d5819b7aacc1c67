"""The function block that reads and writes the objects of the CNC by ADS."""

from collections.abc import Sequence

_READ = """\
        Read(NETID := NetId, PORT := 551, IDXGRP := 16#120300,
            IDXOFFS := Base + {offset}, LEN := SIZEOF({variable}),
            DESTADDR := ADR({variable}), READ := TRUE, TMOUT := T#5s);
        IF NOT Read.BUSY THEN
            Failed := Read.ERR;
            Read(READ := FALSE);
            IF NOT Failed THEN
                {then}
            END_IF;
        END_IF;"""

_WRITE = """\
        Write(NETID := NetId, PORT := 551, IDXGRP := 16#120300,
            IDXOFFS := Base + {offset}, LEN := SIZEOF({variable}),
            SRCADDR := ADR({variable}), WRITE := TRUE, TMOUT := T#5s);
        IF NOT Write.BUSY THEN
            Failed := Write.ERR;
            Write(WRITE := FALSE);
            IF NOT Failed THEN
                State := {then};
            END_IF;
        END_IF;"""


def access_block(
    name: str, number: int, sensors: Sequence[tuple[str, str]], position: int
) -> list[str]:
    """Return the lines of the block around the law.

    Args:
        name: Of the axis, as an identifier.
        number: Of the axis.
        sensors: Word and comment of each sensor.
        position: Reference position in 0.1 µm.
    """
    inputs, passed = [], []
    for word, comment in sensors:
        inputs += sensor_inputs(word, comment)
        passed += [f"{word} := {word}, {word}Ok := {word}Ok, "]
    steps = [
        ("0: (* what the CNC has: coefficient *)",
         _read("16#43", "StartCoefficient", "State := 1;")),
        ("1: (* and offset; the law goes on from there *)",
         _read("16#44", "StartOffset0", "Starting := TRUE;\n                State := 2;")),
        ("2: (* the axis list holds the same position: this changes nothing *)",
         _write("16#45", "Position0", "3")),
        ("3: (* homed and switched on? *)", _read("16#1D8", "IsActive", "State := 4;")),
        ("4: (* what the law says *)", _write("16#44", "SendOffset0", "5")),
        ("5: (* and then again from 3 *)", _write("16#43", "SendCoefficient", "3")),
    ]  # fmt: skip
    body: list[str] = []
    for label, text in steps:
        body += [f"    {label}", *text.split("\n")]
    return [
        "(* Access to the CNC: port 551 (GEO), group 16#120300, objects TEMPC. *)",
        f"FUNCTION_BLOCK FB_TempComp_{name}",
        "VAR_INPUT",
        *inputs,
        declare("CycleTime : LREAL := 0.01;", "of the PLC task in s"),
        declare(f"AxisIndex : UDINT := {number};",
                "<A> of the offsets 16#<A>0043 ...: compare with the object browser"),
        declare("NetId : T_AmsNetId := '';", "'' = this controller"),
        "END_VAR",
        "VAR_OUTPUT",
        declare("Failed : BOOL;", "the last access to the CNC failed; it is repeated"),
        declare("Holding : BOOL;", "a sensor failed; the last values are held"),
        "END_VAR",
        "VAR",
        f"    Law : FB_TempCompLaw_{name};",
        "    Read : ADSREAD;",
        "    Write : ADSWRITE;",
        "    State : INT;",
        "    Base : UDINT;",
        declare(f"Position0 : DINT := {position};", "TEMPC::position_0 in 0.1 um"),
        "    StartOffset0 : DINT;",
        "    StartCoefficient : LREAL;",
        declare("Starting : BOOL;", "the law is to start from what the CNC has"),
        declare("IsActive : BOOL;", "TEMPC::f_is_active"),
        declare("SendOffset0 : DINT;", "TEMPC::offset_0 in 0.1 um"),
        declare("SendCoefficient : LREAL;", "TEMPC::coefficient in um/m"),
        "END_VAR",
        "",
        "Base := AxisIndex * 16#10000;",
        "IF State >= 3 THEN",
        f"    Law({''.join(passed)}CycleTime := CycleTime,",
        "        Active := IsActive, Preset := Starting, PresetOffset0 := StartOffset0,",
        "        PresetCoefficient := StartCoefficient);",
        "    (* Until it is known whether it is active, the law stays where it starts. *)",
        "    Starting := Starting AND (State = 3);",
        "    Holding := Law.Holding;",
        "END_IF;",
        "",
        "IF NOT Write.BUSY THEN",
        "    (* What is being written does not change meanwhile. *)",
        "    SendOffset0 := Law.Offset0;",
        "    SendCoefficient := Law.Coefficient;",
        "END_IF;",
        "",
        "CASE State OF",
        *body,
        "END_CASE;",
        "END_FUNCTION_BLOCK",
    ]  # fmt: skip


def declare(variable: str, comment: str) -> str:
    """Return the line of a variable with its comment, in a column."""
    return f"    {variable:<34}(* {comment} *)"


def sensor_inputs(word: str, comment: str) -> list[str]:
    """Return the inputs of a sensor."""
    return [
        declare(f"{word} : LREAL;", f"sensor '{comment}' in degC"),
        declare(f"{word}Ok : BOOL;", "FALSE: sensor or terminal has a fault"),
    ]


def _read(offset: str, variable: str, then: str) -> str:
    return _READ.format(offset=offset, variable=variable, then=then)


def _write(offset: str, variable: str, then: str) -> str:
    return _WRITE.format(offset=offset, variable=variable, then=then)
