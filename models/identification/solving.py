"""Solvers of compiled code, as this project calls them: one that is interrupted never returns a value.

CasADi ends IPOPT when a signal's handler raises, then drops the exception and returns the iterate that it stopped at.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

HANDLED: Final = ("SIGINT", "SIGTERM", "SIGALRM")  # Signals whose handlers end what is being done by an exception.


@contextmanager
def interruptible() -> Iterator[None]:
    """A block in which a solver runs. What a handler of HANDLED raises meanwhile leaves the block in any case.

    So Ctrl-C is KeyboardInterrupt, although the solver swallowed it. Handlers run in the main thread only; in another
    one the solver is not interrupted, and the block does nothing.
    """
    raised: list[BaseException] = []
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _known()}
    noted = {number: _noting(handler, raised) for number, handler in before.items() if callable(handler)}
    try:
        for number, handler in noted.items():
            signal.signal(number, handler)
        yield
    finally:
        for number in noted:
            signal.signal(number, before[number])
    if raised:
        raise raised[0]


def _known() -> list[signal.Signals]:
    """Those of HANDLED that this platform has."""
    return [one for one in signal.Signals if one.name in HANDLED]


def _noting(handler: Callable[..., Any], raised: list[BaseException]) -> Callable[[int, FrameType | None], None]:
    """The handler, with what it raises also noted in `raised`."""

    def noted(number: int, frame: FrameType | None) -> None:
        try:
            handler(number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    return noted
