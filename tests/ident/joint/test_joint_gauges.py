"""What may be moved between effects: found, fixed by a rule, said, and harmless."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.ident.fit.joint import (
    Backlash,
    Cross,
    JointData,
    JointFit,
    Leadscrew,
    Plane,
    Temperature,
    examine_design,
    fit_joint,
)

from .gauge import in_gauge

X, Y = np.linspace(0.0, 1000.0, 21), np.linspace(0.0, 500.0, 11)
PLANE = Plane("X", ("X", "Y"), (X, Y))
WARM = Temperature("X", {"offset": "T", "coefficient": "T"}, 200.0)
RUNS = "runs of X"


def _sentences(fit: JointFit, *names: str) -> list[str]:
    return [g.sentence for g in fit.gauges if set(names) <= set(g.effects)]


PAIRS = {
    "constants": (
        [Leadscrew("X", X), Cross("X", master="Y", setpoints=Y)],
        ("leadscrew of X", "cross of X over Y"),
        "A constant may be moved between the leadscrew of X, the cross of X over Y and",
    ),
    "slope and coefficient": (
        [Leadscrew("X", X), WARM],
        ("leadscrew of X", "temperature of X (T)"),
        "A straight line over X may be moved between",
    ),
    "cross and plane": (
        [Cross("X", master="Y", setpoints=Y), PLANE],
        ("cross of X over Y", PLANE.name),
        "Any curve over Y may be moved between",
    ),
    "cross and plane of other nodes": (
        [Cross("X", master="Y", setpoints=np.linspace(0.0, 500.0, 8)), PLANE],
        ("cross of X over Y", PLANE.name),
        "A straight line over Y may be moved between",
    ),
    "leadscrew and plane": (
        [Leadscrew("X", X), PLANE],
        ("leadscrew of X", PLANE.name),
        "Any curve over X may be moved between",
    ),
    "backlash and two directions": (
        [Leadscrew("X", X, bilateral=True), Backlash("X")],
        ("leadscrew of X", "backlash of X"),
        "A constant difference between the directions may be moved between",
    ),
    "large plane": (
        [
            Leadscrew("X", X),
            Plane("X", ("X", "Y"), (X, np.linspace(0.0, 500.0, 20))),
        ],
        ("leadscrew of X", PLANE.name),
        "Any curve over X may be moved between",
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_a_freedom_is_said_and_changes_no_sum(mixed: Any, name: str) -> None:
    stack, names, begin = PAIRS[name]
    case = mixed(5, count=2500)
    fit = fit_joint(case.data, stack)
    found = _sentences(fit, *names)
    assert any(sentence.startswith(begin) for sentence in found), found
    assert not fit.confusions
    # Move every value as a user might: a constant, then back to the rule.
    rng = np.random.default_rng(0)
    values = [part.values + 0.0 for part in fit.parts]
    again, datum = in_gauge(fit, values, {"X": fit.datum["X"][0]})
    for one, other in zip(values, again, strict=True):
        assert np.abs(one - other).max() < 1e-12  # already there
    other = [each + rng.normal(0.0, 0.01, len(each)) for each in values]
    moved, datum = in_gauge(fit, other)
    before = sum(
        part.effect.block(case.data)[0] @ each
        for part, each in zip(fit.parts, other, strict=True)
    )
    after = datum["X"] + sum(
        part.effect.block(case.data)[0] @ each
        for part, each in zip(fit.parts, moved, strict=True)
    )
    # Values of 0.01 mm: rounding only.
    assert np.abs(after - before).max() < 1e-12


def test_the_datum_keeps_the_constant_and_tables_have_none(mixed: Any) -> None:
    case = mixed(6, count=2000)
    error = {"X": case.data.error["X"] + 1.0}
    data = dataclasses.replace(case.data, error=error)
    stack = [Leadscrew("X", X), Cross("X", master="Y", setpoints=Y), PLANE]
    fit = fit_joint(data, stack)
    for part in fit.parts:
        # Over the readings, with the wild ones that only the fit itself finds.
        assert abs(part.contribution.mean()) < 1e-12
    assert fit.datum["X"][0] == pytest.approx(1.0, abs=0.02)  # the mix has its own mean


def test_the_temperature_corrects_nothing_at_its_reference(mixed: Any) -> None:
    case = mixed(7, count=2000)
    warm = dataclasses.replace(WARM, reference_temperature=21.5)
    fit = fit_joint(case.data, [Leadscrew("X", X), warm])
    part = fit.parts[1]
    assert isinstance(part.effect, Temperature)
    for law, values in part.effect.split(part.values).items():
        at = np.interp(21.5, part.effect.nodes[law], values)
        assert abs(at) < 1e-12 * np.abs(values).max()
    assert "21.5 °C" in " ".join(gauge.rule for gauge in fit.gauges)


def test_run_offsets_sum_to_zero_beside_the_datum(mixed: Any) -> None:
    case = mixed(8, count=2000)
    run = np.arange(2000) % 4
    data = dataclasses.replace(case.data, run=run)
    fit = fit_joint(data, [Leadscrew("X", X)])
    assert abs(sum(each.offset for each in fit.runs["X"])) < 1e-12
    assert _sentences(fit, RUNS, "leadscrew of X")


def test_the_rule_does_not_depend_on_the_errors(mixed: Any, effects: Any) -> None:
    one, other = mixed(9, count=2000), mixed(10, count=2000)
    data = dataclasses.replace(one.data, error=other.data.error)
    first, second = (fit_joint(each, effects()) for each in (one.data, data))
    assert first.gauges == second.gauges
    rng = np.random.default_rng(1)
    values = [rng.normal(size=part.effect.size) for part in first.parts]
    for a, b in zip(
        in_gauge(first, values)[0], in_gauge(second, values)[0], strict=True
    ):
        assert np.array_equal(a, b)


def test_gauges_are_known_before_any_error_is(mixed: Any, effects: Any) -> None:
    case = mixed(11, count=1500)
    plan = dataclasses.replace(case.data, error={})
    assert examine_design(plan, effects())[0] == fit_joint(case.data, effects()).gauges


def test_a_ring_shares_its_constant_alone() -> None:
    rng = np.random.default_rng(2)
    c, x = rng.uniform(0.0, 360.0, 800), rng.uniform(0.0, 500.0, 800)
    error = 0.01 * np.sin(np.radians(c)) + 1e-5 * x + rng.normal(0.0, 5e-4, 800)
    data = JointData(position={"C": c, "X": x}, error={"C": error})
    stack = [
        Leadscrew("C", np.linspace(0.0, 360.0, 13), modulo=True),
        Cross("C", master="X", setpoints=Y),
    ]
    fit = fit_joint(data, stack)
    assert len(fit.gauges) == 1
    assert fit.parts[0].table[0] == fit.parts[0].table[-1]


def test_a_joint_covariance_keeps_the_rule(mixed: Any, effects: Any) -> None:
    case = mixed(6, count=800)
    fit = fit_joint(case.data, effects(0.0)[:2])
    for part in fit.parts:
        spread = part.covariance
        assert np.sqrt(np.diag(spread)) == pytest.approx(part.standard_deviation)
        # Whatever is read, the table has mean zero over the readings: sums of some 1e-7 mm²
        # cancel to rounding.
        mean = part.effect.block(case.data)[0].mean(axis=0)
        assert abs(mean @ spread @ mean) < 1e-10 * np.trace(spread)
