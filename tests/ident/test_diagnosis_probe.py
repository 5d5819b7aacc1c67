"""Probe lists: clean, gentle, and such that each open rule shows."""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile, check
from axcomp.data.measurements import read_log
from axcomp.ident.cli import main
from axcomp.ident.diagnosis import (
    Probe,
    ProbeAxis,
    Probed,
    make_probe,
    probe_programs,
    probe_steps,
    probe_text,
    probed_in,
    travel_in,
)
from axcomp.ident.exchange import (
    ExchangeError,
    Motion,
    Reading,
    machine_lists,
    offset_at,
    simulate,
)
from axcomp.ident.proof import verify_log
from axcomp.models import AbstractLookup, Conventions

from .nc_machine import KEYWORDS, Machine

RULES = Conventions()
AXES = {
    1: ProbeAxis(1, "X", (-12.5, 803.2)),
    2: ProbeAxis(2, "Y", (0.0, 400.0)),
    3: ProbeAxis(3, "Z", (0.0, 60.0)),
    4: ProbeAxis(4, "C", (0.0, 360.0), rotary=True, modulo=True),
}
ALL = (
    Probed(1, "backlash", (1,)),
    Probed(1, "crosstalk", (2,), 2000),
    Probed(1, "leadscrew", (1,)),
    Probed(2, "temperature", (2,)),
    Probed(2, "cross", (1,)),
    Probed(3, "plane", (1, 2)),
    Probed(4, "leadscrew", (4,)),
)
PROBE = make_probe(AXES, ALL, RULES)


def read_back(probe: Probe) -> list[ListFile]:
    groups = (probe.lists, probe.additions)
    return [
        ListFile.parse(one.dumps(), one.source) for g in groups for one in g.values()
    ]


def test_probe_lists_have_no_error_and_no_warning() -> None:
    for lists in ([one] for one in read_back(PROBE)):
        # The one remark that no list can avoid: one manual discontinues `unit` (S-14).
        odd = [f for f in check(lists) if f.id not in ("P-COMP-00003", "P-COMP-00008")]
        assert odd == []
    assert all(f.level == "info" for f in check(read_back(PROBE)))


def seen(rules: Conventions, **places: float) -> dict[str, float]:
    """What tables read by these rules add, in µm, by axis and compensation."""
    numbers = {axis.name: axis.number for axis in AXES.values()}
    at = {numbers[name]: value for name, value in places.items()}
    found = {}
    for number, listing in PROBE.lists.items():
        reading = Reading(rules)
        for one in machine_lists([listing]).in_use(rules):
            model = one.model(reading)
            if not isinstance(model, AbstractLookup):
                continue
            name, masters = one.name, one.masters
            row = np.array([[at.get(master, 0.0) for master in masters]])
            value = round(1000 * float(offset_at(model, row)[0]), 6)
            if value:
                found[f"{AXES[number].name} {name}"] = value
    return found


def test_each_plateau_stands_where_the_steps_say_and_is_10_um_high() -> None:
    expected = {"cross": 10.0, "plane": 10.0, "leadscrew": -10.0}
    for step in probe_steps(PROBE):
        if step.compensation not in expected:
            continue
        name = f"{step.axis} {step.compensation}"
        assert seen(RULES, **step.end)[name] == expected[step.compensation]
        assert name not in seen(RULES, **step.start)


@pytest.mark.parametrize(
    ("rule", "value", "compensation"),
    [
        ("leadscrew_sign", 1, "leadscrew"),
        ("cross_sign", -1, "cross"),
        ("plane_sign", -1, "plane"),
    ],
)
def test_turned_sign_shows_at_the_plateau(
    rule: str, value: int, compensation: str
) -> None:
    step = next(s for s in probe_steps(PROBE) if s.compensation == compensation)
    told = [one for one in step.outcomes if one.conventions == {rule: value}]
    assert len(told) == 1
    name = f"{step.axis} {compensation}"
    shown = seen(Conventions.from_dict({rule: value}), **step.end)[name]
    assert shown == -seen(RULES, **step.end)[name]
    assert told[0].seen == f"{'+' if shown > 0 else '−'}10 µm"


def test_turned_indices_move_the_plateau_of_a_plane_to_where_the_step_says() -> None:
    step = next(s for s in probe_steps(PROBE) if s.compensation == "plane")
    turned = Conventions(plane_index="ij")
    assert "Z plane" not in seen(turned, **step.end)
    assert "X at 555 and Y at 120" in step.outcomes[2].seen
    assert seen(turned, X=555.0, Y=120.0)["Z plane"] == 10.0
    assert "Z plane" not in seen(RULES, X=555.0, Y=120.0)


def test_cross_table_of_the_other_owner_moves_the_other_axis() -> None:
    master = Conventions(cross_list="master")
    axes = AXES | {2: ProbeAxis(2, "Y", (0.0, 900.0))}
    probe = make_probe(axes, [Probed(2, "cross", (1,))], RULES)
    (step,) = probe_steps(probe)
    assert "X moves by 10 µm when Y stands at 474 to 636" in step.outcomes[2].seen
    motion = Motion({1: np.array([0.0]), 2: np.array([555.0])}, {}, None)
    found = {
        one.axis: float(one.total[0])
        for one in simulate(list(probe.lists.values()), motion, Reading(master))
    }
    assert found == {1: pytest.approx(0.01, abs=1e-15), 2: 0.0}


def test_slopes_are_gentle_and_nodes_lie_within_the_travel() -> None:
    for number, axis in AXES.items():
        grid = axis.grid.positions
        assert axis.travel[0] <= grid[0] < grid[-1] <= axis.travel[1], number
        # The gate of a job allows 20 µm/mm; the shortest travel here is 60 mm.
        assert 10.0 / np.diff(grid).min() < 2.0


def test_memory_that_the_loaded_list_reserves_stays() -> None:
    old = ListFile.parse(b"kopf.achs_nr 1\nkw.ssfk.max_points 1600\n", "old")
    probe = make_probe(AXES, ALL, RULES, {1: old})
    assert probe.lists[1].integer("kw.ssfk.max_points") == 1600
    assert PROBE.lists[1].get("kw.ssfk.max_points") is None


def test_unknown_travel_and_short_travel_are_refused() -> None:
    with pytest.raises(
        ExchangeError, match=r"axis 9, whose travel .*--travel A9=0:500"
    ):
        make_probe(AXES, [Probed(1, "cross", (9,))], RULES)
    with pytest.raises(ExchangeError, match="found 0 to 5, expected 10 mm"):
        make_probe(
            {1: ProbeAxis(1, "X", (0.0, 5.0))}, [Probed(1, "leadscrew", (1,))], RULES
        )


def test_text_and_program_name_every_step() -> None:
    text, program = probe_text(PROBE), probe_programs(PROBE)["probe.nc"]
    for step in probe_steps(PROBE):
        assert step.sentence in text
        assert f"{step.axis}[COMP ON {step.keyword}]" in program
    numbers = [int(w[1:]) for w in program.split() if w[0] == "N" and w[1:].isdigit()]
    assert numbers == sorted(set(numbers))
    assert program.rstrip().endswith("M30")


def test_lists_say_what_is_probed_and_over_which_travel() -> None:
    lists = read_back(PROBE)
    assert {(one.axis, one.name) for one in probed_in(lists, RULES)} == {
        (one.axis, one.name) for one in ALL
    }
    travel = travel_in(lists, RULES)
    assert travel[1] == (-12.0, 798.0)
    assert 3 not in travel  # a slave only: nothing is looked up over it


JOB = """
[axes.X]
number = 1
limits = [0, 500]
[axes.Y]
number = 2
limits = [0, 300]
[measurements.m]
file = "m.csv"
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "m"
setpoints = [0, 10]
"""


def test_command_makes_lists_of_a_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "job.toml").write_text(JOB)
    (tmp_path / "m.csv").write_text("x,y\n1,2\n")
    out = tmp_path / "out"
    assert main(["probe", str(tmp_path / "job.toml"), "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == [
        "achskw2.lis",
        "achsmds2.add.lis",
        "probe.txt",
        "probe.nc",
    ]
    assert found["steps"][0]["end"] == {"X": 350.0}
    assert found["steps"][0]["outcomes"][1]["conventions"] == {"cross_sign": -1}
    assert sorted(p.name for p in out.iterdir()) == sorted(found["files"])
    assert main(["check", *(str(p) for p in out.glob("*.lis")), "--strict"]) == 0


def test_command_makes_lists_of_lists_and_never_writes_onto_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    raw = PROBE.lists[2].dumps()
    Path("achskw2.lis").write_bytes(raw)
    command = ["probe", "achskw2.lis", "--travel", "A2=0:400", "--word", "A2=Y"]
    assert main([*command, "--out", "."]) == 1
    assert (
        "achskw2.lis: is an input and is never written onto" in capsys.readouterr().err
    )
    assert Path("achskw2.lis").read_bytes() == raw
    assert main(command) == 0
    assert "Y, cross: switch all off (Y[COMP OFF_ALL])" in capsys.readouterr().out
    assert Path("axcomp-probe/achskw2.lis").is_file()
    assert main(["probe", "achskw2.lis", "--travel", "2=5"]) == 2
    assert "expected an axis and its travel" in capsys.readouterr().err
    assert main(["probe", "achskw2.lis", "--word", "Y"]) == 2
    assert "expected an axis and its word" in capsys.readouterr().err


def test_program_names_axes_of_the_job_once_and_leaves_all_as_it_was() -> None:
    words = {axis.name for axis in AXES.values()}
    every = {(word, keyword) for word in words for keyword in KEYWORDS}
    before = set(sorted(every)[::2])
    machine = Machine(words, every, set(before))
    machine.run(probe_programs(PROBE)["probe.nc"])
    assert machine.active == before
    # What is probed is on all the time from the start of the log to its end.
    probed = {(step.axis, step.keyword) for step in probe_steps(PROBE)}
    assert probed <= machine.at_halts[1]
    assert machine.at_halts[1] == machine.at_halts[2]
    assert {word for _, word, _ in machine.switched} == {
        s.axis for s in probe_steps(PROBE)
    }


def test_two_axes_of_one_name_are_refused() -> None:
    axes = {1: ProbeAxis(1, "X", (0.0, 500.0)), 2: ProbeAxis(2, "x", (0.0, 500.0))}
    with pytest.raises(
        ExchangeError, match="found X twice, expected a word of its own"
    ):
        make_probe(axes, [Probed(1, "cross", (2,))], RULES)


@pytest.mark.parametrize("word", ["Y AXIS", "1X", "PORTAL", "x", "Ä", "X=1", "Z" * 17])
def test_a_word_that_no_nc_program_understands_is_refused(word: str) -> None:
    axes = {1: ProbeAxis(1, "X_1", (0.0, 500.0)), 2: ProbeAxis(2, word, (0.0, 500.0))}
    with pytest.raises(
        ExchangeError, match="expected a word of NC programs, A, B, C, Q"
    ):
        make_probe(axes, [Probed(1, "cross", (2,))], RULES)


def test_keywords_that_an_older_controller_does_not_know_are_named() -> None:
    program = probe_programs(PROBE)["probe.nc"]
    assert "; BACKLASH is known from build V3.1.3081.05 on: delete its" in program
    assert program.index("M00") < program.index("G01")


def test_each_channel_has_a_program_that_names_its_own_axes_only() -> None:
    axes = {
        1: ProbeAxis(1, "X", (0.0, 500.0)),
        2: ProbeAxis(2, "Y", (0.0, 500.0), channel=2),
        3: ProbeAxis(3, "X", (0.0, 500.0), channel=2),
    }
    tables = [Probed(1, "leadscrew", (1,)), Probed(2, "cross", (1,))]
    programs = probe_programs(make_probe(axes, tables, RULES))
    for name, word in (("probe_1.nc", "X"), ("probe_2.nc", "Y")):
        machine = Machine({word}, {(word, each) for each in KEYWORDS}, set())
        machine.run(programs.pop(name))
        assert {each for _, each, _ in machine.switched} == {word}
        # It waits before it moves, and before and behind the log. The master of Y belongs to the
        # other channel: a person leads it, there and back, for the gauge and for the log.
        assert machine.halts == 3 + (6 if word == "Y" else 0)
    assert not programs


FRICTION_JOB = """
[axes.X]
number = 1
limits = [0, 500]
[measurements.m]
file = "m.csv"
[[fits]]
compensation = "friction"
axis = "X"
measurement = "m"
table_entries = 12
inertia = "fit"
"""


def test_friction_without_a_list_is_named_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.csv").write_text("x,y\n1,2\n")
    (tmp_path / "job.toml").write_text(FRICTION_JOB)
    command = ["probe", str(tmp_path / "job.toml"), "--out", str(tmp_path / "out")]
    assert main(command) == 1
    said = capsys.readouterr().err
    assert "nothing to probe" in said
    assert "fit it (axcomp fit), load the list" in said
    assert not (tmp_path / "out").exists()
    screw = FRICTION_JOB[FRICTION_JOB.index("[[fits]]") :].replace(
        "friction", "leadscrew"
    )
    screw = screw.replace("table_entries = 12", "start = 0\ninterval = 10\npoints = 9")
    screw = screw.replace('inertia = "fit"', "")
    (tmp_path / "job.toml").write_text(FRICTION_JOB + screw)
    assert main(command) == 0
    assert "X, friction: not probed" in capsys.readouterr().out


FRICTION = """kopf.achs_nr 1
kopf.log_achs_name SPINDEL
frict_comp.mode 3
frict_comp.table_entries 2
frict_comp.scaling_factor 1000
frict_comp.table[0].in 100
frict_comp.table[0].out 40
frict_comp.table[1].in 90000
frict_comp.table[1].out 60
"""


def test_friction_is_probed_at_a_low_level_of_what_is_loaded() -> None:
    loaded = ListFile.parse(FRICTION.encode(), "achskw1.lis")
    (one,) = probed_in([loaded], RULES)
    found = make_probe({1: ProbeAxis(1, "X", (0.0, 500.0))}, [one], RULES)
    listing = found.lists[1]
    assert listing.integer("frict_comp.scaling_factor") == 150
    assert listing.table("frict_comp", "out") == loaded.table("frict_comp", "out")
    assert found.additions[1].integer("lr_param.frict_comp") == 1
    (step,) = probe_steps(found)
    for word in (
        "S-0-0081",
        "S-0-0084",
        "60B2",
        "6077",
        "slowly",
        "V.A.FRICT_COMP_CURR.X",
    ):
        assert word in step.sentence
    assert [dict(each.conventions) for each in step.outcomes[:2]] == [
        {"friction_sign": 1}, {"friction_sign": -1},
    ]  # fmt: skip
    # Nobody looks for micrometres in a current.
    assert not any("µm" in each.means for each in step.outcomes)
    machine = Machine({"X"}, {("X", "FRICT")}, set())
    machine.run(probe_programs(found)["probe.nc"])
    assert machine.active == set()
    assert "SPINDEL" not in probe_programs(found)["probe.nc"]
    coarse = ListFile.parse(FRICTION.replace("1000", "4").encode(), "achskw1.lis")
    with pytest.raises(ExchangeError, match="scaling_factor: found 4, expected 10 or"):
        probed_in([coarse], RULES)


def test_axes_of_a_gantry_are_moved_and_switched_together() -> None:
    axes = {
        1: ProbeAxis(1, "X", (0.0, 500.0)),
        2: ProbeAxis(2, "Y", (0.0, 500.0), partner="V"),
        5: ProbeAxis(5, "V", (0.0, 500.0), partner="Y"),
    }
    probed = [Probed(n, "leadscrew", (n,)) for n in (2, 5)] + [Probed(1, "cross", (2,))]
    probe = make_probe(axes, probed, RULES)
    (program,) = probe_programs(probe).values()
    blocks = program.splitlines()
    # Whose program moves one of them alone twists the gantry, and so does its COMP.
    assert not any(
        "G0" in block and ("Y=" in block or "V=" in block) for block in blocks
    )
    assert any("Lead Y and V together to 150." in block for block in blocks)
    assert any("Y[COMP ON LEAD] V[COMP ON LEAD]" in block for block in blocks)
    assert any("Y[COMP OFF_ALL] V[COMP OFF_ALL]" in block for block in blocks)
    assert "Y and V: always both axes of a gantry together" in probe_text(probe)


@dataclasses.dataclass
class Logger(Machine):
    """A machine that keeps where it goes, by the halt before."""

    way: list[tuple[int, dict[str, float]]] = dataclasses.field(default_factory=list)

    def _move(self, block: str) -> None:
        super()._move(block)
        self.way.append((self.halts, dict(self.position)))


def test_a_log_of_the_second_part_of_the_program_settles_the_signs(
    tmp_path: Path,
) -> None:
    probed = [Probed(1, "leadscrew", (1,)), Probed(2, "cross", (1,)),
              Probed(3, "plane", (1, 2))]  # fmt: skip
    probe = make_probe({n: AXES[n] for n in (1, 2, 3)}, probed, RULES)
    words = {"X", "Y", "Z"}
    machine = Logger(words, {(w, k) for w in words for k in KEYWORDS}, set())
    machine.run(probe_programs(probe)["probe.nc"])
    stops = [
        [place.get(word, 0.0) for word in ("X", "Y", "Z")]
        for halts, place in machine.way
        if halts == 2
    ]
    way = np.concatenate(
        [np.linspace(a, b, 201)[1:] for a, b in itertools.pairwise(stops)]
    )
    places = {number: way[:, number - 1] for number in (1, 2, 3)}
    time = 0.02 * np.arange(len(way))
    columns = {"time": time}
    columns |= {f"A{number}.position": place for number, place in places.items()}
    lists = tuple(read_back(probe))
    rules = Conventions(leadscrew_sign=1, cross_sign=-1)
    for one in simulate(lists, Motion(places, {}, time), Reading(rules)):
        columns[f"A{one.axis}.drive_position"] = places[one.axis] + sum(
            one.parts.values()
        )
        columns |= {f"A{one.axis}.{name}": part for name, part in one.parts.items()}
    file = tmp_path / "log.csv"
    np.savetxt(file, np.stack([*columns.values()], axis=1), fmt="%.7f", delimiter=",",
               header=",".join(columns), comments="")  # fmt: skip
    found = verify_log(lists, read_log(file), Reading(RULES))
    assert {"leadscrew_sign", "cross_sign"} <= found.settled
    assert found.conventions.leadscrew_sign == 1
    assert found.conventions.cross_sign == -1
