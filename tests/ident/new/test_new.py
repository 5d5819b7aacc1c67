"""What `axcomp new` writes: roles, nodes, fits and questions."""

import json
import math
import random
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from axcomp.ident.cli import main
from axcomp.ident.job import load_job, run_job
from axcomp.ident.new import open_question

from .conftest import answer
from .instruments import write_scope

Written = Callable[[str], Path]


def new(folder: Path, text: str, *options: str, name: str = "readings.csv") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    job = folder / "job.toml"
    assert main(["new", str(folder / name), "--out", str(job), *options]) == 0
    return job


def asked(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    """Return the questions of the job that is made of the same file once more."""
    capsys.readouterr()
    files = [str(each) for each in folder.glob("*.csv")]
    assert main(["new", *files, "--out", str(folder / "again.toml"), "--json"]) == 0
    found: list[dict[str, object]] = json.loads(capsys.readouterr().out)["questions"]
    return found


INSTRUMENTS = ("laser", "straightness", "probe", "scope", "thermal", "motion")


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_an_open_job_is_refused_at_its_first_question(
    written: Written, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = written(name)
    capsys.readouterr()
    assert main(["fit", str(job), "--out", str(job.parent / "none")]) == 1
    words = "axes.X.number: found nothing, expected this key"
    assert words in capsys.readouterr().err


def test_a_fit_that_fails_names_the_question_that_has_no_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k / 100},{k % 50},{0.3 * (k % 9 - 4)}\n" for k in range(200))
    job = new(tmp_path, f"t,x,i\n{rows}")
    job.write_text(job.read_text().replace("#? number =", "number = 1"))
    capsys.readouterr()
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "no answer yet: QUESTION 2: The file states no unit" in said
    # Answered, what is wrong is something else; a question that may stay open is none.
    text = job.read_text()
    assert "QUESTION 3 (may stay open)" in text
    job.write_text(text.replace('#? "X.current"', '"X.current"', 1))
    (tmp_path / "out").write_text("in the way")
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 1
    assert "no answer yet" not in capsys.readouterr().err


@pytest.mark.parametrize("name", ["laser", "straightness", "probe", "motion"])
def test_the_fit_asks_for_the_owner_of_a_constant_as_the_job_does(
    written: Written, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = written(name)
    assert "#? remove =" in job.read_text()
    numbered = job.with_name("numbered.toml")
    numbered.write_bytes(job.read_bytes())
    numbers = job.read_text().count("#? number =")
    answer(numbered, [f"number = {k}" for k in range(1, numbers + 1)])
    capsys.readouterr()
    assert main(["fit", str(numbered), "--out", str(job.parent / "none")]) == 1
    assert "expected the job to say whose they are" in capsys.readouterr().err


LASER = "run,direction,target [mm],error [um]\n" + "".join(
    f"{run},{way:+d},{x},{(x - 100) / 200 + way:.2f}\n"
    for run in (1, 2)
    for way in (1, -1)
    for x in range(0, 220, 20)
)


def test_a_job_in_a_file_for_a_folder_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "readings.csv").write_text(LASER)
    job = tmp_path / "readings.csv" / "job.toml"
    assert main(["new", str(tmp_path / "readings.csv"), "--out", str(job)]) == 2
    assert "which is a file, expected a folder" in capsys.readouterr().err


def test_a_job_for_a_folder_that_does_not_exist_names_the_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "readings.csv").write_text(LASER)
    job = tmp_path / "no" / "such" / "job.toml"
    assert main(["new", str(tmp_path / "readings.csv"), "--out", str(job)]) == 2
    assert f"--out: found {job.parent}, which does not" in capsys.readouterr().err


@pytest.mark.parametrize("text", [LASER, "#SESSION\nthe rest of it all\n"])
def test_a_file_that_is_no_list_is_refused_where_it_is_given_as_one(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file, listing = tmp_path / "readings.csv", tmp_path / "achskw1.lis"
    file.write_text(LASER)
    listing.write_text(text)
    command = ["new", str(file), "--list", str(listing)]
    assert main([*command, "--out", str(tmp_path / "job.toml")]) == 2
    assert "holds no entry of a compensation or axis list" in capsys.readouterr().err
    listing.write_text("# to be filled\n")
    assert main([*command, "--out", str(tmp_path / "job.toml")]) == 0


def test_a_job_that_exists_is_replaced_only_when_that_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = new(tmp_path, LASER)
    job.write_text("mine")
    again = ["new", str(tmp_path / "readings.csv"), "--out", str(job)]
    assert main(again) == 2
    assert "which exists, expected a new file or --force" in capsys.readouterr().err
    assert job.read_text() == "mine"
    assert main([*again, "--force"]) == 0
    assert job.read_text() != "mine"


@pytest.mark.parametrize(("step", "asked_for"), [(4, True), (0.004, False)])
def test_the_unit_of_a_clock_that_may_be_in_ms_is_asked_for(
    tmp_path: Path, step: float, asked_for: bool
) -> None:
    rows = "".join(
        f"{step * k:g},{abs(25 - k % 50)},{0.3 * (k % 9 - 4)}\n" for k in range(200)
    )
    text = new(tmp_path, f"t,x,i [A]\n{rows}").read_text()
    assert ('The file states no unit of "t"' in text) == asked_for
    assert ('#? time = { column = "t", unit = "ms" }' in text) == asked_for


def test_a_measurement_is_never_replaced_by_its_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "readings.csv"
    file.write_text(LASER)
    assert main(["new", str(file), "--out", str(file), "--force"]) == 2
    assert "which is an input, expected another file" in capsys.readouterr().err
    assert file.read_text() == LASER


@pytest.mark.parametrize("number", ["0", "70000"])
def test_a_number_that_no_axis_has_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], number: str
) -> None:
    (tmp_path / "readings.csv").write_text(LASER)
    command = ["new", str(tmp_path / "readings.csv"), "--axis", f"X={number}"]
    assert main([*command, "--out", str(tmp_path / "job.toml")]) == 2
    assert "expected a number from 1 to 65535" in capsys.readouterr().err


def test_the_owner_of_a_constant_is_told_by_either_key(written: Written) -> None:
    text = written("laser").read_text().replace("#? number =", "number =")
    assert open_question(text) is not None
    (line,) = [one for one in text.splitlines() if one.startswith("#? datum =")]
    assert "#? remove =" in text
    # The lines with the other key stay as they are.
    assert open_question(text.replace(line, line.removeprefix("#? "))) is None


def test_reading_a_file_ends_with_the_command_that_makes_a_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "laser x.csv"
    file.write_text(LASER)
    main(["read", str(file)])
    assert capsys.readouterr().out.rstrip().endswith(f"axcomp new '{file}'")


def test_axes_named_on_the_command_line_are_not_asked_for(tmp_path: Path) -> None:
    job = new(tmp_path, LASER, "--axis", "Y=2")
    spec = load_job(job).spec
    assert {name: axis.number for name, axis in spec.axes.items()} == {"Y": 2}
    assert spec.fits[0].compensation == "leadscrew"
    assert spec.measurements["readings"].axis == "Y"
    # The slope of ±0.5 µm at the ends does not stand out of a reversal of ±1 µm.
    assert "QUESTION" not in job.read_text()


def test_an_axis_that_nobody_names_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new(tmp_path, "x [mm],deviation [um]\n" + "".join(f"{x},1\n" for x in range(30)))
    question = asked(tmp_path, capsys)[1]
    assert question["about"] == "axes.Y.number"
    assert 'does not say of which axis "deviation" is' in str(question["words"])


@pytest.mark.parametrize(
    "names", ["Position [mm];Deviation [µm]", "Position [mm];Run 1 [µm];Run 2 [µm]"]
)
def test_a_straightness_whose_axes_nobody_names_is_no_leadscrew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], names: str
) -> None:
    cells = names.count(";")
    rows = "".join(f"{50 * k}" + f";{k * k % 17}" * cells + "\n" for k in range(21))
    job = new(tmp_path, f"Straightness\n{names}\n{rows}")
    assert 'compensation = "cross"\naxis = "Y"' in job.read_text()
    questions = {question["about"] for question in asked(tmp_path, capsys)}
    assert questions >= {"axes.X.number", "axes.Y.number"}


def test_the_direction_of_a_straightness_is_that_of_the_axis_that_moves(
    tmp_path: Path,
) -> None:
    rows = "".join(f"{50 * k};{k * k % 17};+\n" for k in range(21))
    text = f"Straightness of Y along X\nPosition [mm];Error [µm];Direction\n{rows}"
    assert "[axes.Z]" not in new(tmp_path, text).read_text()


def test_a_log_whose_axis_is_a_guess_is_refused_as_one_that_names_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(
        f"{0.01 * k:.2f},{2 * k},{2 * k + k % 3 / 100}\n" for k in range(100)
    )
    file = tmp_path / "log.csv"
    file.write_text(f"time [s],first,second\n{rows}")
    assert main(["new", str(file), "--out", str(tmp_path / "job.toml")]) == 1
    said = capsys.readouterr().err
    assert "found no column that names its axis" in said
    assert re.search(r"taken '\w+' for X, it says: line \d+: found X moving", said)


def test_a_zero_within_the_shape_of_the_error_is_asked_for_and_may_stay_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{10 * k},{3 + 4 * (-1) ** k}\n" for k in range(41))
    new(tmp_path, f"X target [mm],X error [um]\n{rows}", "--axis", "X=1")
    question = asked(tmp_path, capsys)[-1]
    assert "without an answer both are the machine's" in str(question["words"])


@pytest.mark.parametrize(("size", "first"), [(0.0123, "mm"), (12.3, "um")])
def test_a_unit_that_the_file_lacks_is_asked_for_the_likelier_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: float, first: str
) -> None:
    new(tmp_path, "x,dz\n" + "".join(f"{x},{size * x / 9:.5f}\n" for x in range(10)))
    question = asked(tmp_path, capsys)[-1]
    assert f'states no unit of "dz", whose largest value is {size:.4g}' in str(
        question["words"]
    )
    answers = question["answers"]
    assert isinstance(answers, list)
    assert f'"Z.error" = {{ column = "dz", unit = "{first}" }}' == answers[0]


@pytest.mark.parametrize(
    ("head", "size", "units"),
    [
        ("c [deg],error", 12.3, ["mdeg", "arcsec", "urad", "deg"]),
        ("c [deg],error", 0.0123, ["deg", "urad", "arcsec", "mdeg"]),
        ("target [deg],channel2", 12.3, ["mdeg", "arcsec", "urad", "deg"]),
        ("angle [deg],Up 1", 12.3, ["mdeg", "arcsec", "urad", "deg"]),
        ("c [deg],dz", 12.3, ["um", "mm"]),
    ],
)
def test_a_rotary_axis_without_a_unit_is_asked_for_one_of_angles(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    head: str,
    size: float,
    units: list[str],
) -> None:
    rows = "".join(f"{30 * k},{size * k / 12:.5f}\n" for k in range(13))
    new(tmp_path, f"{head}\n{rows}", *(() if "dz" in head else ("--axis", "C=4")))
    told = [str(each["answers"]) for each in asked(tmp_path, capsys)]
    (answers,) = [each for each in told if ".error" in each]
    assert re.findall(r'unit = "(\w+)"', answers) == units


@pytest.mark.parametrize(
    ("head", "roles"),
    [
        ("Zeit [s];Geber X [mm];Laser X [mm]", ["X.encoder", "X.actual"]),
        ("time [s];Set [mm];Feedback [mm];Laser [mm]", ["X.position", "X.encoder", "X.actual"]),
        ("t [s];Sollposition [mm];Messsystem [mm];Interferometer [mm]",
         ["X.position", "X.encoder", "X.actual"]),
        # An error needs a place, and there is no other one.
        ("time [s];Encoder [mm];Error [mm]", ["X.position", "X.error"]),
    ],
)  # fmt: skip
def test_the_own_reading_of_the_machine_is_known_by_its_names(
    tmp_path: Path, head: str, roles: list[str]
) -> None:
    rows = []
    for k in range(2000):
        place = 200.0 + 200.0 * math.sin(0.01 * k)
        error = 0.01 * math.sin(place / 50.0)
        own = [place] * (len(roles) - 1)
        last = error if roles[-1] == "X.error" else place + error
        rows.append(";".join(f"{value:.5f}" for value in (0.01 * k, *own, last)))
    job = new(tmp_path, "\n".join([head, *rows]) + "\n", "--axis", "X=1")
    columns = load_job(job).spec.measurements["readings"].columns
    assert [role for role in columns if role != "time"] == roles
    assert load_job(job).spec.fits[0].compensation == "leadscrew"


@pytest.mark.parametrize("form", ["X={:g} Y={:g} Z={:.4f}", "{:g};{:g};{:.4f}"])
def test_probed_points_ask_whether_the_still_coordinate_is_the_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    points = [
        (x, y, 1e-4 * x * y / 100) for x in range(0, 101, 20) for y in range(0, 61, 20)
    ]
    head = "" if "X" in form else "X [mm];Y [mm];Z [mm]\n"
    text = head + "".join(form.format(*point) + "\n" for point in points)
    axes = [
        word for k, name in enumerate("ZXY", 1) for word in ("--axis", f"{name}={k}")
    ]
    job = new(tmp_path, text, *axes)
    answers = [line for line in job.read_text().splitlines() if line.startswith("#? ")]
    assert '"Z.error" = { column = "Z' in "\n".join(answers)
    assert '"Z.position"' in answers[-1]
    assert "sign = -1" in answers[-2]
    assert "own probe reads on a flat reference are the negative" in " ".join(
        job.read_text().replace("\n# ", " ").split()
    )
    assert 'compensation = "plane"' in job.read_text()
    # Without the likely answer there is nothing to fit.
    assert main(["fit", str(job), "--out", str(tmp_path / "none")]) == 1
    assert "Z.error" in capsys.readouterr().err


def test_heights_of_a_probe_ask_for_their_sign(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{x};{y};{x * y / 1e5}\n" for x in (0, 20, 40) for y in (0, 20))
    new(tmp_path, f"X [mm];Y [mm];Höhe [mm]\n{rows}")
    question = asked(tmp_path, capsys)[-1]
    assert "own probe" in str(question["words"])
    assert str(question["answers"]).count("sign = -1") == 1


def test_a_rotary_axis_is_asked_whether_it_goes_round(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{30 * k},{k % 5 / 1000}\n" for k in range(12))
    new(tmp_path, f"c [deg],error [deg]\n{rows}", "--axis", "C=4")
    (told,) = [
        each for each in asked(tmp_path, capsys) if "modulo" in str(each["about"])
    ]
    assert told["answers"] == ["modulo = [0.0, 360.0]"]
    assert not told["needed"]


def test_a_current_without_a_unit_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{0.002 * k},{k * k / 9},{k % 3}\n" for k in range(50))
    new(tmp_path, f"t [s],x [mm],strom_x\n{rows}")
    questions = asked(tmp_path, capsys)
    assert [each["needed"] for each in questions] == [True, True, False]
    assert str(questions[1]["answers"]).count("strom_x") == 3


LIST = """\
kopf.achs_nr 7
kopf.log_achs_name X
kw.ssfk.unit 1
kw.ssfk.crossmodulo 0
kw.ssfk.kw_nr_max 3
kw.ssfk.table[0].setpoint 0
kw.ssfk.table[0].pos 10
kw.ssfk.table[1].setpoint 1000000
kw.ssfk.table[1].pos 20
kw.ssfk.table[2].setpoint 2000000
kw.ssfk.table[2].pos 0
Ende
"""


def test_an_existing_list_brings_number_and_nodes_and_asks_whether_it_was_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "achskw7.lis").write_text(LIST)
    job = new(tmp_path, LASER, "--list", str(tmp_path / "achskw7.lis"))
    text = job.read_text()
    assert 'list = "achskw7.lis"' in text
    assert "number = 7 " in text
    assert "\n# start = 0.0\n" in text  # the nodes of the list stay
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 1
    assert "found no active" in capsys.readouterr().err
    answer(job, ["active = []"])
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert len(result["fits"][0]["parameters"]["table"]["pos"]) == 3


def test_a_cross_table_over_another_master_gives_the_new_one_no_nodes(
    tmp_path: Path,
) -> None:
    listing = tmp_path / "achskw2.lis"
    listing.write_text(
        "kopf.achs_nr 2\nkw.crosscomp.unit 1\nkw.crosscomp.master_ax_nr 3\n"
        "kw.crosscomp.last_index 1\nkw.crosscomp.table[1].setpoint 2000000\nEnde\n"
    )
    rows = "".join(f"{x},{(x / 100) ** 2:.2f}\n" for x in range(0, 520, 20))
    axes = [each for k, n in enumerate("XYZ", 1) for each in ("--axis", f"{n}={k}")]
    text = f"X [mm],EYX [um]\n{rows}"
    asks = new(tmp_path, text, "--list", str(listing), *axes).read_text()
    assert "achskw2.lis holds cross of Y over Z already" in asks
    assert "nothing over X adds to it" in re.sub(r"\n# ", " ", asks)
    assert "\nstart = 0.0\n" in asks
    listing.write_text(listing.read_text().replace("master_ax_nr 3", "master_ax_nr 1"))
    same = new(tmp_path, text, "--list", str(listing), *axes, "--force").read_text()
    assert "the new values are old + measured" in re.sub(r"\n# ", " ", same)
    assert "\n# start = 0.0\n" in same


def test_a_list_that_could_be_of_several_axes_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listing = tmp_path / "achskw3.lis"
    listing.write_text("kopf.achs_nr 3\nkopf.log_achs_name ACHSE_3\n")
    file = tmp_path / "probe.csv"
    file.write_text("x [mm],dz [um]\n" + "".join(f"{x},1\n" for x in range(30)))
    out = ["--out", str(tmp_path / "job.toml")]
    assert main(["new", str(file), "--list", str(listing), *out]) == 2
    assert "--axis NAME=3" in capsys.readouterr().err


def test_files_of_the_same_error_are_fitted_together(tmp_path: Path) -> None:
    first, second = tmp_path / "monday.csv", tmp_path / "tuesday.csv"
    for file in (first, second):
        file.write_text(LASER)
    job = tmp_path / "job.toml"
    options = ["--axis", "X=1", "--out", str(job)]
    assert main(["new", str(first), str(second), *options]) == 0
    (fit,) = load_job(job).spec.fits
    assert fit.sources == ("monday", "tuesday")


def test_what_moved_with_other_axes_names_the_other_fits_and_discover(
    tmp_path: Path,
) -> None:
    rows = "".join(f"{x},{y},{x / 50},{y / 90}\n" for x in range(9) for y in range(9))
    job = new(tmp_path, f"x [mm],y [mm],dx [um],dz [um]\n{rows}", "--axis", "X=1")
    text = job.read_text()
    assert '# compensation = "cross"' in text
    assert "axcomp discover job.toml --write fits.toml" in text


@pytest.mark.parametrize("axes", ["ZXY", "XYZ"])
def test_a_mesh_names_its_columns_itself(tmp_path: Path, axes: str) -> None:
    mesh = "[bed_mesh default]\nversion = 1\npoints =\n"
    mesh += "".join("  0.01, 0.02, 0.04\n" for _ in range(3))
    mesh += "".join(
        f"{key} = {value}\n"
        for key, value in {
            "x_count": 3, "y_count": 3, "min_x": 0, "max_x": 20, "min_y": 0, "max_y": 20
        }.items()
    )  # fmt: skip
    options = [each for k, n in enumerate(axes, 1) for each in ("--axis", f"{n}={k}")]
    job = new(tmp_path, mesh, *options, name="printer.cfg")
    spec = load_job(job).spec
    assert spec.measurements["printer"].columns == {}
    assert (spec.fits[0].compensation, spec.fits[0].axis) == ("plane", "Z")


@pytest.mark.parametrize(("degrees", "told"), [(24.0, True), (20.5, False)])
def test_lengths_read_off_the_reference_temperature_are_told(
    tmp_path: Path, degrees: float, told: bool
) -> None:
    rows = "".join(
        f"{20 * k};{0.2 * k + k % 3};{degrees}\n" for k in [*range(11), *range(11)]
    )
    head = "Soll [mm];Fehler [um];Material [degC]\n"
    job = new(tmp_path, head + rows, "--axis", "X=1")
    text = job.read_text()
    assert ("read at 24 °C (material). To bring its lengths to 20 °C" in text) == told
    assert ('# material_temperature = "material"' in text) == told
    job.write_text(text.replace('#? remove = "none"', 'remove = "none"'))
    (screw,) = run_job(job, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert ("holds what X has grown by, +46 µm/m if it is of steel" in said) == told
    stated = job.read_text().replace("# expansion", "expansion")
    job.write_text(stated.replace("# material_temp", "material_temp"))
    (screw,) = run_job(job, tmp_path / "out").fits
    assert not any("grown by" in remark.message for remark in screw.remarks)


def test_columns_that_name_no_role_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{10 * k},{1e-3 * (k % 7) * (-1) ** k}\n" for k in range(20))
    job = new(tmp_path, f"channel1,channel2\n{rows}")
    place, error = asked(tmp_path, capsys)[-2:]
    places, errors = place["answers"], error["answers"]
    assert isinstance(places, list)
    assert isinstance(errors, list)
    # The likeliest first: the position goes furthest, an error below 0.5 rather is in mm.
    assert places == [f'"X.position" = "channel{k}"' for k in (1, 2)]
    assert errors[0] == '"X.error" = { column = "channel2", unit = "mm" }'
    assert "No column says that it is the error of X" in str(error["words"])
    job.write_text(job.read_text().replace("#? number =", "number = 1"))
    for line in (places[0], errors[0]):
        job.write_text(job.read_text().replace(f"#? {line}", line))
    assert [fit.compensation for fit in load_job(job).spec.fits] == ["leadscrew"]


def test_single_letters_beside_a_position_are_what_engineers_mean(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(
        f"{k / 100},{k % 50},{k % 9 - 4},{0.3 * (k % 9 - 4)},{20 + k / 9}\n"
        for k in range(200)
    )
    job = new(tmp_path, f"t,x,v,i,T\n{rows}")
    text = job.read_text()
    for line in ('time = "t"', '"X.position" = "x"', '"X.velocity" = "v"'):
        assert line in text
    assert '"temperature.sensor" = "T"' in text
    assert '#? "X.current" = { column = "i", unit = "A" }' in text
    assert "[axes.Y]" not in text
    assert "QUESTION" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("names", "units"),
    [("Soll [mm];Abweichung [µm]", ["um"]), ("Soll [mm];1 auf;1 ab", ["um", "mm"])],
)
def test_where_a_title_says_target_less_actual_the_sign_is_asked_for(
    tmp_path: Path, names: str, units: list[str]
) -> None:
    rows = "".join(f"{10 * k};{k % 3};{k % 4 + 1}\n" for k in range(9))
    wide = names.count(";") > 1
    body = rows if wide else "".join(f"{10 * k};{k % 3}\n" for k in range(9))
    job = new(tmp_path, f"Soll minus Ist\n{names}\n{body}")
    lines = [line for line in job.read_text().splitlines() if '"X.error"' in line]
    signed = [line for line in lines if "sign = -1" in line]
    assert all(line.startswith("#? ") for line in lines)
    assert len(lines) == 2 * len(units)
    assert len(signed) == len(units)
    assert "less what was reached" in job.read_text().replace("\n# ", " ")


@pytest.mark.parametrize("ways", ["+-", "++"])
def test_a_dial_at_one_place_from_both_sides_asks_for_a_backlash(
    tmp_path: Path, ways: str
) -> None:
    rows = "".join(f"200;{ways[k % 2]};{12 * (k % 2) + k % 3}\n" for k in range(10))
    job = new(tmp_path, f"X Soll [mm];Richtung;X Abweichung [µm]\n{rows}")
    assert ('compensation = "backlash"' in job.read_text()) == (ways == "+-")


def test_of_corrections_the_sign_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{10 * k},{(k % 7) * (-1) ** k}\n" for k in range(20))
    new(tmp_path, f"Target [mm],Correction [um]\n{rows}")
    column = '"X.error" = { column = "Correction [um]", unit = "um"'
    question = asked(tmp_path, capsys)[-1]
    assert question["answers"] == [f"{column}, sign = {s} }}" for s in (-1, 1)]


def test_an_error_beside_directions_of_approach_is_that_of_the_axis_that_moved(
    tmp_path: Path,
) -> None:
    rows = "".join(f"{w},{10 * k},{k % 7}\n" for w in "+-" for k in range(12))
    job = new(tmp_path, f"Dir,X (mm),Error (um)\n{rows}").read_text()
    assert '"X.error"' in job
    assert 'compensation = "leadscrew"' in job


@pytest.mark.parametrize("target", ["target", "Soll °"])
def test_an_axis_that_is_called_rotary_is_one_and_its_error_an_angle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], target: str
) -> None:
    turn = [30 * k for k in range(12)]
    rows = [f"+,{x},{x % 7}\n" for x in turn] + [f"-,{x},{x % 7}\n" for x in turn[::-1]]
    job = new(
        tmp_path, f"C axis\ndirection,{target},error\n{''.join(rows)}"
    ).read_text()
    assert 'type = "rotary"' in job
    answers = asked(tmp_path, capsys)[-1]["answers"]
    assert isinstance(answers, list)
    assert any('unit = "arcsec"' in answer for answer in answers)
    assert not any('unit = "um"' in answer for answer in answers)


def test_beside_temperatures_an_axis_at_rest_shows_its_drift(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k},{-8000 - k // 2},{20 + k / 8}\n" for k in range(60))
    job = new(tmp_path, f"time [s],mcu_pos_z,frame_t\n{rows}")
    answers = asked(tmp_path, capsys)[-1]["answers"]
    assert isinstance(answers, list)
    assert answers[0] == '"Z.error" = { column = "mcu_pos_z", unit = "um" }'
    assert answers[-1] == '"Z.error" = { column = "mcu_pos_z", unit = "inc" }'
    assert '"temperature.frame" = "frame_t"' in job.read_text()
    assert 'compensation = "temperature"' in job.read_text()


def test_one_column_that_names_nothing_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "trace.csv"
    file.write_text("time [s],alpha,flag [V]\n0,1,2\n1,2,3\n")
    assert main(["new", str(file), "--out", str(tmp_path / "job.toml")]) == 1
    shown = capsys.readouterr().err
    assert "found columns time, alpha, flag, of which none names a role" in shown
    assert shown.count("\n") == 1


def test_a_job_without_a_fit_says_so_instead_of_naming_the_next_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new(tmp_path, "X;Y\n" + "".join(f"{k};{k / 2}\n" for k in range(9)))
    shown = capsys.readouterr().out
    assert "It holds no fit" in shown
    assert "axcomp fit" not in shown


def test_a_line_through_few_readings_is_judged_by_all_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new(tmp_path, "x [mm],dx [um]\n0,0\n50,1.2\n100,3.1\n150,3.6\n")
    words = str(asked(tmp_path, capsys)[1]["words"])
    # Two of four lie on the robust line exactly: by these alone it would be certain.
    assert "a slope of 25.4 ± 3.7 µm/m" in words


def test_columns_of_the_same_role_make_one_question(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k / 500},{k * k / 9},{k % 3},{k % 5}\n" for k in range(50))
    new(tmp_path, f"t [s],x [mm],x current [A],x torque [Nm]\n{rows}")
    question = asked(tmp_path, capsys)[1]
    assert question["words"] == "Which of these columns counts?"
    assert str(question["answers"]).count("X.current") == 2


def test_a_damaged_line_is_asked_for_and_left_out_where_that_is_answered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = LASER.replace("1,+1,40,0.70", "1,+1,40,NaN")
    job = new(tmp_path, damaged, "--axis", "X=1")
    (question,) = asked(tmp_path, capsys)[1:]
    assert "Line 4: column 'error': found 'NaN" in str(question["words"])
    assert main(["fit", str(job), "--out", str(tmp_path / "none")]) == 1
    answer(job, ["skip = [4]"])
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 0


@pytest.mark.parametrize("name", ["Temperature", "T_scale"])
def test_a_sensor_that_failed_for_long_is_left_out_with_a_word(
    tmp_path: Path, name: str
) -> None:
    rows = "".join(
        f"{60 * k},{100 * (k % 4)},{k % 7},{20 + k / 40:.2f},{21 if k % 3 else 'n.v.'}\n"
        for k in range(90)
    )
    head = f"time [s],X.position [mm],X.error [um],T_frame [degC],{name} [degC]\n"
    job = new(tmp_path, head + rows, "--axis", "X=1")
    assert f"Not used: {name} (no number in 30 of 90 rows)." in job.read_text()
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) in (0, 1)
    assert (tmp_path / "out" / "result.json").is_file()


def test_the_unit_of_columns_per_run_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{20 * k};{k}.5;{k}.2;{k}.4;{k}.1\n" for k in range(12))
    job = new(tmp_path, f"Target;Up 1;Down 1;Up 2;Down 2\n{rows}", "--axis", "X=1")
    question = asked(tmp_path, capsys)[-1]
    assert 'The file states no unit of "Up 1"' in str(question["words"])
    answers = question["answers"]
    assert isinstance(answers, list)
    job.write_text(job.read_text().replace(f"#? {answers[0]}", answers[0]))
    spec = load_job(job).spec.measurements["readings"].column_specs["X.error"]
    assert [(part.unit, part.run, part.direction) for part in spec.parts] == [
        ("um", 1, 1), ("um", 1, -1), ("um", 2, 1), ("um", 2, -1)
    ]  # fmt: skip


def test_a_file_for_each_direction_makes_one_table_of_both(tmp_path: Path) -> None:
    files = []
    for way, word in ((1, "positiv"), (-1, "negativ")):
        file = tmp_path / f"{word}.csv"
        rows = "".join(f"{x};{way + x / 200:.2f}\n" for x in range(0, 220, 20)[::way])
        file.write_text(f"Messrichtung: {word}\nSoll [mm];Fehler [µm]\n{rows}", "utf-8")
        files.append(str(file))
    job = tmp_path / "job.toml"
    assert main(["new", *files, "--axis", "X=1", "--out", str(job)]) == 0
    (fit,) = load_job(job).spec.fits
    assert fit.sources == ("positiv", "negativ")
    assert "\nbilateral = true\n" in job.read_text()


@pytest.mark.parametrize(("reversal", "first"), [(4.0, -1), (0.05, None)])
def test_the_direction_of_runs_that_name_none_is_asked_for(
    tmp_path: Path, reversal: float, first: int | None
) -> None:
    rng = random.Random(4)
    rows = "".join(
        f"{x};"
        + ";".join(
            f"{x / 50 - k % 2 * reversal + rng.gauss(0, 0.1):.2f}" for k in range(4)
        )
        + "\n"
        for x in range(0, -350, -50)
    )
    head = "Position [mm];" + ";".join(f"Lauf {k} [um]" for k in range(1, 5))
    text = new(tmp_path, f"{head}\n{rows}", "--axis", "X=1").read_text()
    words = re.sub(r"\n# ", " ", text)
    assert "No column says in which direction its run was measured" in words
    assert ("they look like runs in turn" in words) == (first is not None)
    assert ("\nbilateral = true\n" in text) == (first is not None)
    likeliest, other = re.findall(r'#\? "X.error" = (.*)', text)
    in_turn, one_way = (likeliest, other) if first else (other, likeliest)
    assert "direction" not in one_way
    # The targets go down; a pair of runs is one run in both directions.
    assert re.findall(r"run = (\d), direction = (-?1)", in_turn) == [
        ("1", "-1"), ("1", "1"), ("2", "-1"), ("2", "1"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "asked_for"),
    [
        ("X_SetPos [mm],X_ActPos [mm]", True),
        ("SetPos [mm],ActPos [mm]", True),
        ("Soll [mm],Ist [mm]", False),
    ],
)
def test_positions_of_the_controller_alone_are_no_measurement_unless_the_user_says_so(
    tmp_path: Path, names: str, asked_for: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{x},{x + 0.003 * (-1) ** k}\n" for k, x in enumerate(range(30)))
    text = new(tmp_path, f"{names}\n{rows}", "--axis", "X=1").read_text()
    assert ("or the machine's own reading" in re.sub(r"\n# ", " ", text)) == asked_for
    assert (text.count('#? "X.encoder"') == 1) == asked_for
    answered = text.replace('#? "X.encoder"', '"X.encoder"')
    assert open_question(answered) is None  # as for every other answer
    capsys.readouterr()
    assert main(["read", str(tmp_path / "readings.csv")]) == 0
    assert ("it tells no error of the machine" in capsys.readouterr().out) == asked_for


def test_the_zero_is_asked_for_where_the_list_is_loaded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "achskw7.lis").write_text(LIST)
    job = new(tmp_path, LASER, "--list", str(tmp_path / "achskw7.lis"))
    assert "#? datum = { at = 0.0 }" in job.read_text()
    assert "QUESTION 2 (may stay open): The readings show" in capsys.readouterr().out


def test_a_number_in_the_name_of_a_file_is_no_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = new(tmp_path, LASER, name="laser_v73.csv")
    assert list(load_job_axes(job)) == ["X"]


def load_job_axes(job: Path) -> list[str]:
    return [line[6:-1] for line in job.read_text().splitlines() if line[:6] == "[axes."]


def test_the_reading_of_a_drive_beside_an_error_is_its_place(tmp_path: Path) -> None:
    rows = "".join(f"{k};{2 * k};{k % 7}\n" for k in range(60))
    text = new(tmp_path, f"time [s];X ActPos [mm];X Error [um]\n{rows}").read_text()
    # With X.encoder the fit of this very job found no X.position.
    assert '"X.position" = { column = "X ActPos [mm]"' in text
    assert 'compensation = "leadscrew"\naxis = "X"' in text


def test_the_deviation_from_targets_of_one_axis_is_its_own(tmp_path: Path) -> None:
    rows = "".join(f"{20 * k};{k % 5}\n" for k in range(20))
    text = new(tmp_path, f"Soll X [mm];Abweichung [um]\n{rows}").read_text()
    assert 'compensation = "leadscrew"\naxis = "X"' in text
    assert "[axes.Y]" not in text


@pytest.mark.parametrize("unit", ["arcsec", "arcs", "''"])
def test_an_angle_over_one_rotary_axis_is_its_own_error(
    tmp_path: Path, unit: str
) -> None:
    rows = "".join(f"{20 * k};{k % 5}\n" for k in range(18))
    text = new(tmp_path, f"Position C [°];Abweichung [{unit}]\n{rows}").read_text()
    assert 'compensation = "leadscrew"\naxis = "C"' in text
    assert "[axes.Y]" not in text


def test_an_error_beside_places_in_inches_may_be_in_inches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k};{1e-5 * k}\n" for k in range(20))
    new(tmp_path, f"Target [inch];Error\n{rows}")
    answers = asked(tmp_path, capsys)[-1]["answers"]
    assert isinstance(answers, list)
    assert [line.split('unit = "')[1][:-3] for line in answers] == ["in", "thou"]


def test_what_follows_the_targets_is_the_actual_position_and_rows_are_no_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k + 1};{20 * k};{20 * k + 1e-3 * (k % 4)}\n" for k in range(20))
    new(tmp_path, f"Nr;Sollwert;Messwert\n{rows}")
    answers = asked(tmp_path, capsys)[-1]["answers"]
    assert isinstance(answers, list)
    assert answers[0] == '"X.actual" = "Messwert"'
    assert not any("Nr" in line for line in answers)


def test_runs_of_a_letter_a_number_and_a_sign_are_runs(tmp_path: Path) -> None:
    names = "".join(f";V{run}+ [um];V{run}- [um]" for run in (1, 2, 3))
    rows = "".join(f"{20 * k}" + ";1.5;-6.5" * 3 + "\n" for k in range(20))
    text = new(tmp_path, f"Position [mm]{names}\n{rows}").read_text()
    assert "[axes.V1]" not in text
    assert "bilateral = true" in text


@pytest.mark.parametrize(
    ("column", "names"),
    [("Axis", "XY"), ("Axis", "12"), ("Compensation", ("off", "on"))],
)
def test_rows_of_several_axes_or_states_below_each_other_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], column: str, names: str
) -> None:
    rows = "".join(f"{name},{20 * k},{k}\n" for name in names for k in range(20))
    (tmp_path / "both.csv").write_text(f"{column},Target,Error_um\n{rows}")
    assert main(["new", str(tmp_path / "both.csv")]) == 1
    # One table of both passed its gate.
    assert f"found readings of {names[0]}, {names[1]}" in capsys.readouterr().err


def test_values_of_a_drive_that_no_machine_has_in_mm_ask_for_their_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_scope(tmp_path / "drive.csv")
    lines = (tmp_path / "drive.csv").read_text().splitlines()
    for k, line in enumerate(lines):
        cells = line.split("\t")
        if cells[0] == "Unit":
            cells[1] = "(None)"
        elif len(cells) == 4 and cells[0].isdecimal():
            cells[1] = str(round(1e4 * float(cells[1].replace(",", "."))))
        lines[k] = "\t".join(cells)
    # Tenths of µm, as the controller counts.
    new(tmp_path, "\n".join(lines) + "\n", name="drive.csv")
    words = [each for each in asked(tmp_path, capsys) if "X.ActPos" in str(each)]
    assert '"X.encoder" = { column = "X.ActPos", unit = "0.1um" }' in str(words)


@pytest.mark.parametrize("words", ["01", "12", ("left", "right")])
def test_two_words_of_a_direction_ask_which_is_positive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, str]
) -> None:
    rows = "".join(
        f"{20 * k},{way},{k % 4}\n" for way in words for k in range(12) for _ in "ab"
    )
    job = new(tmp_path, f"Target,Dir,Error_um\n{rows}")
    (question,) = [each for each in asked(tmp_path, capsys) if "positive" in str(each)]
    assert question["answers"] == [
        f'"X.direction" = {{ column = "Dir", positive = "{word}" }}'
        for word in words[::-1]
    ]
    assert "bilateral = true" in job.read_text()


def test_means_of_both_ways_are_its_runs_and_their_scatter_no_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{20 * k};{k % 5};{k % 5 - 8};0.3;0.2{k}\n" for k in range(12))
    new(tmp_path, f"Position;Mittelwert auf;Mittelwert ab;s auf;s ab\n{rows}")
    answers = str(asked(tmp_path, capsys)[-1]["answers"])
    assert '"Mittelwert ab", unit = "um", run = 1, direction = -1' in answers
    assert "s auf" not in answers


def test_names_that_end_as_inches_do_are_asked_for_their_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{x},{y},{1e-4 * (x % 3)}\n" for x in range(12) for y in range(8))
    new(tmp_path, f"x_in,y_in,z_in\n{rows}")
    answers = [each["answers"] for each in asked(tmp_path, capsys)]
    for axis in "XY":
        units = [f'"{axis}.position" = {{ column = "{axis.lower()}_in", unit = "{unit}" }}'
                 for unit in ("in", "mm")]  # fmt: skip
        assert units in answers
    assert '"Z.error" = { column = "z_in", unit = "in" }' in str(answers)


def test_several_units_above_a_table_are_no_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k},{1e-4 * (k % 3)}\n" for k in range(12))
    (tmp_path / "a.csv").write_text(f"Units: inch, tenths\nTarget,Error\n{rows}")
    # Taken in mm and µm, the list was 25 times too small.
    assert main(["new", str(tmp_path / "a.csv")]) == 1
    assert "found unit 'inch, tenths'" in capsys.readouterr().err


def test_an_axis_whose_angles_begin_anew_goes_round(tmp_path: Path) -> None:
    rows = "".join(
        f"{0.01 * k:.2f},{(1.3 * k) % 360:.3f},{k % 7}\n" for k in range(900)
    )
    (tmp_path / "c.csv").write_text("t [s],C.position [deg],C.error [mdeg]\n" + rows)
    job = tmp_path / "job.toml"
    assert main(["new", str(tmp_path / "c.csv"), "--out", str(job)]) == 0
    written = job.read_text().splitlines()
    assert any(line.startswith("modulo = [0.0, 360.0]") for line in written)
    assert "modulo = true" in written


@pytest.mark.parametrize("name", ["Neigung", "pitch error", "Nick", "Lauf;Nick"])
def test_angles_over_a_length_are_no_error_of_an_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    run = "1;" * name.count(";")
    rows = "".join(f"{50 * k};{run}{k % 4},5\n" for k in range(10))
    (tmp_path / "level.csv").write_text(f"X [mm];{name} [arcsec]\n{rows}")
    out = tmp_path / "job.toml"
    assert main(["new", str(tmp_path / "level.csv"), "--out", str(out)]) == 1
    assert "lists correct positions, and no tilt" in capsys.readouterr().err
    assert not out.exists()


def test_a_ball_bar_is_refused_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{5 * k},{k % 4},{k % 5}\n" for k in range(73))
    file = tmp_path / "circle.csv"
    file.write_text(f"Angle (deg),CW (um),CCW (um)\n{rows}")
    out = tmp_path / "job.toml"
    assert main(["new", str(file), "--out", str(out)]) == 1
    assert "of a ball bar or a roundness no list is made" in capsys.readouterr().err
    # Of a rotary axis that is named, the same are runs.
    assert main(["new", str(file), "--axis", "C=4", "--out", str(out)]) == 1
    assert "ball bar" not in capsys.readouterr().err


def test_an_instrument_that_counts_the_other_way_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{50 * k};{-50.001 * k:.4f}\n" for k in range(13))
    new(tmp_path, f"X cmd [mm];X laser [mm]\n{rows}")
    words = " ".join(str(each["words"]) for each in asked(tmp_path, capsys))
    assert "does the instrument count the other way? sign = -1" in words
    assert "is a unit wrong" not in words


@pytest.mark.parametrize(
    ("title", "asks"),
    [
        ("Kompensation aktiv: ja", True),
        ("Measured with compensation (achskw1.lis loaded)", True),
        ("# nach Korrektur", True),
        ("Temperaturkompensation: ein", False),
        ("Air compensation on", False),
        ("Messung mit Laser 7", False),
    ],
)
def test_a_title_that_speaks_of_a_compensation_asks_whether_it_was_on(
    tmp_path: Path, title: str, asks: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{20 * k};{k}.5\n" for k in range(12))
    job = new(
        tmp_path, f"{title}\n\nSoll [mm];Abweichung [µm]\n{rows}", "--axis", "X=1"
    )
    abouts = [question["about"] for question in asked(tmp_path, capsys)]
    assert ("measurements.readings.active" in abouts) == asks
    assert ("\nactive = []" in job.read_text()) != asks


@pytest.mark.parametrize(("up", "down"), [("1", "2"), ("2", "1"), ("0", "1")])
def test_the_number_of_a_direction_that_the_rows_follow_is_offered_first(
    tmp_path: Path, up: str, down: str
) -> None:
    places = [0, 100, 200, 300]
    rows = [f"{x},{up},1" for x in places] + [f"{x},{down},3" for x in places[::-1]]
    job = new(tmp_path, "\n".join(["x,dir,error [um]", *rows, *rows]) + "\n")
    ways = re.findall(r'positive = "(.)"', job.read_text())
    assert ways == [up, down]


def test_columns_of_which_nobody_says_the_run_are_told_to_be_stated_together(
    tmp_path: Path,
) -> None:
    head = "Position X [mm],rechts 1 [um],links 1 [um],rechts 2 [um],links 2 [um]"
    rows = [
        f"{x},{x / 99},{3 - x / 99},{x / 90},{3 - x / 90}" for x in range(0, 400, 50)
    ]
    job = new(tmp_path, "\n".join([head, *rows]) + "\n")
    assert "Columns of runs are stated" in job.read_text().replace("\n# ", " ")


def motor_trace(place: str, speed: str) -> str:
    """Return a trace of a drive with these heads of its second and third column."""
    angles = [0.01 * k for k in range(3000)]
    rows = "".join(
        f"{0.2 * u:.3f},{100 + 30 * math.sin(u):.4f},{900 * math.cos(u):.2f},"
        f"{math.copysign(2.0, math.cos(u))}\n"
        for u in angles
    )
    return f"time [s],{place},{speed},current [A]\n{rows}"


@pytest.mark.parametrize("speed", ["Motor speed [rpm]", "X velocity [1/min]"])
def test_the_speed_of_a_motor_is_left_out_beside_a_place_in_mm(
    tmp_path: Path, speed: str
) -> None:
    text = new(tmp_path, motor_trace("X pos [mm]", speed), "--axis", "X=1").read_text()
    assert "(in rpm, as of a motor, and X is in mm)" in text
    assert '"X.velocity"' not in text
    assert "rotary" not in text


@pytest.mark.parametrize("place", ["", "X pos"])
def test_the_speed_of_a_motor_makes_no_linear_axis_a_rotary_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], place: str
) -> None:
    text = motor_trace(place or "supply [V]", "X speed [rpm]")
    (tmp_path / "drive.csv").write_text(text)
    out = tmp_path / "job.toml"
    assert main(["new", str(tmp_path / "drive.csv"), "--out", str(out)]) == 1
    assert "found rpm, as of a motor, and nothing of X in mm" in capsys.readouterr().err
    assert not out.exists()
    job = new(tmp_path, text.replace("X ", "C "), name="c.csv")
    assert 'type = "rotary"' in job.read_text()
