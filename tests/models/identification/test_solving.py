"""An interrupted solve raises; it never returns the iterate that it stopped at."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

import casadi as ca
import numpy as np
import pytest

from design.trajectory.nlp import Program, Solver
from models.identification.solving import interruptible

COUNT = 30_000  # unknowns of the program without end


class EndedError(Exception):
    """What a handler raises here."""


@contextmanager
def handling(number: signal.Signals, handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


@contextmanager
def soon(number: signal.Signals) -> Iterator[None]:
    """Another process sends the signal to this one soon, although compiled code holds the interpreter then."""
    child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
        signal.sigtimedwait({signal.SIGALRM}, 0.5)
        os.kill(os.getppid(), number)
        os._exit(0)
    yield
    os.waitpid(child, 0)


def endless() -> Solver:
    """A program whose solve takes many times as long as the signal: a Rosenbrock valley with terms without end. With a
    tenth of them it was solved on a fast machine before the signal came."""
    program = Program()
    x = program.variable("x", np.ones(COUNT), -5.0, 5.0)
    y = x
    for _ in range(30):
        y = ca.sin(y) + 1e-3 * y**2 + x
    weight = program.parameter("weight")
    program.minimise(weight * ca.sumsqr(y[1:] - y[:-1] ** 2) + ca.sumsqr(1 - y))
    program.subject_to(x[0] + x[1], -10.0, 10.0)
    return program.build()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of a fork beside threads; the child only sends a signal
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_solve_raises_what_the_handler_raised(number: signal.Signals) -> None:
    def end(_number: int, _frame: FrameType | None) -> None:
        raise EndedError

    solver = endless()
    with handling(number, end), soon(number), pytest.raises(EndedError):
        solver.solve({"weight": 100.0}, {"x": np.full(COUNT, -1.2)})


def test_an_exception_that_is_swallowed_leaves_the_block_and_the_handler_is_put_back() -> None:
    with handling(signal.SIGINT, signal.default_int_handler):
        with pytest.raises(KeyboardInterrupt), interruptible(), suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_handler_that_only_notes_the_signal_leaves_the_value() -> None:
    seen: list[int] = []
    with handling(signal.SIGINT, lambda number, _frame: seen.append(number)):
        with interruptible():
            signal.raise_signal(signal.SIGINT)
            value = 1.0
        assert (seen, value) == ([signal.SIGINT], 1.0)


def test_in_another_thread_nothing_is_handled() -> None:
    done: list[bool] = []

    def work() -> None:
        with interruptible():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]
