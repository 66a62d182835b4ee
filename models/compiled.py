"""The one way in which this project compiles a numerical kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def compiled(kernel: Kernel) -> Kernel:
    """Numba's compilation, cached on disk, in IEEE arithmetic: no reassociation, no contraction to fused operations.

    So the compiled kernel equals the uncompiled one, `kernel.py_func`, bit for bit, which a test asserts.
    """
    return cast(Kernel, numba.njit(cache=True, error_model="numpy", fastmath=False)(kernel))
