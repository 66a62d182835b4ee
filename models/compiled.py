"""The one way in which this project compiles a numerical kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def compiled(kernel: Kernel) -> Kernel:
    """Numba's compilation, cached on disk, in IEEE arithmetic: no reassociation, no contraction to fused operations.

    So the compiled kernel equals the uncompiled one, `kernel.py_func`, bit for bit, which a test asserts. It lets other
    threads of Python run meanwhile.
    """
    return cast(Kernel, numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=False)(kernel))


def inlined(kernel: Kernel) -> Kernel:
    """`compiled` for a part of compiled kernels, in which it is then written out.

    So the compiler knows there what it knows in that kernel, such as the lengths of local arrays; and where many arrays
    are handed over for little work, the call costs more than the work.
    """
    return cast(Kernel, numba.njit(inline="always", error_model="numpy", fastmath=False)(kernel))
