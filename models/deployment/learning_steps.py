"""Learning on the drive, sample by sample: the reference that every export is compared with.

`learn` begins with the wipe. From there on the compensator's elements w_i of every length l_i that is tried go along
(w = w + step / l_i within +-X), so that factor sum K w is the friction's force with this length and any scale.
At the wipe's two rests, and at the end of every motion over the stroke, the mean thrust u and the forces f_i are noted.
After the wipe, and after each round of motions, with n rests and the sums over them,

    a_i = sum f f - (sum f)^2 / n;  b_i = sum f u - (sum f)(sum u) / n;  factor_i = b_i / a_i, but at least `least`
    the length is the one with the least factor_i (factor_i a_i - 2 b_i), the residual sum of squares but for a constant

of the wipe's rests and the last round's motions; the wipe alone tells no length. The mean of direction times x - x_T*
over a round, weighted, tells what mass and dead time are off by. u_ff is scaled with the mass, x_T*'s response
moved with the dead time, and u_rf goes on without a bump.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.deployment.learning_numbers import Learning
from models.simulation.kernel import clipped

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MAX_STROKE_MISS: Final = 1e-3  # of the stroke, by which a motion that is learned from may miss it
# Entries of `told`: scale of the friction, of the elements' way and of u_ff; errors of mass and dead time; constant
# force; thrust summed over a rest; direction of the motion; the two weighted errors of a motion and of a round; sums of
# u and u^2 over a round; u at the wipe's rests, and their mean.
FACTOR, STRETCH, GAIN, MASS, LATE, OFFSET, HOLD, DIRECTION, BY_MASS, BY_LATE = range(10)
ALL_MASS, ALL_LATE, THRUST, WIPED_OUT, WIPED_BACK, ABOUT = range(10, 16)
ROUND, SINCE, COUNTED, CHOSEN = range(4)  # of `at`: -1 where nothing is learned, 0 during the wipe; samples; motions
FORCE, SQUARE, PRODUCT = range(3)  # of `sums`


class LearningNumbers(NamedTuple):
    """`Learning` as the kernel reads it."""

    rounds: int  # 0: there is no learning
    motions: int
    rest: int
    window: int
    nominal: int
    least: float
    stroke: float
    stretch: Array
    mass: Array
    dead_time: Array
    faultless: Array
    most: Array
    early: Array
    sooner: Array


class LearningState(NamedTuple):
    """What has been learned and what it is learned from; changed in place."""

    told: Array
    at: Integers
    position: Array  # (M,) the response of x_T* by now
    bank: Array  # (K, N) [m] the elements of each length
    rests: Array  # (K, 2) [N] their forces at the wipe's rests
    sums: Array  # (K, 3) over a round, of f, f^2 and f u


def learning_numbers(known: Learning | None, stroke: float, taps: int) -> LearningNumbers:
    """The numbers for the kernel; stroke [m], taps: of the response of x_T*."""
    if known is None:
        none = np.zeros(0)
        return LearningNumbers(0, 0, 0, 0, 0, 0.0, stroke, none, none, none, none, none, np.zeros(taps), np.zeros(taps))
    rows = (known.stretch, known.mass, known.dead_time, known.faultless, known.most)
    changes = (np.append(row, np.zeros(taps - len(row))) for row in (known.early, known.sooner))
    counts = known.rounds, known.motions, known.rest, known.window, known.nominal
    return LearningNumbers(*counts, known.least, stroke, *(np.array(row) for row in rows), *changes)


def learning_state(given: LearningNumbers, elements: int) -> LearningState:
    """Room for what is learned; `forget` makes it nominal."""
    count, taps = given.stretch.size, given.early.size
    room = (np.zeros((count, size)) for size in (elements, 2, 3))
    return LearningState(np.zeros(16), np.zeros(4, np.int64), np.zeros(taps), *room)


@compiled
def forget(one: LearningState, position: Array) -> None:
    """As designed: nothing is learned. position (M,) [m/m]: the response of x_T* as designed."""
    one.told[:] = 0.0
    one.told[FACTOR], one.told[STRETCH], one.told[GAIN] = 1.0, 1.0, 1.0
    one.at[ROUND], one.at[SINCE], one.at[COUNTED], one.at[CHOSEN] = -1, -1, 0, -1
    for i in range(one.position.size):  # assigned as a whole, it would take the compiler many times as long
        one.position[i] = position[i]


@compiled
def begin(given: LearningNumbers, one: LearningState, position: Array) -> None:
    """The learning begins together with the wipe. position [m/m]: as of `forget`."""
    forget(one, position)
    one.bank[:] = 0.0
    one.sums[:] = 0.0
    one.at[ROUND], one.at[SINCE], one.at[CHOSEN] = 0, 0, given.nominal


@compiled
def lead(given: LearningNumbers, one: LearningState, limit: Array, step: float) -> None:
    """Moves the elements of every length along the path by a step [m]."""
    if one.at[ROUND] < 0 or step == 0.0:
        return
    for i in range(given.stretch.size):
        way = given.stretch[i] * step
        for n in range(limit.size):
            one.bank[i, n] = clipped(one.bank[i, n] + way, limit[n])


@compiled
def force_of(one: LearningState, stiffness: Array, i: int) -> float:
    """The force [N] of the elements of length number i, at the nominal scale."""
    force = 0.0
    for n in range(stiffness.size):
        force += stiffness[n] * one.bank[i, n]
    return force


@compiled
def _choose(given: LearningNumbers, one: LearningState, first: int, last: int, motions: int) -> None:
    """Takes scale, length and constant force from the rests of the wipe and of `motions`."""
    told, count = one.told, 2.0 + motions
    out, back = told[WIPED_OUT], told[WIPED_BACK]
    thrust, fewest = out + back + told[THRUST], np.inf
    for i in range(first, last + 1):
        there, here = one.rests[i, 0], one.rests[i, 1]
        force = there + here + one.sums[i, FORCE]
        square = there * there + here * here + one.sums[i, SQUARE]
        product = there * out + here * back + one.sums[i, PRODUCT]
        spread = square - force * force / count
        along = product - force * thrust / count
        factor = max(along / max(spread, 1e-300), given.least)
        missed = factor * (factor * spread - 2.0 * along)
        if missed < fewest:
            fewest = missed
            told[FACTOR], told[OFFSET] = factor, told[ABOUT] + (thrust - factor * force) / count
            one.at[CHOSEN] = i
    told[STRETCH] = given.stretch[one.at[CHOSEN]]


@compiled
def _turn(given: LearningNumbers, one: LearningState, position: Array) -> None:
    """The end of a round: mass and dead time, then the friction; the next round begins."""
    told, most = one.told, given.most
    told[MASS] = clipped(told[MASS] + (told[ALL_MASS] / given.motions - given.faultless[0]), most[0])
    told[LATE] = clipped(told[LATE] + (told[ALL_LATE] / given.motions - given.faultless[1]), most[1])
    told[GAIN] = 1.0 + told[MASS]
    for j in range(position.size):
        one.position[j] = position[j] + told[LATE] * (given.early[j] + told[LATE] * given.sooner[j])
    _choose(given, one, 0, given.stretch.size - 1, given.motions)
    told[ALL_MASS], told[ALL_LATE], told[THRUST] = 0.0, 0.0, 0.0
    one.sums[:] = 0.0
    one.at[COUNTED] = 0
    one.at[ROUND] = one.at[ROUND] + 1 if one.at[ROUND] < given.rounds else -1


@compiled
def _rested(given: LearningNumbers, one: LearningState, stiffness: Array) -> None:
    """A motion has ended."""
    told = one.told
    thrust = told[HOLD] / (given.window + 1) - told[ABOUT]
    for i in range(given.stretch.size):
        force = force_of(one, stiffness, i)
        one.sums[i, FORCE] += force
        one.sums[i, SQUARE] += force * force
        one.sums[i, PRODUCT] += force * thrust
    told[THRUST] += thrust
    told[ALL_MASS] += told[BY_MASS]
    told[ALL_LATE] += told[BY_LATE]
    one.at[COUNTED] += 1


@compiled
def _wiping(given: LearningNumbers, one: LearningState, stiffness: Array, half: int, thrust: float) -> bool:
    """A sample of the wipe; whether it was the last and something has been learned."""
    told, at = one.told, one.at
    at[SINCE] += 1
    back = at[SINCE] > half
    sample = at[SINCE] - half if back else at[SINCE]
    if sample >= half - given.window:
        told[HOLD] += thrust
    if sample < half:
        return False
    for i in range(given.stretch.size):
        one.rests[i, 1 if back else 0] = force_of(one, stiffness, i)
    told[WIPED_BACK if back else WIPED_OUT] = told[HOLD] / (given.window + 1)
    told[HOLD] = 0.0
    if not back:
        return False
    told[ABOUT] = 0.5 * (told[WIPED_OUT] + told[WIPED_BACK])
    told[WIPED_OUT] -= told[ABOUT]
    told[WIPED_BACK] -= told[ABOUT]
    _choose(given, one, given.nominal, given.nominal, 0)
    at[ROUND], at[SINCE] = 1, -1
    return True


@compiled
def _moving(
    given: LearningNumbers, one: LearningState, stiffness: Array, change: float, error: float, thrust: float
) -> bool:
    """A sample of a round; whether it was a motion's last."""
    told, at = one.told, one.at
    if change != 0.0:
        at[SINCE] = 0 if abs(abs(change) - given.stroke) <= MAX_STROKE_MISS * given.stroke else -1
        told[DIRECTION] = 1.0 if change > 0.0 else -1.0
        told[HOLD], told[BY_MASS], told[BY_LATE] = 0.0, 0.0, 0.0
    elif at[SINCE] >= 0:
        at[SINCE] += 1
    if at[SINCE] < 0:
        return False
    if at[SINCE] < given.mass.size:
        beyond = told[DIRECTION] * -error
        told[BY_MASS] += given.mass[at[SINCE]] * beyond
        told[BY_LATE] += given.dead_time[at[SINCE]] * beyond
    if at[SINCE] >= given.rest - given.window:
        told[HOLD] += thrust
    if at[SINCE] < given.rest:
        return False
    at[SINCE] = -1
    _rested(given, one, stiffness)
    return True


@compiled
def learn(
    given: LearningNumbers,
    one: LearningState,
    stiffness: Array,
    position: Array,
    half: int,
    change: float,
    error: float,
    thrust: float,
) -> bool:
    """A sample of the learning; whether the friction's numbers are new. half: samples of the wipe's way out.

    position (M,): the response of x_T* as designed; change [m]: of the target; error [m]; thrust [N]: the command.
    """
    if one.at[ROUND] == 0:
        return _wiping(given, one, stiffness, half, thrust)
    if not _moving(given, one, stiffness, change, error, thrust) or one.at[COUNTED] < given.motions:
        return False
    _turn(given, one, position)
    return True
