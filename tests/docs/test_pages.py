"""README and docs: every block of code runs, every key and rule stands in its page."""

import importlib.util
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from pydantic import TypeAdapter

from axcomp.ident.cli import main
from axcomp.ident.cli._app import app
from axcomp.ident.job.file._schema import JobFile
from axcomp.models import Conventions

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_reference = importlib.util.spec_from_file_location(
    "job_reference", DOCS / "job_reference.py"
)
assert _reference is not None
assert _reference.loader is not None
job_reference = importlib.util.module_from_spec(_reference)
if DOCS.is_dir():
    _reference.loader.exec_module(job_reference)
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
COMPENSATIONS = sorted((DOCS / "compensations").glob("*.md"))
KEYS = {
    name
    for part in (job_reference.parts(JobFile) if DOCS.is_dir() else ())
    for name in part.model_fields
}
pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="needs the source tree")


def blocks(page: Path) -> Iterator[tuple[str, str]]:
    """Language and text of each block of code."""
    for found in re.finditer(
        r"^```(\w*)\n(.*?)^```", page.read_text("utf-8"), re.M | re.S
    ):
        yield found[1], found[2]


def commands(text: str) -> Iterator[list[str]]:
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["axcomp"]:
            yield words[1:]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_a_page_is_understood(page: Path) -> None:
    known = typer.main.get_command(app)
    for language, text in blocks(page):
        if language not in ("", "sh"):
            continue
        for words in commands(text):
            command = known.get_command(None, words[0])  # type: ignore[attr-defined, arg-type]
            assert command is not None, words
            command.make_parser(typer.Context(command)).parse_args(words[1:])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_job_of_a_page_follows_the_schema(page: Path) -> None:
    for language, text in blocks(page):
        if language == "toml":
            job: dict[str, Any] = tomllib.loads(text)
            # A page may show the part that it is about, or single keys.
            for key in set(job) - set(JobFile.model_fields):
                assert key in KEYS, key
                del job[key]
            job.setdefault("axes", {"X": {"number": 1}})
            job.setdefault("measurements", {"laser": {"file": "laser.csv"}})
            JobFile.model_validate(job, strict=False)


@pytest.mark.slow
@pytest.mark.usefixtures("no_drawing")
@pytest.mark.parametrize("page", COMPENSATIONS, ids=lambda page: page.stem)
def test_the_job_of_a_compensation_makes_a_list(page: Path, files: Path) -> None:
    (job,) = (text for language, text in blocks(page) if language == "toml")
    (files / "job.toml").write_text(job, "utf-8")
    assert main(["fit", "job.toml"]) == 0
    assert list((files / "axcomp-out").glob("achs*.lis"))


@pytest.mark.slow
def test_the_worked_examples_of_the_readme_run(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max 2\n"
    rows = ((0, 0, 0), (8000000, 0, 0))
    for k, values in enumerate(rows):
        for name, value in zip(("setpoint", "pos", "neg"), values, strict=True):
            old += f"kw.ssfk.table[{k}].{name} {value}\n"
    (files / "achskw1.lis").write_text(old + "End\n", "ascii")
    (files / "after.toml").write_text(
        '[axes.X]\nnumber = 1\nlist = "axcomp-out/achskw1.lis"\n[measurements.laser]\n'
        'file = "laser_after.csv"\naxis = "X"\nactive = ["leadscrew"]\ndatum = { at = 0.0 }\n',
        "utf-8",
    )
    for language, text in blocks(ROOT / "README.md"):
        if language == "toml":
            (files / "job.toml").write_text(text, "utf-8")
        elif language == "python":
            exec(compile(text, "README.md", "exec"), {})
        elif language == "sh":
            for words in commands(text):
                status = main(words)
                assert status == 0, (words, capsys.readouterr())


@pytest.mark.heavy
def test_the_commands_of_the_page_on_fleets_run(files: Path) -> None:
    from distributed import LocalCluster

    shown = [text for language, text in blocks(DOCS / "batch.md") if not language]
    (table,) = (text for text in shown if text.startswith("job,"))
    (files / "fleet.csv").write_text(table)
    laser = (files / "laser.csv").read_bytes()
    for each in ("m7/x.csv", "m8/x.csv", "fleet/x.csv"):
        (files / each).parent.mkdir()
        (files / each).write_bytes(laser)
    job = (
        '[machine]\n[axes.X]\nnumber = 1\n[measurements.laser]\nfile = "x.csv"\naxis = "X"\n'
        'datum = { at = 0.0 }\n[[fits]]\ncompensation = "leadscrew"\naxis = "X"\n'
        'measurement = "laser"\nstart = 0\ninterval = 50\npoints = 17\nbilateral = true\n'
    )
    for each in ("x-axis.toml", "fleet/a.toml", "fleet/b.toml"):
        (files / each).write_text(job)
    cluster: Any = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="")
    with cluster as dask:
        for words in commands("\n".join(shown)):
            if words[0] == "batch" and "--resume" not in words:
                shutil.rmtree("night-7", ignore_errors=True)
            address = dask.scheduler_address
            words = [word.replace("tcp://host:8786", address) for word in words]
            assert main(words) == 0, words


def test_job_reference_and_its_schema_are_up_to_date() -> None:
    # Renew with: python docs/job_reference.py docs
    assert (DOCS / "job.md").read_text("utf-8") == job_reference.document()
    assert (DOCS / "job.schema.json").read_text("utf-8") == job_reference.schema()


def test_every_key_of_the_job_says_what_it_is_and_its_example_is_valid() -> None:
    for part in job_reference.parts(JobFile):
        for name, field in part.model_fields.items():
            meaning, example = job_reference.described(part, name)
            assert meaning, f"{part.__name__}.{name}"
            if example and name != "compensation":  # each fit has its own
                kind: Any = field.annotation
                for limit in field.metadata:
                    kind = Annotated[kind, limit]
                TypeAdapter(kind).validate_python(
                    tomllib.loads(f"it = {example}")["it"]
                )


def test_every_rule_of_the_controller_stands_in_its_page() -> None:
    page = (DOCS / "conventions.md").read_text("utf-8")
    for rule in Conventions().listing():
        assert f"| `{rule.name}` | `{rule.value}` |" in page
