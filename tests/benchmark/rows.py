"""The contenders, and how they are measured: in rounds of all of them, so that a drift of the machine cancels."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.simulation.exact import respond
from models.simulation.kernel import Loop, Run, run_one
from models.simulation.simulator import simulate, simulate_many
from tests.benchmark import others
from tests.benchmark.job import PIECE, Job, prepared, variations
from tests.benchmark.plain import Plain
from tests.benchmark.twin import Twin

Array = NDArray[np.float64]

SUBSTEPS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500)
TOLERANCES: Final = (1e-3, 1e-4, 1e-6, 1e-8)
BATCH: Final = 64


@dataclass(frozen=True)
class Size:
    """How much is measured: rounds, every `stride`-th of them with the slow contenders too, over `piece` [s]."""

    duration: float
    piece: float
    rounds: int
    stride: int
    substeps: tuple[int, ...] = SUBSTEPS
    tolerances: tuple[float, ...] = TOLERANCES
    batch: int = BATCH


FULL: Final = Size(duration=math.inf, piece=PIECE, rounds=15, stride=5)
QUICK: Final = Size(duration=1.0, piece=0.02, rounds=5, stride=5, substeps=(1, 5, 10, 50), tolerances=(1e-3, 1e-6))


@dataclass(frozen=True)
class Contender:
    """One way to do the job: `seconds` does it once and says how long it took, over `simulated` [s] of the loop.

    family: what belongs together as a curve of error against time, `label` one point of it. position: x (n,) [m] of the
    job's reversal. same_job: False if the contender does something else than the job, which the note names.
    """

    family: str
    label: str
    simulated: float
    seconds: Callable[[], float]
    position: Callable[[], Array]
    slow: bool = False
    same_job: bool = True
    note: str = ""

    @property
    def name(self) -> str:
        """Family and label."""
        return f"{self.family}, {self.label}" if self.label else self.family


@dataclass(frozen=True)
class Row:
    """What was measured of a contender: medians [s per simulated s], `ratio` to the simulator's in the same round."""

    family: str
    label: str
    per_second: float
    ratio: float
    error: float
    same_job: bool
    note: str
    measured: tuple[float, ...]

    @property
    def name(self) -> str:
        """Family and label."""
        return f"{self.family}, {self.label}" if self.label else self.family


SIMULATOR: Final = "simulator"
HOT: Final = "simulator's hot loop"
TWIN: Final = "C twin"
BATCHED: Final = "simulator in a batch"
PLAIN: Final = "plain Python"
SCIPY: Final = "solve_ivp at each sample"
CONTROL: Final = "python-control at each sample"
CONTINUOUS: Final = "python-control, continuous"
SLOW: Final = (PLAIN, SCIPY, CONTROL, CONTINUOUS)


def contenders(job: Job, size: Size, twin: Twin | None, plain: Plain) -> list[Contender]:
    """All of them; without `twin` that one is left out."""
    whole = job if math.isinf(size.duration) else job.first(size.duration)
    found = [_simulator(whole, substeps) for substeps in size.substeps]
    found.append(_kernel(HOT, whole, run_one))
    if twin is not None:
        found.append(_kernel(TWIN, whole, twin))
    found.append(_batch(whole, size.batch))
    piece, exact = job.first(size.piece), job.reversal()
    found.append(
        Contender(PLAIN, "10 substeps", piece.duration, plain.seconds, plain.position, slow=True, note="numba off")
    )
    return found + _others(piece, exact, size.tolerances)


def oracle(job: Job) -> Array:
    """x (n,) [m] of the job's reversal by models/simulation/exact.py."""
    exact = job.reversal()
    return respond(exact.machine, exact.controller, exact.target)[0]


def measure(
    candidates: Sequence[Contender], truth: Array, size: Size, progress: Callable[[str], None]
) -> tuple[Row, ...]:
    """A row for each contender; the first pass, which gives the errors, also compiles what is to be compiled."""
    errors = []
    for one in candidates:
        progress(f"error of {one.name}")
        errors.append(float(np.max(np.abs(one.position() - truth))))
        if not one.slow:
            one.seconds()
    times: list[list[float]] = [[math.nan] * size.rounds for _ in candidates]
    for k in range(size.rounds):
        progress(f"round {k + 1} of {size.rounds}" + (", with the slow ones" if k % size.stride == 0 else ""))
        order = range(len(candidates))
        for i in order if k % 2 == 0 else reversed(order):
            one = candidates[i]
            if not one.slow or k % size.stride == 0:
                times[i][k] = one.seconds() / one.simulated
    base = next(i for i, one in enumerate(candidates) if (one.family, one.label) == (SIMULATOR, "10 substeps"))
    return tuple(
        _row(one, error, np.array(own), np.array(times[base]))
        for one, error, own in zip(candidates, errors, times, strict=True)
    )


def _row(one: Contender, error: float, own: Array, base: Array) -> Row:
    ratio, measured = float(np.nanmedian(own / base)), own[np.isfinite(own)]
    return Row(
        one.family,
        one.label,
        float(np.median(measured)),
        ratio,
        error,
        one.same_job,
        one.note,
        tuple(measured.tolist()),
    )


def _timed(call: Callable[..., Any], *arguments: Any, **options: Any) -> float:
    """Processor time [s]: what a call takes on one core, however busy other programs keep the machine."""
    begin = time.process_time()
    call(*arguments, **options)
    return time.process_time() - begin


def _simulator(job: Job, substeps: int) -> Contender:
    exact = job.reversal()

    def run(one: Job) -> Array:
        return simulate(one.machine, one.controller, one.target, substeps=substeps).position

    label = "1 substep" if substeps == 1 else f"{substeps} substeps"
    return Contender(SIMULATOR, label, job.duration, lambda: _timed(run, job), lambda: run(exact))


def _kernel(family: str, job: Job, kernel: Callable[[Loop, Run], None]) -> Contender:
    """A loop alone at 10 substeps, what it works on prepared before the time is taken."""

    def run(one: Job) -> Array:
        loop, signals = prepared(one, 10)
        kernel(loop, signals)
        return signals.position

    return Contender(
        family,
        "",
        job.duration,
        lambda: _timed(kernel, *prepared(job, 10)),
        lambda: run(job.reversal()),
        note="10 substeps, without setting up",
    )


def _batch(job: Job, count: int) -> Contender:
    machines = variations(job.machine, count)
    exact = job.reversal()

    def position() -> Array:
        together = variations(exact.machine, count)
        return simulate_many(together, [exact.controller] * count, exact.target)[0].position

    return Contender(
        BATCHED,
        "",
        count * job.duration,
        lambda: _timed(simulate_many, machines, [job.controller] * count, job.target),
        position,
        note=f"{count} machines, 10 substeps, one core; time per trajectory",
    )


def _others(piece: Job, exact: Job, tolerances: Sequence[float]) -> list[Contender]:
    loosest = max(tolerances)

    def contender(
        family: str, label: str, run: Callable[[Job], Array], note: str = "", *, same_job: bool = True
    ) -> Contender:
        return Contender(
            family, label, piece.duration, lambda: _timed(run, piece), lambda: run(exact), True, same_job, note
        )

    def scipy(method: str, tolerance: float) -> Callable[[Job], Array]:
        return lambda job: others.with_scipy(job, method, tolerance)

    found = [contender(SCIPY, f"RK45, {tolerance:g}", scipy("RK45", tolerance)) for tolerance in tolerances]
    # At tighter tolerances LSODA takes minutes a simulated second: the friction's corners keep it at tiny steps.
    found.append(contender(SCIPY, f"LSODA, {loosest:g}", scipy("LSODA", loosest)))
    for tolerance in (loosest, 1e-6):
        label = f"RK45, {tolerance:g}"
        found.append(
            contender(CONTROL, label, lambda job, tolerance=tolerance: others.with_control(job, tolerance))  # type: ignore[misc]
        )
    continuous = "another loop: PID continuous, dead time by Pade, no rounding"
    found.append(
        contender(
            CONTINUOUS,
            f"RK45, {loosest:g}",
            lambda job: others.with_control_continuous(job, loosest),
            continuous,
            same_job=False,
        )
    )
    return found
