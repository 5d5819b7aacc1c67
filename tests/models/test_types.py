"""What a checker of types says of code that uses the models."""

import textwrap
from pathlib import Path

import pytest
from mypy import api

USER = """
    import numpy as np
    from axcomp.models import (
        Backlash, Cross, EquidistantNodes, FrictionTable, Leadscrew, Plane, Setpoints,
        StribeckFriction, TemperatureLine,
    )

    nodes = EquidistantNodes(0.0, 10.0, 11)
    Leadscrew(nodes, np.zeros(11), neg=np.zeros(11))
    Plane(nodes, Setpoints(np.arange(3.0)), np.zeros((3, 11)))
    Cross(nodes, [0.0] * 11)
    Backlash(0.01)
    StribeckFriction(1.0, np.array([1.0, 2.0]), np.float64(3.0), 1.0, 0.01)
    FrictionTable(Setpoints(np.arange(3.0)), np.zeros(3), scaling=0.5)
    TemperatureLine(0.0, 0.0, 1e-5)
"""


@pytest.mark.heavy
def test_numpy_arrays_and_numbers_are_welcome_to_a_strict_checker(
    tmp_path: Path,
) -> None:
    script = tmp_path / "user.py"
    script.write_text(textwrap.dedent(USER))
    home = str(Path(__file__).parents[2] / ".dev")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MYPYPATH", home)
        found, errors, status = api.run(["--strict", str(script)])
    assert (status, errors) == (0, ""), found
