"""The law as a drive runs it, one sample after the other: the reference that every export is compared with.

Every operation and its order are part of the definition, so that code in another language can give the same bits. At
sample k, with the target r[k] and the reading x[k] (what is not within +-MAX_POSITION_M, a NaN among it, is taken as at
k - 1):

    c[k] = r[k] - r[k-1];  b[k] = r[k-M];  y, q, u_ff = sums over j = 0 .. M-1 of S_j c[k-j]     (x_T* = b + y)
    z_i = z_i + (b[k] - b[k-1]) + (q[k] - q[k-1]) within +-X_i;  f = sum K_i z_i;  u_rf = f - f_0
    e = (b[k-d] - x[k]) + y[k-d];  u_fb by `models.simulation.kernel.pid_step` or `models.feedback.law.output`
    v = u_fb + ((u_ff + u_rf) + u_plan);  u = v within the limit;  the integral moves by its share of u - v

y[k-d] is summed anew over c[k-d-j]. During a wipe its way is added to b - x and q, its thrust takes the place of u_rf,
and f_0 follows f, so that u_rf sets in without a bump. `reset` starts at a reading, with the thrust that is on the
axis. What the axis has learned (`models.deployment.learning_steps`) outlives a reset: it scales u_ff, the elements'
steps and f, and takes the place of x_T*'s S_j; as designed these scales are 1.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.compiled import compiled
from models.deployment import learning_steps as learning
from models.deployment.coefficients import Coefficients, WipeMotion
from models.deployment.learning_steps import (
    FACTOR,
    GAIN,
    LATE,
    MASS,
    OFFSET,
    ROUND,
    STRETCH,
    LearningNumbers,
    LearningState,
)
from models.feedback.law import LawArrays, advance, arrays, output
from models.simulation.kernel import clipped, pid_step

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MAX_POSITION_M: Final = 1e6  # m; no axis is longer, and so no sum overflows
# What is asked of the law at a sample; all but STEP take no time. INIT is a reset at 0 that forgets what was learned.
STEP, RESET, WIPE, PLAN, LEARN, INIT = range(6)
TARGET_MISSING, READING_MISSING, LIMITED, WIPING, LEARNING = 1, 2, 4, 8, 16  # bits of the status
# Entries of `kept`: target and reading of the sample before, b and q of it, f_0, the integral, d and e of the PID,
TARGET, READING, BASE, MOVED, ZERO, INTEGRAL, SLOPE, ERROR = range(8)
# and of `at`: the newest target's place, the wipe's sample, the plan's sample; -1: none.
NEWEST, WIPED, PLANNED = range(3)


class Numbers(NamedTuple):
    """`Coefficients` as the kernel reads them."""

    sample_time: float
    position: Array
    path: Array
    thrust: Array
    delay: int
    gains: Array
    stiffness: Array
    limit: Array
    thrust_limit: float
    tracking: float
    wipe_distance: float
    wipe_amplitude: float
    wipe_count: int  # 0: there is no wipe
    wipe_still: int
    plan: Array
    start: float


class Memory(NamedTuple):
    """What the law remembers from sample to sample; changed in place."""

    target: Array  # (memory,) the last targets, in a ring
    change: Array  # (memory,) their changes
    z: Array  # (N,)
    kept: Array
    at: Integers


class Answered(NamedTuple):
    """Thrust (n,) [N] and status (n,) of what is asked."""

    thrust: Array
    status: Integers


@compiled
def _profile(s: float) -> float:
    return s * s * s * (10.0 + s * (-15.0 + 6.0 * s))


@compiled
def _push(s: float) -> float:
    return s * (60.0 + s * (-180.0 + 120.0 * s))


@compiled
def _way(numbers: Numbers, sample: int) -> float:
    """The wipe's way [m] at its sample, which counts from 1."""
    count, half, distance = numbers.wipe_count, numbers.wipe_count + numbers.wipe_still, numbers.wipe_distance
    if sample <= 0 or sample >= 2 * half:
        return 0.0
    if sample <= half:
        return distance * _profile(min(sample, count) / count)
    return distance - distance * _profile(min(sample - half, count) / count)


@compiled
def _wipe_thrust(numbers: Numbers, sample: int) -> float:
    count, half, amplitude = numbers.wipe_count, numbers.wipe_count + numbers.wipe_still, numbers.wipe_amplitude
    if sample <= half:
        return amplitude * _push(min(sample, count) / count)
    return -(amplitude * _push(min(sample - half, count) / count))


@compiled
def _reset(
    numbers: Numbers, law: LawArrays, memory: Memory, state: LearningState, position: float, thrust: float
) -> None:
    """At rest on a reading [m], the integral holding the thrust [N]; the elements virgin, u_rf active.

    What has been learned stays; learning under way ends."""
    held = thrust if -MAX_POSITION_M <= thrust <= MAX_POSITION_M else 0.0
    kept = memory.kept
    at = position if -MAX_POSITION_M <= position <= MAX_POSITION_M else 0.0
    memory.target[:] = at
    memory.change[:] = 0.0
    memory.z[:] = 0.0
    kept[:] = 0.0
    kept[TARGET], kept[READING], kept[BASE] = at, at, at
    kept[INTEGRAL] = clipped(held, numbers.thrust_limit) if numbers.gains[1] > 0.0 else 0.0
    for i in range(law.c.size):
        law.state[i] = law.hold[i] * clipped(held, numbers.thrust_limit)
    memory.at[NEWEST], memory.at[WIPED], memory.at[PLANNED] = 0, -1, -1
    state.at[ROUND] = -1


@compiled
def _wiped(numbers: Numbers, memory: Memory) -> tuple[float, float, float, bool]:
    """Way, way d samples ago [m] and thrust [N] of the wipe at this sample, and whether it runs."""
    if memory.at[WIPED] < 0:
        return 0.0, 0.0, 0.0, False
    memory.at[WIPED] += 1
    sample = memory.at[WIPED]
    total = 2 * (numbers.wipe_count + numbers.wipe_still)
    if sample >= total + numbers.delay:
        memory.at[WIPED] = -1
    if sample > total:
        return 0.0, _way(numbers, sample - numbers.delay), 0.0, False
    return _way(numbers, sample), _way(numbers, sample - numbers.delay), _wipe_thrust(numbers, sample), True


@compiled
def _elements(numbers: Numbers, memory: Memory, state: LearningState, step: float) -> float:
    force, way = 0.0, state.told[STRETCH] * step
    for i in range(memory.z.size):
        memory.z[i] = clipped(memory.z[i] + way, numbers.limit[i])
        force += numbers.stiffness[i] * memory.z[i]
    return float(state.told[FACTOR] * force)


@compiled
def _learn_sample(
    numbers: Numbers,
    rules: LearningNumbers,
    memory: Memory,
    state: LearningState,
    error: float,
    thrust: float,
    compensation: float,
) -> None:
    """Learns from a sample; u_rf [N] goes on from what it was, with the elements of the length that was chosen."""
    half, change = numbers.wipe_count + numbers.wipe_still, memory.change[memory.at[NEWEST]]
    if learning.learn(rules, state, numbers.stiffness, numbers.position, half, change, error, thrust):
        chosen = state.at[learning.CHOSEN]
        for i in range(memory.z.size):  # assigned as a whole, it would take the compiler many times as long
            memory.z[i] = state.bank[chosen, i]
        force = state.told[FACTOR] * learning.force_of(state, numbers.stiffness, chosen)
        memory.kept[ZERO] = force - compensation


@compiled
def _step(
    numbers: Numbers,
    law: LawArrays,
    rules: LearningNumbers,
    memory: Memory,
    state: LearningState,
    target: float,
    position: float,
) -> tuple[float, int]:
    """One sample: the thrust [N] and the status."""
    kept, size, status = memory.kept, memory.target.size, 0
    if not (-MAX_POSITION_M <= target <= MAX_POSITION_M):
        target, status = kept[TARGET], status | TARGET_MISSING
    if not (-MAX_POSITION_M <= position <= MAX_POSITION_M):
        position, status = kept[READING], status | READING_MISSING
    newest = memory.at[NEWEST] - 1 if memory.at[NEWEST] > 0 else size - 1
    memory.at[NEWEST] = newest
    memory.target[newest], memory.change[newest] = target, target - kept[TARGET]
    kept[TARGET], kept[READING] = target, position
    y = q = u = 0.0
    for j in range(numbers.position.size):
        change, late = memory.change[(newest + j) % size], memory.change[(newest + j + numbers.delay) % size]
        y += state.position[j] * late
        q += numbers.path[j] * change
        u += numbers.thrust[j] * change
    u = state.told[GAIN] * u
    way, late_way, push, wiping = _wiped(numbers, memory)
    base = memory.target[(newest + numbers.position.size) % size]
    q = q + way
    step = (base - kept[BASE]) + (q - kept[MOVED])
    force = _elements(numbers, memory, state, step)
    learning.lead(rules, state, numbers.limit, step)
    kept[BASE], kept[MOVED] = base, q
    if wiping:
        kept[ZERO], status = force, status | WIPING
    compensation = push if wiping else force - kept[ZERO]
    planned = 0.0
    if memory.at[PLANNED] >= 0:
        planned = numbers.plan[memory.at[PLANNED]]
        memory.at[PLANNED] = memory.at[PLANNED] + 1 if memory.at[PLANNED] + 1 < numbers.plan.size else -1
    late_base = memory.target[(newest + numbers.position.size + numbers.delay) % size]
    error = ((late_base - position) + late_way) + y
    if law.c.size > 0:
        feedback = output(law, error, 0.0)
    else:
        feedback, kept[INTEGRAL], kept[SLOPE] = pid_step(
            error, kept[ERROR], kept[INTEGRAL], kept[SLOPE], numbers.gains, numbers.sample_time
        )
        kept[ERROR] = error
    wanted = feedback + ((u + compensation) + planned)
    thrust = clipped(wanted, numbers.thrust_limit)
    if thrust != wanted:
        status |= LIMITED
    if law.c.size > 0:
        advance(law, error, 0.0, thrust - wanted)
    else:
        kept[INTEGRAL] = kept[INTEGRAL] + numbers.tracking * (thrust - wanted)
    if state.at[ROUND] >= 0:
        status |= LEARNING
        _learn_sample(numbers, rules, memory, state, error, thrust, compensation)
    return thrust, status


@compiled
def _ask(
    numbers: Numbers,
    law: LawArrays,
    rules: LearningNumbers,
    memory: Memory,
    state: LearningState,
    asked: int,
    one: float,
    two: float,
) -> None:
    """What takes no time; one, two: the reading [m] and thrust [N] of a reset, the thrust of an INIT."""
    if asked == RESET:
        _reset(numbers, law, memory, state, one, two)
    elif asked == WIPE:
        memory.at[WIPED], state.at[ROUND] = 0 if numbers.wipe_count > 0 else -1, -1
    elif asked == PLAN:
        memory.at[PLANNED] = 0 if numbers.plan.size > 0 else -1
    elif asked == LEARN and rules.rounds > 0:
        memory.at[WIPED] = 0
        learning.begin(rules, state, numbers.position)
    elif asked == INIT:
        learning.forget(state, numbers.position)
        _reset(numbers, law, memory, state, 0.0, numbers.start)


@compiled
def _run(
    numbers: Numbers,
    law: LawArrays,
    rules: LearningNumbers,
    memory: Memory,
    state: LearningState,
    asked: Integers,
    given: Array,
    out: Answered,
) -> None:
    for k in range(asked.size):
        out.thrust[k], out.status[k] = 0.0, 0
        if asked[k] == STEP:
            out.thrust[k], out.status[k] = _step(numbers, law, rules, memory, state, given[k, 0], given[k, 1])
        else:
            _ask(numbers, law, rules, memory, state, asked[k], given[k, 0], given[k, 1])


class Learned(NamedTuple):
    """The friction's force and presliding length over the nominal ones [1], the constant force [N], and what mass [1]
    and dead time [s] are off by."""

    force: float
    length: float
    offset: float
    mass: float
    dead_time: float


class RunningLaw:
    """The law with its memory, reset at position 0 with the file's own start.

    >>> from models.deployment.coefficients import coefficients
    >>> law = RunningLaw(coefficients(controller, stroke=20e-6, thrust_limit=machine.drive.rated_thrust))
    >>> law.step(target=20e-6, position=0.0)  # [N]
    100.44...
    """

    def __init__(self, known: Coefficients) -> None:
        """At rest at 0, holding `start` [N]."""
        wipe, pid = known.wipe or WipeMotion(0.0, 0, 0, 0.0), known.pid
        self._numbers = Numbers(
            sample_time=known.sample_time,
            position=np.array(known.position),
            path=np.array(known.path),
            thrust=np.array(known.thrust),
            delay=known.delay,
            gains=np.array([pid.kp, pid.ki, pid.kd, pid.derivative_filter]),
            stiffness=np.array(known.stiffness, float),
            limit=np.array(known.limit, float),
            thrust_limit=known.thrust_limit,
            tracking=known.tracking,
            wipe_distance=wipe.distance,
            wipe_amplitude=wipe.amplitude,
            wipe_count=wipe.count,
            wipe_still=wipe.still,
            plan=np.array(known.plan, float),
            start=known.start,
        )
        size = known.memory
        self._law = arrays(known.law)
        self._memory = Memory(
            np.zeros(size), np.zeros(size), np.zeros(len(known.limit)), np.zeros(8), np.zeros(3, np.int64)
        )
        self._rules = learning.learning_numbers(known.learning, known.stroke, len(known.position))
        self._state = learning.learning_state(self._rules, len(known.limit))
        self.run([INIT], [[0.0, 0.0]])

    def run(self, asked: ArrayLike, given: ArrayLike) -> tuple[Array, Integers]:
        """Thrust (n,) [N] and status (n,) of what is asked (n,): STEP with target and reading (n, 2) [m], RESET with
        reading and thrust [m, N], WIPE, PLAN, LEARN or INIT. It goes on from the run before."""
        what, values = np.ascontiguousarray(asked, np.int64), np.ascontiguousarray(given, float)
        out = Answered(np.empty(what.size), np.empty(what.size, np.int64))
        _run(self._numbers, self._law, self._rules, self._memory, self._state, what, values, out)
        return out.thrust, out.status

    def reset(self, position: float, thrust: float) -> None:
        """At rest on a reading [m], the integral holding a thrust [N]."""
        self.run([RESET], [[position, thrust]])

    def step(self, target: float, position: float) -> float:
        """The thrust [N] at a target and a reading [m]."""
        return float(self.run([STEP], [[target, position]])[0][0])

    @property
    def learned(self) -> Learned:
        """What has been learned so far; as designed before."""
        told = self._state.told
        length = 1.0 / told[STRETCH]
        return Learned(*(float(one) for one in (told[FACTOR], length, told[OFFSET], told[MASS], told[LATE])))
