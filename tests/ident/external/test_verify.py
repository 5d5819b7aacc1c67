"""`axcomp verify` on what a controller shows of an external compensation."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.cli import main

# A1: 0.1 mm per 1000 mm of A3; A3 itself is not compensated, A2 only has an axis list.
CROSS = (
    "kopf.achs_nr 1\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 1\n"
    "kw.crosscomp.master_ax_nr 3\n"
    "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 0\n"
    "kw.crosscomp.table[1].setpoint 10000000\nkw.crosscomp.table[1].correction 1000\n"
)
LISTS = ["achskw1.lis", "achsmds2.lis"]
Verify = Callable[[str], dict[str, object]]


@pytest.fixture
def verify(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Verify:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "achskw1.lis").write_text(CROSS)
    (tmp_path / "achsmds2.lis").write_text("kopf.achs_nr 2\nlr_param.ssfk 0\n")

    def run(log: str) -> dict[str, object]:
        status = main(["verify", *LISTS, "--log", log, "--increment", "1e-5", "--json"])
        (found,) = json.loads(capsys.readouterr().out)
        assert found["axis"] == "A1"
        assert found["compensation"] == "external"
        assert (status == 0) == (found["verdict"] == ["agrees"])
        return found  # type: ignore[no-any-return]

    return run


def diagdata(offset: int, state: int = 1) -> str:
    """The layout of [004] p. 19, at A3 = 250 mm, where the table says 0.025 mm."""
    position, offsets = [100, 0, 250 * 10**8], [offset, 0, 0]
    lines = [
        f"ext_comp[0].state {state}",
        "ext_comp[0].initialized 1",
        "ext_comp[0].registered 1",
    ]
    for k in range(10):
        lines.append(f"ext_comp[0].extcomp_input[{k}] {[*position, *7 * [0]][k]}")
        lines.append(f"ext_comp[0].extcomp_output[{k}] {[*offsets, *7 * [0]][k]}")
    return "Diagnose\n" + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("offset", "state", "verdict", "sentence"),
    [
        (2_500_001, 1, ["agrees"], "agrees within 1e-05 µm"),
        (-2_500_000, 1, ["sign"], "adds -1 times"),
        (5_000_000, 1, ["twice"], "adds 2 times"),
        (250_000, 1, ["unit"], "adds 0.1 times what the tables say: a LEVEL, or"),
        (0, 1, [], "adds nothing, the tables 25 µm"),
        (1_250_000, 1, [], "adds 0.5 times what the tables say: a LEVEL"),
        (-2_075_000, 1, [], "adds -0.83 times what the tables say: other tables, or"),
        (3_250_000, 1, [], "adds 1.3 times what the tables say: other tables, or"),
        (0, 0, [], "not active: state is not 1"),
    ],
)
def test_one_moment_of_the_controller_is_judged(
    tmp_path: Path,
    verify: Verify,
    offset: int,
    state: int,
    verdict: list[str],
    sentence: str,
) -> None:
    (tmp_path / "diagdata.txt").write_text(diagdata(offset, state))
    found = verify("diagdata.txt")
    assert found["verdict"] == verdict
    assert str(found["sentence"]).startswith(sentence)


@pytest.mark.parametrize(
    ("factor", "verdict"), [(1.0, ["agrees"]), (-1.0, ["sign"]), (10.0, ["unit"])]
)
@pytest.mark.parametrize(
    "name", ["A1.EXTC[0].actual_offset", "EXTC[0].actual_offset.A1"]
)
def test_recorded_objects_are_judged(
    tmp_path: Path, verify: Verify, factor: float, verdict: list[str], name: str
) -> None:
    place = np.linspace(0.0, 900.0, 200)
    increments = np.rint(factor * 1e-4 * place / 1e-5).astype(int)
    rows = [
        f"{0.001 * k:.3f},{z!r},{offset}"
        for k, (z, offset) in enumerate(zip(place.tolist(), increments, strict=True))
    ]
    (tmp_path / "log.csv").write_text(
        f"time,A3.position,{name}\n" + "\n".join(rows) + "\n"
    )
    assert verify("log.csv")["verdict"] == verdict


def test_recording_without_an_external_compensation_is_judged_as_before(
    tmp_path: Path, verify: Verify, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{z},{1e-4 * z!r},0" for z in range(0, 900, 5)]
    (tmp_path / "log.csv").write_text(
        "A3.position,A1.cross,A1.EXTC[0].actual_offset\n" + "\n".join(rows) + "\n"
    )
    assert (
        main(["verify", *LISTS, "--log", "log.csv", "--json", "--increment", "1e-5"])
        == 0
    )
    (found,) = json.loads(capsys.readouterr().out)
    assert (found["compensation"], found["verdict"]) == ("cross", ["agrees"])


def test_diagdata_with_numbers_of_more_than_64_bits_are_named(
    tmp_path: Path, verify: Verify, capsys: pytest.CaptureFixture[str]
) -> None:
    text = diagdata(2_499_999).replace("2499999", str(10**20))
    (tmp_path / "diagdata.txt").write_text(text)
    assert main(["verify", *LISTS, "--log", "diagdata.txt"]) == 1
    found = f"found {10**20} as extcomp_output, expected integers of 64 bits"
    assert found in capsys.readouterr().err


def test_diagdata_without_values_is_named(
    tmp_path: Path, verify: Verify, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "diagdata.txt").write_text("ext_comp[0].state 1\n")
    assert main(["verify", *LISTS, "--log", "diagdata.txt"]) == 1
    assert "found 0 values of extcomp_input" in capsys.readouterr().err
