"""Every rule of the controller that the manuals leave open, by name, in one place."""

import dataclasses
import difflib
import functools
import typing
from collections.abc import Mapping
from typing import Any, Literal

Sign = Literal[1, -1]


class ConventionError(ValueError):
    """A convention that does not exist, or a value that it cannot take.

    Attributes:
        name: Of the convention as given.
        found: What was given.
        expected: What could be given instead, in words.
    """

    def __init__(self, name: str, found: str, expected: str) -> None:
        super().__init__(name, found, expected)
        self.name, self.found, self.expected = name, found, expected

    def __str__(self) -> str:
        return f"convention {self.name!r}: found {self.found}, expected {self.expected}"


@dataclasses.dataclass(frozen=True)
class Convention:
    """One rule: its name, the value taken, its default, what else it could be.

    Attributes:
        name: Field of `Conventions`.
        value: Value taken.
        default: Value that is assumed until a log or a second measurement settles it.
        choices: All values that it can take.
        rule: Number in the list of contradictions and silent points (S-…).
        meaning: One line.
    """

    name: str
    value: int | str
    default: int | str
    choices: tuple[int | str, ...]
    rule: str
    meaning: str


def _about(rule: str, meaning: str) -> dict[str, str]:
    return {"rule": rule, "meaning": meaning}


@dataclasses.dataclass(frozen=True)
class Conventions:
    """How the controller reads and applies lists where the manuals do not say it.

    Frozen and hashable, so that it can be a static argument. What each field means, and
    the point of the manuals behind it, is with the field (`Conventions.listing`).
    """

    plane_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-11", "Offset per entry of a plane table."),
    )
    plane_index: Literal["ji", "ij"] = dataclasses.field(
        default="ji",
        metadata=_about(
            "S-17", "First index of a plane table: master 2 (ji) or master 1 (ij)."
        ),
    )
    plane_input: Literal["command", "actual"] = dataclasses.field(
        default="command",
        metadata=_about("S-17", "Positions of the masters that enter a plane table."),
    )
    cross_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-11", "Offset per entry of a cross table."),
    )
    cross_edge: Literal["hold", "zero"] = dataclasses.field(
        default="hold",
        metadata=_about("S-12", "Outside a cross table: edge held, or no offset."),
    )
    cross_list: Literal["slave", "master"] = dataclasses.field(
        default="slave",
        metadata=_about("S-10", "Axis in whose list the data of a cross table stand."),
    )
    leadscrew_sign: Sign = dataclasses.field(
        default=-1,
        metadata=_about("S-18", "Offset per entry of a leadscrew table."),
    )
    leadscrew_input: Literal["all", "none"] = dataclasses.field(
        default="all",
        metadata=_about(
            "S-23",
            "Offsets of other compensations that enter the leadscrew table where "
            "set_pos_without_comp is 0.",
        ),
    )
    direction_source: Literal["command", "actual"] = dataclasses.field(
        default="command",
        metadata=_about("S-21", "Motion whose direction chooses the table."),
    )
    start_direction: Sign = dataclasses.field(
        default=1,
        metadata=_about(
            "S-21", "Direction before the first motion; at standstill the last one."
        ),
    )
    backlash_reference: Sign = dataclasses.field(
        default=1,
        metadata=_about(
            "S-45", "Direction of the reference flank where P-AXIS-00021 is 1."
        ),
    )

    def __post_init__(self) -> None:
        """Refuse values that a convention cannot take.

        Raises:
            ConventionError: If a value is none of the choices.
        """
        for field in dataclasses.fields(self):
            _check(field.name, getattr(self, field.name))

    def listing(self) -> tuple[Convention, ...]:
        """Return every convention with its value, default, choices and meaning."""
        return tuple(
            Convention(
                name=field.name,
                value=getattr(self, field.name),
                default=getattr(Conventions, field.name),
                choices=_choices(field.name),
                rule=field.metadata["rule"],
                meaning=field.metadata["meaning"],
            )
            for field in dataclasses.fields(self)
        )

    def to_dict(self) -> dict[str, int | str]:
        """Return all values by name, as plain numbers and strings."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Conventions":
        """Return the conventions with these values, defaults for the rest.

        Raises:
            ConventionError: If a name is unknown (names the nearest one) or a value is
                none of its choices.
        """
        known = [field.name for field in dataclasses.fields(cls)]
        for name, value in values.items():
            if name not in known:
                near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.0)
                raise ConventionError(
                    str(name), "an unknown name", f"a known one such as {near[0]!r}"
                )
            _check(name, value)
        return cls(**values)


def _check(name: str, value: object) -> None:
    choices = _choices(name)
    # True == 1, but it is no sign.
    if isinstance(value, bool) or value not in choices:
        expected = " or ".join(repr(choice) for choice in choices)
        raise ConventionError(name, repr(value), expected)


@functools.cache
def _choices(name: str) -> tuple[int | str, ...]:
    return typing.get_args(typing.get_type_hints(Conventions)[name])
