"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.signal import find_peaks

from ..core import FitError, one_blas_thread
from ._equation import Recording, record
from ._inverse import fit_carried
from ._result import FrictionFit, friction_of
from ._samples import DriveSamples
from ._structures import AbstractStructure, CoulombViscous, KnotTable, Stribeck
from ._weights import ridged, weigh

WINDOWS = 10
_FEWEST = 30
"""Rows in motion that a window needs."""
_UNLIKELY = 0.02
"""Share of the best law's likelihood below which another law casts no doubt on it."""
_WAVE, _TURNS = 0.2, 2
"""Share of the friction by which it rises or falls again, and how often it may do so."""
_LONGEST = 0.5
"""Longest step of a shape's logarithm: what is further is no longer linear in it."""


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """One kind of law and how it predicts what it has not seen.

    Attributes:
        structure: Kind of law.
        fit: By all rows; of a simpler law where they do not carry it.
        without: The same without each window: `state` and `shape` alone.
        window_error: RMS error per window held out, relative to the RMS of the load.
        fitted_error: As ``error``, on the rows fitted.
    """

    structure: AbstractStructure
    fit: FrictionFit
    without: tuple[FrictionFit, ...]
    window_error: Float[np.ndarray, " w"]
    fitted_error: float

    @cached_property
    def error(self) -> float:
        """Root of the mean square of the error over the windows."""
        return float(np.sqrt(np.mean(self.window_error**2)))

    @cached_property
    def standard_error(self) -> float:
        """Of that mean square, in terms of ``error``."""
        return _mean_error(self.window_error**2) / (2.0 * max(self.error, 1e-300))

    @property
    def parameters(self) -> int:
        """How many numbers it has, inertia and offset left out."""
        return len(self.structure.names) + len(self.structure.shapes)

    def worse(self, other: "Candidate") -> float:
        """Return how much it predicts worse, in standard errors of the paired difference."""
        difference = self.window_error**2 - other.window_error**2
        return float(difference.mean() / max(_mean_error(difference), 1e-300))


@dataclasses.dataclass(frozen=True, eq=False)
class Choice:
    """The law chosen, and all that competed.

    Attributes:
        candidates: From simple to rich.
        window: Of each sample of the recording.
    """

    candidates: tuple[Candidate, ...]
    window: Int[np.ndarray, " t"]

    @property
    def best(self) -> Candidate:
        """That with the smallest error held out."""
        return min(self.candidates, key=lambda rival: rival.error)

    @cached_property
    def chosen(self) -> Candidate:
        """The simplest that is as good as the best."""
        return _simplest(self.candidates)

    @property
    def fit(self) -> FrictionFit:
        """The chosen law, fitted to the whole recording."""
        return self.chosen.fit

    @property
    def law(self) -> FrictionFit:
        """The simplest of the parametric laws that predicts as well as the best of them."""
        return _simplest(self.parametric).fit

    @property
    def parametric(self) -> list[Candidate]:
        """Those whose parameters have a meaning of their own."""
        return [rival for rival in self.candidates if rival.structure.parametric]

    def deviation(
        self,
        fit: FrictionFit,
        without: Sequence[FrictionFit],
        velocity: Float[np.ndarray, " v"],
        read: Callable[[Float[np.ndarray, "v *n"]], Float[np.ndarray, "*c"]],
    ) -> Float[np.ndarray, "*c"]:
        """Return the standard deviation of what is read from a law, with the doubt of the law.

        A law is doubtful by the noise of its rows (`score_covariance`) or by how it changes
        without each window (jackknife, B. Efron, C. Stein, Ann. Statist. 9(3), 1981),
        whichever is more; by the straight lines of a table; and by the other laws, each as
        likely as its windows held out are no worse than the best (Student's distribution).

        Args:
            fit: The law, fitted to the whole recording.
            without: The same without each window.
            velocity: In mm/s.
            read: Linear map of friction at these velocities, along the first axis, to the
                values in question; further axes are kept.
        """

        def doubt(
            fit: FrictionFit, without: Sequence[FrictionFit]
        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """Return values, the variance by windows, and the squares by straight lines."""
            law = fit.friction(velocity), fit.structure.bent(velocity, fit.factors)
            table = read(np.column_stack([*law, friction_of(without, velocity)]))
            value, bent, others = table[..., 0], table[..., 1], table[..., 2:]
            count = others.shape[-1]
            # Mean square of Student's t: few windows tell their own spread badly.
            heavier = (count - 1) / max(count - 3, 1)
            spread = heavier * (count - 1) * np.var(others, axis=-1)
            return value, spread, bent**2

        value, spread, lines = doubt(fit, without)
        slopes = read(fit.slopes(velocity))
        noise = ((slopes @ fit.law_covariance) * slopes).sum(axis=-1)
        variance = np.maximum(noise, spread) + lines
        total, best, counted = 1.0, self.best, {fit.structure}
        for rival in self.candidates:
            law, count = rival.fit, len(rival.window_error)
            share = (1 + max(rival.worse(best), 0) ** 2 / (count - 1)) ** (-count / 2)
            if law.structure in counted or share < _UNLIKELY:
                continue
            counted.add(law.structure)
            other, spread, lines = doubt(law, rival.without)
            more = spread + lines + (other - value) ** 2
            variance, total = variance + share * more, total + share
        return np.asarray(np.sqrt(variance / total))


def _simplest(rivals: Sequence[Candidate]) -> Candidate:
    """Return the simplest that predicts as well as the best."""
    best = min(rivals, key=lambda rival: rival.error)
    good = [rival for rival in rivals if rival.worse(best) <= 1.0]
    return min(good, key=lambda rival: rival.parameters)


def choose_law(
    samples: DriveSamples, *, inertia: float | None = None, loss: str = "trim"
) -> Choice:
    """Choose among kinds of law by windows held out (one standard error rule).

    Coulomb + viscous, Stribeck and a table compete, alike in both directions and per
    direction; not a table that rises and falls again and again.

    The recording is cut into stretches of time with equal shares of the motion; each is
    predicted by the law solved on the others. Which rows are wild, and how smooth a table
    is, is what all rows say. Errors are those of the filtered force; wild rows are counted
    only as far as they would count in the fit. Paired: a law is as good as the best where
    its windows are not worse by more than one standard error of the difference.

    Args:
        samples: The recording.
        inertia: In drive units per mm/s², where it is known.
        loss: ``"trim"`` (least squares, wild samples out), ``"student"``, ``"huber"`` or
            ``"gauss"``.

    Raises:
        FitError: If the recording is too short to hold out windows.
    """
    recording = record(samples, inertia, None)
    window, reach = _windows(recording), recording.reach
    edges = window.searchsorted(range(WINDOWS + 1))
    # Rows beside a window share samples with it by the filter.
    touched = np.stack([edges[:-1] - reach, edges[1:] + reach]).clip(0, len(window))
    # From simple to rich.
    ways, knots = (False, True), recording.knots
    kinds = [*map(CoulombViscous, ways), *map(Stribeck, ways)]
    tables = [KnotTable(way, knots) for way in ways if len(knots) > 2]
    candidates: list[Candidate] = []
    counts = np.add.reduceat(recording.usable * 1.0, edges[:-1])

    def squares(error: np.ndarray) -> np.ndarray:
        """Return the sums of squares of errors over the windows, relative to the load."""
        square = recording.usable * np.minimum(error**2, weights.limit**2)
        return np.add.reduceat(square / recording.load_size**2, edges[:-1])

    with one_blas_thread():
        weights = weigh(recording, loss)
        for kind in (*kinds, *tables):
            fit = fit_carried(weights.free.under(kind), weights)
            if _wavers(fit):
                continue
            without, error = _hold_out(fit, window, touched)
            errors = np.sqrt(squares(error) / counts)
            fitted = float(np.sqrt(squares(fit.error).sum() / counts.sum()))
            # Where the data do not carry a law, the simpler one speaks for it.
            structure = kind if fit.missing else fit.structure
            candidates.append(Candidate(structure, fit, without, errors, fitted))
    # Each sample belongs to the window of the nearest row.
    centres = recording.centres
    between = 0.5 * (centres[1:] + centres[:-1])
    window = window[np.searchsorted(between, np.arange(len(samples.time)))]
    return Choice(tuple(candidates), window)


def _wavers(fit: FrictionFit) -> bool:
    """Return whether a table rises and falls again and again over the speed.

    Friction falls and rises once; a table may follow errors of the motion between its speeds.
    """
    if not isinstance(fit.structure, KnotTable):
        return False
    for table in fit.factors.reshape(fit.structure.ways, -1):
        least = _WAVE * float(np.sqrt(np.mean(table**2)))
        turns = (find_peaks(sign * table, prominence=least)[0] for sign in (1.0, -1.0))
        if sum(map(len, turns)) > _TURNS:
            return True
    return False


def _mean_error(values: Float[np.ndarray, " w"]) -> float:
    """Return the standard error of a mean."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _windows(recording: Recording) -> Int[np.ndarray, " s"]:
    """Return the window of each row: an axis may rest for half of the time.

    Raises:
        FitError: If the recording is too short for so many windows.
    """
    moving = int(recording.usable.sum())
    if moving < WINDOWS * _FEWEST:
        msg = (
            f"model choice: found {moving} samples in motion after filtering, expected"
            f" {WINDOWS} windows of at least {_FEWEST}."
        )
        raise FitError(msg)
    share = np.cumsum(recording.usable) / moving
    return np.minimum((share * WINDOWS).astype(np.int64), WINDOWS - 1)


def _hold_out(
    fit: FrictionFit, window: Int[np.ndarray, " s"], touched: Int[np.ndarray, "2 w"]
) -> tuple[tuple[FrictionFit, ...], Float[np.ndarray, " s"]]:
    """Return what a law is without each window, and the error of each row when held out.

    Solved by the sums of all rows, linear in the shape, less those that share samples with the
    window (``touched``: the first of them, and the row behind the last).
    """
    size, rows = len(fit.state), fit.rows
    sums = rows.sums - np.stack([rows.sums_of(slice(*ends)) for ends in touched.T])
    solution = ridged(sums[:, :, :-1] + fit.prior, sums[:, :, -1])
    steps = np.clip(solution[:, size:], -_LONGEST, _LONGEST)
    shapes = np.clip(fit.shape + steps, *fit.equation.bounds)
    error = rows.target - (rows.right @ solution.T)[np.arange(len(window)), window]
    pairs = zip(solution[:, :size], shapes, strict=True)
    laws = (
        dataclasses.replace(fit, state=state, shape=shape) for state, shape in pairs
    )
    return tuple(laws), error
