"""A job as text that asks: keys, remarks, and questions with their possible answers."""

import dataclasses
import itertools
import re
import textwrap
from collections.abc import Sequence

ANSWER = "#? "
"""Stands before each possible answer to a question."""
OPTIONAL = " (may stay open)"
"""Stands behind the number of a question that a fit does without."""
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
    """Lines of a job in the making, and what they ask."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.questions: list[Question] = []

    def add(self, *lines: str) -> None:
        """Add lines as they stand."""
        self.lines += lines

    def note(self, *sentences: str) -> None:
        """Add sentences as remarks, wrapped."""
        for sentence in sentences:
            self.lines += _wrapped(sentence, "# ")

    def key(self, line: str, remark: str = "") -> None:
        """Add a key with a remark behind it."""
        self.lines.append(f"{line:<33} # {remark}" if remark else line)

    def ask(
        self, about: str, words: str, answers: Sequence[str], *, needed: bool = True
    ) -> None:
        """Add a question with the lines that would answer it."""
        number = len(self.questions) + 1
        self.questions.append(
            Question(len(self.lines) + 1, about, words, tuple(answers), needed)
        )
        head = f"# QUESTION {number}{'' if needed else OPTIONAL}: "
        self.lines += _wrapped(words, head)
        self.lines += [f"{ANSWER}{answer}" for answer in answers]

    def text(self, head: Sequence[str]) -> str:
        """Return the job below a head, whose lines the questions then count."""
        self.questions = [
            dataclasses.replace(question, line=question.line + len(head))
            for question in self.questions
        ]
        return "\n".join([*head, *self.lines]) + "\n"


def _wrapped(sentence: str, opening: str) -> list[str]:
    return textwrap.wrap(
        sentence,
        _WIDTH,
        initial_indent=opening,
        subsequent_indent="# ",
        break_long_words=False,
        break_on_hyphens=False,
    )
