"""What a command takes: its docstring says it; what several take stands here."""

import copy
import inspect
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_args, get_origin

import typer

from ...data.errors import FoundError, UsageError

if TYPE_CHECKING:
    from ...data.lists import ListFile
    from ..exchange import StoredConventions


_OPTION = re.compile(
    r"^ {4}(?P<name>\w+)(?: \((?P<flag>--\S+)? ?(?P<metavar>[^)]*)\))?:"
    r" (?P<help>.+(?:\n {8}.+)*)",
    re.MULTILINE,
)
_ONE_LINE = re.compile(r"(?<=\S)\n *(?=\S)")


def declared(command: Callable[..., bool | None]) -> Callable[..., None]:
    """Return a command for typer: exit status 1 where it returns False.

    A parameter that may be given by its place is an argument, one that is only given by its
    name an option. The docstring is the help; under *Options* it says what each is, as
    ``name (--flag METAVAR): help``.
    """

    def run(**values: Any) -> None:
        if command(**values) is False:
            raise typer.Exit(1)

    written = inspect.cleandoc(command.__doc__ or "")
    text, head, examples = written.partition("Examples:\n")
    text, _, options = text.partition("Options:\n")
    texts = {match["name"]: match for match in _OPTION.finditer(options)}
    signature = inspect.signature(command)
    parameters = [
        parameter.replace(annotation=_declared(parameter, texts.get(parameter.name)))
        for parameter in signature.parameters.values()
    ]
    run.__doc__ = _ONE_LINE.sub(" ", text) + head + examples
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return run


def _declared(parameter: inspect.Parameter, text: "re.Match[str] | None") -> Any:
    """Return the type of a parameter with what typer shows of it."""
    base = parameter.annotation
    if text is None:
        return base
    if get_origin(base) is Annotated:
        base, info = get_args(base)
    elif parameter.kind is not parameter.KEYWORD_ONLY:
        info = typer.Argument()
    else:  # a flag has no --no-… beside it
        flag = text["flag"] or (f"--{parameter.name}" if base is bool else None)
        info = typer.Option(*filter(None, [flag]))
    info = copy.copy(info)
    # Of rich's marks there are none: what stands in brackets is meant.
    info.help = _ONE_LINE.sub(" ", text["help"]).replace("[[", "[\\[")
    info.metavar = text["metavar"] or info.metavar
    return Annotated[base, info]


def positive(value: float | None) -> float | None:
    """Return the value of an option that must be a number above 0, if it is given."""
    if value is not None and not 0 < value < math.inf:
        message = f"found {value:g}, expected more than 0"
        raise typer.BadParameter(message)
    return value


AsJson = Annotated[
    bool,
    typer.Option("--json", help="Print the result for machines on standard output."),
]
Positive = Annotated[float, typer.Option(callback=positive)]
OneOrMore = Annotated[int | None, typer.Option(min=1)]
Increment = Annotated[
    float | None,
    typer.Option(
        callback=positive,
        help="mm (or °) per encoder increment, for lists and values in increments.",
    ),
]
CycleTime = Annotated[
    float | None,
    typer.Option(
        callback=positive,
        help="Of the controller in s: a recording with another time step is refused.",
    ),
]
Modulo = Annotated[
    list[str] | None,
    typer.Option(
        metavar="A4=0:360",
        help="Range of an axis that turns, in °; may be given several times.",
    ),
]
Rules = Annotated[
    Path | None,
    typer.Option(
        "--conventions",
        metavar="FILE.toml",
        help="Rules of this machine's controller, as axcomp verify saves them; left out:"
        " those of the job or of --save, where the command has one, else the defaults.",
    ),
]
Lists = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE.lis …",
        help="Compensation lists, and axis lists for what is active.",
    ),
]
Plots = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for plots of the tables.")
]


_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
RANGE = rf"\s*(?P<low>{_NUMBER})\s*:\s*(?P<high>{_NUMBER})\s*"
"""Two ends as in ``0:360``."""


def read_lists(files: Sequence[Path]) -> "list[ListFile]":
    """Return the lists; one that a glob and a name both give is one list all the same.

    A folder stands for the lists in it; one that holds none is refused.
    """
    from ...data.lists import ListFile

    every = list[Path]()
    for file in files:
        inside = [file]
        if file.is_dir():
            inside = sorted(p for p in file.iterdir() if p.suffix.lower() == ".lis")
        if not inside:
            raise FoundError(str(file), "a folder without lists", "*.lis files in it")
        every += inside
    return [ListFile.read(file) for file in dict.fromkeys(every)]


def refuse_target(
    path: Path, option: str, inputs: Iterable[Path] = (), *, force: bool | None = None
) -> None:
    """Refuse to write a file that is read, that exists, or whose folder does not or is a file.

    By force one that exists may be replaced; None: the command has no such option.
    """
    if not path.parent.is_dir():
        state = "is a file" if path.parent.exists() else "does not exist"
        refuse(option, f"{path.parent}, which {state}", "a folder for the new file")
    if path.resolve() in {file.resolve() for file in inputs}:
        refuse(option, f"{path}, which is an input", "another file")
    if path.exists() and not force:
        instead = "a new file" if force is None else "a new file or --force"
        refuse(option, f"{path}, which exists", instead)


def refuse(option: str, found: str, expected: str) -> NoReturn:
    """Raise the `UsageError` of an option that cannot be used."""
    message = f"{option}: found {found}, expected {expected}"
    raise UsageError(message)


def matched(option: str, text: str, pattern: str, expected: str) -> "re.Match[str]":
    """Return what an option says as the groups of a pattern; refuse anything else."""
    match = re.fullmatch(pattern, text)
    if match is None:
        refuse(option, repr(text), expected)
    return match


def read_shown_list(path: Path) -> "ListFile":
    """Return the list in a file that is to be shown; refuse one without any entry."""
    from ...data.lists import ListFile

    listing = ListFile.read(path)
    if listing.is_wide or not listing.columns:
        words = "no entry" if listing.lines else "an empty file"
        words = "UTF-16, or no text" if listing.is_wide else words
        raise FoundError(str(path), words, "entries of a list")
    return listing


def rules_of(file: Path | None) -> "StoredConventions":
    """Return the rules in a file, the defaults without one."""
    from ..exchange import StoredConventions, read_conventions

    return StoredConventions() if file is None else read_conventions(file)


def by_axis(
    texts: Sequence[str] | None, option: str, value: str, expected: str
) -> "dict[int, re.Match[str]]":
    """Return what an option such as ``A4=0:360`` says of axes, by number, as groups of a pattern.

    The pattern is that of what stands behind ``A4=``; what is expected ends with an example.
    """
    pattern, expected = rf"A?(?P<axis>\d{{1,5}})={value}", f"an axis and {expected}"
    matches = [matched(option, text, pattern, expected) for text in texts or ()]
    return {int(match["axis"]): match for match in matches}


def axis_ranges(
    texts: Sequence[str] | None,
    option: str,
    expected: str = "its range as in A4=0:360",
    limit: float = math.inf,
) -> dict[int, tuple[float, float]]:
    """Return what an option says of axes, two ascending ends each, by axis number."""
    matches = by_axis(texts, option, RANGE, expected).items()
    words = f"an axis and {expected}"
    return {
        axis: ascending(match, option, words, limit=limit) for axis, match in matches
    }


def ascending(
    match: "re.Match[str]", option: str, expected: str, *, limit: float = math.inf
) -> tuple[float, float]:
    """Return the two ends that `RANGE` has found; refuse what does not ascend in the limit."""
    low, high = float(match["low"]), float(match["high"])
    if not (-limit <= low < high <= limit and math.isfinite(high - low)):
        refuse(option, repr(match[0]), expected)
    return low, high
