"""How many elements the friction compensator RFM needs: the fewest with which a design meets its specification and has
time to spare, as friction that stands elsewhere at the start, or a little more error, moves a settling time.

Each number is judged on the nonsmooth machine by `design.validation`. More elements follow the friction better, but the
fit is not nested, so the settling time need not fall with every element. Numbers are therefore tried one after another
from 1 on, up to the number of the machine's own elements, which the RFM then has itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from design.effect_compensation import with_effects
from design.friction_compensation import simplify, with_force
from design.validation import repeats_within, validate
from models.controller import Controller
from models.machine import Machine
from models.machines.parts import MOST_COMPENSATED
from models.quantity import keeps_to

SPARE: Final = 0.05  # of the specified settling time that a design settles sooner than it has to
EXTRA_COUNTS: Final = 3  # numbers beyond the chosen one that a curve shows, and the machine's own number


@dataclass(frozen=True)
class Trial:
    """What the design achieves with `count` elements: the slowest motion's settling time [s], the worst 3 sigma [m]
    after the specified one, the peak thrust [N], and whether the simulation became periodic; spare: whether it meets
    its specification with time to spare."""

    count: int
    settling_time: float
    dispersion: float
    peak_thrust: float
    periodic: bool
    meets: bool
    spare: bool

    @property
    def rank(self) -> tuple[bool, float, float, bool, int]:
        """Sorts trials from the best to the worst: those with time to spare, the fewest first, then those that meet,
        the quickest first, before those that miss."""
        if self.spare:
            return False, 0.0, 0.0, False, self.count
        return not self.meets, self.settling_time, self.dispersion, not self.periodic, self.count


@dataclass(frozen=True)
class Choice:
    """The chosen number of elements, the largest that may be tried, and the trials in the order of their numbers."""

    count: int
    most: int
    trials: tuple[Trial, ...]

    @property
    def meets(self) -> bool:
        """Whether the design meets its specification with the chosen number."""
        return any(one.meets for one in self.trials)

    @property
    def spare(self) -> bool:
        """Whether it does with time to spare."""
        return any(one.spare for one in self.trials)


def largest_count(machine: Machine) -> int:
    """The largest number of elements that is tried: that of the machine's elements, as far as a file may state it."""
    return min(len(with_force(machine.friction).limit), MOST_COMPENSATED)


def choose(
    machine: Machine,
    bare: Controller,
    *,
    stroke: float | None = None,
    seed: int = 0,
    further: int = 0,
    tell: Callable[[int, int], None] = lambda _count, _most: None,
) -> Choice:
    """The fewest elements with which `bare`, the controller without RFM, meets the machine's specification with time to
    spare, or else those with which it does soonest.

    It is met if every motion of the sequence, with strokes of `stroke` [m] (default: the specification's), settles in
    time, the thrust stays within the rating, and the last two periods agree. The search ends at the first number that
    does with SPARE of its time to spare. If none does, it is the one whose slowest motion settles first, of those that
    meet where there are any; among equals the one with the least 3 sigma.
    further: so many numbers beyond the one at which the search ends, and the largest one, are tried for their outcome.
    tell: receives each number before it is tried, and the largest one. The machine's effects act, and those are met
    that can be (design.effect_compensation); `bare` is designed for the plant that has their modes and delays, or not.
    """
    most, trials = largest_count(machine), list[Trial]()

    def attempt(count: int) -> None:
        tell(count, most)
        trials.append(_trial(machine, bare, count, stroke, seed))

    for count in range(1, most + 1):
        attempt(count)
        if trials[-1].spare:
            break
    met = trials[-1].count
    if further:
        for count in sorted({*range(met + 1, min(met + further, most) + 1), most} - {one.count for one in trials}):
            attempt(count)
    return Choice(min(trials, key=lambda one: one.rank).count, most, tuple(trials))


def _trial(machine: Machine, bare: Controller, count: int, stroke: float | None, seed: int) -> Trial:
    law = with_effects(replace(bare, friction_compensation=simplify(machine.friction, count)), machine)
    found = validate(machine, law, stroke=stroke, seed=seed)
    settling, periodic = found.slowest.settling_time, found.repeat_error <= repeats_within(machine)
    in_time = keeps_to(settling, machine.specification.settling_time)
    meets = in_time and periodic and found.peak_thrust <= machine.drive.rated_thrust
    spare = meets and settling <= (1 - SPARE) * machine.specification.settling_time
    return Trial(count, settling, found.worst_dispersion, found.peak_thrust, periodic, meets, spare)
