"""The one way in which this project compiles a numerical kernel."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def compiled(kernel: Kernel) -> Kernel:
    """Numba's compilation, cached on disk, in IEEE arithmetic: no reassociation, no contraction to fused operations.

    So the compiled kernel equals the uncompiled one, `kernel.py_func`, bit for bit, which a test asserts. It lets other
    threads of Python run meanwhile.
    """
    made: Any = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=False)(kernel)
    if made is not kernel:  # as it is where nothing is compiled
        # Numba looks at the kernel's own file alone, and would go on with what other files had when it was compiled.
        parts = {
            _digest(__file__),
            _digest(made.py_func.__code__.co_filename),
            *_made_of(made.py_func.__globals__, set()),
        }
        stamp = hashlib.sha256("".join(sorted(parts)).encode()).hexdigest()
        stored = made._cache._cache_file
        # As a version: of what another one stored Numba reads nothing, and so none that names a class that is no more.
        stored._version = (stored._version, stamp)
    return cast(Kernel, made)


def inlined(kernel: Kernel) -> Kernel:
    """`compiled` for a part of compiled kernels, in which it is then written out.

    So the compiler knows there what it knows in that kernel, such as the lengths of local arrays; and where many arrays
    are handed over for little work, the call costs more than the work.
    """
    return cast(Kernel, numba.njit(inline="always", error_model="numpy", fastmath=False)(kernel))


def _made_of(names: Mapping[str, object], seen: set[str]) -> Iterator[str]:
    """What a kernel with these names about it may hold: numbers and texts, arrays, the files of tuples with named
    fields, and those of other kernels."""
    for name, value in names.items():
        numbers = value if isinstance(value, tuple) else (value,)
        if all(isinstance(one, int | float | complex | str) for one in numbers) and not name.startswith("__"):
            yield f"{name}={numbers!r};"
        if isinstance(value, np.ndarray):
            yield f"{name}={value.dtype}{value.tobytes().hex()};"
        if isinstance(value, type) and issubclass(value, tuple) and value.__module__ in sys.modules:
            yield _digest(str(getattr(sys.modules[value.__module__], "__file__", "")))
        for part in [value, *(vars(value).values() if isinstance(value, ModuleType) else ())]:
            ours = type(part).__module__.startswith("numba.")  # others may make up any attribute
            function = getattr(part, "py_func", getattr(part, "_defn", None)) if ours else None  # or what writes code
            if isinstance(function, FunctionType) and _is_own(file := function.__code__.co_filename, seen):
                seen.add(file)
                yield _digest(file)
                yield from _made_of(function.__globals__, seen)


def _is_own(file: str, seen: set[str]) -> bool:
    return file not in seen and "site-packages" not in file and file.endswith(".py")


@cache
def _digest(file: str) -> str:
    """Of a file's content; of a cell of a notebook, which is in no file, its name, as Numba looks at its source."""
    path = Path(file)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else file
