"""Calls beside each other in threads: the compiled kernels, which take the time, let other threads run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import starmap
from typing import Any, TypeVar

from joblib import cpu_count

T = TypeVar("T")


def beside(found: Callable[..., T], *arguments: Iterable[Any]) -> Iterator[T]:
    """As `map`, in the same order, as many at a time as there are cores to use (joblib's LOKY_MAX_CPU_COUNT counts).

    Nothing runs before the first is asked for. A call that itself works on several beside each other has as many
    threads again. Raises ValueError where the arguments are not equally many.
    """
    calls = list(zip(*arguments, strict=True))
    at_once = min(len(calls), cpu_count())
    if at_once < 2:
        yield from starmap(found, calls)
        return
    with ThreadPoolExecutor(at_once) as threads:
        yield from threads.map(found, *zip(*calls, strict=True))
