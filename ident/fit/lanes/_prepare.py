"""From requests to lanes: what several fits of the same readings share is found once.

The fits without each run of a job look at the same readings: these are checked, located
among the nodes and told apart by runs once, and every fit takes its rows.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...core._errors import FitError
from .._checks import Extent, check_extent, check_finite, check_layout, check_smoothness
from .._grid import Grid, Located
from .._runs import RunDesign, run_design
from ._request import TableRequest
from ._stack import Lane


@dataclasses.dataclass(frozen=True)
class _Readings:
    """Readings that are sound in themselves, and where they lie.

    Attributes:
        grid: Nodes of a 1-D table.
        extent: How many there are, and their ends.
        place: Position of every reading along the nodes.
        located: Its cell.
        error: In mm or °.
        weight: Known weights.
        design: Run effects, none of the runs apart; None without any.
    """

    grid: Grid
    extent: Extent
    place: Float[np.ndarray, " t"]
    located: Located
    error: Float[np.ndarray, " t"]
    weight: Float[np.ndarray, " t"]
    design: RunDesign | None

    def parts(self, rows: Int[np.ndarray, "f n"]) -> Iterator["_Readings"]:
        """Yield parts of as many readings each; runs that have none left are gone."""
        place, error, weight = self.place[rows], self.error[rows], self.weight[rows]
        cells = [
            getattr(self.located, field.name)[rows]
            for field in dataclasses.fields(Located)
        ]
        designs: Sequence[RunDesign | None] = [None] * len(rows)
        if self.design is not None:
            designs = self.design.parts(rows)
        counts = np.full((len(rows), 1), rows.shape[1])
        if self.grid.fast == 2:
            back = self.located.s[rows].sum(axis=1, keepdims=True)
            counts = np.hstack([counts - back, back])
        ends = zip(counts, place.min(axis=1), place.max(axis=1), strict=True)
        for k, (own, low, high) in enumerate(ends):
            yield _Readings(
                self.grid,
                Extent(own, low.reshape(1), high.reshape(1)),
                place[k],
                Located(*(each[k] for each in cells)),
                error[k],
                weight[k],
                designs[k],
            )


_Kind = tuple[int, int, str]


class Prepared:
    """Makes the lanes of requests."""

    def __init__(self, requests: Sequence[TableRequest]) -> None:
        self._requests = requests
        self._known: dict[_Kind, _Readings] = {}

    def lanes(self, apart: Mapping[int, tuple[int, ...]]) -> Iterator[tuple[int, Lane]]:
        """Yield fits ready for their stacks, without those that the readings do not allow.

        Args:
            apart: Requests, by number, with runs that do not count in the mean of the runs.
        """
        alike: dict[tuple[_Kind, int], list[int]] = {}
        for k in apart:
            request = self._requests[k]
            kind = id(request.samples), id(request.layout), request.run_effects
            count = -1 if request.rows is None else len(request.rows)
            alike.setdefault((kind, count), []).append(k)
        for (kind, _), own in alike.items():
            try:
                parts = self._parts(kind, own)
            except FitError:
                continue
            for k, part in zip(own, parts, strict=True):
                try:
                    yield k, _lane(self._requests[k], part, apart[k])
                except FitError:
                    continue

    def _parts(self, kind: _Kind, own: Sequence[int]) -> list[_Readings]:
        """Return what requests for as many readings of the same samples are fitted to."""
        requests = [self._requests[k] for k in own]
        whole = self._known.get(kind)
        if whole is None:
            whole = self._known[kind] = _readings(requests[0])
        rows = [request.rows for request in requests if request.rows is not None]
        return list(whole.parts(np.stack(rows))) if rows else [whole] * len(own)


def _readings(request: TableRequest) -> _Readings:
    """Return the readings that a request takes its rows from.

    Raises:
        FitError: If they are not sound, or an option is unknown.
    """
    samples, layout = request.samples, request.layout
    check_finite(samples)
    check_layout(layout)
    grid = Grid(layout)
    return _Readings(
        grid=grid,
        extent=Extent.of(layout, samples),
        place=samples.positions[:, 0],
        located=grid.locate(samples),
        error=np.asarray(samples.error, float),
        weight=np.ones(len(samples.error))
        if samples.weight is None
        else np.asarray(samples.weight, float),
        design=run_design(samples, request.run_effects),
    )


def _lane(request: TableRequest, readings: _Readings, apart: tuple[int, ...]) -> Lane:
    layout, count = request.layout, len(readings.error)
    check_extent(layout, readings.extent, request.allow_gaps)
    check_smoothness(request.smoothness)
    if request.loss not in ("student", "huber", "gauss"):
        msg = f"loss: found {request.loss!r}"
        raise FitError(msg)
    design = readings.design
    if design is not None and apart:
        design = design.without(apart)
    null = readings.grid.fast * (1 if layout.periodic else 2)
    if count - null - (0 if design is None else design.count) < 1:
        msg = f"{count} readings leave nothing to judge the noise by"
        raise FitError(msg)
    return Lane(
        readings.grid, readings.located, readings.error, readings.weight, design, apart
    )
