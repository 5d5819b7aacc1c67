"""Jobs by command line without drawings, which other tests look at."""

import pytest


@pytest.fixture(autouse=True)
def words_only(no_drawing: None) -> None:
    """No test of this folder looks at a drawing."""
