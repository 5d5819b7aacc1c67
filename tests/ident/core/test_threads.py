import threading

from threadpoolctl import ThreadpoolController

from axcomp.ident.core import one_blas_thread


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
