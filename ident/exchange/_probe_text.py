"""A probe as a text for the machine, and as an NC program."""

from collections.abc import Mapping

from ..kinds import kinds
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

    At its end every compensation is on or off as it was before.

    Args:
        probe: The probe.
        feed: In mm/min.
    """
    lines = ["; Probe: log positions and offsets while this runs. Check the way first."]
    blocks: list[str] = []
    for step in probe_steps(probe):
        blocks += [f"; {step.axis}: {step.compensation}", f"{step.axis}[COMP OFF_ALL]"]
        on = f"{step.axis}[COMP ON {step.keyword}]"
        way, before = "G00" if step.moving else "G01", step.moving or step.steady
        rest = "G04 1"
        blocks += [_block("G01", step.start, feed), rest]
        if before:
            blocks += [on]
        blocks += [_block(way, step.end, feed), rest]
        if not before:
            blocks += [on, rest]
        blocks += [_block(way, step.start, feed), rest]
    words = dict.fromkeys(step.axis for step in probe_steps(probe))
    was = {
        (word, one.keyword): f"V.L.WAS_{word}_{one.keyword}".upper()
        for word in words
        for one in kinds()
    }
    lines += ["#VAR", *(f"{memory} = 0" for memory in was.values()), "#ENDVAR"]
    before_all = [
        f"{memory} = V.A.{keyword}_COMP_ACTIVE.{word}"
        for (word, keyword), memory in was.items()
    ]
    after_all = ["; As it was", *(f"{word}[COMP OFF_ALL]" for word in words)]
    for (word, keyword), memory in was.items():
        after_all += [f"$IF {memory} == 1", f"{word}[COMP ON {keyword}]", "$ENDIF"]
    number = 10
    for block in (*before_all, *blocks, *after_all, "M30"):
        if block.startswith(";"):
            lines.append(block)
            continue
        lines.append(f"N{number} {block}")
        number += 10
    return "\n".join([*lines, ""])


def _block(way: str, places: Mapping[str, float], feed: float) -> str:
    words = " ".join(f"{name}={number_text(value)}" for name, value in places.items())
    return f"G90 {way} {words}" + (f" F{feed:g}" if way == "G01" else "")
