"""All that was measured of a machine, one row per reading, whatever it was meant for."""

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from ._errors import DiscoverError

_CHANNELS = (
    "position",
    "error",
    "direction",
    "velocity",
    "acceleration",
    "temperature",
    "current",
)


@dataclasses.dataclass(frozen=True)
class Observed:
    """Readings of a machine; NaN = not measured in this row, no key = never.

    Attributes:
        time: Instant of each row in s, or None where the rows only have an order.
        run: Number of the run or set-up of each row.
        source: Number of the measurement of each row: each has a zero of its own.
        position: Commanded, mm or °, by axis.
        error: Actual − commanded at standstill, actual − encoder in motion; mm or °.
        direction: ±1, of the last motion of the axis.
        velocity: In mm/s or °/s.
        acceleration: In mm/s² or °/s².
        temperature: In °C, by sensor.
        current: In the unit of the drive.
        rotary: Axes whose positions are angles.
        modulo: Range of the axes that go round.
    """

    time: Float[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"]
    source: Int[np.ndarray, " t"]
    position: Mapping[str, Float[np.ndarray, " t"]]
    error: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    direction: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    velocity: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    acceleration: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    temperature: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    current: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    rotary: frozenset[str] = frozenset()
    modulo: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        for channel in _CHANNELS:
            for name, values in getattr(self, channel).items():
                if len(values) != len(self):
                    where = f"{channel} of {name}"
                    count, rows = f"{len(values)} values", f"{len(self)}, one per row"
                    raise DiscoverError(where, count, rows)

    def __len__(self) -> int:
        return len(self.run)

    @property
    def clock(self) -> Float[np.ndarray, " t"]:
        """Instants, or the numbers of the rows where there is no time."""
        if self.time is None:
            return np.arange(len(self), dtype=float)
        return self.time

    def take(self, rows: Int[np.ndarray, " n"] | Bool[np.ndarray, " t"]) -> "Observed":
        """Return some of the rows."""

        def some(channel: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            return {name: values[rows] for name, values in channel.items()}

        return dataclasses.replace(
            self,
            time=None if self.time is None else self.time[rows],
            run=self.run[rows],
            source=self.source[rows],
            position=some(self.position),
            error=some(self.error),
            direction=some(self.direction),
            velocity=some(self.velocity),
            acceleration=some(self.acceleration),
            temperature=some(self.temperature),
            current=some(self.current),
        )

    def unit(self, axis: str) -> str:
        """Return the unit of positions and errors of an axis."""
        return "°" if axis in self.rotary else "mm"


def stack(parts: Iterable[Observed]) -> Observed:
    """Return the rows of several recordings one after the other.

    What a recording does not have is NaN in its rows; runs and sources stay apart, and
    each clock starts where the one before has ended.
    """
    every = list(parts)
    if not every:
        where, expected = "job", "at least one"
        raise DiscoverError(where, "no measurement", expected)
    sizes = [len(part) for part in every]
    merged: dict[str, dict[str, np.ndarray]] = {}
    for channel in _CHANNELS:
        names = dict.fromkeys(name for part in every for name in getattr(part, channel))
        merged[channel] = {
            name: np.concatenate(
                [
                    getattr(part, channel).get(name, np.full(size, np.nan))
                    for part, size in zip(every, sizes, strict=True)
                ]
            )
            for name in names
        }
    runs, sources, times = [], [], []
    first_run = first_source = 0
    start = 0.0
    for part in every:
        own = np.unique(part.run, return_inverse=True)[1].reshape(-1)
        kind = np.unique(part.source, return_inverse=True)[1].reshape(-1)
        runs.append(own + first_run)
        sources.append(kind + first_source)
        first_run += int(own.max(initial=-1)) + 1
        first_source += int(kind.max(initial=-1)) + 1
        clock = part.clock
        times.append(clock - clock.min(initial=np.inf if len(clock) else 0.0) + start)
        start = float(times[-1].max(initial=start)) + 1.0
    known = all(part.time is not None for part in every)
    return Observed(
        time=np.concatenate(times) if known else None,
        run=np.concatenate(runs).astype(np.int64),
        source=np.concatenate(sources).astype(np.int64),
        rotary=frozenset().union(*(part.rotary for part in every)),
        modulo={key: span for part in every for key, span in part.modulo.items()},
        **merged,
    )
