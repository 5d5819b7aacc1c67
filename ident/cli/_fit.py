"""The command ``fit``: a job file → lists, report, result, and what it found for a terminal."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ...data.errors import AxcompError
from ..report._scale import number, scale_of
from ._console import note, print_line, print_remarks, table_of, working
from ._options import AsJson

if TYPE_CHECKING:
    from rich.console import Console

    from ..job import AbstractResult, EffectShare, GroupResult, JobResult

_STAGES = ("before", "predicted", "from_file")
"""Errors of a sum that are shown."""


def fit(
    job: Path,
    *,
    out: Path = Path("axcomp-out"),
    after: Path | None = None,
    as_json: AsJson = False,
) -> bool:
    """Run a job: measurements → lists, report, result.

    Ends with exit status 1 where a gate fails (the list then lies in rejected/), or a
    second measurement does not show what was predicted.
    AXCOMP_CACHE=off does without the compilation cache in the user's cache folder.

    Options:
        job (JOB.toml): Job file.
        out: Folder for lists, report and result.
        after (JOB2.toml): Job of a second measurement, made with the lists of the first one
            loaded: says what became of each error, and settles signs.

    Examples:
      axcomp fit job.toml
      axcomp fit job.toml --after after.toml
    """
    from rich.console import Console

    start = time.monotonic()
    with working("reading the job") as step:
        from ..job import run_job, tree_json, use_compilation_cache

        use_compilation_cache()
        try:
            result = run_job(job, out, progress=step, after=after)
        except AxcompError:
            _name_question(job)
            raise
        step("drawing the report")
        from ..report import write_report

        report, *_ = write_report(result, out)
    console = Console(stderr=as_json, highlight=False)
    _print_fits(console, result)
    lines = [f"Files in {out}:", *(f"  {file}" for file in result.files)]
    seconds = time.monotonic() - start
    lines += [f"Report: {report}", f"{_verdict_of(result)} ({seconds:.1f} s)."]
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
    if as_json:
        typer.echo(tree_json(result.tree), nl=False)
    return result.passed and result.confirmed


def _name_question(job: Path) -> None:
    """Say which question of a job has no answer yet: what is wrong often follows from it."""
    from ..new import open_question

    text = job.read_text(encoding="utf-8", errors="replace") if job.is_file() else ""
    if (found := open_question(text)) is not None:
        line, words = found
        note([f"{job}:{line}: no answer yet: {words}"])


def _print_fits(console: "Console", result: "JobResult") -> None:
    """Print what a person wants to know first; what several fits say alike, once."""
    printed = set[str]()
    fits = dict(enumerate(result.fits))
    for group in result.groups:
        _print_group(console, group, result.fits, printed)
        for index in group.fits:
            _print_fit(console, fits.pop(index), printed, grouped=True)
    for fit_result in fits.values():
        _print_fit(console, fit_result, printed)
    print_remarks(console, result.remarks, printed)


def _verdict_of(result: "JobResult") -> str:
    """Return what the last line says of a job."""
    from ..job import Verdict
    from ..report import short_verdict

    if result.verdict is Verdict.REJECTED and not result.confirmed:
        return "NOT CONFIRMED: the second measurement shows another effect, take the lists out"
    if not result.passed:
        if any(file.parts[0] == "rejected" for file in result.files):
            return "NOT PASSED: do not load the rejected lists"
        return "NOT PASSED: not all that was asked for is known, see the errors"
    if result.verdict is Verdict.GOOD:
        return "Done"
    fits: dict[str, list[str]] = {}
    for fit in result.fits:
        if fit.judgement.verdict is result.verdict:
            name = f"{fit.compensation} of {fit.axis}"
            fits.setdefault(short_verdict(fit.judgement), []).append(name)
    words = "; ".join(
        verdict if len(names) == len(result.fits) else f"{verdict} ({', '.join(names)})"
        for verdict, names in fits.items()
    )
    return f"{words[0].upper()}{words[1:]}. Done"


def _print_fit(
    console: "Console",
    fit: "AbstractResult",
    printed: set[str],
    *,
    grouped: bool = False,
) -> None:
    """Print figures, gate, verdict and remarks of a fit, without what is said elsewhere."""
    from ..report import headline_of

    name = f"{fit.compensation} of {fit.axis}: " if grouped else ""
    if not (grouped or fit.left_out):
        _print_figures(console, fit)
    failed = [check for check in fit.gate if not check.passed]
    if fit.gate and not failed:
        console.print(f"{name}gate: passed ({len(fit.gate)} checks)", markup=False)
    for check in failed:
        words = f"{check.value:.4g} {check.unit}, allowed {check.limit:.4g}"
        line = f"{name}gate: FAILED {check.name}: {words} ({check.where})"
        console.print(line, markup=False)
    if not fit.left_out:
        sentence = headline_of(fit, scale_of(fit.unit)).sentence
        print_line(console, f"{name}verdict: {sentence}")
    print_remarks(console, fit.remarks, printed)


def _print_figures(console: "Console", fit: "AbstractResult") -> None:
    from ..report._section import ISO, figure_rows

    over = f" over {', '.join(fit.over)}" if fit.over else ""
    scale = scale_of(fit.unit)
    stages, figures = figure_rows(fit.error, scale)
    heads = [stage.replace("_", " ") for stage in stages]
    rows = []
    for name, (_, values) in figures.items():
        kept = name in ISO and "rms, all" in figures
        label = name.replace("all", "wild kept") + ", wild kept" * kept
        rows.append((label, *values))
    title = f"{fit.compensation} of {fit.axis}{over}, {scale.error}"
    console.print(table_of(["error", *heads], rows, numbers=heads, title=title))


def _print_group(
    console: "Console",
    group: "GroupResult",
    fits: Sequence["AbstractResult"],
    printed: set[str],
) -> None:
    """Print what was identified together, what of it is written, and what is undetermined."""
    from ..job.joint._share import TOGETHER  # takes long to load

    _print_sums(console, group)
    _print_effects(console, group, fits)
    confusions = dict.fromkeys(pair.sentence for pair in group.confusions)
    for sentence in confusions:
        print_line(console, f"undetermined: {sentence}")
    for effect in group.effects:
        if effect.written and effect.why and effect.name not in " ".join(confusions):
            print_line(console, f"undetermined: of the {effect.name}: {effect.why}")
    for gauge in group.gauges:
        print_line(console, f"free: {gauge.sentence} {gauge.rule}")
    texts = [remark.message for index in group.fits for remark in fits[index].remarks]
    printed |= confusions.keys() | {text for text in texts if text.startswith(TOGETHER)}
    print_remarks(console, group.remarks, printed)


def _print_sums(console: "Console", group: "GroupResult") -> None:
    count, rows = len(group.fits), []
    fits = "one fit" if count == 1 else f"{count} fits as one"
    for axis in group.axes:
        scale = scale_of(axis.unit)
        sizes = [*(axis.error[stage].sound.rms for stage in _STAGES), axis.noise]
        shown = [number(scale.factor * size) for size in sizes]
        counts = str(len(axis.rows)), str(int(axis.wild.sum()))
        rows.append((f"{axis.axis}, {scale.error}", *shown, *counts))
    heads = ["before", "predicted", "from file", "one reading", "readings", "wild"]
    title = f"group {group.name}: {fits}, rms"
    console.print(table_of(["error of", *heads], rows, numbers=heads, title=title))


def _print_effects(
    console: "Console", group: "GroupResult", fits: Sequence["AbstractResult"]
) -> None:
    scales, rows = {axis.axis: scale_of(axis.unit) for axis in group.axes}, []
    for effect in group.effects:
        fit = None if effect.index is None else fits[effect.index]
        size = scales.get(effect.axis, scale_of("mm")).shown(effect.rms)
        if not effect.determined or (fit is not None and fit.left_out):
            size = "not known"
        over = () if fit is None else fit.over
        share, state = f"{effect.information:.0%}", _state(effect, fit)
        rows.append((effect.name, ", ".join(over) or "–", size, share, state))
    heads = ["effect", "over", "rms", "information", "list"]
    console.print(table_of(heads, rows, numbers=("rms", "information")))


def _state(share: "EffectShare", fit: "AbstractResult | None") -> str:
    """Return what becomes of an effect: in the list of its fit, or in none."""
    if fit is None:
        return f"none: {share.why}"
    if fit.left_out:
        return "LEFT OUT"
    if not share.written:
        return "nothing to write"
    return "written in part" if share.why else "written"
