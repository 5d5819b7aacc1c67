"""The PLC program that a temperature job writes, run as the PLC would run it."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from axcomp.ident.job import ThermalLaw
from axcomp.ident.kinds.temperature._law import (
    plc_objects,
    structured_text,
)

Env = dict[str, Any]
Make = Callable[..., Any]

LAW = ThermalLaw(
    temperature=np.array([20.0, 25.0, 40.0]),
    offset=np.array([0.0, 0.0123, -0.0400]),
    coefficient=np.array([0.0, -55.5, -220.25]),
    offset_deviation=np.zeros(3),
    coefficient_deviation=np.zeros(3),
)
CYCLE = 0.01
RATES = (0.0005, 0.4)


def program_of(
    lag: float = 0.0, names: tuple[str, ...] = ("frame",), **changes: Any
) -> dict[str, Any]:
    given: dict[str, Any] = {
        "axis": "X", "number": 1, "title": "Mill", "law": LAW, "position": -200.1996,
        "zero": 20.0, "offset": names[0], "coefficient": names[-1], "rates": RATES, "sign": 1,
    }  # fmt: skip
    sensors = dict.fromkeys(names, lag)
    return {**given, "sensors": sensors, **changes}


def text_of(
    lag: float = 0.0, names: tuple[str, ...] = ("frame",), **changes: Any
) -> str:
    return structured_text(program_of(lag, names, **changes))


@pytest.fixture
def law_block(program: Make) -> Make:
    """Return what makes the law alone, behind a lag in s."""

    def make(lag: float = 0.0) -> Any:
        library = {"ADSREAD": dict, "ADSWRITE": dict}
        return program(text_of(lag), library).new("FB_TempCompLaw_X")

    return make


def cycle(block: Any, warm: float, ok: bool = True, active: bool = True) -> Env:
    return block.cycle(
        TempFrame=warm, TempFrameOk=ok, CycleTime=CYCLE, Active=active,
        Preset=False, PresetOffset0=0, PresetCoefficient=0.0,
    )  # fmt: skip


@pytest.mark.parametrize("warm", [-5.0, 20.0, 22.5, 25.0, 33.3, 40.0, 70.0])
def test_program_gives_the_table_and_holds_its_ends(
    law_block: Make, warm: float
) -> None:
    env = cycle(law_block(), warm, active=False)
    expected = np.interp(warm, LAW.temperature, LAW.coefficient)
    assert env["COEFFICIENT"] == pytest.approx(
        expected, abs=1e-9
    )  # the same arithmetic
    # Whole units of 0.1 µm: half of one is lost.
    offset = 1e4 * float(np.interp(warm, LAW.temperature, LAW.offset))
    assert abs(env["OFFSET0"] - offset) <= 0.5 + 1e-9


def test_active_values_move_no_faster_than_the_rate(law_block: Make) -> None:
    block = law_block()
    cycle(block, 20.0)
    before, offsets = 0.0, [0.0]
    for _ in range(200):
        env = cycle(block, 40.0)
        assert abs(env["COEFFICIENT"] - before) <= RATES[1] * CYCLE * (1 + 1e-9)
        before = env["COEFFICIENT"]
        offsets.append(env["OFFSETNOW"])
    steps = np.abs(np.diff(offsets))
    assert steps.max() <= 1e4 * RATES[0] * CYCLE * (1 + 1e-9)
    # 2 s at the rate, and it is under way.
    assert before == pytest.approx(-RATES[1] * 200 * CYCLE, rel=1e-9)


@pytest.mark.parametrize(
    ("warm", "ok"), [(30.0, False), (math.nan, True), (850.0, True), (-180.0, True)]
)
def test_failed_sensor_holds_the_values(law_block: Make, warm: float, ok: bool) -> None:
    block = law_block(lag=100.0)
    sound = dict(cycle(block, 30.0, active=False))
    for _ in range(50):
        env = cycle(block, warm, ok)
        assert env["HOLDING"]
        assert (env["OFFSET0"], env["COEFFICIENT"]) == (
            sound["OFFSET0"],
            sound["COEFFICIENT"],
        )
    assert not cycle(block, 30.0)["HOLDING"]
    # The structure did not follow the broken sensor either.
    assert block.env["STRUCTUREFRAME"] == pytest.approx(30.0, abs=1e-9)


def test_failed_sensor_stops_a_ramp_where_it_is(law_block: Make) -> None:
    block = law_block()
    moving = dict(cycle(block, 20.0))
    for _ in range(20):
        moving = dict(cycle(block, 40.0))
    assert moving["COEFFICIENT"] < 0
    for _ in range(20):
        env = cycle(block, 40.0, ok=False)
        assert env["COEFFICIENT"] == moving["COEFFICIENT"]
    assert cycle(block, 40.0)["COEFFICIENT"] < moving["COEFFICIENT"]


def test_structure_follows_its_sensor_with_the_time_constant(law_block: Make) -> None:
    block = law_block(lag=3.0)
    env = cycle(block, 20.0, active=False)
    for _ in range(300):
        env = cycle(block, 30.0, active=False)
    # One time constant after a step: 1 − 1/e; the first-order rule errs by cycle/lag.
    expected = 20.0 + 10.0 * (1 - math.exp(-1))
    assert env["STRUCTUREFRAME"] == pytest.approx(expected, abs=10.0 * CYCLE / 3.0)


class Cnc:
    """The objects of one axis, with the lengths and units of [001] p.22 to 23."""

    def __init__(self, **values: Any) -> None:
        self.values = {0x10043: 0.0, 0x10044: 0, 0x10045: 0, 0x101D8: True}
        self.values |= {int(key[1:], 16): value for key, value in values.items()}
        self.written: list[tuple[int, Any]] = []
        self.broken = False

    def access(self, word: str) -> Callable[[], Any]:
        return lambda: Access(self, word)


class Access:
    """ADSREAD or ADSWRITE: busy for some cycles from the rising edge on."""

    def __init__(self, cnc: Cnc, word: str) -> None:
        self.cnc, self.start, self.left = cnc, word, 0
        self.env = {"BUSY": False, "ERR": False}
        self.was = False

    def call(self, given: dict[str, tuple[Any, Env]]) -> None:
        now = {name: value(env) for name, (value, env) in given.items()}
        trigger = now[self.start]
        if trigger and not self.was:
            self.left, self.env["BUSY"] = 3, True
        elif trigger and self.env["BUSY"]:
            self.left -= 1
            if self.left == 0:
                self.env["BUSY"] = False
                self.env["ERR"] = self.cnc.broken
                if not self.cnc.broken:
                    self.transfer(now)
        self.was = trigger

    def transfer(self, now: dict[str, Any]) -> None:
        assert (now["PORT"], now["IDXGRP"]) == (551, 0x120300)
        offset = now["IDXOFFS"]
        assert now["LEN"] == {float: 8, int: 4, bool: 1}[type(self.cnc.values[offset])]
        if self.start == "READ":
            env, name = now["DESTADDR"]
            env[name] = self.cnc.values[offset]
        else:
            env, name = now["SRCADDR"]
            assert type(env[name]) is type(self.cnc.values[offset])
            self.cnc.values[offset] = env[name]
            self.cnc.written.append((offset, env[name]))


@pytest.fixture
def plc(program: Make) -> Make:
    """Return what makes the whole program beside a controller."""

    def make(cnc: Cnc) -> Any:
        library = {"ADSREAD": cnc.access("READ"), "ADSWRITE": cnc.access("WRITE")}
        return program(text_of(), library).new("FB_TempComp_X")

    return make


def test_program_writes_the_objects_of_the_axis_in_their_units(plc: Make) -> None:
    cnc = Cnc(x101D8=False)
    block = plc(cnc)
    for _ in range(100):
        block.cycle(TempFrame=40.0, TempFrameOk=True)
    assert cnc.values[0x10045] == -2001996  # −200.1996 mm in 0.1 µm
    assert cnc.values[0x10044] == -400  # −0.04 mm in 0.1 µm
    assert cnc.values[0x10043] == pytest.approx(-220.25, abs=1e-9)  # µm/m
    assert [offset for offset, _ in cnc.written].count(0x10045) == 1


@pytest.mark.parametrize(
    ("sign", "words"),
    [
        (
            1,
            "adds it to the position: it is the measured deviation with the other sign.",
        ),
        (-1, "takes it off the position: it is the measured deviation."),
    ],
)
def test_head_says_with_which_sign_the_line_counts(sign: int, words: str) -> None:
    head = " ".join(text_of(sign=sign).partition("*)")[0].split())
    assert f"The CNC {words}" in head
    assert "deviation(T, s)" not in head
    assert "A PLC that stops leaves its last values in the CNC" in head
    assert "stopped PLC is not wrong" not in head


def test_restarted_plc_goes_on_from_what_the_cnc_has(plc: Make) -> None:
    cnc = Cnc(x10043=-200.0, x10044=-350, x10045=-2001996)
    block = plc(cnc)
    for _ in range(400):
        block.cycle(TempFrame=40.0, TempFrameOk=True)
    sent = np.array([value for offset, value in cnc.written if offset == 0x10043])
    assert sent[0] == pytest.approx(-200.0, abs=RATES[1] * 20 * CYCLE)
    assert (np.diff(sent) <= 0).all()
    # From −200 towards −220.25, never by way of 0.
    assert sent.max() <= -200.0


def test_broken_access_is_told_and_repeated(plc: Make) -> None:
    cnc = Cnc()
    cnc.broken = True
    block = plc(cnc)
    for _ in range(30):
        block.cycle(TempFrame=30.0, TempFrameOk=True)
    assert block.env["FAILED"]
    assert cnc.written == []
    cnc.broken = False
    for _ in range(60):
        block.cycle(TempFrame=30.0, TempFrameOk=True)
    assert not block.env["FAILED"]
    assert {offset for offset, _ in cnc.written} == {0x10043, 0x10044, 0x10045}


def test_two_sensors_and_odd_names_make_a_valid_program(program: Make) -> None:
    names = ("Spindel (vorn) *)", "spindel__VORN")
    text = text_of(names=names, axis="X-Achse ß", title="Fräse *) (* 7\n")
    blocks = program(text, {"ADSREAD": dict, "ADSWRITE": dict})
    law = blocks.new("FB_TempCompLaw_X_Achse")
    env = law.cycle(
        Temp1Spindel_vorn=40.0, Temp1Spindel_vornOk=True,
        Temp2Spindel_vorn=20.0, Temp2Spindel_vornOk=True, CycleTime=CYCLE,
        Active=False, Preset=False, PresetOffset0=0, PresetCoefficient=0.0,
    )  # fmt: skip
    assert env["OFFSET0"] == -400
    assert env["COEFFICIENT"] == 0.0


def test_the_objects_for_xae_hold_the_same_program() -> None:
    given = program_of(3.0, ("frame", "odd ]]> name"), title="Mill ]]> 7")
    objects = plc_objects(given)
    assert list(objects) == ["FB_TempCompLaw_X", "FB_TempComp_X"]
    parts, head = [], ""
    for name, text in objects.items():
        root = ET.fromstring(text)
        assert root.tag == "TcPlcObject"
        (pou,) = root
        assert pou.attrib["Name"] == name
        declaration, body = (
            pou.findtext("Declaration"),
            pou.findtext("Implementation/ST"),
        )
        assert declaration is not None
        assert body is not None
        assert f"FUNCTION_BLOCK {name}\n" in declaration
        assert "END_FUNCTION_BLOCK" not in body  # XAE adds it
        if declaration.startswith("(* Temperature"):
            head, _, declaration = declaration.partition("\n\n(* Access")
            declaration = f"(* Access{declaration}"
        parts.append(f"{declaration}\n{body}END_FUNCTION_BLOCK\n")
    assert "\n\n".join([head, "\n".join(parts)]) == structured_text(given)


def test_the_objects_for_xae_keep_their_ids() -> None:
    first, second = (plc_objects(program_of(lag)) for lag in (0.0, 5.0))

    def ids(objects: dict[str, str]) -> list[str]:
        return [ET.fromstring(text)[0].attrib["Id"] for text in objects.values()]

    assert ids(first) == ids(second)
    assert len(set(ids(first))) == 2
    assert first != second


@pytest.mark.parametrize("lag", [0.0, 1800.0])
def test_program_says_when_it_is_right_after_a_loss_of_power(lag: float) -> None:
    said = " ".join(text_of(lag, ("frame", "screw")).split())
    told = "three time constants later: 5400 s (frame), 5400 s (screw)."
    assert (told in said) == (lag > 0.0)
