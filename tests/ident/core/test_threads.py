import threading

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from axcomp.ident.core import Estimate, one_blas_thread
from axcomp.ident.core._evidence import Spread, View
from axcomp.ident.fit.joint import JointData, Leadscrew, fit_joint


def _blas_threads() -> list[int]:
    pools = ThreadpoolController().info()
    return [pool["num_threads"] for pool in pools if pool["user_api"] == "blas"]


def test_overlapping_fits_leave_the_number_of_blas_threads_as_it_was() -> None:
    first_inside, second_inside = threading.Event(), threading.Event()
    first_done = threading.Event()

    def first() -> None:
        with one_blas_thread():
            first_inside.set()
            second_inside.wait(10.0)
        first_done.set()

    def second() -> None:
        first_inside.wait(10.0)
        with one_blas_thread():
            second_inside.set()
            first_done.wait(10.0)
            # The first fit has ended; the second one still runs on one thread.
            assert set(_blas_threads()) == {1}

    with ThreadpoolController().limit(limits=2, user_api="blas"):
        before = _blas_threads()
        threads = [threading.Thread(target=each) for each in (first, second)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert _blas_threads() == before


def test_deviations_that_are_asked_for_later_are_computed_on_one_blas_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    threads: list[int] = []
    spread = Estimate.spread

    def watched(self: Estimate, view: View) -> Spread:
        threads.extend(_blas_threads())
        return spread(self, view)

    place = np.tile(np.linspace(0.0, 90.0, 10), 3)
    error = np.random.default_rng(0).normal(0.0, 1e-3, len(place))
    data = JointData(position={"X": place}, error={"X": error})
    part = fit_joint(data, [Leadscrew("X", np.linspace(0.0, 90.0, 10))]).parts[0]
    monkeypatch.setattr(Estimate, "spread", watched)
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        assert np.isfinite(part.standard_deviation).all()
        assert np.isfinite(part.covariance).all()
    assert threads
    assert set(threads) == {1}
