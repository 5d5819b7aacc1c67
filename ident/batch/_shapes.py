"""What jobs of equal shape have in common, known before anything is measured."""

from pathlib import Path

from ...data.errors import AxcompError


def shape_of(path: Path) -> tuple[str, str | None]:
    """Return the shape of a job, and why it cannot run (None where it can)."""
    from ..job import load_job

    try:
        job = load_job(path)
    except (AxcompError, OSError) as error:
        return "", " ".join(str(error).split())
    parts = []
    for fit in job.spec.fits:
        keys = (
            "points",
            "setpoints",
            "bilateral",
            "modulo",
            "loss",
            "smoothness",
            "group",
        )
        shown = (f"{key}={_size(getattr(fit, key, None))}" for key in keys)
        parts.append(f"{fit.compensation} {' '.join(shown)}")
    return "; ".join(parts), None


def _size(value: object) -> str:
    if isinstance(value, list) and value and not isinstance(value[0], int):
        return str(len(value))
    return str(value)
