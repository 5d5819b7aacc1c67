r"""The 21 geometric errors of a machine with three linear axes.

Names are those of ISO 230-1:2012: E, the direction of the error (X, Y, Z in mm; A, B, C, the
rotations about them, in rad), the axis that moves. So EYX is the straightness of X towards Y
and EAX its roll. EA0Z, EB0Z and EC0Y are the squareness of Z to Y, of Z to X and of Y to X,
as the rotation of the later axis about X, Y and Z. 1e-6 rad is 1 µm/m.
"""

from collections.abc import Mapping
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ._nodes import AbstractNodes, Values, float_array
from ._stencil import Stencil

AXES = "XYZ"
FUNCTIONS = tuple(
    tuple(f"E{direction}{axis}" for direction in "XYZABC") for axis in AXES
)
"""Names of the six functions of each axis, in the order of the tables."""
SQUARENESS = ("EA0Z", "EB0Z", "EC0Y")
"""Names of the three angles between the axes, in their order."""

_ANGLES = ((0, 2), (1, 2), (2, 1))
"""Direction of rotation of each squareness, and the axis that it turns."""


def _tables(
    values: tuple[ArrayLike, ArrayLike, ArrayLike],
) -> tuple[Values, Values, Values]:
    x, y, z = values
    return float_array(x), float_array(y), float_array(z)


@final
class GeometricErrors(eqx.Module):
    r"""Errors of the tool in the workpiece: rigid bodies, linear in all errors.

    With $r$ the distance of the axes from `reference`, $\delta_a(x_a)$ the three linear and
    $\varepsilon_a(x_a)$ the three angular functions of axis $a$, and $t$ the tool,

    $$e = \sum_a \delta_a(x_a) + \varepsilon_a(x_a) \times l_a
        + \begin{pmatrix} E_{A0Z} \\ E_{B0Z} \\ 0 \end{pmatrix} \times r_Z e_Z
        + \begin{pmatrix} 0 \\ 0 \\ E_{C0Y} \end{pmatrix} \times r_Y e_Y,
      \qquad l_a = \sum_{b \text{ after } a} r_b e_b + t .$$

    The error is actual − commanded place of the tool as the workpiece sees it, and so is
    every function, whichever of both the axis carries: what an instrument between them shows
    along the axis, with the other axes at `reference` and no tool. Therefore the lever $l_a$
    holds the axes between $a$ and the tool, and it does not matter where the bed stands.

    Functions are tables, linear between nodes, edges held. A table may hold an offset; a slope
    of EXY and the angle EC0Y, say, are one and the same: an estimate puts it in one place.

    Sources: ISO 230-1:2012, 3.4 and annex A; H. Schwenke et al., Geometric error measurement
    and compensation of machines, CIRP Annals 57(2), 2008, 660-675.
    """

    nodes: tuple[AbstractNodes, AbstractNodes, AbstractNodes]
    """Nodes along X, Y and Z in mm, common to the functions of an axis."""
    values: tuple[
        Float[Values, "6 _i"], Float[Values, "6 _j"], Float[Values, "6 _k"]
    ] = eqx.field(converter=_tables)
    """Functions of X, of Y, of Z: three rows in mm, three in rad (`FUNCTIONS`)."""
    squareness: Float[Values, "3"] = eqx.field(converter=float_array)
    """EA0Z, EB0Z and EC0Y in rad."""
    chain: str = eqx.field(default="XYZ", static=True)
    """The axes in their order from the workpiece to the tool."""
    reference: tuple[float, float, float] = eqx.field(
        default=(0.0, 0.0, 0.0), static=True
    )
    """Position of X, Y and Z in mm about which angles act."""
    sign: float = eqx.field(default=-1.0, static=True)
    """Offset per error: −1 takes it off."""

    def __check_init__(self) -> None:
        if sorted(self.chain) != list(AXES):
            msg = (
                "chain must name X, Y and Z from the workpiece to the tool, got "
                f"{self.chain!r}."
            )
            raise ValueError(msg)
        for axis, nodes, values in zip(AXES, self.nodes, self.values, strict=True):
            if values.shape != (6, nodes.count):
                msg = (
                    f"Functions of {axis} must have shape (6, {nodes.count}), got "
                    f"{values.shape}."
                )
                raise ValueError(msg)

    @classmethod
    def of(
        cls,
        nodes: tuple[AbstractNodes, AbstractNodes, AbstractNodes],
        errors: Mapping[str, ArrayLike],
        chain: str = "XYZ",
        reference: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> "GeometricErrors":
        """Return errors given by name; functions and angles without one are 0.

        Args:
            nodes: Along X, Y and Z in mm.
            errors: One value per node (EXX, …) in mm or rad, or one angle (EC0Y, …) in rad.
            chain: The axes from the workpiece to the tool.
            reference: Position of X, Y and Z in mm about which angles act.

        Raises:
            ValueError: If a name is unknown or a function has not one value per node.
        """
        unknown = set(errors) - {*SQUARENESS, *sum(FUNCTIONS, ())}
        if unknown:
            msg = (
                f"Found errors named {', '.join(sorted(unknown))}, expected EXX … ECZ, "
                f"{', '.join(SQUARENESS)}."
            )
            raise ValueError(msg)
        x, y, z = (
            jnp.stack(
                [
                    jnp.broadcast_to(float_array(errors.get(name, 0.0)), grid.count)
                    for name in names
                ]
            )
            for names, grid in zip(FUNCTIONS, nodes, strict=True)
        )
        angles = [float_array(errors.get(name, 0.0)) for name in SQUARENESS]
        return cls(nodes, (x, y, z), jnp.stack(angles), chain, reference)

    def __getitem__(self, name: str) -> Array:
        """Return a function's values at its nodes, or an angle, by its name.

        Raises:
            KeyError: If there is no such error.
        """
        rows: dict[str, Array] = dict(zip(SQUARENESS, self.squareness, strict=True))
        for names, values in zip(FUNCTIONS, self.values, strict=True):
            rows |= zip(names, values, strict=True)
        return rows[name]

    @eqx.filter_jit
    def error(
        self,
        positions: Float[Array | np.ndarray, "t 3"],
        tool: Float[Array | np.ndarray, "*t 3"] | None = None,
    ) -> Float[Array, "t 3"]:
        """Return the error of the tool in X, Y and Z in mm.

        Args:
            positions: Commanded X, Y and Z in mm.
            tool: From the point that `positions` name to the tip, in mm; for all alike or one
                a position. None: no tool.
        """
        place = jnp.asarray(positions, dtype=jnp.float64)
        *functions, angles = self._shares(place, tool)
        total = jnp.einsum("tcs,s->tc", angles, self.squareness)
        for axis, shares in enumerate(functions):
            stencil = self.nodes[axis].stencil(place[:, axis])
            now = jax.vmap(stencil)(self.values[axis])
            total = total + jnp.einsum("tcf,ft->tc", shares, now)
        return total

    def offset(
        self,
        positions: Float[Array | np.ndarray, "t 3"],
        tool: Float[Array | np.ndarray, "*t 3"] | None = None,
    ) -> Float[Array, "t 3"]:
        """Return what takes the error off, in mm; arguments as `error`."""
        return self.sign * self.error(positions, tool)

    @eqx.filter_jit
    def stencil(
        self,
        positions: Float[Array | np.ndarray, "t 3"],
        direction: Float[Array | np.ndarray, "t 3"],
        tool: Float[Array | np.ndarray, "*t 3"] | None = None,
    ) -> Stencil:
        """Return the 39 numbers that the error along a direction touches, and their shares.

        Here shares have a unit: they are levers in mm for angles.

        Args:
            positions: Commanded X, Y and Z in mm.
            direction: Along which the error is taken, of length 1.
            tool: As for `error`.
        """
        place = jnp.asarray(positions, dtype=jnp.float64)
        along = jnp.asarray(direction, dtype=jnp.float64)
        nodes, weights, first = [], [], 0
        *functions, angles = self._shares(place, tool)
        for axis, shares in enumerate(functions):
            count = self.nodes[axis].count
            part = self.nodes[axis].stencil(place[:, axis])
            arms = jnp.einsum("tc,tcf->tf", along, shares)
            starts = first + count * jnp.arange(6, dtype=part.nodes.dtype)
            touched = starts[None, :, None] + part.nodes[:, None, :]
            nodes.append(touched.reshape(-1, 12))
            weights.append(
                (arms[:, :, None] * part.weights[:, None, :]).reshape(-1, 12)
            )
            first += 6 * count
        last = first + jnp.arange(3, dtype=nodes[0].dtype)
        nodes.append(jnp.broadcast_to(last, (place.shape[0], 3)))
        weights.append(jnp.einsum("tc,tcs->ts", along, angles))
        return Stencil(
            jnp.concatenate(nodes, axis=1), jnp.concatenate(weights, axis=1), first + 3
        )

    @property
    def numbers(self) -> Float[Array, " n"]:
        """All errors in a row, as `stencil` counts them."""
        return jnp.concatenate(
            [*(block.reshape(-1) for block in self.values), self.squareness]
        )

    def with_numbers(
        self, numbers: Float[Array | np.ndarray, " n"]
    ) -> "GeometricErrors":
        """Return the same machine with other errors, in a row as `numbers`."""
        row = float_array(numbers)
        ends = np.cumsum([6 * nodes.count for nodes in self.nodes])
        x, y, z, angles = jnp.split(row, ends)
        values = (x.reshape(6, -1), y.reshape(6, -1), z.reshape(6, -1))
        return GeometricErrors(
            self.nodes, values, angles, self.chain, self.reference, self.sign
        )

    def _shares(
        self,
        place: Float[Array, "t 3"],
        tool: Float[Array | np.ndarray, "*t 3"] | None,
    ) -> list[Float[Array, "t 3 _f"]]:
        """Return what a unit of each function of X, Y, Z, and of each angle, does to the tool."""
        tip = jnp.zeros(3) if tool is None else jnp.asarray(tool, dtype=jnp.float64)
        relative = place - jnp.array(self.reference)[None, :]
        unit = jnp.broadcast_to(jnp.eye(3), (place.shape[0], 3, 3))
        shares = []
        for axis in AXES:
            following = self.chain[self.chain.index(axis) + 1 :]
            between = np.array([float(other in following) for other in AXES])
            lever = relative * between[None, :] + jnp.broadcast_to(tip, place.shape)
            # Columns: the rotation about each axis moves the end of the lever so.
            turned = jnp.cross(unit, lever[:, None, :])
            shares.append(jnp.concatenate([unit, jnp.swapaxes(turned, 1, 2)], axis=2))
        square = [
            jnp.cross(unit[:, about], relative[:, axis, None] * unit[:, axis])
            for about, axis in _ANGLES
        ]
        return [*shares, jnp.stack(square, axis=2)]
