"""Schemes that meet what the friction remembers: shortest motions, and trajectories for the histories they bring about.

The element states of each history come from the nonsmooth simulation of the design itself, so design and simulation
alternate. A scheme is what a controller then puts out; it may learn the friction from the thrust that holds a table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.controller import feedback_alone, reference_delay_samples
from design.deadbeat import DesignError
from design.trajectory.compensator import MotionProfile, compensate, motion_profile, rest_states
from design.trajectory.history_aware import Built, Limits, Task, Trajectory, build, solve
from design.trajectory.robust import Objective as RobustObjective
from design.trajectory.robust import RobustTask, RobustTrajectory, build_robust, solve_robust
from design.trajectory.scenarios import Errors, Feedback, Scenario, tables
from design.validation import sequence
from models.controller import Controller, References, compensator_path, references
from models.friction import Friction
from models.machine import Machine
from models.plant import Plant, delay_split
from models.quantity import show
from models.records.record import motions
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

# Design and simulation alternate so often: the histories follow from the design, and change little.
DESIGN_ROUNDS: Final = 2
# Of the settling time: for so long after the motion the error counts in "sensitivity", until the feedback meets it.
LOOK: Final = 0.6
LOOK_ROBUST: Final = 1.2  # A robust trajectory leaves more to the feedback, which takes longer.
# A search for a feasible motion gives up this many times the samples of the one aimed at beyond it, or so many samples.
MAX_EXTRA, MAX_EXTRA_SAMPLES = 1.0, 200
MAX_MOTION_SAMPLES: Final = 120  # A motion has at most three times as many samples as the paper's.
# Smoothing widths where many copies of the loop are solved: a tenth of the limits will do.
COARSE_SMOOTHING: Final = (0.3, 0.1)


@dataclass(frozen=True)
class Wanted:
    """What has to be reached: stroke [m], fine tolerance [m], settling time [s], and the limits of the thrust."""

    stroke: float
    tolerance: float
    settling_time: float
    limits: Limits


def samples_for(machine: Machine, settling_time: float) -> int:
    """Samples that a motion may take so that the table, L later, rests by settling_time [s]."""
    late = rest_time(machine, 0)
    return math.floor((settling_time - late) / machine.sample_time + 1e-9)


def rest_time(machine: Machine, samples: int) -> float:
    """When [s] the table rests after a motion of so many samples: L later.

    Where L is not a whole number of samples, the last sample's thrust is held by the friction alone already.
    """
    _, rest = delay_split(machine.plant.dead_time, machine.sample_time)
    return (samples - (rest > 0)) * machine.sample_time + machine.plant.dead_time


def most_samples(machine: Machine) -> int:
    """Samples that a motion has at most: it rests by half the time from one to the next, and its design is solved."""
    return min(samples_for(machine, machine.specification.interval / 2), MAX_MOTION_SAMPLES)


def least_samples(plant: Plant, sample_time: float) -> int:
    """Samples that a motion has at least, with samples of sample_time [s]: its end has two conditions of each mode.

    Where L is not a whole number of samples, the last one's net thrust is 0 beside them.
    """
    return 2 * len(plant.modes) + (delay_split(plant.dead_time, sample_time)[1] > 0)


def slip_states(machine: Machine) -> Array:
    """(2, N) [m]: every element at its lower, and at its upper limit: most friction to climb, and most to carry."""
    return np.outer([-1.0, 1.0], machine.friction.limit)


def quickest(
    machine: Machine,
    wanted: Wanted,
    begin: int,
    least: int = 0,
    known: Mapping[int, Trajectory] = MappingProxyType({}),
) -> tuple[int, dict[int, Trajectory]]:
    """The least number of samples, from `least` on, with a least peak thrust within the limits; all tried.

    known: what was tried before on this machine, for the same stroke and slew but perhaps another limit of the thrust
    [N], which only says which of them do. From full slip either way, which bounds what any history asks for. Bisection
    over the number of samples, one problem each: the least peak falls with their number. Raises DesignError if even
    the most that it goes beyond, see MAX_EXTRA, or that a motion may have, see `most_samples`, do not do.
    """
    tried = dict(known)

    def possible(count: int) -> bool:
        if count not in tried:
            task = Task(machine.plant, machine.friction, machine.sample_time, count, wanted.stroke, "peak_thrust", 2)
            tried[count] = solve(build(task), slip_states(machine), Limits(slew=wanted.limits.slew))
        return tried[count].solution.converged and tried[count].peak <= wanted.limits.thrust

    low = max(least_samples(machine.plant, machine.sample_time), least) - 1
    high, step, most = max(begin, low + 1), 2, most_samples(machine)
    last = min(begin + round(max(MAX_EXTRA_SAMPLES, MAX_EXTRA * begin)), most)
    while high > most or not possible(high):
        if high >= last:
            interval = f" or more than the {show(machine.specification.interval, 's')} from one motion to the next"
            raise DesignError(
                f"no motion of up to {show(rest_time(machine, last), 's')} keeps within "
                f"{show(wanted.limits.thrust, 'N')}; allow more, or give a shorter stroke"
                f"{interval if last == most < MAX_MOTION_SAMPLES else ''}"
            )
        low, high, step = high, min(high + step, last), 2 * step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if possible(middle) else (middle, high)
    return high, tried


def histories(machine: Machine, controller: Controller, stroke: float, given: References | None = None) -> Array:
    """Element states (motions, N) [m] before each motion of the last period in the nonsmooth simulation.

    Those before a motion down are turned, so that all are histories of a motion up. The reversal up comes first; up and
    down differ, as the longest elements do not slip over the whole way. The scale is taken as ideal: a rounding of the
    scale that falls otherwise on another processor must not make another design.
    """
    target = sequence(machine, stroke)
    exact = replace(machine, scale=replace(machine.scale, resolution=0.0, noise=0.0))
    response = simulate(exact, controller, target, given=given)
    states = rest_states(machine.friction, response.position, target)
    turned = [one.direction * state for one, state in zip(motions(target), states, strict=True)]
    return np.array(turned[-2 * machine.specification.motions :])


def outermost(machine: Machine) -> list[int]:
    """The reversal and the last inching motion, up and down: they bound what the friction remembers."""
    count = machine.specification.motions
    return sorted({0, count - 1, count, 2 * count - 1})


def least_peak(machine: Machine, wanted: Wanted, count: int) -> tuple[Built, Trajectory]:
    """One x_T* with the least peak thrust over all histories of the sequence; see `aware`."""
    task = Task(
        machine.plant,
        machine.friction,
        machine.sample_time,
        count,
        wanted.stroke,
        "peak_thrust",
        histories=2 * machine.specification.motions,
    )
    return aware(machine, wanted, task)


def aware(machine: Machine, wanted: Wanted, task: Task) -> tuple[Built, Trajectory]:
    """The history-aware trajectory of a task without scenarios, at the histories that it brings about itself."""
    built, found = build(task), None
    states = np.repeat(slip_states(machine)[:1], task.histories, axis=0)
    for _ in range(DESIGN_ROUNDS + 1):
        found = solve(built, states, wanted.limits, start=found)
        if not found.solution.converged:
            found = solve(built, states, wanted.limits)
        motion = profile_of(machine, found)
        given = compensate(motion, machine.friction, sequence(machine, wanted.stroke))
        states = histories(machine, feedback_alone(machine), wanted.stroke, given)
    assert found is not None
    return built, found


def least_sensitive(
    machine: Machine, wanted: Wanted, begin: Trajectory, errors: Errors
) -> tuple[Built, Trajectory, tuple[Scenario, ...]]:
    """From `begin`, the trajectory least sensitive to the errors within the thrust of the outermost histories.

    The errors are met at the reversal up, where the friction climbs most.
    """
    chosen = outermost(machine)
    scenarios = tuple(
        Scenario(plant, friction, 0, weight)
        for plant, friction, weight in tables(machine.plant, machine.friction, errors)
    )
    count, ts = begin.task.samples, machine.sample_time
    first = count + round(machine.plant.dead_time / ts)
    task = replace(
        begin.task,
        objective="sensitivity",
        histories=len(chosen),
        scenarios=scenarios,
        feedback=feedback(machine, first, LOOK * machine.specification.settling_time),
    )
    given = compensate(profile_of(machine, begin), machine.friction, sequence(machine, wanted.stroke))
    states = histories(machine, feedback_alone(machine), wanted.stroke, given)[chosen]
    others = [
        histories(
            replace(machine, plant=one.plant, friction=one.friction),
            feedback_alone(machine),
            wanted.stroke,
            given,
        )[chosen[one.history]]
        for one in scenarios
    ]
    built = build(task)
    found = solve(built, states, wanted.limits, ratios=COARSE_SMOOTHING, others=others, net=begin.net)
    return built, found, scenarios


def robust_trajectory(
    machine: Machine,
    wanted: Wanted,
    begin: Trajectory,
    objective: RobustObjective,
    *,
    seen: int = 4,
    ratios: Sequence[float] = COARSE_SMOOTHING,
    rounds: int = DESIGN_ROUNDS,
) -> RobustTrajectory:
    """One trajectory and one thrust for the outermost histories that it brings about itself, and so for all.

    begin: a history-aware trajectory whose net thrust the first solve begins from. seen: how many of the
    outermost it is solved for. ratios [1]: smoothing widths. rounds: of design and simulation.
    """
    count = begin.task.samples
    first = count + 1 + round(machine.plant.dead_time / machine.sample_time)
    chosen = outermost(machine)[:seen]
    scenarios = tuple(Scenario(machine.plant, machine.friction, i) for i in range(len(chosen)))
    task = RobustTask(
        machine.plant,
        scenarios,
        feedback(machine, first, LOOK_ROBUST * machine.specification.settling_time),
        machine.sample_time,
        count,
        wanted.stroke,
        objective,
    )
    built = build_robust(task)
    given = compensate(profile_of(machine, begin), machine.friction, sequence(machine, wanted.stroke))
    states = histories(machine, feedback_alone(machine), wanted.stroke, given)[chosen]
    found = solve_robust(built, list(states), begin.net, wanted.limits, ratios=ratios)
    for _ in range(rounds - 1):
        states = histories(machine, robust_controller(machine, found), wanted.stroke)[chosen]
        found = solve_robust(built, list(states), found, wanted.limits, ratios=ratios)
    return found


@dataclass(frozen=True)
class Scheme:
    """How a table is led: all that the controller puts out on its own, for what it takes the friction to be.

    known: the friction as the design has it. references: x_T*, u_ff, u_rf over a target for a friction. path: where
    along the target the compensator's elements are led, (n,) [m]. adapted: the scheme for a machine of another mass and
    dead time, or None for one that stays as it was designed.
    """

    controller: Controller
    known: Friction
    references: Callable[[Friction, Array], References]
    path: Callable[[Array], Array]
    adapted: Callable[[Machine], Scheme] | None = None


def paper(controller: Controller) -> Scheme:
    """The paper's scheme, with the path of the controller's RFM. Raises ValueError for a controller without an RFM."""
    known = controller.friction_compensation
    if known is None:
        raise ValueError("the controller has no friction compensation that could learn; give one with an RFM")

    def put_out(friction: Friction, target: Array) -> References:
        return references(replace(controller, friction_compensation=friction), target)

    return Scheme(controller, known, put_out, lambda target: compensator_path(controller, target))


def history_aware(machine: Machine, motion: MotionProfile) -> Scheme:
    """A history-aware trajectory: the machine's elements follow it in the middle of each sample.

    For a machine of another mass it asks for as much more thrust, so that the table moves alike; its x_T* is where that
    table is at the samples, which depends on the dead time.
    """
    middle = replace(motion, position=motion.middle)

    def adapted(other: Machine) -> Scheme:
        net = motion.net[:-2] * (other.plant.mass / machine.plant.mass)
        return history_aware(other, motion_profile(other.plant, other.sample_time, net, motion.stroke))

    return Scheme(
        feedback_alone(machine),
        machine.friction,
        lambda friction, target: compensate(motion, friction, target),
        lambda target: compensate(middle, machine.friction, target).position,
        adapted,
    )


def profile_of(machine: Machine, trajectory: Trajectory) -> MotionProfile:
    """What the history-aware compensator needs of a trajectory."""
    return motion_profile(machine.plant, machine.sample_time, trajectory.net, trajectory.task.stroke)


def feedback(machine: Machine, first: int, look: float) -> Feedback:
    """The machine's loop, with the error counted over `look` [s] from sample `first` on."""
    control = machine.control
    last = first + round(look / machine.sample_time)
    return Feedback(machine.sample_time, control.pid, reference_delay_samples(machine), first, last)


def robust_controller(machine: Machine, found: RobustTrajectory) -> Controller:
    """The controller of a robust trajectory [SI], with the machine's PID."""
    return found.controller(machine.sample_time, machine.control.pid, reference_delay_samples(machine))
