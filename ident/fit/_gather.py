"""Fits that wait for each other, so that those of equal shape go together.

A job is straight code: read, fit, fit without each run, write. Run many jobs in threads of
one `Gathering`, and each fit waits until no job can go on without one; then all of them are
handed to their group function at once. Outside a gathering a fit is a group of its own.
"""

import contextlib
import contextvars
import dataclasses
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

_Request = TypeVar("_Request")
_Result = TypeVar("_Result")

_SIDE_BY_SIDE = 1
"""Calls that run at a time. A second one would only take the interpreter from the first,
which costs a fifth of the time; while one waits for the disk, another has its turn."""

_CURRENT: contextvars.ContextVar["tuple[Gathering, int] | None"] = (
    contextvars.ContextVar("gathering", default=None)
)


@dataclasses.dataclass(eq=False)
class _Ticket:
    """Requests of one caller, and what became of them."""

    caller: int
    group: Callable[[Sequence[Any]], list[Any]]
    requests: Sequence[Any]
    done: threading.Event
    results: list[Any]
    error: Exception | None = None


class Gathering:
    """Runs calls side by side and lets their fits go together.

    Attributes:
        moved: When a call last got on, by `time.monotonic`.
    """

    def __init__(self) -> None:
        self.moved = time.monotonic()
        self._changed = threading.Condition()
        self._waiting: list[_Ticket] = []
        self._busy: set[int] = set()
        self._turns = threading.Semaphore(_SIDE_BY_SIDE)
        self._running: set[int] = set()

    @property
    def busy(self) -> list[int]:
        """Calls that the others wait for, by number."""
        with self._changed:
            return sorted(self._running)

    def run(
        self, calls: Sequence[Callable[[], _Result]]
    ) -> list[_Result | BaseException]:
        """Return what each call returned or raised, in order."""
        results: list[_Result | BaseException] = [
            RuntimeError("the call did not end")
        ] * len(calls)

        def work(k: int) -> None:
            _CURRENT.set((self, k))
            self._take_turn(k)
            try:
                results[k] = calls[k]()
            except BaseException as error:
                results[k] = error
            finally:
                self._rest(k)

        self._busy = set(range(len(calls)))
        threads = [
            threading.Thread(target=work, args=(k,), daemon=True)
            for k in range(len(calls))
        ]
        for thread in threads:
            thread.start()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: not self._busy)
                tickets, self._waiting = self._waiting, []
            if not tickets:
                break
            _serve(tickets)
            self.moved = time.monotonic()
            self._busy.update(ticket.caller for ticket in tickets)
            for ticket in tickets:
                ticket.done.set()
        for thread in threads:
            thread.join()
        return results

    def ask(
        self,
        caller: int,
        group: Callable[[Sequence[_Request]], list[_Result]],
        requests: Sequence[_Request],
    ) -> list[_Result]:
        """Return what a group function makes of requests, beside those of other calls."""
        ticket = _Ticket(caller, group, requests, threading.Event(), [])
        with self._changed:
            self._waiting.append(ticket)
        self._rest(caller)
        ticket.done.wait()
        self._take_turn(caller)
        if ticket.error is not None:
            raise ticket.error
        return ticket.results

    @contextlib.contextmanager
    def away(self) -> Iterator[None]:
        """Give the turn of the calling call to another one meanwhile."""
        self._turns.release()
        try:
            yield
        finally:
            self._turns.acquire()

    def _take_turn(self, caller: int) -> None:
        self._turns.acquire()
        with self._changed:
            self._running.add(caller)

    def _rest(self, caller: int) -> None:
        with self._changed:
            self.moved = time.monotonic()
            self._busy.discard(caller)
            self._running.discard(caller)
            if not self._busy:
                self._changed.notify_all()
        self._turns.release()


def _serve(tickets: Sequence[_Ticket]) -> None:
    groups: dict[Callable[[Sequence[Any]], list[Any]], list[_Ticket]] = {}
    for ticket in tickets:
        groups.setdefault(ticket.group, []).append(ticket)
    for group, own in groups.items():
        requests = [request for ticket in own for request in ticket.requests]
        try:
            results = group(requests)
        except Exception:  # one of them is at fault: each for itself then
            for ticket in own:
                _serve_one(ticket)
            continue
        for ticket in own:
            count = len(ticket.requests)
            ticket.results, results = results[:count], results[count:]


def _serve_one(ticket: _Ticket) -> None:
    try:
        ticket.results = ticket.group(ticket.requests)
    except Exception as error:  # its caller must hear of it
        ticket.error = error


@contextlib.contextmanager
def waiting() -> Iterator[None]:
    """Let other calls of the gathering run while this one waits for the disk."""
    current = _CURRENT.get()
    if current is None:
        yield
        return
    with current[0].away():
        yield


def in_group(
    group: Callable[[Sequence[_Request]], list[_Result]],
    requests: Sequence[_Request],
) -> list[_Result]:
    """Return what a group function makes of requests, together with others where it can."""
    current = _CURRENT.get()
    if current is None:
        return group(requests)
    gathering, caller = current
    return gathering.ask(caller, group, requests)
