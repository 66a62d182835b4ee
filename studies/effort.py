"""How long a study will take and how much memory, said before the work and refused beyond a bound.

What is simulated is counted, and a short simulation of this very machine on this computer says what one sample takes.
Other work is given as the number of samples that could be simulated in its time, a ratio that hardly depends on the
computer. It was measured on the default machine, so that an estimate may be off by a factor of two or three.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from models.machine import Machine
from models.quantity import show
from models.simulation.simulator import simulate
from studies.options import BadInputError, Options
from studies.study import between

MAX_EXPECTED_S: Final = 4 * 3600.0  # s that a study may be expected to take where --time-limit does not say otherwise
MAX_MEMORY_BYTES: Final = 4 << 30  # bytes that it may be expected to hold
SAID: Final = 20.0  # s from which on the time is said before the work
PROBE: Final = 4000  # samples of the short simulation
SIMULATED: Final = 150  # bytes that a simulated sample takes: its signals, of one machine
LOG_LENGTH_RATIO: Final = 1.05  # of the samples of a table: its log begins before it and ends after it
DIAGNOSED: Final = 14_000  # bytes that a sample takes in a diagnosis: 150,000 samples took 2.2 GB
TRANSFERRED: Final = 1.5  # factor on its time and memory where fits to single records are made beside that to all
IDENTIFIED: Final = 1000  # bytes that a sample takes in an identification
# Samples simulated in the time in which one is diagnosed: 1800 to 4200 on four axes with 1 to 10 friction elements.
DIAGNOSING: Final = 2500
IDENTIFYING: Final = 35  # samples simulated in the time in which one is identified from
FORESIGHT_FACTOR: Final = 3.0  # factor by which what is foreseen may be off, either way


def seconds_a_sample(machine: Machine) -> float:
    """Processor time [s] that one sample of this machine's simulation takes here."""
    law, target = machine.feedback_only(), np.full(PROBE, machine.specification.stroke)
    simulate(machine, law, target[:2])  # compiles what is not yet compiled
    taken = []
    for _ in range(2):
        begin = time.process_time()
        simulate(machine, law, target)
        taken.append(time.process_time() - begin)
    return min(taken) / PROBE


def diagnosing(machine: Machine, samples: int, records: int) -> tuple[float, float]:
    """Processor time [s] and memory [bytes] that a diagnosis of so many samples in so many records takes here."""
    work = samples * (TRANSFERRED if records > 1 else 1.0)
    return work * DIAGNOSING * seconds_a_sample(machine), work * DIAGNOSED


def more_samples(machine: Machine, rows: int, held: int, records: int, most: int) -> str:
    """What to give along with the record of a table of so many rows, beside others of `held` samples in so many
    `records`, where that makes them more samples than `most`; else nothing."""
    count = math.ceil(LOG_LENGTH_RATIO * rows) + held
    if count <= most:
        return ""
    most = math.ceil(count / 1000) * 1000
    _, memory = diagnosing(machine, most, records + 1)
    return f"give --most-samples {most}, which takes about {memory / 1e9:.2g} GB of memory"


def period(machine: Machine) -> float:
    """Samples in one period of the specified motions."""
    wanted = machine.specification
    return 2 * wanted.motions * wanted.interval / machine.sample_time


def foresee(
    seconds: Mapping[str, float],
    memory: float,
    options: Options,
    progress: Callable[[float, str], None],
    most: float = MAX_MEMORY_BYTES,
) -> None:
    """Says how long the work will take, by what it is [s], and how much it holds [bytes], where it takes long.

    Raises BadInputError where that is more than --time-limit, or than `most` [bytes].
    """
    whole, limit = sum(seconds.values()), MAX_EXPECTED_S if options.time_limit is None else options.time_limit
    longest = max(seconds, key=lambda what: seconds[what])
    held = f"{memory / 1e9:.2g} GB, most of the time for {longest}"
    said = f"about {lasting(whole)} and {held}"
    if memory > most:
        raise BadInputError(
            f"--machine: this would take {said}; more than {most / 1e9:.1f} GB is refused: give fewer or shorter "
            "motions, fewer tables, a longer sample time or --quick"
        )
    if whole > limit:
        raise BadInputError(
            f"--time-limit: this would take {said}, more than {lasting(limit)}; give fewer or shorter motions, fewer "
            f'tables, --quick, or --time-limit "{lasting(1.5 * whole)}"'
        )
    if whole > SAID:
        progress(
            0.0,
            f"this will take {between(whole / FORESIGHT_FACTOR, whole * FORESIGHT_FACTOR)} of a processor "
            f"that does nothing else, and {held}",
        )


def lasting(seconds: float) -> str:
    """A time [s] in the unit that it is told in."""
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return show(seconds, "s", 2)
