"""A job as text that asks: keys, remarks, and questions with their possible answers."""

import dataclasses
import itertools
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

from .._templates import templates

ANSWER = "#? "
"""Stands before each possible answer to a question."""
OPTIONAL = " (may stay open)"
"""Stands behind the number of a question that a fit does without."""
_QUESTION = re.compile(r"# QUESTION \d+")
_OPEN = re.compile(r"# QUESTION \d+: ")
_EITHER = (("datum", "remove"), ("actual", "encoder"), ("error", "position"))
"""Keys, or kinds of role, of which either answers a question."""
_WIDTH = 88


@dataclasses.dataclass(frozen=True)
class Question:
    """What a written job asks.

    Attributes:
        line: Of the file, from 1.
        about: The key that answers it: ``axes.X.number``.
        words: What is asked.
        answers: Lines of the file that would answer it.
        needed: Without an answer `axcomp fit` refuses the job.
    """

    line: int
    about: str
    words: str
    answers: tuple[str, ...]
    needed: bool


def open_question(text: str) -> tuple[int, str] | None:
    """Return the line and the words of the first question of a job that has no answer yet.

    One that may stay open is none.
    """
    lines = text.splitlines()
    for number, line in enumerate(lines, start=1):
        if not _OPEN.match(line):
            continue
        rest = itertools.dropwhile(lambda one: one.startswith("# "), lines[number:])
        block = [
            *itertools.takewhile(lambda one: one and not one.startswith("# "), rest)
        ]
        wanted = {_key(one) for one in block if one.startswith(ANSWER)}
        stated = {_key(one) for one in block if one[0] != "#"}
        for one, other in _EITHER:
            wanted |= {key.replace(one, other) for key in wanted}
            wanted |= {key.replace(other, one) for key in wanted}
        if wanted and not wanted & stated:
            words = itertools.takewhile(
                lambda one: one.startswith("# "), lines[number:]
            )
            return number, " ".join(each.removeprefix("# ") for each in (line, *words))
    return None


def _key(line: str) -> str:
    return line.removeprefix(ANSWER).partition("=")[0].strip()


class JobPage:
    """The template of a job at work: what it remarks and asks, as lines of the job."""

    def __init__(self) -> None:
        self.questions: list[Question] = []

    def note(self, *, caller: Callable[[], str]) -> str:
        """Return a sentence as a remark, wrapped."""
        return _wrapped(caller(), "# ")

    def ask(
        self,
        about: str,
        answers: Sequence[str],
        needed: bool = True,
        *,
        caller: Callable[[], str],
    ) -> str:
        """Return a question with the lines that would answer it."""
        words = " ".join(caller().strip().splitlines())
        self.questions.append(Question(0, about, words, tuple(answers), needed))
        head = f"# QUESTION {len(self.questions)}{'' if needed else OPTIONAL}: "
        lines = [f"{ANSWER}{answer}\n" for answer in answers]
        return "".join([_wrapped(words, head), *lines])

    def rendered(self, **values: Any) -> str:
        """Return the job, whose lines the questions then know."""
        template = templates(__package__ or "").get_template("job.toml.jinja")
        text = template.render(
            **values, note=self.note, ask=self.ask, questions=self.questions
        )
        lines = enumerate(text.splitlines(), start=1)
        heads = [number for number, line in lines if _QUESTION.match(line)]
        self.questions = [
            dataclasses.replace(question, line=line)
            for question, line in zip(self.questions, heads, strict=True)
        ]
        return text


def _wrapped(sentence: str, opening: str) -> str:
    lines = textwrap.wrap(
        sentence,
        _WIDTH,
        initial_indent=opening,
        subsequent_indent="# ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "".join(f"{line}\n" for line in lines)
