"""A probe as a text for the machine, and as an NC program."""

from collections.abc import Mapping

from ._probe import Probe, number_text
from ._probe_steps import probe_steps


def probe_text(probe: Probe) -> str:
    """Return all of it as a text to be read at the machine."""
    lines = [
        "Probe: one plateau of 10 µm (0.01°) per compensation.",
        "",
        "Keep the lists that are loaded now. Load the probe lists, add the entries of"
        " achsmds*.add.lis to the axis lists, reference the axes, move slowly.",
        "A gauge shows what really moves; a log shows what the controller says that it"
        " adds. Where both differ in sign, the gauge is right.",
        "",
    ]
    for k, step in enumerate(probe_steps(probe), start=1):
        lines.append(f"{k}. {step.sentence}")
        lines += [f"   {one.seen}: {one.means}." for one in step.outcomes]
        lines.append("")
    lines += [
        "With a log of all positions and these values: axcomp verify LISTS --log LOG.csv"
        " --save MACHINE.conventions.toml",
        "Afterwards load the lists that you kept.",
        "",
    ]
    return "\n".join(lines)


def probe_program(probe: Probe, feed: float = 1000.0) -> str:
    """Return an NC program that goes through all of it, resting for a second each time.

    Args:
        probe: The probe.
        feed: In mm/min.
    """
    lines = ["; Probe: log positions and offsets while this runs. Check the way first."]
    blocks: list[str] = []
    for step in probe_steps(probe):
        blocks += [f"; {step.axis}: {step.compensation}", f"{step.axis}[COMP OFF_ALL]"]
        on = f"{step.axis}[COMP ON {step.keyword}]"
        way = "G00" if step.moving else "G01"
        rest = "G04 1"
        blocks += [_block("G01", step.start, feed), rest]
        if step.moving:
            blocks += [on]
        blocks += [_block(way, step.end, feed), rest]
        if not step.moving:
            blocks += [on, rest]
        blocks += [_block(way, step.start, feed), rest]
    number = 10
    for block in (*blocks, "M30"):
        if block.startswith(";"):
            lines.append(block)
            continue
        lines.append(f"N{number} {block}")
        number += 10
    return "\n".join([*lines, ""])


def _block(way: str, places: Mapping[str, float], feed: float) -> str:
    words = " ".join(f"{name}={number_text(value)}" for name, value in places.items())
    return f"G90 {way} {words}" + (f" F{feed:g}" if way == "G01" else "")
