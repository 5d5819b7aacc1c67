"""Fits that wait for each other, so that those of equal shape go together.

A job is straight code: read, fit, fit without each run, write. Run many jobs in threads of
one `Gathering`, and each fit waits until no job can go on without one; then all of them are
handed to their group function at once. Outside a gathering a fit is a group of its own.
"""

import collections
import contextlib
import contextvars
import dataclasses
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

_Request = TypeVar("_Request")
_Result = TypeVar("_Result")

_CURRENT: contextvars.ContextVar["tuple[Gathering, int] | None"] = (
    contextvars.ContextVar("gathering", default=None)
)


@dataclasses.dataclass(eq=False)
class _Ticket:
    """Requests of one caller, and what became of them.

    Attributes:
        gate: Closed until the requests are served and the caller has its turn.
    """

    caller: int
    group: Callable[[Sequence[Any]], list[Any]]
    requests: Sequence[Any]
    gate: threading.Lock
    results: list[Any]
    error: Exception | None = None


class Gathering:
    """Runs calls side by side and lets their fits go together.

    One call runs at a time. A second one would only take the interpreter from the first,
    which costs a fifth of the time; while one waits for the disk, another has its turn.
    Whoever rests hands the turn to the next one and wakes nobody else.

    Attributes:
        moved: When a call last got on, by `time.monotonic`.
    """

    def __init__(self) -> None:
        self.moved = time.monotonic()
        self._state = threading.Lock()
        """Held by whoever looks at what stands below, or changes it."""
        self._waiting: list[_Ticket] = []
        self._busy: set[int] = set()
        self._running: set[int] = set()
        self._queue: collections.deque[tuple[int, threading.Lock]] = collections.deque()
        """Who is to have the turn, first come, first served; each behind a closed gate."""
        self._taken = True
        self._resting = _closed()
        """Open while no call can go on without its requests."""

    @property
    def busy(self) -> list[int]:
        """Calls that the others wait for, by number."""
        with self._state:
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
        tickets: list[_Ticket] = []
        while self._busy:
            with self._state:
                self._queue.extend((ticket.caller, ticket.gate) for ticket in tickets)
                self._hand_on()
            self._resting.acquire()
            tickets, self._waiting = self._waiting, []
            _serve(tickets)
            self.moved = time.monotonic()
            self._busy.update(ticket.caller for ticket in tickets)
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
        ticket = _Ticket(caller, group, requests, _closed(), [])
        self._rest(caller, ticket)
        ticket.gate.acquire()
        if ticket.error is not None:
            raise ticket.error
        return ticket.results

    @contextlib.contextmanager
    def away(self, caller: int) -> Iterator[None]:
        """Give the turn of a call to another one meanwhile."""
        with self._state:
            self._hand_on()
        try:
            yield
        finally:
            self._take_turn(caller)

    def _take_turn(self, caller: int) -> None:
        with self._state:
            gate = _closed()
            self._queue.append((caller, gate))
            if not self._taken:
                self._hand_on()
        gate.acquire()

    def _rest(self, caller: int, ticket: _Ticket | None = None) -> None:
        with self._state:
            self.moved = time.monotonic()
            if ticket is not None:
                self._waiting.append(ticket)
            self._busy.discard(caller)
            self._running.discard(caller)
            self._hand_on()
            if not self._busy:
                self._resting.release()

    def _hand_on(self) -> None:
        """Give the turn to the next one; there may be none."""
        self._taken = bool(self._queue)
        if self._queue:
            caller, gate = self._queue.popleft()
            self._running.add(caller)
            gate.release()


def _closed() -> threading.Lock:
    """Return a gate that opens once, for one to pass."""
    gate = threading.Lock()
    gate.acquire()
    return gate


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
    gathering, caller = current
    with gathering.away(caller):
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
