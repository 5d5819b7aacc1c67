"""C and C++ of an external compensation, from the graph of its model."""

import functools
import re
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import jinja2

LAW = "axcomp_external_law"
"""Name of the function that CasADi generates."""
_HELP = re.compile(
    rf"^CASADI_SYMBOL_EXPORT (?!int {LAW}\()[^\n]*(?:\}}\n|\{{\n.*?^\}}\n)\n?",
    re.DOTALL | re.MULTILINE,
)
"""Functions about the function, which only CasADi itself would ask for."""
_HEAD = re.compile(
    r"^((?:CASADI_SYMBOL_EXPORT|static) int \w+\(const casadi_real\*\* arg.*\{)$",
    re.MULTILINE,
)
_EITHER = re.compile(r"^/\* Pre-c99.*\n#if .*\n(.*\n)#else\n.*\n#endif\n", re.MULTILINE)
"""Functions of C99 that the SDK has not, with how CasADi does without them."""
_PATTERN = re.compile(r"^static const casadi_int (casadi_s\d+)\[.*\n", re.MULTILINE)
_REAL_TIME = (
    "fabs fmod floor ceil sqrt exp log pow sin cos tan asin acos atan atan2".split()
)
"""Functions of ``math.h`` that the SDK has for real time, with a line behind the name."""
_UNUSED = " (void)arg; (void)res; (void)iw; (void)w; (void)mem;"
_FILES = (
    "axcomp_external.h",
    "axcomp_external.c",
    "axcomp_external_layer.hpp",
    "axcomp_external_layer.cpp",
)


def code_files(
    law: ca.Function, axes: Sequence[int], *, title: str, zone: float, ramp_cycles: int
) -> dict[str, str]:
    """Return the text of each C and C++ file by name.

    Args:
        law: From `casadi_function`.
        axes: Logical numbers, ascending.
        title: One line at the top of the files.
        zone: Distance from a software limit in mm or ° in which an offset fades out.
        ramp_cycles: Cycles of a ramp.
    """
    sizes = {
        "arg": law.sz_arg(),
        "res": law.sz_res(),
        "iw": max(law.sz_iw(), 1),
        "w": max(law.sz_w(), 1),
    }
    facts = {
        "arithmetic": _arithmetic(law),
        "axes": axes,
        "name": LAW,
        "ramp_cycles": ramp_cycles,
        "real_time": _REAL_TIME,
        "title": plain(title),
        "work": sizes,
        "zone": f"{zone:.17g}" if zone % 1.0 else f"{zone:.1f}",
    }
    return {name: rendered(name, facts) for name in _FILES}


def plain(title: str) -> str:
    """Return a title as any of the files can hold it: ASCII, and no end of a comment."""
    ascii_only = title.encode("ascii", "replace").decode()
    return re.sub(r"[^\w ,.:;/+=?!%-]+|-(?=-)|/$", " ", ascii_only)


def rendered(name: str, facts: Mapping[str, Any]) -> str:
    """Return a file of the export, from its template."""
    return _templates().get_template(f"{name}.jinja").render(facts)


@functools.cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader(__package__ or "", "templates"),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,
    )


def _arithmetic(law: ca.Function) -> str:
    """Return the C code that CasADi generates for a function, which becomes static.

    What no one uses is left out or named as such: no compiler warns of it.
    """
    generator = ca.CodeGenerator(LAW, {"with_header": False})
    generator.add(law)
    text = _HELP.sub("", generator.dump()).replace("#include <math.h>\n", "")
    text = _EITHER.sub(r"\1", text)
    text = _HEAD.sub(lambda match: match[1] + _UNUSED, text)
    for pattern in list(_PATTERN.finditer(text)):
        if len(re.findall(rf"\b{pattern[1]}\b", text)) == 2:  # its macro and itself
            text = text.replace(pattern[0], "")
    return f"#define CASADI_SYMBOL_EXPORT static\n{text}"
