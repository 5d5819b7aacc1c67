"""Units as people read them; without NumPy, as commands for lists need them."""


def small_unit(unit: str) -> str:
    """Return how people read thousandths of mm, or of ``deg`` (°): in µm or m°."""
    return "µm" if unit == "mm" else "m°"
