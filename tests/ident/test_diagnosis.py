"""What to look at on a controller: the table of objects, and a recording that verifies itself."""

import contextlib
import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.data.measurements import CNC_OBJECTS
from axcomp.ident.cli import main
from axcomp.ident.diagnosis import (
    OBJECTS,
    SCOPE,
    objects_csv,
    observables,
    scope_configuration,
)
from axcomp.ident.exchange import Motion, Reading, simulate
from axcomp.ident.kinds import kinds
from axcomp.models import Conventions

CYCLE = 5e-3
INCREMENT = 1e-5
"""mm per increment of all encoders."""
RNG = np.random.default_rng(18)


def table(prefix: str, positions: np.ndarray, column: str, values: np.ndarray) -> str:
    rows = zip(positions, values, strict=True)
    return "".join(
        f"{prefix}.table[{k}].setpoint {round(1e4 * x)}\n"
        f"{prefix}.table[{k}].{column} {round(1e4 * y)}\n"
        for k, (x, y) in enumerate(rows)
    )


NODES = np.linspace(0.0, 300.0, 16)
CROSS = table("kw.crosscomp", NODES, "correction", 2e-2 * np.sin(NODES / 40))
SCREW = table("kw.ssfk", NODES, "pos", 3e-2 * np.cos(NODES / 55))
PLANE = "".join(
    f"kw.crosscomp2.table[{j}][{i}].correction {RNG.integers(-150, 150)}\n"
    for j in range(4)
    for i in range(7)
)
LISTS = {
    "achskw1.lis": "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 0\n"
    f"kw.ssfk.kw_nr_max 16\nkw.ssfk.set_pos_without_comp 1\n{SCREW}",
    "achskw2.lis": "kopf.achs_nr 2\nkw.crosscomp.unit 1\nkw.crosscomp.master_ax_nr 1\n"
    f"kw.crosscomp.last_index 15\n{CROSS}",
    "achskw3.lis": "kopf.achs_nr 3\nkw.crosscomp2.unit 1\nkw.crosscomp2.interval 500000\n"
    "kw.crosscomp2.last_index_master1 6\nkw.crosscomp2.last_index_master2 3\n"
    f"kw.crosscomp2.master1_ax_nr 1\nkw.crosscomp2.master2_ax_nr 2\n{PLANE}"
    "kw.crosstalk.mode 1\nkw.crosstalk.master_dyn_ax_nr 2\nkw.crosstalk.acceleration 900\n"
    "kw.crosstalk.deceleration -900\nkw.crosstalk.n_cycles 8\n"
    "kw.crosstalk.position[0].correction_accelerate_dir_pos 210\n"
    "kw.crosstalk.position[0].correction_decelerate_dir_pos -180\n",
    "achsmds2.lis": "kopf.achs_nr 2\nlr_param.crosscomp 1\nlr_param.anwahl_losekomp 1\n"
    "lr_param.n_backlash_cyc 6\ngetriebe[0].lose 140\n",
    "achsmds3.lis": "kopf.achs_nr 3\nlr_param.crosscomp2 1\nlr_param.crosstalk 1\n"
    "lr_param.ext_comp.err_limit 500\n",
}


def lists(**changed: str) -> list[ListFile]:
    texts = LISTS | {f"{name}.lis": text for name, text in changed.items()}
    return [ListFile.parse(text.encode(), name) for name, text in texts.items()]


@pytest.fixture(scope="module")
def path() -> Motion:
    return moved()


def moved() -> Motion:
    """Return a motion over the whole workspace, with reversals of each axis."""
    t = CYCLE * np.arange(1500)
    return Motion(
        positions={
            1: 150 - 150 * np.cos(2 * np.pi * t / 3.7),
            2: 75 - 75 * np.cos(2 * np.pi * t / 1.9),
            3: 40 + 10 * np.sin(2 * np.pi * t / 3.1),
        },
        directions={},
        time=t,
    )


def recorded(
    loaded: list[ListFile], motion: Motion, sign: float
) -> dict[str, np.ndarray]:
    """Return what a controller with these lists shows, by channel of the configuration."""
    shown: dict[str, np.ndarray] = {
        f"A{axis}.position": np.round(place, 6)
        for axis, place in motion.positions.items()
    }
    for axis in simulate(loaded, motion, Reading(Conventions())):
        name = f"A{axis.axis}"
        for one in CNC_OBJECTS:
            if one.compensation in axis.parts and one.reports is not None:
                values = np.round(sign * axis.parts[one.compensation] / INCREMENT)
                shown[f"{name}.{one.name}"] = values
        if len(loaded) > 1:
            continue  # a search over sums per axis, which takes its time
        drive = motion.positions[axis.axis] + sign * axis.total
        shown[f"{name}.drive_position"] = np.round(drive, 6)
    return shown


def channels(configuration: bytes) -> dict[str, Mapping[str, str]]:
    """Return the acquisitions of a configuration by name."""
    pool = ET.fromstring(configuration.decode("utf-8-sig")).iter("AdsAcquisition")
    found = [{one.tag: one.text or "" for one in node} for node in pool]
    return {one["Name"]: one for one in found}


def export(
    file: Path, names: Mapping[str, Mapping[str, str]], shown: Mapping[str, np.ndarray]
) -> None:
    """Write the text export of a recording as Scope does: one clock, tabs between."""
    own = {name: each for name, each in names.items() if name in shown}
    rows = len(next(iter(shown.values())))
    head = {
        "Name": list(own), "SymbolComment": [""] * len(own),
        "Data-Type": [one["DataType"] for one in own.values()],
        "SampleTime[ms]": [f"{1e3 * CYCLE:g}"] * len(own),
        "VariableSize": [one["VariableSize"] for one in own.values()],
        "SymbolBased": ["False"] * len(own),
        "IndexGroup": [one["IndexGroup"] for one in own.values()],
        "IndexOffset": [one["IndexOffset"] for one in own.values()],
        "SymbolName": [one["SymbolName"] for one in own.values()],
        "NetID": ["127.0.0.1.1.1"] * len(own), "Port": ["551"] * len(own),
        "Offset": ["0"] * len(own), "ScaleFactor": ["1"] * len(own),
        "BitMask": ["0xffffffffffffffff"] * len(own), "Unit": ["(None)"] * len(own),
        "Unit ScaleFactor": ["1"] * len(own), "Unit Offset": ["0"] * len(own),
    }  # fmt: skip
    ticks = round(rows * CYCLE * 1e7)
    lines = [
        "Name\tcompensations", "File\tx.csv",
        "Starttime of export\t132959733843760000\tMontag, 2. Mai 2022\t15:56:24.376",
        f"Endtime of export\t{132959733843760000 + ticks}\tMontag, 2. Mai 2022\t15:57",
        "", "",
        *("\t".join([key, *cells]) for key, cells in head.items()), "",
    ]  # fmt: skip
    columns = [1e3 * CYCLE * np.arange(rows), *(shown[name] for name in own)]
    lines += [
        "\t".join(f"{cell:.10g}" for cell in row) for row in zip(*columns, strict=True)
    ]
    file.write_text("\r\n".join(lines) + "\r\n", encoding="latin-1")


def test_the_offset_object_of_each_kind_stands_in_the_table_of_objects() -> None:
    names = {one.name: one.compensation for one in CNC_OBJECTS}
    assert {kind.channel: kind.name for kind in kinds() if kind.channel} == {
        channel: names[channel] for channel in (k.channel for k in kinds()) if channel
    }


def test_table_gives_the_addresses_of_the_manuals_and_says_where_there_is_none() -> (
    None
):
    rows = list(csv.DictReader(io.StringIO(objects_csv(observables(lists())))))
    at = {(row["axis"], row["name"]): row for row in rows}
    # [001] p. 35, 61, 48, 91 and 12; [004] p. 20.
    assert at["A2", "CROSSC::actual_offset"]["index_offset"] == "0x20035"
    assert at["A1", "LSEC::sum epsilon"]["index_offset"] == "0x1001D"
    assert at["A3", "CC2::correction"]["index_offset"] == "0x30052"
    assert at["A3", "CROSSTALK::end_offset"]["index_offset"] == "0x301F8"
    assert at["A2", "BC::actual backlash"]["index_offset"] == "0x20093"
    assert at["A3", "EXTC[0].actual_offset"]["index_offset"] == "0x31181"
    assert at["", "EXTC[0].state"]["index_offset"] == "0x1183"
    assert {row["index_group"] for row in rows} == {"0x120300", ""}
    without = {name for (_, name), row in at.items() if not row["index_offset"]}
    assert {"dig_cmd_pos", "A1.position", "V.A.CROSS_COMP_CURR"} <= without
    assert all(at_row["note"] for at_row in rows if not at_row["index_offset"])


def test_what_is_switched_off_is_listed_too() -> None:
    off = lists(achsmds2="kopf.achs_nr 2\nlr_param.crosscomp 0\n")
    assert "CROSSC::actual_offset" in {row.name for row in observables(off)}


def test_configuration_records_every_object_that_has_an_address() -> None:
    rows = observables(lists())
    first = scope_configuration(rows, cycle_time=CYCLE)
    assert first == scope_configuration(rows, cycle_time=CYCLE)
    assert first.startswith(b"\xef\xbb\xbf<?xml")
    found = channels(first)
    assert set(found) == {row.channel for row in rows if row.channel}
    for row in rows:
        if row.channel is None:
            continue
        own = found[row.channel]
        assert own["Enabled"] == ("true" if row.bytes is not None else "false")
        assert int(own["IndexOffset"]) == (row.index_offset or 0)
        assert int(own["BaseSampleTime"]) == 50_000  # 5 ms in ticks of 100 ns


def test_every_trace_draws_an_acquisition_and_all_identifiers_differ() -> None:
    root = ET.fromstring(scope_configuration(observables(lists())).decode("utf-8-sig"))
    guids = [node.text for node in root.iter("Guid")]
    assert len(guids) == len(set(guids))
    drawn = [node.text for node in root.iter("AcquisitionGUID")]
    pool = {node.findtext("Guid") for node in root.iter("AdsAcquisition")}
    assert set(drawn) == pool
    assert len(drawn) == len(pool)


GUID, NUMBER, FLAG = (
    r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}",
    r"-?\d+",
    "true|false",
)
NODE = {
    "Guid": GUID, "Title": ".+", "Name": ".+", "Comment": ".*", "SortPriority": NUMBER,
    "DisplayColor": rf"Black|{NUMBER}", "SubMember": r"\s*",
}  # fmt: skip
SCHEMA: dict[str, tuple[set[str], dict[str, str]]] = {
    "ScopeProject": ({"DataPool", "YTChart"}, {
        "Version": r"1\.0\.0\.0", "StopMode": "AutoStop", "MainServer": r"\d+(\.\d+){5}",
        "RecordTime": NUMBER}),
    "DataPool": ({"AdsAcquisition"}, {}),
    "AdsAcquisition": (set(), {
        "Enabled": FLAG, "AmsNetId": r"\d+(\.\d+){5}", "TargetPort": "551",
        "SymbolBased": "false", "SymbolName": ".+", "IndexGroup": NUMBER,
        "IndexOffset": NUMBER, "DataType": "BIT|INT32|REAL64", "VariableSize": "[148]",
        "UseTaskSampleTime": FLAG, "BaseSampleTime": NUMBER, "UseLocalServer": FLAG,
        "ArrayLength": "0"}),
    "YTChart": ({"AxisGroup", "ChartStyle"}, {}),
    "ChartStyle": (set(), {"StackedAxes": FLAG}),
    "AxisGroup": ({"TimeAxis", "ValueAxis", "Channel"}, {"Enabled": FLAG}),
    "TimeAxis": (set(), {"Orientation": "X"}),
    "ValueAxis": (set(), {"Orientation": "Y"}),
    "Channel": ({"AcquisitionInterpreter", "ChannelStyle"}, {"Enabled": FLAG}),
    "ChannelStyle": (set(), {"Visible": FLAG}),
    "AcquisitionInterpreter": (set(), {
        "AcquisitionGUID": GUID, "Usage": "Y", "Offset": "0", "ScaleFactor": "1",
        "BitMask": NUMBER}),
}  # fmt: skip
"""Members and fields of each node, as Scope projects have them: what any of them may lack."""
SIZES = {"BIT": "1", "INT32": "4", "REAL64": "8"}


def checked(node: ET.Element) -> None:
    members, fields = SCHEMA[node.tag]
    assert node.get("AssemblyName") == "TwinCAT.Measurement.Scope.API.Model"
    values = {each.tag: each.text or "" for each in node}
    assert set(values) == {*NODE, *fields}
    assert len(values) == len(node)
    for name, pattern in (NODE | fields).items():
        assert re.fullmatch(pattern, values[name]), (
            f"{node.tag}.{name}: {values[name]!r}"
        )
    if node.tag == "AdsAcquisition":
        assert values["VariableSize"] == SIZES[values["DataType"]]
    for each in node.findall("SubMember/*"):
        assert each.tag in members, f"{each.tag} in {node.tag}"
        checked(each)


@pytest.mark.parametrize("cycle", [None, 0.002])
def test_configuration_has_the_nodes_and_fields_of_scope_projects(
    cycle: float | None,
) -> None:
    text = scope_configuration(observables(lists()), cycle_time=cycle).decode("utf-8")
    assert text.count("\n") == text.count("\r\n")
    checked(ET.fromstring(text.removeprefix("\ufeff")))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in LISTS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def verdicts_of(
    folder: Path,
    names: list[str],
    path: Motion,
    sign: float = 1.0,
    off: slice = slice(0),
) -> tuple[int, dict[str, list[str]]]:
    """Record what a controller shows of some lists, and verify the export as it is.

    Args:
        folder: Where the lists lie.
        names: Theirs.
        path: Motion of the record.
        sign: With which it adds its offsets.
        off: Rows in which the cross table of A2 is switched off.
    """
    assert main(["objects", *names, "--out", "look"]) == 0
    assert {file.name for file in (folder / "look").iterdir()} == {OBJECTS, SCOPE}
    configured = channels((folder / "look" / SCOPE).read_bytes())
    shown = recorded([ListFile.read(Path(name)) for name in names], path, sign)
    on = np.ones(path.rows)  # states; changes per cycle are of no interest here
    enabled = {n: on for n, one in configured.items() if one["Enabled"] == "true"}
    for name in ("A2.CROSSC::f_is_active", "A2.CROSSC::actual_offset"):
        column = (enabled | shown).get(name, on).copy()
        column[off] = 0.0
        (shown if name in shown else enabled)[name] = column
    assert {name for name in shown if "::" in name} <= set(enabled)
    export(folder / "log.csv", configured, enabled | shown)
    command = ["verify", *names, "--increment", str(INCREMENT), "--log", "log.csv"]
    sink = io.StringIO()
    with contextlib.redirect_stdout(sink):
        status = main([*command, "--json"])
    found = json.loads(sink.getvalue())
    return status, {
        f"{one['axis']} {one['compensation']}": one["verdict"] for one in found
    }


@pytest.mark.slow
def test_export_of_the_recording_is_verified_without_a_mapping(
    folder: Path, path: Motion
) -> None:
    status, verdicts = verdicts_of(folder, list(LISTS), path)
    acting = ("A1 leadscrew", "A2 backlash", "A2 cross", "A3 plane", "A3 crosstalk")
    assert verdicts == {name: ["agrees"] for name in acting}
    assert status == 0


@pytest.mark.parametrize(
    ("sign", "status", "verdict"), [(1.0, 0, "agrees"), (-1.0, 1, "sign")]
)
def test_export_of_one_list_is_judged_as_any_log(
    folder: Path, path: Motion, sign: float, status: int, verdict: str
) -> None:
    found = verdicts_of(folder, ["achskw2.lis"], path, sign)
    assert found == (status, {"A2 cross": [verdict]})


@pytest.mark.parametrize(
    ("sign", "status", "verdict"), [(1.0, 0, "agrees"), (-1.0, 1, "sign")]
)
def test_what_was_switched_off_in_a_record_is_judged_where_its_state_says_on(
    folder: Path,
    path: Motion,
    capsys: pytest.CaptureFixture[str],
    sign: float,
    status: int,
    verdict: str,
) -> None:
    off = slice(500, 1100)
    found = verdicts_of(folder, ["achskw2.lis"], path, sign, off)
    assert found == (status, {"A2 cross": [verdict]})
    assert (
        "A2.CROSSC::actual_offset: off in 40 % of the rows" in capsys.readouterr().err
    )


def test_a_record_without_states_names_the_rows_that_hold_nothing(
    folder: Path, path: Motion, capsys: pytest.CaptureFixture[str]
) -> None:
    place, rows = path.positions[1], path.rows
    offset = 2e-2 * np.sin(place / 40) * (np.arange(rows) < rows // 2)
    columns = np.column_stack([CYCLE * np.arange(rows), place, offset])
    header = "time,A1.position,A2.cross"
    np.savetxt("log.csv", columns, delimiter=",", header=header, comments="")
    assert main(["verify", "achskw2.lis", "--log", "log.csv"]) == 1
    assert "% of the rows hold exactly 0: where it was switched" in " ".join(
        capsys.readouterr().out.split()
    )


def test_table_is_printed_where_no_folder_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["objects", *LISTS]) == 0
    assert capsys.readouterr().out == objects_csv(observables(lists()))
    assert main(["objects", *LISTS, "--cycle-time", "0"]) == 2
