"""What effects ask of the thrust along x_T*, so that a controller can put it out ahead of the error that they make.

The effects are replayed along x_T* (kernel.replay) with the compensator's friction, and once without them. What they
make of the friction F, the external force d and the thrust is met by c[k], held as the thrust is:

    c[k] = mean over its interval of  F - F without effects - d + u - T(u),   u = u_ff + u_rf + c

T is what thrust hooks make of a thrust. c is on both sides, so it is found in ROUNDS rounds: with each the error is
smaller by the effect's relative size. More would do a lag no good: its inverse asks for thrust that no drive has.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.effects.base import Effect
from models.friction import Friction, elements
from models.simulation.effect_kernel import Path, replay

Array = NDArray[np.float64]

SUBSTEPS: Final = 4  # substeps of an interval of the thrust
ROUNDS: Final = 2
BEFORE: Final = 3  # intervals of rest before the start, the first of which no motion reaches
NOWHERE: Final = np.zeros(0)  # the past of contacts that are virgin
NO_FRICTION: Final = elements([0.0], [1.0])


@dataclass(frozen=True)
class EffectFeedforward:
    """Effects to be met along x_T*, in the catalogue's order.

    fractional_delay [s]: the part of the dead time that is not a whole sample, by which the thrust of sample k begins
    to act later than the sample of x_T* at k T_s.
    """

    effects: tuple[Effect, ...]
    fractional_delay: float


def effect_thrust(
    feedforward: EffectFeedforward,
    friction: Friction | None,
    position: Array,
    thrust: Array,
    sample_time: float,
    past: Array = NOWHERE,
) -> Array:
    """The thrust c (n,) [N] that meets the effects along x_T* `position` (n,) [m], from rest at 0 before its start.

    friction: the compensator's elements; past (m,) [m]: where the table went before, from rest at 0 and back, as in a
    wipe, before which they are virgin; thrust (n,) [N]: all else that is put out. What the effects ask for at rest at
    the start is held by the feedback, so c is the departure from it.
    """
    whole = np.concatenate([past, position])
    contacts, path = friction or NO_FRICTION, _path(whole, sample_time, feedforward.fractional_delay)
    known = np.concatenate([np.zeros(BEFORE + past.size), thrust])
    plain = replay(contacts, (), path._replace(command=known), 0.0).friction
    added = np.zeros(known.size)
    for _ in range(ROUNDS):
        sent = known + added
        met = replay(contacts, feedforward.effects, path._replace(command=sent), 0.0, start=0.0)
        added = sent + np.mean(met.friction - plain - met.force - met.thrust, axis=1)
    return np.asarray(added[BEFORE + past.size :] - added[past.size], float)


def _path(position: Array, sample_time: float, delay: float) -> Path:
    """The intervals of the thrust along x_T*, BEFORE at rest before them.

    Between samples stand Akima's cubics: their speed has no jumps, which an effect of the acceleration would not bear,
    and they do not overshoot where the path comes to rest.
    """
    from scipy.interpolate import Akima1DInterpolator  # noqa: PLC0415  # slow to import, and few designs meet effects

    n, after = position.size, np.full(2, position[-1])
    course = Akima1DInterpolator(np.arange(-BEFORE, n + 2), np.concatenate([np.zeros(BEFORE), position, after]))
    samples = np.arange(-BEFORE, n) + delay / sample_time
    middles = samples[:, None] + (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS
    return Path(sample_time, course(middles), course(middles, 1) / sample_time, course(samples), np.zeros(samples.size))
