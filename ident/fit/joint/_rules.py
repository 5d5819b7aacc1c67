"""Freedoms of the sum, and the rule that fixes them: the simplest effect carries.

Found from the null space of the information of rows in which everything varies by itself.
The effects give way in a fixed order: runs first, then planes, crosstalk, temperature,
bilateral leadscrews, crosses, leadscrews, backlash; the datum keeps what is left. An effect
gives way by having mean zero over the readings along every shape that a simpler one can
carry; a temperature by correcting nothing at its reference temperature. Measured errors play
no part.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...core import node_shares
from ._data import JointData
from ._design import Component, Design, design_of
from ._everything import everything_varies
from ._families import Family, families, information
from ._null import null_space, pivoted
from ._sums import Information
from ._tables import LeadscrewEffect
from ._temperature import TemperatureEffect

_ORDER = (
    "wander",
    "runs",
    "delay",
    "plane",
    "crosstalk",
    "temperature coefficient",
    "temperature offset",
    "bilateral leadscrew",
    "cross",
    "leadscrew",
    "backlash",
    "datum",
)
_NOTHING = 1e-7
"""Size of a direction, relative to all, below which a component has no part in it."""


@dataclasses.dataclass(frozen=True)
class Rules:
    """Directions that may be moved, and what fixes them.

    Attributes:
        null: One direction per column, shape ``(n, g)``.
        functionals: Zero under the rule, shape ``(q, n)``.
        shapes: Families of the structural analysis, with their information and places.
        matrix: Information on all these shapes where everything varies.
        slices: Of each component in it.
    """

    null: Float[np.ndarray, "n g"]
    functionals: Float[np.ndarray, "q n"]
    shapes: tuple[Family, ...]
    matrix: Float[np.ndarray, "m m"]
    slices: tuple[slice, ...]

    @property
    def gain(self) -> Float[np.ndarray, "g n"]:
        """How far each direction is moved, per unknown."""
        if not self.null.shape[1]:
            return np.zeros((0, len(self.null)))
        return np.asarray(
            np.linalg.pinv(self.functionals @ self.null, rcond=1e-9) @ self.functionals
        )

    def project(self, theta: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return values, or columns of them, under the rule; their sum stays what it is."""
        return np.asarray(theta - self.null @ (self.gain @ theta))


def priority(component: Component, design: Design) -> int:
    """Return how simple a component is: the larger, the later it gives way."""
    kind = component.kind
    if kind == "leadscrew":
        effect = design.effects[component.effect]
        if isinstance(effect, LeadscrewEffect) and effect.bilateral:
            kind = "bilateral leadscrew"
    return _ORDER.index(kind)


def rules_of(
    design: Design, data: JointData, drift: int, counts: Float[np.ndarray, " n"]
) -> Rules:
    """Return the freedoms of the sum for these effects and the rule that fixes them.

    Args:
        design: Columns of the actual data.
        data: The actual data, all rows.
        drift: Pieces of the drift of each run.
        counts: Sum of the weights with which actual readings touch each unknown.
    """
    everywhere = np.ones(design.size, bool)
    total = sum(each.count for each in families(design, everywhere, smooth=False))
    varied = everything_varies(design, data, total)
    effects = tuple(
        effect.lagging(dict.fromkeys(effect.sensor_names, 0.0))
        if isinstance(effect, TemperatureEffect)
        else effect
        for effect in design.effects
    )
    ideal = Information.of(
        design_of(
            design.axis, effects, varied, drift, None, measured=False, wander=False
        )
    )
    shapes = families(design, ideal.diagonal > 0, smooth=False)
    matrix, slices = information(ideal, shapes)
    found = null_space(matrix)
    null = np.zeros((design.size, found.shape[1]))
    for family, own in zip(shapes, slices, strict=True):
        null[family.component.places] = family.shapes @ found[own]
    functionals = eliminate(design, null, counts)
    return Rules(null, functionals, tuple(shapes), matrix, tuple(slices))


def with_lost(
    rules: Rules,
    design: Design,
    lost: Float[np.ndarray, "n g"],
    counts: Float[np.ndarray, " n"],
) -> Rules:
    """Return the rules with directions beside them that the actual data leave open."""
    if not lost.shape[1]:
        return rules
    held = lost - rules.null @ np.linalg.lstsq(rules.null, lost, rcond=None)[0]
    size = np.linalg.norm(lost, axis=0)
    basis, left, _ = pivoted(held / size)
    more = basis[:, left > _NOTHING]
    if not more.shape[1]:
        return rules
    # The new ones begin where the rule so far puts them.
    more = more - rules.null @ (rules.gain @ more)
    fixed = eliminate(design, more, counts)
    return dataclasses.replace(
        rules,
        null=np.hstack([rules.null, more]),
        functionals=np.vstack([rules.functionals, fixed]),
    )


def eliminate(
    design: Design, null: Float[np.ndarray, "n g"], counts: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "q n"]:
    """Return functionals that fix null directions, the least simple effect giving way first."""
    remaining = null / np.maximum(np.linalg.norm(null, axis=0), 1e-300)
    rows: list[Float[np.ndarray, "_ n"]] = []
    sequence = sorted(
        range(len(design.components)),
        key=lambda k: (priority(design.components[k], design), -k),
    )
    for k in sequence:
        component = design.components[k]
        if not remaining.shape[1]:
            break
        own = remaining[component.places]
        # A plane has very many values: only the right side is ever wanted whole.
        whole = own.shape[0] < own.shape[1]
        left, size, right = np.linalg.svd(own, full_matrices=whole)
        rank = int(
            (size > _NOTHING * max(float(size.max(initial=0.0)), _NOTHING)).sum()
        )
        rank = rank if float(size.max(initial=0.0)) > _NOTHING else 0
        if not rank:
            continue
        weights = _reference(component, design) if rank == 1 else None
        if weights is None:
            weights = left[:, :rank].T * counts[component.places]
        part = np.zeros((rank, design.size))
        part[:, component.places] = weights
        rows.append(part)
        remaining = remaining @ right[rank:].T
    return np.vstack(rows) if rows else np.zeros((0, design.size))


def _reference(component: Component, design: Design) -> Float[np.ndarray, "1 p"] | None:
    """Return what a law gives at the reference temperature; None for other components."""
    if not component.kind.startswith("temperature"):
        return None
    effect = design.effects[component.effect]
    assert isinstance(effect, TemperatureEffect)
    nodes = effect.nodes[component.kind.removeprefix("temperature ")]
    return node_shares(np.array([effect.reference_temperature]), nodes)
