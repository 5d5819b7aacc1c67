"""What changes over a recording of friction, or over its places, and no law of friction knows."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import final

import numpy as np
from jaxtyping import Float, Int

from ...friction import DriveSamples
from ...job.result._result import Remark

_LOOKED_AT, _PARTS = 3_000, 5
"""Samples that are looked at, and parts of the recording, or of the travel, that are compared."""
_BY_PLACE, _BY_TIME, _VARIES = 0.05, 0.1, 0.15
"""Shares of the friction from which on is told: a load that changes with the position, friction
that changes over the recording, and both that are not the same everywhere or all the time."""
_BOTH = 0.1
"""Share of the samples of a part that each direction has: a constant load is no friction only
where both show it."""
_TURNS = 20
"""Stretches of the recording that belong to one half and the other in turn."""
_SURE = 3.0
"""Standard deviations from which on a change is one."""

Parts = list[Int[np.ndarray, " _"]]


def changes(
    samples: DriveSamples,
    friction: Callable[[Float[np.ndarray, " t"]], Float[np.ndarray, " t"]],
    unit: str,
) -> Iterator[Remark]:
    """Yield what the current of a recording does beside the law that was found.

    Args:
        samples: Of the recording.
        friction: The law: current over velocity.
        unit: Of the current.
    """
    rows = np.flatnonzero(samples.in_motion)
    rows = rows[:: -(-len(rows) // _LOOKED_AT)]
    looked = _Looked(samples, rows, friction(samples.velocity[rows]), unit)
    yield from looked.load_of_place()
    yield from looked.friction_of_time()
    yield from looked.load_of_time()
    yield from looked.friction_of_place()


@final
@dataclasses.dataclass(frozen=True)
class _Looked:
    """Rows in motion that are enough to see what the law does not say."""

    samples: DriveSamples
    rows: Int[np.ndarray, " r"]
    friction: Float[np.ndarray, " r"]
    unit: str

    @property
    def size(self) -> float:
        """Root mean square of the friction."""
        return float(np.sqrt(np.mean(self.friction**2)))

    @property
    def ones(self) -> Float[np.ndarray, " r"]:
        """Column of a constant load."""
        return np.ones(len(self.rows))

    @property
    def stretches(self) -> Parts:
        """Parts of the recording, one after the other."""
        return np.array_split(np.arange(len(self.rows)), _PARTS)

    def both(self, parts: Parts) -> bool:
        """Whether each part has both directions."""
        speed = self.samples.velocity[self.rows]
        ahead = np.array([np.mean(speed[part] > 0) for part in parts])
        return bool(np.minimum(ahead, 1.0 - ahead).min() >= _BOTH)

    def by_part(
        self, parts: Parts, *columns: Float[np.ndarray, " r"]
    ) -> Float[np.ndarray, " p"]:
        """Return the factor of the first column in the current of each part.

        The other columns and the acceleration stand beside it.
        """
        every = [*columns]
        if self.samples.acceleration is not None:
            every.append(self.samples.acceleration[self.rows])
        design, current = np.stack(every, axis=1), self.samples.current[self.rows]
        return np.array(
            [np.linalg.lstsq(design[part], current[part])[0][0] for part in parts]
        )

    def load_of_place(self) -> Iterator[Remark]:
        """Yield that the load changes with the position."""
        if self.samples.position is None:
            return
        place = self.samples.position[self.rows]
        way = np.sign(self.samples.velocity[self.rows])
        beside = self.friction, way, self.ones
        slopes = self.by_part(self.stretches, place, *beside)
        mean, scatter = float(np.mean(slopes)), float(np.std(slopes))
        change = abs(mean) * float(np.ptp(place))
        sure = abs(mean) > _SURE * scatter / _PARTS**0.5
        if sure and change > _BY_PLACE * self.size:
            yield Remark.warning(
                f"The load changes by {change:.3g} {self.unit} over the positions"
                " driven, as a spring, a cable or a lever does: that is no friction, and the"
                " law, the inertia and what differs between the directions hold a part of"
                " it. Record on a short way to and fro."
            )

    def friction_of_time(self) -> Iterator[Remark]:
        """Yield that friction changes over the recording."""
        if not self.both(self.stretches):
            return
        shares = self.by_part(self.stretches, self.friction, self.ones)
        # A straight line over the parts, and how far they lie beside it.
        when = np.linspace(-0.5, 0.5, _PARTS)
        line, (beside,), *_ = np.polyfit(when, shares, 1, full=True)
        scatter = float(np.sqrt(beside / (_PARTS - 2) / (when @ when)))
        if abs(line[0]) > max(_SURE * scatter, _BY_TIME):
            yield Remark.warning(
                f"Friction {'falls' if line[0] < 0 else 'grows'} by {abs(line[0]):.0%} over the"
                " recording, as it does while an axis warms: the list holds the mean. Run the"
                " axis warm first, and record it then."
            )

    def load_of_time(self) -> Iterator[Remark]:
        """Yield that the constant load is another at times, by halves of each part that agree."""
        split = [half for part in self.stretches for half in np.array_split(part, 2)]
        if not self.both(split):
            return
        loads = self.by_part(split, self.ones, self.friction).reshape(_PARTS, 2)
        change = float(np.ptp(loads.mean(axis=1)))
        if change > max(_SURE * _apart(loads), _VARIES * self.size):
            yield Remark.warning(
                f"The constant load changes by {change:.3g} {self.unit} over the recording, as"
                " a workpiece, a clamp or a counterweight does: that is no friction, and the"
                " law holds a part of it. Record with one load."
            )

    def friction_of_place(self) -> Iterator[Remark]:
        """Yield that friction is another from place to place, by stretches in turn that agree."""
        if self.samples.position is None:
            return
        order = np.argsort(self.samples.position[self.rows], kind="stable")
        turn = order * _TURNS // len(order) % 2
        split = [
            part[which == half]
            for part, which in zip(
                np.array_split(order, _PARTS), np.array_split(turn, _PARTS), strict=True
            )
            for half in (0, 1)
        ]
        if min(map(len, split)) < _PARTS or not self.both(split):
            return
        shares = self.by_part(split, self.friction, self.ones).reshape(_PARTS, 2)
        mean = shares.mean(axis=1)
        change = float(np.ptp(mean))
        if change > max(_SURE * _apart(shares), _VARIES):
            where = np.array_split(self.samples.position[self.rows][order], _PARTS)
            least, most = (where[int(k)] for k in (np.argmin(mean), np.argmax(mean)))
            yield self._larger_at(
                change, float(np.median(most)), float(np.median(least))
            )
        else:
            yield from self._slope_of_friction()

    def _slope_of_friction(self) -> Iterator[Remark]:
        """Yield that friction grows along the way, at speeds that reach one part and another.

        Where the far places were passed fast alone, the law has taken them for the speed: what
        a speed shows beside it stands in columns of its own.
        """
        assert self.samples.position is not None  # else it is not asked for
        speed = self.samples.velocity[self.rows]
        place = self.samples.position[self.rows]
        place = place - place.mean()
        beside = self.friction, np.sign(speed), speed, place, self.ones
        slopes = self.by_part(self.stretches, self.friction * place, *beside)
        mean, scatter = float(np.mean(slopes)), float(np.std(slopes))
        change = abs(mean) * float(np.ptp(place))
        if change > _VARIES and abs(mean) > _SURE * scatter / _PARTS**0.5:
            least, most = np.sort(self.samples.position[self.rows])[[0, -1]]
            if mean < 0.0:
                least, most = most, least
            yield self._larger_at(change, float(most), float(least))

    def _larger_at(self, change: float, most: float, least: float) -> Remark:
        return Remark.warning(
            f"Friction is {change:.0%} larger about {most:.4g} {self.samples.unit} than about"
            f" {least:.4g}: a list knows no place and holds the mean. Look at lubrication, covers"
            " and the fit of the guides there."
        )


def _apart(halves: Float[np.ndarray, "p 2"]) -> float:
    """Return by how much both halves of a part differ, as a standard deviation.

    By the median: a part may hold a step.
    """
    return 1.4826 * float(np.median(np.abs(np.diff(halves))))
