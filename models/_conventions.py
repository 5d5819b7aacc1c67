"""Every rule of the controller that the manuals leave open, by name, in one place."""

import dataclasses
import difflib
import functools
import typing
from collections.abc import Mapping
from typing import Any, Literal

Sign = Literal[1, -1]
Decides = Literal["sign", "owner", "zero", ""]


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
        decides: ``sign`` where another value turns what a list adds, ``owner`` where it
            hands it to another axis or master, ``zero`` where it shifts an axis as a
            whole, which an instrument with a zero of its own cannot show, else empty. A
            list is unproven as long as such a rule is assumed.
    """

    name: str
    value: int | str
    default: int | str
    choices: tuple[int | str, ...]
    rule: str
    meaning: str
    decides: Decides


def _about(rule: str, meaning: str, decides: Decides = "") -> dict[str, str]:
    return {"rule": rule, "meaning": meaning, "decides": decides}


@dataclasses.dataclass(frozen=True)
class Conventions:
    """How the controller reads and applies lists where the manuals do not say it.

    Frozen and hashable, so that it can be a static argument. What each field means, and
    the point of the manuals behind it, is with the field (`Conventions.listing`).
    """

    plane_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-11", "Offset per entry of a plane table.", "sign"),
    )
    plane_index: Literal["ji", "ij"] = dataclasses.field(
        default="ji",
        metadata=_about(
            "S-17",
            "First index of a plane table: master 2 (ji) or master 1 (ij).",
            "owner",
        ),
    )
    plane_input: Literal["command", "actual"] = dataclasses.field(
        default="command",
        metadata=_about("S-17", "Positions of the masters that enter a plane table."),
    )
    cross_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-11", "Offset per entry of a cross table.", "sign"),
    )
    cross_edge: Literal["hold", "zero"] = dataclasses.field(
        default="hold",
        metadata=_about("S-12", "Outside a cross table: edge held, or no offset."),
    )
    cross_list: Literal["slave", "master"] = dataclasses.field(
        default="slave",
        metadata=_about(
            "S-10", "Axis in whose list the data of a cross table stand.", "owner"
        ),
    )
    leadscrew_sign: Sign = dataclasses.field(
        default=-1,
        metadata=_about("S-18", "Offset per entry of a leadscrew table.", "sign"),
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
            "S-45", "Direction of the reference flank where P-AXIS-00021 is 1.", "zero"
        ),
    )
    backlash_start: Literal["direction", "reference"] = dataclasses.field(
        default="direction",
        metadata=_about(
            "S-45",
            "Before the first motion the backlash takes the start direction, or the "
            "direction of its reference flank.",
        ),
    )
    temperature_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-43", "Offset per Δs of the temperature line.", "sign"),
    )
    temperature_filter: Literal["switching", "values"] = dataclasses.field(
        default="switching",
        metadata=_about(
            "S-06", "What temp_comp_n_cycles smooths: switching, or the offset itself."
        ),
    )
    table_filter: Literal["switching", "values"] = dataclasses.field(
        default="switching",
        metadata=_about(
            "S-06", "What n_cycles of cross and plane smooths: switching or the offset."
        ),
    )
    filter_delay: Literal[0, 1] = dataclasses.field(
        default=0,
        metadata=_about(
            "S-06", "Cycles between a change and the first share of its sin² filter."
        ),
    )
    external_limit: Literal["offset", "change"] = dataclasses.field(
        default="offset",
        metadata=_about(
            "S-54",
            "What P-AXIS-00743 and 744 limit: the offset, or its change per cycle.",
        ),
    )
    friction_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about(
            "S-47", "Current per entry of a friction table for positive motion.", "sign"
        ),
    )
    friction_below: Literal["hold", "line"] = dataclasses.field(
        default="hold",
        metadata=_about(
            "S-27",
            "Below the first friction entry: it is held, or a line from 0 at rest.",
        ),
    )
    friction_above: Literal["hold", "line"] = dataclasses.field(
        default="hold",
        metadata=_about(
            "S-27", "Above the last friction entry: it is held, or its segment goes on."
        ),
    )
    friction_rest: Literal["zero", "hold"] = dataclasses.field(
        default="zero",
        metadata=_about(
            "S-27",
            "Current at standstill: none, or that of speed 0 in the last direction.",
        ),
    )
    friction_build_up: Literal["first", "reversal", "start"] = dataclasses.field(
        default="first",
        metadata=_about(
            "S-28",
            "The current rises after reversals and on the first motion of all, "
            "after reversals only, or after every start.",
        ),
    )
    friction_decay: Literal["zero", "step"] = dataclasses.field(
        default="zero",
        metadata=_about(
            "S-30",
            "Weight in the last of the N cycles before a reversal: 0, or 1/(N + 1).",
        ),
    )
    friction_overlap: Literal["product", "lesser"] = dataclasses.field(
        default="product",
        metadata=_about(
            "S-30",
            "Weights before and after reversals where both act: product, or the "
            "lesser.",
        ),
    )
    friction_delay: Literal["all", "reversal"] = dataclasses.field(
        default="all",
        metadata=_about(
            "S-31", "delay_cycles delay all values, or hold them from each reversal on."
        ),
    )
    crosstalk_sign: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-42", "Offset per entry of a crosstalk list.", "sign"),
    )
    crosstalk_accelerate: Literal["sign", "speed"] = dataclasses.field(
        default="sign",
        metadata=_about(
            "S-34",
            "Accelerating is where a is not negative, or where |v| does not shrink.",
            "sign",
        ),
    )
    crosstalk_undirected: Literal["own", "accelerate"] = dataclasses.field(
        default="own",
        metadata=_about(
            "S-35",
            "Without velocity_dependent decelerations take their own entries "
            "for positive direction, or those of accelerations.",
        ),
    )
    crosstalk_velocity: Literal["master", "slave"] = dataclasses.field(
        default="master",
        metadata=_about(
            "S-35", "Axis whose velocity gives the direction for crosstalk."
        ),
    )
    crosstalk_rest: Sign = dataclasses.field(
        default=1,
        metadata=_about("S-35", "Direction for crosstalk where the velocity is 0."),
    )
    crosstalk_above: Literal["hold", "line"] = dataclasses.field(
        default="hold",
        metadata=_about(
            "S-36", "Above the specified acceleration: offset held, or it grows on."
        ),
    )
    crosstalk_outside: Literal["hold", "zero"] = dataclasses.field(
        default="hold",
        metadata=_about(
            "S-37, S-38",
            "Outside the crosstalk tests: nearest point held, or no offset.",
        ),
    )
    crosstalk_surface: Literal["grid", "triangles", "thin_plate"] = dataclasses.field(
        default="grid",
        metadata=_about(
            "S-38",
            "Between the tests of mode 3: bilinear where they form a grid, else "
            "triangles; always triangles; or a thin plate.",
        ),
    )
    crosstalk_input: Literal["command", "actual"] = dataclasses.field(
        default="command",
        metadata=_about(
            "S-61", "Acceleration and velocity that enter a crosstalk list."
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
                decides=field.metadata["decides"],
            )
            for field in dataclasses.fields(self)
        )

    @property
    def of_crosstalk(self) -> dict[str, Any]:
        """Arguments of `axcomp.models.Crosstalk` that these rules decide."""
        return {
            "sign": float(self.crosstalk_sign),
            "by_speed": self.crosstalk_accelerate == "speed",
            "own_deceleration": self.crosstalk_undirected == "own",
            "rest_direction": self.crosstalk_rest,
            "held_above": self.crosstalk_above == "hold",
            "held_outside": self.crosstalk_outside == "hold",
        }

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
        names = [field.name for field in dataclasses.fields(cls)]
        for name, value in values.items():
            if name not in names:
                nearest = difflib.get_close_matches(str(name), names, n=1, cutoff=0.0)
                raise ConventionError(
                    str(name), "an unknown name", f"a known one such as {nearest[0]!r}"
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
