"""Independent work on several threads."""

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context

import pytest

from handtrack.parallel import in_parallel, one_blas_thread, thread_count


def test_results_keep_the_order_of_their_items(monkeypatch):
    monkeypatch.setenv("HANDTRACK_THREADS", "4")

    def slow_for_the_first(item):
        time.sleep(0.02 / (1 + item))
        return item * item

    assert in_parallel(slow_for_the_first, range(8)) == [i * i for i in range(8)]


def test_work_within_work_does_not_wait_for_itself_and_an_error_is_the_callers(monkeypatch):
    monkeypatch.setenv("HANDTRACK_THREADS", "2")
    found = in_parallel(lambda i: in_parallel(lambda j: 10 * i + j, range(3)), range(4))
    assert found == [[10 * i + j for j in range(3)] for i in range(4)]
    with pytest.raises(ZeroDivisionError):
        in_parallel(lambda item: 1 // item, [2, 1, 0])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_copy_of_the_process_has_threads_of_its_own(monkeypatch):
    """It waited for those of the first for ever."""
    monkeypatch.setenv("HANDTRACK_THREADS", "2")
    in_parallel(str, range(2))
    with get_context("fork").Pool(1) as pool:
        assert pool.apply_async(in_parallel, (str, [1, 2])).get(60) == ["1", "2"]


@pytest.mark.parametrize(("said", "one"), [("1", True), ("2", False)])
def test_the_environment_says_how_many_threads(monkeypatch, said, one):
    monkeypatch.setenv("HANDTRACK_THREADS", said)
    assert thread_count() == int(said)
    here = threading.current_thread().name
    names = in_parallel(lambda _: threading.current_thread().name, range(4))
    assert (set(names) == {here}) is one
    monkeypatch.setenv("HANDTRACK_THREADS", "nonsense")
    assert thread_count() >= 1


def test_linear_algebra_takes_one_thread_whichever_of_ours_begins_or_ends():
    pools = pytest.importorskip("threadpoolctl")
    import scipy.linalg  # noqa: F401  has a BLAS of its own

    def threads():
        known = pools.threadpool_info()
        return {one["num_threads"] for one in known if one["user_api"] == "blas"}

    with pools.threadpool_limits(2, user_api="blas"), ThreadPoolExecutor(1) as other:
        before = threads()
        with one_blas_thread:
            assert threads() == {1}
        other.submit(one_blas_thread.__enter__).result()
        assert threads() == {1}, "begun by another thread than the first time"
        one_blas_thread.__enter__()
        other.submit(one_blas_thread.__exit__).result()
        assert threads() == {1}
        one_blas_thread.__exit__()
        assert threads() == before
