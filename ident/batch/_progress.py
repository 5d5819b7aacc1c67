"""How far a batch has come, how fast it goes, and how long it will still take."""

import dataclasses
import time


@dataclasses.dataclass
class Progress:
    """Where a batch stands.

    Attributes:
        total: Jobs of the batch.
        done: Jobs that are done, those of earlier runs included.
    """

    total: int
    done: int
    _fresh: int = 0
    _start: float = dataclasses.field(default_factory=time.monotonic)

    def count(self, jobs: int) -> None:
        """Note that jobs were finished."""
        self.done += jobs
        self._fresh += jobs

    @property
    def rate(self) -> float:
        """Jobs per second since this run began."""
        return self._fresh / max(time.monotonic() - self._start, 1e-9)

    @property
    def left(self) -> float | None:
        """Seconds still to go at that rate, None before anything is done."""
        return (self.total - self.done) / self.rate if self._fresh else None

    def __str__(self) -> str:
        words = f"{self.done} of {self.total} jobs"
        if self.left is None:
            return words
        return f"{words}, {self.rate:.1f} per second, {_time(self.left)} left"


def _time(seconds: float) -> str:
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {whole % 60} s" if minutes else f"{whole} s"
