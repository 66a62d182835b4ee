"""The parallel map: as map, on as many cores as there are to be used."""

from __future__ import annotations

import threading
import time

import pytest
from joblib import cpu_count
from threadpoolctl import threadpool_info, threadpool_limits

from diagnosis.model.parallel import on_single_blas_thread, parallel_map


@pytest.mark.parametrize("cores", ["1", "2"])
def test_results_keep_the_order_of_the_calls_whichever_ends_first(cores: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", cores)

    def late(i: int, name: str) -> str:
        time.sleep(0.02 if i == 0 else 0.0)
        return f"{i}{name}"

    assert list(parallel_map(late, range(4), "abcd")) == ["0a", "1b", "2c", "3d"]
    assert list(parallel_map(late, [], [])) == []


@pytest.mark.parametrize("cores", [1, 2])
def test_as_many_run_at_a_time_as_there_are_cores_to_use(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if cores == 1:
        monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")
    else:
        monkeypatch.setattr("diagnosis.model.parallel.cpu_count", lambda: cores)  # a machine may have one core only
    met = threading.Barrier(2)

    def meets(_: int) -> bool:
        try:
            met.wait(1.0)
        except threading.BrokenBarrierError:
            return False
        return True

    assert list(parallel_map(meets, range(2))) == [cores == 2] * 2


@pytest.mark.parametrize("cores", [1, 2])
def test_nothing_runs_before_it_is_asked_for(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.model.parallel.cpu_count", lambda: cores)
    done: list[int] = []
    found = parallel_map(done.append, [1, 2])
    assert done == []
    assert list(found) == [None, None]
    assert sorted(done) == [1, 2]


def test_an_exception_in_one_call_is_raised() -> None:
    def bad(i: int) -> float:
        return 1 / i

    with pytest.raises(ZeroDivisionError):
        list(parallel_map(bad, [1, 0, 2]))


def test_another_count_of_one_argument_is_refused() -> None:
    with pytest.raises(ValueError, match=r"shorter|longer"):
        list(parallel_map(lambda a, b: (a, b), [1, 2], [3]))


def test_blas_has_one_thread_within_and_its_own_number_behind() -> None:
    def threads() -> set[int]:
        return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        assert on_single_blas_thread(on_single_blas_thread(threads))() == {1}
        assert threads() == before
        assert before == {2} or cpu_count() < 2
