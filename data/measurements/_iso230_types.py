"""What an evaluation by ISO 230-2 gives: figures per position and for the axis."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class Iso230Position:
    """Figures at one target in mm; None where the data do not give them.

    Attributes:
        target: Commanded position.
        mean_up: Mean deviation x̄↑; `mean_down` from the other side.
        s_up: Estimator s↑ of the unidirectional repeatability (n − 1); `s_down`
            likewise.
        runs_up: Number of approaches n↑; `runs_down` likewise.
        R_up: 4 s↑; `R_down` likewise.
        R: Bidirectional repeatability max(2 s↑ + 2 s↓ + |B|, R↑, R↓).
        B: Reversal x̄↑ − x̄↓, with its sign.
        mean: Mean bidirectional deviation (x̄↑ + x̄↓)/2.
    """

    target: float
    mean_up: float | None
    mean_down: float | None
    s_up: float | None
    s_down: float | None
    runs_up: int
    runs_down: int
    R_up: float | None
    R_down: float | None
    R: float | None
    B: float | None
    mean: float | None


@dataclasses.dataclass(frozen=True)
class Iso230Run:
    """The deviations of one run in one direction, by ascending target, for drawing."""

    run: int
    direction: int
    target: Float[np.ndarray, " p"]
    error: Float[np.ndarray, " p"]


@dataclasses.dataclass(frozen=True)
class Iso230:
    """Figures of an axis by ISO 230-2 in mm; None where the data do not give them.

    Attributes:
        A: Bidirectional accuracy max(x̄ + 2s) − min(x̄ − 2s) over both directions.
        R: Bidirectional repeatability, the largest R at any target.
        B: Reversal, the largest |B| at any target.
        B_mean: Mean reversal, with its sign.
        E: Bidirectional systematic deviation: range of all x̄↑ and x̄↓.
        M: Range of the mean bidirectional deviation.
        R_up: Unidirectional repeatability; `R_down` from the other side.
        A_up: Unidirectional accuracy; `A_down` likewise.
        E_up: Unidirectional systematic deviation; `E_down` likewise.
        positions: By ascending target.
        runs: Every run in each direction.
        run_offsets: Mean over its readings of deviation − mean at that target and
            direction, by run: drift from run to run, which enters R as if it were
            scatter.
        remarks: What could not be evaluated or should be known, one sentence each.
    """

    A: float | None
    R: float | None
    B: float | None
    B_mean: float | None
    E: float | None
    M: float | None
    R_up: float | None
    R_down: float | None
    A_up: float | None
    A_down: float | None
    E_up: float | None
    E_down: float | None
    positions: tuple[Iso230Position, ...]
    runs: tuple[Iso230Run, ...]
    run_offsets: Mapping[int, float]
    remarks: tuple[str, ...]

    @property
    def bidirectional(self) -> bool:
        """Whether any target was approached from both sides."""
        return self.B is not None

    def figures(self) -> dict[str, float | None]:
        """Return the overall figures by name."""
        one_sided = ("R_up", "R_down", "A_up", "A_down", "E_up", "E_down")
        names = ("A", "R", "B", "B_mean", "E", "M", *one_sided)
        return {name: getattr(self, name) for name in names}

    def judged(self) -> tuple[str, float | None]:
        """Return what a tolerance is held against: A, or A↑ or A↓ alone."""
        for name in ("A", "A_up", "A_down"):
            if (value := getattr(self, name)) is not None:
                return name, value
        return "A", None

    def single_targets(self) -> tuple[float, ...]:
        """Return the targets with a single approach from a side: A lacks their s."""
        return tuple(p.target for p in self.positions if 1 in (p.runs_up, p.runs_down))

    def incomplete_targets(self) -> tuple[float, ...]:
        """Return the targets with fewer approaches from a side than others have."""
        full = [
            max(getattr(p, side) for p in self.positions)
            for side in ("runs_up", "runs_down")
        ]
        return tuple(
            p.target for p in self.positions if [p.runs_up, p.runs_down] != full
        )

    def accuracy_ends(self) -> tuple[float, float] | None:
        """Return the ends of the band x̄ ± 2s, whose distance is A; None without s."""
        sides = self._sides()
        spread = [(mean, s) for mean, s in sides if s is not None]
        if not spread:
            return None
        low = min(mean - 2 * s for mean, s in spread)
        return low, max(mean + 2 * s for mean, s in spread)

    def systematic_ends(self) -> tuple[float, float]:
        """Return the lowest and the highest mean, whose distance is E."""
        means = [mean for mean, _ in self._sides(both=self.bidirectional)]
        return min(means), max(means)

    def _sides(self, *, both: bool = False) -> list[tuple[float, float | None]]:
        """Return mean and s per target and side; with ``both`` where both sides are."""
        return [
            (mean, s)
            for p in self.positions
            for mean, s in ((p.mean_up, p.s_up), (p.mean_down, p.s_down))
            if mean is not None and (p.B is not None or not both)
        ]
