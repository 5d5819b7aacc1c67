"""Integers survive: what a list says strictly is written back to the digit."""

import numpy as np
from hypothesis import given, settings, strategies as st

from axcomp.data.lists import ListFile, Value, new_list
from axcomp.ident.kinds.backlash.entries import backlash_from_list, entries_of_backlash
from axcomp.ident.kinds.crosstalk.entries import (
    crosstalk_from_list,
    entries_of_crosstalk,
)
from axcomp.ident.kinds.friction.entries import entries_of_friction, friction_from_list
from axcomp.ident.kinds.temperature.entries import (
    entries_of_temperature,
    temperature_from_list,
)
from axcomp.models import Conventions

RULES = Conventions()


def listed(entries: dict[str, Value]) -> ListFile:
    raw = new_list({"kopf.achs_nr": 1, **entries}).dumps()
    return ListFile.parse(raw, "achskw1.lis")


@settings(max_examples=40, deadline=None)
@given(
    st.sets(st.integers(2, 10**7), min_size=1, max_size=12),
    st.integers(0, 2**31 - 1),
    st.integers(0, 10),
    st.integers(0, 4),
    st.integers(0, 248),
)
def test_friction_entries_survive(
    speeds: set[int], seed: int, delay: int, ahead: int, late: int
) -> None:
    knots = [1, *sorted(speeds)]
    values = np.random.default_rng(seed).integers(-(2**20), 2**20, len(knots)).tolist()
    knots.append(knots[-1] + 5)
    values.append(values[-1])  # flat at the end, as it is written
    entries: dict[str, Value] = {
        "frict_comp.mode": 3,
        "frict_comp.table_entries": len(knots),
        "frict_comp.position_delay": delay,
        "frict_comp.reversal_lookahead": ahead,
        "frict_comp.delay_cycles": late,
        "frict_comp.scaling_factor": 1000,
    }
    for k, (speed, value) in enumerate(zip(knots, values, strict=True)):
        entries[f"frict_comp.table[{k}].in"] = speed
        entries[f"frict_comp.table[{k}].out"] = value
    assert entries_of_friction(friction_from_list(listed(entries), RULES)) == entries


@settings(max_examples=12, deadline=None)
@given(
    st.integers(1, 5), st.integers(0, 2), st.integers(0, 20), st.integers(0, 2**31 - 1)
)
def test_crosstalk_entries_survive(
    size: int, axes: int, cycles: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    grid = np.sort(rng.choice(10**6, size, replace=False))
    # Two adaptation axes: a row of a grid, three tests at most along the second one.
    points = [[int(a)] * axes for a in grid] if axes == 1 else [[]]
    if axes == 2:
        points = [[int(a), int(b)] for a in grid[:3] for b in (0, 70)]
    names = [
        f"correction_{a}celerate_dir_{d}" for a in ("ac", "de") for d in ("pos", "neg")
    ]
    entries: dict[str, Value] = {
        "kw.crosstalk.mode": axes + 1,
        "kw.crosstalk.master_dyn_ax_nr": 2,
    }
    masters = (2, 5, 6)[: axes + 1]
    for k, master in enumerate(masters[1:], start=1):
        entries[f"kw.crosstalk.master_pos{k}_ax_nr"] = master
    if axes:
        entries["kw.crosstalk.max_points"] = len(points)
    entries |= {
        "kw.crosstalk.n_cycles": cycles,
        "kw.crosstalk.velocity_dependent": 1,
        "kw.crosstalk.acceleration": int(rng.integers(1, 10**5)),
        "kw.crosstalk.deceleration": int(-rng.integers(1, 10**5)),
    }
    for k, point in enumerate(points):
        stem = f"kw.crosstalk.position[{k}]"
        entries |= {f"{stem}.ax_{j}": value for j, value in enumerate(point, start=1)}
        entries |= {f"{stem}.{name}": int(rng.integers(-9999, 9999)) for name in names}
    model = crosstalk_from_list(listed(entries), RULES)
    assert entries_of_crosstalk(model, masters) == entries


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([1, 2]),
    st.integers(-(2**15), 2**15 - 2),
    st.integers(0, 19),
    st.integers(-(2**31) + 1, 2**31 - 2),
    st.integers(-(10**5), 10**5),
    st.integers(-(10**10), 10**10),
)
def test_entries_of_the_axis_list_survive(
    flank: int, width: int, cycles: int, place: int, shift: int, slope: int
) -> None:
    entries: dict[str, Value] = {
        "lr_param.anwahl_losekomp": flank,
        "getriebe[0].lose": width,
        "lr_param.n_backlash_cyc": cycles,
        "lr_param.temp_comp": 1,
        "lr_param.temp_comp_position_0": place,
        "lr_param.temp_comp_offset_0": shift,
        "lr_param.temp_comp_coefficient": slope / 10**6,  # six decimals of µm/m
        "lr_param.temp_comp_n_cycles": cycles,
    }
    listing = listed(entries)
    backlash = backlash_from_list(listing, RULES)
    line = temperature_from_list(listing, RULES)
    assert backlash is not None
    assert line is not None
    assert entries_of_backlash(backlash) | entries_of_temperature(line) == entries
