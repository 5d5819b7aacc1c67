"""`check`: what is wrong with compensation, axis and start-up lists."""

from collections.abc import Iterable, Mapping, Sequence

from ._check_crosstalk import check_crosstalk
from ._check_lists import is_fragment
from ._check_names import check_names, check_remarks
from ._check_plausible import check_plausible
from ._check_set import check_set
from ._check_structure import check_structures
from ._check_tables import check_tables
from ._check_values import check_values
from ._check_view import ListView
from ._finding import Finding
from ._listfile import ListFile
from ._registry import parse_build, registry


def check(
    files: Sequence[ListFile],
    *,
    build: str | None = None,
    increment: float | None = None,
    gantry: Iterable[tuple[int, int]] = (),
    plane_index: str = "ji",
    modulo: Mapping[int, tuple[float, float]] | None = None,
) -> list[Finding]:
    """Return what is wrong with lists of one machine, each alone and as a set.

    Args:
        files: Compensation, axis and start-up lists, in any order.
        build: Controller build, such as ``V3.1.3108.4``; the newest where left out.
        increment: mm (or degrees) per encoder increment, where it is known.
        gantry: Pairs of logical axis numbers, master and partner, that form a gantry.
        plane_index: First index of a plane table: master 2 (``ji``) or 1 (``ij``), as the
            conventions of the controller say (S-17).
        modulo: Range in ° by logical number of the axes that go round; None where nobody
            said which do.

    Returns:
        Findings in the order of the files, then of their lines.

    Raises:
        BuildError: If ``build`` is not the name of a build.
    """
    if build is not None:
        parse_build(build)
    views = [ListView(file, build, increment, plane_index, modulo) for file in files]
    for view in views:
        _check_alone(view)
    check_set(views, gantry)
    for view in views:
        view.findings.sort(key=lambda finding: (finding.line, finding.column))
    return [finding for view in views for finding in view.findings]


def _check_alone(view: ListView) -> None:
    if view.file.is_wide:
        view.add(
            "error",
            "the file is UTF-16: no line of it can be read",
            found="UTF-16",
            expected="ASCII, Latin-1 or UTF-8",
        )
        return
    check_remarks(view)
    if not view.columns:
        view.add(
            "error",
            "the list holds no entry",
            found="no entry" if view.file.lines else "an empty file",
            expected="entries such as kopf.achs_nr",
        )
        return
    if view.file.kind == "unknown":
        view.add(
            "warning",
            "none of the entries belongs to a compensation, axis or start-up list",
            found=next(iter(view.columns)),
            expected="entries kopf.*, kw.*, frict_comp.*, lr_param.*, zahl_kw",
        )
        return
    check_names(view)
    check_values(view)
    check_plausible(view)
    check_structures(view)
    if view.file.kind == "compensation":
        check_tables(view)
        check_crosstalk(view)
        _report_increments(view)
    else:
        _report_missing_number(view)


def _report_increments(view: ListView) -> None:
    """Say which tables count in increments, where nobody said how long one is."""
    if view.increment is not None:
        return
    for function in registry().functions:
        unit = function.unit
        if unit is None or function.structure not in view.in_use:
            continue
        if unit in view.columns and view.integer(unit) == 0:
            view.add(
                "info",
                f"the {function.name} counts in encoder increments: their length must "
                "be given (--increment) to read it in mm",
                unit,
                found="0",
                expected="1, metric, or a known increment",
            )


def _report_missing_number(view: ListView) -> None:
    """Say that an axis list has no number; it is then taken from the file's name."""
    row = registry().by_key["kopf.achs_nr"]
    whole = view.file.kind == "axis" and not is_fragment(view)
    if whole and row.key not in view.columns:
        view.add(
            "info",
            f"{row.key} is missing: the axis is taken from the name of the file",
            found="no entry",
            expected=row.text,
        )
