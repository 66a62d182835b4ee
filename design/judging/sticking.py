"""Whether a loop that is stable while the friction slips is unstable while it sticks, and why.

Elements of the friction that stick are a spring from the position at the scale to the thrust's input. On a plant whose
modes all have positive gains such a spring stores what it takes. With a mode of negative gain the scale moves against
the thrust's input, and the spring's force does more work there than it takes at the scale: the swing grows of itself.
No real friction does that, as it acts where it is deflected. Where the machine file has a friction-driven mode, which
is what it drives there, that is counted; a friction that goes with the acceleration, too, is left to simulations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.family import linear
from design.feasibility import UNSTABLE
from design.loop import dominant_pole
from models.controller import Feedback
from models.friction import Friction
from models.machine import Machine
from models.plant import Mode, Plant, against_spring
from models.quantity import listed, show

MAX_SPRINGS: Final = 12  # springs that are looked at, of a friction with more elements

Spring = tuple[float, float]


@dataclass(frozen=True)
class Sticking:
    """An unstable loop at one of the friction's slopes, the one at which it grows fastest.

    slope [N/m] and damping [N s/m] of the elements that stick; pole: magnitude [1] by which the motion grows in a
    sample; frequency [Hz] at which it swings, 0 where it does not. modes: of negative gain, that make it so;
    makes_work: whether the plant against that spring is unstable without any feedback; heals: whether the loop is
    stable where `modes` are left out, against that spring and while the friction slips.
    """

    slope: float
    damping: float
    pole: float
    sample_time: float
    frequency: float
    modes: tuple[Mode, ...] = ()
    makes_work: bool = False
    heals: bool = False

    @property
    def growth_time(self) -> float:
        """In which the motion grows by a factor e [s]."""
        return self.sample_time / math.log(self.pole)


def sticking(machine: Machine, feedback: Feedback | None = None) -> Sticking | None:
    """What makes the loop unstable while the friction sticks; None where it is stable, or unstable anyhow, or where
    an effect has the friction act elsewhere in another way than by modes.

    feedback: by default the one in place. Of the plant, the friction and what the effects add that is linear.

    >>> from models.machine import load
    >>> sticking(load()) is None
    True
    """
    law, ts, known = feedback or machine.control.feedback, machine.sample_time, linear(machine)
    every, plant = springs(machine.friction), known.plant
    if any(effect.differentiates or effect.rubs_elsewhere for effect in machine.effects):
        return None

    def pole_of(plant: Plant, spring: Spring) -> complex:
        stiffness, damping = spring
        held = (stiffness + known.spring, damping + known.drag)
        return dominant_pole(plant, law, ts, *held, known.lag, known.by_friction)

    def grows(plant: Plant, spring: Spring) -> bool:
        return abs(pole_of(plant, spring)) > 1 + UNSTABLE

    if grows(plant, (0.0, 0.0)):
        return None
    poles = [pole_of(plant, spring) for spring in every]
    worst = max(range(len(every)), key=lambda i: abs(poles[i]))
    if not 1 + UNSTABLE < abs(poles[worst]) < math.inf:
        return None
    spring, pole = every[worst], poles[worst]
    alone = _makes_work(plant, spring, ts, known.by_friction)
    modes = _without(plant, lambda rest: not (grows(rest, (0.0, 0.0)) or grows(rest, spring)))
    heals = bool(modes)
    if alone and not modes:
        modes = _without(plant, lambda rest: not _makes_work(rest, spring, ts, known.by_friction))
    frequency = abs(np.angle(pole)) / (2 * math.pi * ts)
    return Sticking(*spring, abs(pole), ts, float(frequency), modes, alone, heals)


def springs(friction: Friction) -> list[Spring]:
    """Stiffness [N/m] and damping [N s/m] of the elements that stick, the stiffest spring first: of all behind a
    reversal, then of those with the longer limits."""
    order = np.argsort(friction.limit)[::-1]
    summed = np.cumsum(np.array([friction.stiffness, friction.damping])[:, order], axis=1)[:, ::-1].T
    few = np.unique(np.linspace(0, len(summed) - 1, min(MAX_SPRINGS, len(summed))).round().astype(int))
    return [(float(stiffness), float(damping)) for stiffness, damping in summed[few] if stiffness > 0]


def _makes_work(plant: Plant, spring: Spring, sample_time: float, by_friction: tuple[Mode, ...]) -> bool:
    """Whether the plant against a spring, with no feedback, swings ever wider; sample_time [s]."""
    held, _, _ = against_spring(plant, *spring, by_friction)
    fastest = float(np.max(np.linalg.eigvals(held).real))
    return fastest * sample_time > UNSTABLE


def _without(plant: Plant, holds: Callable[[Plant], bool]) -> tuple[Mode, ...]:
    """The mode of negative gain without which something holds, the strongest that does; else all of them, if it holds
    without all; else none."""
    negative = sorted((mode for mode in plant.modes if mode.gain < 0), key=lambda mode: mode.gain)
    tried = [(mode,) for mode in negative] + ([tuple(negative)] if len(negative) > 1 else [])
    for some in tried:
        if holds(replace(plant, modes=tuple(mode for mode in plant.modes if mode not in some))):
            return some
    return ()


def state_of(found: Sticking) -> str:
    """At which slope the loop is unstable, and how, in words."""
    grows = f"growing by a factor e in {show(found.growth_time, 's', 2)}"
    moves = f"swings at {show(found.frequency, 'Hz', 3)}" if found.frequency > 0 else "moves away"
    return (
        f"the model's loop is unstable: against a slope of {show(found.slope, 'N/m', 3)} it {moves}, {grows}, though "
        "it is stable while the friction slips"
    )


def cause_of(found: Sticking) -> str:
    """Why it is unstable, in words."""
    if not found.modes:
        return "the feedback does not damp what swings against that slope"
    several, named = len(found.modes) > 1, named_modes(found)
    if not found.makes_work:
        return f"{named}, without which the loop is stable against that slope"
    return (
        f"{named}: in the model friction acts where the thrust does and follows the scale, which "
        f"{'these modes move' if several else 'this mode moves'} against the thrust, so that the friction does work on "
        "the axis, which no real friction does"
    )


def named_modes(found: Sticking) -> str:
    """The modes that make it unstable, in words."""
    at = listed([show(mode.frequency, "Hz", 3) for mode in found.modes])
    return f"the mode{'s' if len(found.modes) > 1 else ''} of negative gain at {at}"


def advice_on(found: Sticking) -> str:
    """What to do about it, in words."""
    if not found.modes:
        return "a PID that is stable at every slope is what pid_tradeoff looks for"
    judge = (
        "real friction acts where it is deflected, at the motor or at the carriage, so that the settling predicted "
        "here need not be the axis's: judge by records, by which gap_diagnosis tells whether the friction drives such "
        "a mode (friction_driven_mode); its improved.toml then knows where it acts"
    )
    if not found.heals:
        return judge
    left = "these modes" if len(found.modes) > 1 else "this mode"
    return (
        f"{judge}. A copy of the machine file without {left} is stable, but knows nothing of that vibration: what it "
        "predicts need not be the axis's either, and no PID is to be tuned for it"
    )
