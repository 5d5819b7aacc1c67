"""The 21 errors against products of homogeneous matrices, carried out axis by axis."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from axcomp.models import EquidistantNodes, ExternalCompensation, GeometricErrors

NODES = (
    EquidistantNodes(-100.0, 100.0, 6),
    EquidistantNodes(0.0, 80.0, 6),
    EquidistantNodes(-50.0, 90.0, 5),
)
FUNCTIONS = [f"E{d}{a}" for a in "XYZ" for d in "XYZABC"]
REFERENCE = (20.0, 100.0, -10.0)
TOOL = np.array([12.0, -30.0, -150.0])
SMALL = 1e-3
"""Scale of the errors: what is left out, products of two, is a thousandth of them."""


def machine(chain: str = "XYZ", scale: float = 1.0) -> GeometricErrors:
    """A machine with all 21 errors: some 10 µm and 10 µm/m times the scale."""
    rng = np.random.default_rng(4)
    counts = dict(zip("XYZ", (6, 6, 5), strict=True))
    errors = {
        name: scale * 1e-2 * rng.normal(size=counts[name[2]])
        * (1.0 if name[1] in "XYZ" else 1e-3)
        for name in FUNCTIONS
    }  # fmt: skip
    errors |= {n: scale * 1e-5 * rng.normal() for n in ("EA0Z", "EB0Z", "EC0Y")}
    return GeometricErrors.of(NODES, errors, chain, REFERENCE)


def places(count: int = 40) -> np.ndarray:
    low, high = np.array([-100.0, 0.0, -50.0]), np.array([400.0, 400.0, 310.0])
    return np.random.default_rng(5).uniform(low, high, (count, 3))


def pose(move: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Homogeneous matrix of a rotation (in rad about X, Y, Z) followed by a move."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    found[:3, 3] = move
    return found


def joint(model: GeometricErrors, axis: int, position: float) -> np.ndarray:
    """Pose of the tool's side of an axis as its workpiece's side sees it."""
    name, away = "XYZ"[axis], position - REFERENCE[axis]
    six = np.array(
        [
            np.interp(position, NODES[axis].positions, model[f"E{d}{name}"])
            for d in "XYZABC"
        ]
    )
    way = np.eye(3)[axis] * away
    square = {"X": "", "Y": "EC0Y", "Z": "EA0Z EB0Z"}[name].split()
    skew = np.zeros(3)
    for angle in square:
        skew["ABC".index(angle[1])] = float(model[angle])
    # The skew axis moves along its own direction without turning what it carries.
    way = Rotation.from_rotvec(skew).apply(way)
    return pose(way + six[:3], six[3:])


def by_matrices(
    model: GeometricErrors, place: np.ndarray, tool: np.ndarray, table: int
) -> np.ndarray:
    """Error of the tool from the poses of workpiece and tool on the bed.

    Args:
        model: Its errors are those of the tool's side against the workpiece's side.
        place: Commanded position.
        tool: Vector to the tip.
        table: So many axes from the workpiece on are tables: they move the workpiece.
    """
    order = ["XYZ".index(axis) for axis in model.chain]
    workpiece, spindle = np.eye(4), np.eye(4)
    for axis in reversed(order[:table]):
        # A table is moved by the inverse of what the workpiece sees of the bed.
        workpiece = workpiece @ np.linalg.inv(joint(model, axis, place[axis]))
    for axis in order[table:]:
        spindle = spindle @ joint(model, axis, place[axis])
    tip = np.linalg.inv(workpiece) @ spindle @ np.append(tool, 1.0)
    return tip[:3] - (place - np.array(REFERENCE) + tool)


@pytest.mark.parametrize(
    ("chain", "table"),
    [
        *[("XYZ", table) for table in range(4)],
        ("YXZ", 1),
        ("ZXY", 2),
        *[
            pytest.param(chain, table, marks=pytest.mark.heavy)
            for chain, shown in (("YXZ", 1), ("ZXY", 2))
            for table in range(4)
            if table != shown
        ],
    ],
)
def test_the_error_is_that_of_a_product_of_homogeneous_matrices(
    chain: str, table: int
) -> None:
    model = machine(chain, SMALL)
    expected = [by_matrices(model, place, TOOL, table) for place in places()]
    found = model.error(places(), TOOL)
    # Products of two errors are left out: 1e-5 mm, times 1e-8 rad, times a lever of 0.5 m.
    scale = float(np.abs(expected).max())
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * scale)


def test_a_roll_of_x_moves_a_tool_above_it_towards_minus_y() -> None:
    model = GeometricErrors.of(NODES, {"EAX": 1e-5})
    place = np.array([[0.0, 0.0, 300.0]])
    np.testing.assert_allclose(model.error(place), [[0.0, -3e-3, 0.0]], atol=1e-16)
    # The tool hangs 100 mm below the spindle: a shorter lever.
    tool = np.array([0.0, 0.0, -100.0])
    np.testing.assert_allclose(
        model.error(place, tool), [[0.0, -2e-3, 0.0]], atol=1e-16
    )


def test_only_axes_between_an_axis_and_the_tool_are_its_lever() -> None:
    place = np.array([[200.0, 300.0, 0.0]])
    for chain, expected in (("XYZ", -3e-3), ("YXZ", 0.0)):
        model = GeometricErrors.of(NODES, {"ECX": 1e-5}, chain)
        assert float(model.error(place)[0, 0]) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("EC0Y", [-3e-3, 0, 0]), ("EB0Z", [2e-3, 0, 0]), ("EA0Z", [0, -2e-3, 0])],
)
def test_squareness_turns_the_later_axis(name: str, expected: list[float]) -> None:
    model = GeometricErrors.of(NODES, {name: 1e-5})
    found = model.error(np.array([[100.0, 300.0, 200.0]]), TOOL)
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=1e-15)


def test_at_the_reference_position_without_tool_only_linear_functions_count() -> None:
    model = machine()
    found = model.error(np.array([REFERENCE]))[0]
    expected = [
        sum(
            np.interp(REFERENCE[k], NODES[k].positions, model[f"E{d}{a}"])
            for k, a in enumerate("XYZ")
        )
        for d in "XYZ"
    ]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


def test_the_stencil_gives_the_error_along_any_direction() -> None:
    model, rng = machine("YZX"), np.random.default_rng(6)
    tools = rng.normal(size=(40, 3)) * 100.0
    along = rng.normal(size=(40, 3))
    stencil = model.stencil(places(), along, tools)
    assert stencil.nodes.shape == (40, 39)
    expected = np.sum(along * np.asarray(model.error(places(), tools)), axis=1)
    # Sums of 39 products of about 1e-2 mm.
    np.testing.assert_allclose(stencil(model.numbers), expected, rtol=0, atol=1e-14)


def test_numbers_in_a_row_and_back_are_the_same_machine() -> None:
    model = machine("ZYX")
    assert eqx.tree_equal(model.with_numbers(model.numbers), model)


def test_the_offset_takes_the_error_off_and_is_an_external_compensation() -> None:
    model = machine()
    compensation = ExternalCompensation(model.offset)
    np.testing.assert_array_equal(
        compensation.offsets(places()), -model.error(places())
    )


def test_it_is_linear_in_all_errors_and_differentiable_under_jit_and_vmap() -> None:
    model = machine()

    @jax.jit
    def error_of(numbers: jax.Array, place: jax.Array) -> jax.Array:
        return model.with_numbers(numbers).error(place[None], TOOL)[0]

    place = jnp.asarray(places()[0])
    slope = jax.jit(jax.jacrev(error_of))(model.numbers, place)
    np.testing.assert_allclose(
        slope @ model.numbers, error_of(model.numbers, place), rtol=0, atol=1e-14
    )
    many = jax.jit(jax.vmap(error_of, in_axes=(None, 0)))
    each = many(model.numbers, jnp.asarray(places()))
    np.testing.assert_allclose(each, model.error(places(), TOOL), rtol=0, atol=1e-15)
    ahead = jax.jit(jax.jacfwd(error_of, argnums=1))(model.numbers, place)
    step = 1e-3
    for axis in range(3):
        ends = [
            error_of(model.numbers, place + s * step * np.eye(3)[axis]) for s in (1, -1)
        ]
        # Linear along each axis inside a cell: rounding of 1e-17 / 1e-3.
        np.testing.assert_allclose(
            ahead[:, axis], (ends[0] - ends[1]) / (2 * step), rtol=0, atol=1e-12
        )


def test_each_error_has_its_name() -> None:
    for name in (*FUNCTIONS, "EA0Z", "EB0Z", "EC0Y"):
        model = GeometricErrors.of(NODES, {name: 1.0})
        assert float(jnp.sum(model[name])) == float(jnp.sum(model.numbers))
    with pytest.raises(KeyError):
        machine()["EXQ"]
    with pytest.raises(ValueError, match="named EXQ, expected EXX … ECZ"):
        GeometricErrors.of(NODES, {"EXQ": 1.0})


def test_a_chain_that_does_not_name_three_axes_is_refused() -> None:
    for chain in itertools.chain(["XY", "XYY"], ["XYbZ"]):
        with pytest.raises(ValueError, match="chain must name X, Y and Z"):
            GeometricErrors.of(NODES, {}, chain)
