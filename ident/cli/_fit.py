"""The command ``fit``: a job file → lists, report, result, and what it found for a terminal."""

import dataclasses
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..report._scale import Scale, number, scale_of
from ._options import AsJson
from ._said import print_remarks, print_table, tell, working

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
        from ..job import result_json, run_job, use_compilation_cache

        use_compilation_cache()
        result = run_job(job, out, progress=step, after=after)
        step("drawing the report")
        from ..report import write_report

        report = write_report(result, out)
    console = Console(stderr=as_json, highlight=False)
    print_result(console, result, out, report, start)
    if as_json:
        typer.echo(result_json(result), nl=False)
    return result.passed and result.confirmed


def print_result(
    console: "Console",
    result: "JobResult",
    out: Path,
    report: Sequence[Path],
    start: float,
) -> None:
    """Print what a person wants to know first; all else is in the report.

    What several fits say alike is said once, after them.

    Args:
        console: Where to.
        result: What the job found.
        out: Folder of its files.
        report: Files of the report.
        start: When the user began to wait (`time.monotonic`).
    """
    grouped = {index: group for group in result.groups for index in group.fits}
    counts = Counter(
        remark.message for one in result.fits for remark in set(one.remarks)
    )
    shared = {words for words, count in counts.items() if count > 1}
    for group in result.groups:
        from ..job.joint import TOGETHER  # takes long to load

        _print_group(console, group, result.fits)
        own = {remark.message for remark in group.remarks}
        for index in group.fits:
            _print_member(console, result.fits[index], group, shared | own, TOGETHER)
    for index, one in enumerate(result.fits):
        if index not in grouped:
            _print_fit(console, one, shared)
    said = {remark.message for group in result.groups for remark in group.remarks}
    every = dict.fromkeys(
        remark
        for one in result.fits
        for remark in one.remarks
        if remark.message in shared - said
    )
    print_remarks(console, [*every, *result.remarks])
    _print_files(console, result, out, report, start)


def _print_files(
    console: "Console",
    result: "JobResult",
    out: Path,
    report: Sequence[Path],
    start: float,
) -> None:
    console.print(f"Files in {out}:", markup=False)
    for file in result.files:
        console.print(f"  {file}", markup=False)
    from ..job import Code, Verdict
    from ..report import short_verdict

    page = next((file for file in report if file.suffix == ".html"), None)
    if page is not None:
        # Some writers name files relative to the folder, others with it.
        shown = page if page.is_file() else out / page
        console.print(f"Report: {shown}", markup=False, soft_wrap=True)
    verdict = "Done"
    if result.verdict is not Verdict.GOOD:
        assumed = any(fit.judgement.has(Code.ASSUMED) for fit in result.fits)
        words = short_verdict(result.verdict, assumed=assumed)
        worst = [
            f"{fit.compensation} of {fit.axis}"
            for fit in result.fits
            if fit.judgement.verdict is result.verdict
        ]
        which = "" if len(worst) == len(result.fits) else f" ({', '.join(worst)})"
        verdict = f"{words[0].upper()}{words[1:]}{which}. Done"
    if result.verdict is Verdict.REJECTED and not result.confirmed:
        verdict = "NOT CONFIRMED: the second measurement shows another effect, take the lists out"
    elif not result.passed:
        rejected = any(file.parts[0] == "rejected" for file in result.files)
        verdict = "NOT PASSED: do not load the rejected lists"
        if not rejected:
            verdict = "NOT PASSED: not all that was asked for is known, see the errors"
    console.print(f"{verdict} ({time.monotonic() - start:.1f} s).", markup=False)


def _print_member(
    console: "Console",
    found: "AbstractResult",
    group: "GroupResult",
    said: set[str],
    opening: str,
) -> None:
    """Print gate and remarks of one fit of a group, without what is said elsewhere."""
    name = f"{found.compensation} of {found.axis}: "
    if found.gate:
        _print_gate(console, found, name)
    if not found.left_out:
        _print_verdict(console, found, name)
    remarks = []
    for remark in found.remarks:
        message = remark.message
        if message in said or message.startswith(opening):
            continue
        # The group has said these sentences already.
        for pair in group.lost:
            message = message.replace(pair.sentence, "").strip()
        remarks.append(dataclasses.replace(remark, message=message))
    print_remarks(console, remarks)


def _print_fit(console: "Console", found: "AbstractResult", shared: set[str]) -> None:
    from ..report._section import figures_of

    if found.left_out:
        print_remarks(console, found.remarks)
        return
    over = f" over {', '.join(found.over)}" if found.over else ""
    unit, factor = scale_of(found.unit).error, scale_of(found.unit).factor
    digits = ".3g" if factor == 1.0 else ".1f"
    stages, figures = figures_of(found.error)
    heads = [stage.replace("_", " ") for stage in stages]
    rows = [
        (
            name.replace("all", "wild kept"),
            *("–" if value is None else f"{factor * value:{digits}}" for value in own),
        )
        for name, own in figures.items()
    ]
    title = f"{found.compensation} of {found.axis}{over}, {unit}"
    print_table(console, ["error", *heads], rows, numbers=heads, title=title)
    _print_gate(console, found)
    _print_verdict(console, found)
    print_remarks(console, [r for r in found.remarks if r.message not in shared])


def _print_verdict(
    console: "Console", found: "AbstractResult", start: str = ""
) -> None:
    from ..report import headline_of

    sentence = headline_of(found, scale_of(found.unit)).sentence
    tell(console, f"{start}verdict: {sentence}")


def _print_gate(console: "Console", found: "AbstractResult", start: str = "") -> None:
    failed = [check for check in found.gate if not check.passed]
    if not failed:
        console.print(f"{start}gate: passed ({len(found.gate)} checks)", markup=False)
    for check in failed:
        console.print(
            f"{start}gate: FAILED {check.name}: {check.value:.4g} {check.unit}, allowed"
            f" {check.limit:.4g} ({check.where})",
            markup=False,
        )


def _print_group(
    console: "Console", group: "GroupResult", fits: Sequence["AbstractResult"]
) -> None:
    """Print what was identified together, what of it is written, and what is undetermined."""
    _print_sums(console, group)
    _print_effects(console, group, fits)
    lost = dict.fromkeys(pair.sentence for pair in group.lost)
    for sentence in lost:
        tell(console, f"undetermined: {sentence}")
    said = " ".join(lost)
    for each in group.effects:
        if each.written and each.why and each.name not in said:
            tell(console, f"undetermined: of the {each.name}: {each.why}")
    for freedom in group.freedoms:
        tell(console, f"free: {freedom.sentence} {freedom.rule}")
    print_remarks(console, [r for r in group.remarks if r.message not in lost])


def _print_sums(console: "Console", group: "GroupResult") -> None:
    count, rows = len(group.fits), []
    fits = "one fit" if count == 1 else f"{count} fits as one"
    for one in group.axes:
        scale = scale_of(one.unit)
        figures = [one.error[stage].sound.rms for stage in _STAGES]
        rows.append(
            (
                f"{one.axis}, {scale.error}",
                *(number(scale.factor * value) for value in (*figures, one.noise)),
                str(len(one.rows)),
                str(int(one.wild.sum())),
            )
        )
    heads = ["before", "predicted", "from file", "one reading", "readings", "wild"]
    title = f"group {group.name}: {fits}, rms"
    print_table(console, ["error of", *heads], rows, numbers=heads, title=title)


def _print_effects(
    console: "Console", group: "GroupResult", fits: Sequence["AbstractResult"]
) -> None:
    scales, rows = {one.axis: scale_of(one.unit) for one in group.axes}, []
    for each in group.effects:
        scale = scales.get(each.axis, scale_of("mm"))
        over = fits[each.index].over if each.index is not None else ()
        rows.append(
            (
                each.name,
                ", ".join(over) or "–",
                _size(each, fits, scale),
                f"{each.information:.0%}",
                _fate(each, fits),
            )
        )
    heads = ["effect", "over", "rms", "information", "list"]
    print_table(console, heads, rows, numbers=("rms", "information"))


def _size(each: "EffectShare", fits: Sequence["AbstractResult"], scale: Scale) -> str:
    if not each.determined or (each.index is not None and fits[each.index].left_out):
        return "not known"
    return f"{number(scale.factor * each.rms)} {scale.error}"


def _fate(each: "EffectShare", fits: Sequence["AbstractResult"]) -> str:
    if each.index is None:
        return f"none: {each.why}"
    if fits[each.index].left_out:
        return "LEFT OUT"
    if not each.written:
        return "nothing to write"
    return "written in part" if each.why else "written"
