"""What an export writes beside the code, from models, lists and jobs; and what it refuses."""

import doctest
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import axcomp
from axcomp.data.lists import ListFile
from axcomp.ident.cli import main
from axcomp.ident.exchange import (
    ExchangeError,
    StoredConventions,
)
from axcomp.ident.external import (
    Placed,
    UntraceableError,
    export_external,
    extremes,
    list_source,
)
from axcomp.ident.kinds import kind
from axcomp.models import Conventions, Leadscrew, OffsetPart, OffsetStack, Plane

from ..job_run.screw import laser, screw_job

SCREW = (
    "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 1000000\n"
    "kw.ssfk.kw_startpos 0\nkw.ssfk.kw_nr_max 3\nkw.ssfk.table[0].pos 0\n"
    "kw.ssfk.table[1].pos 200\nkw.ssfk.table[2].pos -100\n"
)
CROSS = (
    "kw.crosscomp.unit 1\nkw.crosscomp.last_index 1\nkw.crosscomp.master_ax_nr 3\n"
    "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 0\n"
    "kw.crosscomp.table[1].setpoint 1000000\nkw.crosscomp.table[1].correction 100\n"
)
BOX = {1: (0.0, 100.0), 2: (0.0, 100.0)}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "achskw1.lis").write_text(SCREW + CROSS)
    return tmp_path


def spike(height: float) -> OffsetStack:
    values = np.zeros((21, 21))
    values[13, 7] = height
    plane = Plane.quadratic((0.0, 0.0), 5.0, values)
    return OffsetStack((OffsetPart(plane, 1, (0, 1)),), axes=2)


def test_search_finds_a_single_high_node() -> None:
    box = np.array([[0.0, 100.0], [0.0, 100.0]])
    found = extremes(
        spike(0.04), box, feed=500.0, acceleration=1000.0, cycle_time=0.001
    )
    # It looks closer down to 1e-4 of the workspace: 0.01 mm of the 5 mm to the node beside.
    np.testing.assert_allclose(found.offset, [0.0, 0.04], rtol=5e-3)
    # Along one edge of the cell; the other falls off as 0.04 / 5 too, but not at once.
    assert 0.008 <= found.slope[1] <= 0.0161
    # Both slopes change from rise to fall at the node within a cycle, at 500 mm/s per axis.
    kink = 4 * 0.008 * 500.0 / 0.001
    assert 0.45 * kink <= found.acceleration[1] - 1000.0 * found.slope[1] <= 1.05 * kink
    assert found.acceleration[0] == 0.0


def test_the_same_export_gives_the_same_files(tmp_path: Path) -> None:
    for name in ("one", "two"):
        export_external(spike(0.01), tmp_path / name, axes=(1, 2), workspace=BOX)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes()


def test_what_an_export_writes_over_is_kept(folder: Path) -> None:
    (folder / "README.md").write_text("My own")
    written = export_external(spike(0.01), folder, axes=(1, 2), workspace=BOX)
    assert (folder / "kept" / "README.md").read_text() == "My own"
    words = "README.md was there and is replaced: what it held is kept as kept/README."
    assert written.remarks[-1].startswith(words)
    layer = folder / "axcomp_external_layer.cpp"
    adapted = layer.read_text() + "// adapted to our SDK"
    layer.write_text(adapted)
    export_external(spike(0.01), folder, axes=(1, 2), workspace=BOX)
    assert (folder / "kept" / layer.name).read_text() == adapted
    # What is as it was leaves no copy.
    assert len(list((folder / "kept").iterdir())) == 2


def test_models_add_up(folder: Path) -> None:
    both = export_external(
        (spike(0.01), spike(0.02)), folder / "out", axes=(1, 2), workspace=BOX
    )
    np.testing.assert_allclose(both.extremes.offset, [0.0, 0.03], rtol=5e-3)


def test_a_model_that_is_too_rough_for_the_feed_is_named(folder: Path) -> None:
    found = export_external(spike(0.04), folder / "out", axes=(1, 2), workspace=BOX)
    (remark,) = found.remarks
    assert "A2: at 30000 mm/min the offsets need" in remark
    assert remark in (folder / "out" / "README.md").read_text()


def test_what_the_points_of_a_fit_do_not_tell_stands_in_the_export(
    folder: Path,
) -> None:
    machine = axcomp.Geometry((0.0, 0.0, 0.0), (100.0, 100.0, 100.0), (3, 3, 3))
    rng, tool = np.random.default_rng(0), np.array([0.0, 0.0, -80.0])
    position = rng.uniform(0.0, 200.0, (100, 3)) * [1, 1, 0]
    error = np.column_stack([1e-4 * position[:, 0], np.zeros((100, 2))])
    error += 1e-4 * rng.normal(size=error.shape)
    fit = axcomp.fit_volumetric(machine, axcomp.Points(position, error, tool=tool))
    placed = Placed.fitted(fit, (0, 1, 2))
    # The tool that was measured with is a lever of the offsets.
    np.testing.assert_allclose(
        placed(jnp.asarray(position)),
        -fit.predict(position, tool, frame=False).error,
        atol=1e-12,
    )
    found = export_external(
        placed,
        folder / "out",
        axes=(1, 2, 3),
        workspace=dict.fromkeys((1, 2, 3), (0.0, 200.0)),
    )
    readme = (folder / "out" / "README.md").read_text("utf-8")
    assert all(remark in readme for remark in found.remarks)
    tools, hidden, *sums = found.remarks
    assert "a tool of 0, 0, -80 mm" in tools
    assert "do not tell the offsets in 100 % of the volume" in hidden
    assert any("only sums of EXX" in each for each in sums)


def test_any_title_leaves_the_files_whole(folder: Path) -> None:
    title = "Fräse -- 7) */ \\\nN10 G00 X1\n<&"
    export_external(
        spike(0.01), folder / "out", axes=(1, 2), workspace=BOX, title=title
    )
    code = (folder / "out" / "axcomp_external.c").read_text("ascii")
    assert code.count("/* External compensation") == 1
    assert code.index("*/") > code.index("finds the start")
    ET.parse(folder / "out" / "AxcompExternal.tmc")
    program = (folder / "out" / "axcomp_external.nc").read_text("ascii").splitlines()
    assert all(line.startswith(("%", "(", "N")) for line in program)
    assert "N10 G00 X1" not in program
    assert title in (folder / "out" / "README.md").read_text("utf-8")


Law = Callable[[jnp.ndarray], jnp.ndarray]


@pytest.mark.parametrize(
    ("law", "axes", "box", "match"),
    [
        (spike(0.01), (2, 1), BOX, "axes: found 2, 1, expected logical numbers"),
        (spike(0.01), (), {}, "axes: found none"),
        (spike(0.01), (1, 2), {3: (0.0, 1.0)}, "workspace of A3: found 0 to 1"),
        (spike(0.01), (1, 2), {1: (5.0, 1.0)}, "workspace of A1: found 5 to 1"),
        (spike(9.0), (1, 2), BOX, r"offset of A2: found a slope of .* expected less"),
        (lambda p: p / 0.0, (1, 2), BOX, "offset of A1: found no number"),
        (
            spike(0.01),
            (1, 2),
            {1: BOX[1]},
            "workspace of A2: found nothing, expected its",
        ),
        ([], (1, 2), BOX, "models: found none"),
        (lambda p: p[:, :1], (1, 2), BOX, r"found offsets of shape \(1, 1\), expected"),
        (
            Placed(spike(0.01), (1, 2)),
            (1, 2),
            BOX,
            "found 1, 2, expected columns of the 2",
        ),
        (Placed(spike(0.01), (1, 1)), (1, 2), BOX, "found 1, 1, expected columns"),
    ],
)
def test_what_makes_no_compensation_is_refused(
    folder: Path, law: Law, axes: tuple[int, ...], box: dict, match: str
) -> None:
    with pytest.raises(ExchangeError, match=match):
        export_external(law, folder / "out", axes=axes, workspace=box)
    assert not (folder / "out").exists()


def test_what_c_cannot_do_is_named(folder: Path) -> None:
    with pytest.raises(UntraceableError, match="found the operation 'sort' on positio"):
        export_external(
            lambda p: jnp.sort(p, axis=1), folder / "out", axes=(1, 2), workspace=BOX
        )
    with pytest.raises(
        UntraceableError, match="found the operation 'conversion to a n"
    ):
        export_external(np.sin, folder / "out", axes=(1, 2), workspace=BOX)  # type: ignore[arg-type]


def test_lists_become_a_compensation_and_are_switched_off(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export-external", "achskw1.lis", "--out", "ext"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert "ext/axcomp_external.c" in printed
    assert sorted(printed) == sorted(f"ext/{one.name}" for one in Path("ext").iterdir())
    listing = ListFile.read(folder / "ext" / "achsmds1.add.lis")
    # Both would correct twice.
    assert not kind("leadscrew").entries.is_activated(listing)
    assert not kind("cross").entries.is_activated(listing)
    assert listing.get("lr_param.crosscomp") is not None
    assert "A1: cross, leadscrew" in (folder / "ext" / "README.md").read_text()
    header = (folder / "ext" / "axcomp_external.h").read_text()
    assert "[0] = A1, [1] = A3." in header


def test_axes_and_workspace_can_be_given(folder: Path) -> None:
    wide = ["--axes", "1,2,3,5", "--workspace", "A3=0:400"]
    assert main(["export-external", "achskw1.lis", "--out", "ext", *wide]) == 0
    text = (folder / "ext" / "README.md").read_text()
    assert "| 3 | A5 |" in text
    assert "| A3 | 0 to 400 |" in text


def test_what_needs_more_than_positions_is_left_out_and_named(folder: Path) -> None:
    (folder / "achsmds1.lis").write_text(
        "kopf.achs_nr 1\nlr_param.ssfk 1\nlr_param.crosscomp 0\n"
        "lr_param.anwahl_losekomp 1\ngetriebe[0].lose 50\nlr_param.temp_comp 1\n"
    )
    lists = [folder / "achskw1.lis", folder / "achsmds1.lis"]
    found = list_source(lists)
    assert found.replaced == {1: ["leadscrew"]}
    assert found.remarks == (
        "A1: the backlash compensation is left out, as it needs more than the positions"
        " that the interface hands over. Leave it active.",
        "A1: the temperature compensation is left out, as it needs more than the"
        " positions that the interface hands over. Leave it active.",
    )


def test_a_table_that_waited_for_the_program_is_named(folder: Path) -> None:
    (folder / "achskw1.lis").write_text(f"{SCREW}kw.ssfk.manual_activation 1\n{CROSS}")
    assert list_source([folder / "achskw1.lis"]).remarks == (
        "A1: the leadscrew table waits for COMP ON in the NC program (manual_activation"
        " 1); as a part of this compensation it acts whenever that is on.",
    )


def test_a_table_for_each_direction_stays_a_list_and_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    each = SCREW.replace(".pos ", ".neg ")
    both = f"{SCREW}{each[each.index('kw.ssfk.table') :]}kw.ssfk.bilateral 1\n"
    (folder / "achskw1.lis").write_text(both + CROSS)
    assert main(["export-external", "achskw1.lis", "--out", "ext"]) == 0
    words = "A1: the leadscrew compensation is left out, as it has a table for each dir"
    assert words in capsys.readouterr().err
    # It stays switched on.
    assert "ssfk" not in (folder / "ext" / "achsmds1.add.lis").read_text()
    (folder / "achskw1.lis").write_text(both)
    assert main(["export-external", "achskw1.lis", "--out", "ext"]) == 1
    assert "table for both directions alike, expected" in capsys.readouterr().err


def test_lists_without_a_table_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "achskw2.lis").write_text("kopf.achs_nr 2\n")
    assert main(["export-external", "achskw2.lis", "--out", "ext"]) == 1
    assert "achskw2.lis: found no active cross, plane" in capsys.readouterr().err


def fitted(folder: Path) -> Path:
    """Run a job whose machine adds the entries of leadscrew and cross tables as they stand."""
    laser(folder / "laser.csv")
    rules = StoredConventions(Conventions(leadscrew_sign=1, cross_sign=-1))
    (folder / "rules.toml").write_bytes(rules.saved_over())
    job = screw_job(folder, axis="limits = [-20.0, 380.0]")
    text = job.read_text().replace("bilateral = true", "bilateral = false")
    job.write_text(f'{text}\n[machine]\nconventions = "rules.toml"\n')
    assert main(["fit", "job.toml", "--out", "fit"]) == 0
    return folder / "fit"


def test_a_job_is_exported_by_its_own_rules_and_limits(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = fitted(folder)
    found = list_source([job])
    (part,) = found.law.law.parts  # type: ignore[attr-defined]
    assert isinstance(part.model, Leadscrew)
    assert part.model.sign == 1
    assert found.workspace == {1: (-20.0, 380.0)}
    assert found.remarks == ("Signs of X are assumed: no measurement has shown them.",)
    assert main(["export-external", "fit/result.json", "--out", "fit"]) == 1
    assert "found the files of a job, expected a folder" in capsys.readouterr().err
    listed = job / "achskw1.lis"
    written = listed.read_bytes()
    listed.write_bytes(written.replace(b"-", b""))
    assert "achskw1.lis is not as axcomp fit wrote it" in list_source([job]).remarks[1]
    listed.write_bytes(written)
    before = (job / "result.json").read_text()
    assert main(["export-external", "fit", "--out", "fit/external"]) == 0
    after = (job / "result.json").read_text().splitlines()
    # The rest stays as it was written.
    assert [line.rstrip(",") for line in after if line.rstrip(",") not in before] == [
        '"external": "external/axcomp_external.c"'
    ]
    tree = json.loads((job / "result.json").read_text())
    tree["fits"][0]["verdict"] = "rejected"
    (job / "result.json").write_text(json.dumps(tree))
    with pytest.raises(ExchangeError, match="the leadscrew of X rejected, expected fi"):
        list_source([job])
    (job / "result.json").write_text("[]")
    with pytest.raises(ExchangeError, match="found no result of a job"):
        list_source([job])


def test_a_job_that_cannot_be_written_to_is_exported_with_a_remark(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = fitted(folder)
    before = (job / "result.json").read_bytes()
    (job / "result.json.part").mkdir()  # in the way of a new one, also for root
    assert main(["export-external", "fit", "--out", "ext"]) == 0
    shown = capsys.readouterr()
    assert "fit/result.json does not name these files: Is a directory" in shown.err
    assert "ext/axcomp_external.c" in shown.out
    assert (job / "result.json").read_bytes() == before


def test_the_rules_of_a_job_hold_for_tables_that_it_did_not_fit(folder: Path) -> None:
    job = fitted(folder)
    with (job / "achskw1.lis").open("a") as listing:
        listing.write(CROSS)
    cross, screw = list_source([job]).law.law.parts  # type: ignore[attr-defined]
    assert cross.model.sign == -1
    assert screw.model.sign == 1


def test_the_recipe_of_the_document_runs_as_it_stands() -> None:
    page = Path(__file__).parents[3] / "docs" / "external.md"
    found = doctest.testfile(str(page), module_relative=False)
    assert found.attempted > 5
    assert found.failed == 0
