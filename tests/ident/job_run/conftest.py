"""Jobs by command line without drawings, which other tests look at."""

import pytest

from axcomp.ident.report import _style


@pytest.fixture(autouse=True)
def no_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the drawings out where only the words count: they take most of the time."""
    monkeypatch.setattr(_style, "to_svg", lambda figure, name: "<svg ></svg>")
