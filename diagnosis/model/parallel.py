"""Map over threads: the compiled kernels, which take most of the time, release the GIL.

Why not joblib.Parallel(prefer="threads"): it polls its results every 10 ms, and the calls here take as little as 5 ms
(two calls of 5 ms each took 6 ms here and 12 ms there). Calls that are nested in others, as records are within
candidates, run on one thread there, so that a core idles once the other branch is done. What joblib does better is to
return at once on an interrupt or an exception, where this waits for the calls that are running.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from itertools import starmap
from typing import Any, ParamSpec, TypeVar

from joblib import cpu_count
from threadpoolctl import threadpool_limits

P = ParamSpec("P")
T = TypeVar("T")


def on_single_blas_thread(function: Callable[P, T]) -> Callable[P, T]:
    """The function with BLAS on one thread while it runs: the matrices are small, the cores are busy with the threads
    of `parallel_map`, and sums keep their order. Calls may be nested within one another, not beside one another: the
    limit is the whole process's."""

    @wraps(function)
    def limited(*args: P.args, **options: P.kwargs) -> T:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **options)

    return limited


def parallel_map(function: Callable[..., T], *arguments: Iterable[Any]) -> Iterator[T]:
    """`map` over threads: results in the order of the arguments, as many calls at a time as there are cores to use.

    The number of cores is joblib's, so that LOKY_MAX_CPU_COUNT limits it. Nothing runs before the first result is asked
    for. Calls may be nested: each level has threads of its own. An exception is raised where its result would be, after
    the calls that are running. Raises ValueError where the arguments are not equally many.
    """
    calls = list(zip(*arguments, strict=True))
    workers = min(len(calls), cpu_count())
    if workers < 2:
        yield from starmap(function, calls)
        return
    with ThreadPoolExecutor(workers) as threads:
        yield from threads.map(function, *zip(*calls, strict=True))
