"""The designs: for each history its element states from the nonsmooth simulation, the trajectories that meet them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import waiting
from design.deadbeat import DesignError
from design.trajectory.compensator import Shape, compensate, learn, rest_states, shape
from design.trajectory.history_aware import Built, Limits, Task, Trajectory, build, solve
from design.trajectory.robust import CommonTask, CommonTrajectory, build_common, solve_common
from design.trajectory.scenarios import Errors, Feedback, Scenario, tables
from design.validation import respond, sequence
from models.controller import Controller, References, references
from models.friction import Friction
from models.machine import Machine
from models.plant import delay_split
from models.records.record import motions
from models.simulation.simulator import simulate
from studies.trajectory_optimisation.outcomes import MODE_RANGE, RANGE

Array = NDArray[np.float64]

ROUNDS: Final = 2  # of design and simulation: the histories follow from the design
LOOK: Final = 15e-3  # s after the motion over which the error counts in "sensitivity"
LOOK_COMMON: Final = 30e-3  # s, the same for one trajectory for all, whose errors the feedback brings in
REST: Final = 20e-3  # s at the end of a motion over which the thrust that holds the table is averaged
LONGEST: Final = 200  # samples that a search for a feasible motion goes beyond the one aimed at
# What a trajectory should be insensitive to, one standard deviation each: friction as far as learning leaves it wrong.
ERRORS: Final = Errors(0.02, 0.02, RANGE.mass / math.sqrt(3), MODE_RANGE / math.sqrt(3))
COARSE: Final = (0.3, 0.1)  # continuation where a tenth of the limits is fine enough: many copies of the loop


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

    Where L is no whole number of samples, the last sample's thrust is held by the friction alone already.
    """
    _, rest = delay_split(machine.plant.dead_time, machine.sample_time)
    return (samples - (rest > 0)) * machine.sample_time + machine.plant.dead_time


def slip_states(machine: Machine) -> Array:
    """(2, N) [m]: every element at its lower, and at its upper limit: most friction to climb, and most to carry."""
    return np.outer([-1.0, 1.0], machine.friction.limit)


def quickest(machine: Machine, wanted: Wanted, begin: int, least: int = 0) -> tuple[int, dict[int, Trajectory]]:
    """The least number of samples, from `least` on, with a least peak thrust within the limits; all tried.

    From full slip either way, which bounds what any history asks for. Bisection over the number of samples, one
    problem each: the least peak falls with their number. Raises DesignError if even LONGEST more do not do.
    """
    tried: dict[int, Trajectory] = {}

    def possible(count: int) -> bool:
        task = Task(machine.plant, machine.friction, machine.sample_time, count, wanted.stroke, "peak_thrust", 2)
        tried[count] = solve(build(task), slip_states(machine), Limits(slew=wanted.limits.slew))
        return tried[count].solution.converged and tried[count].peak <= wanted.limits.thrust

    low = max(2 * len(machine.plant.modes), least - 1)
    high, step = max(begin, low + 1), 2
    while not possible(high):
        low, high, step = high, high + step, 2 * step
        if high > begin + LONGEST:
            raise DesignError(
                f"no motion of up to {rest_time(machine, high):g} s keeps within {wanted.limits.thrust:g} N; allow more"
            )
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
    for _ in range(ROUNDS + 1):
        found = solve(built, states, wanted.limits, start=found)
        if not found.solution.converged:
            found = solve(built, states, wanted.limits)
        motion = motion_of(machine, found)
        given = compensate(motion, machine.friction, sequence(machine, wanted.stroke))
        states = histories(machine, bare(machine), wanted.stroke, given)
    assert found is not None
    return built, found


def least_sensitive(
    machine: Machine, wanted: Wanted, begin: Trajectory, *, quick: bool
) -> tuple[Built, Trajectory, tuple[Scenario, ...]]:
    """From `begin`, the trajectory least sensitive to ERRORS within the thrust of the outermost histories.

    The errors are met at the reversal up, where the friction climbs most.
    """
    errors = replace(ERRORS, length=0.0, mass=0.0) if quick else ERRORS
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
        feedback=feedback(machine, first, LOOK),
    )
    given = compensate(motion_of(machine, begin), machine.friction, sequence(machine, wanted.stroke))
    states = histories(machine, bare(machine), wanted.stroke, given)[chosen]
    others = [
        histories(replace(machine, plant=one.plant, friction=one.friction), bare(machine), wanted.stroke, given)[
            chosen[one.history]
        ]
        for one in scenarios
    ]
    built = build(task)
    found = solve(built, states, wanted.limits, ratios=COARSE, others=others, net=begin.net)
    return built, found, scenarios


def one_for_all(
    machine: Machine, wanted: Wanted, begin: Trajectory, objective: Any, *, quick: bool
) -> CommonTrajectory:
    """One trajectory and one thrust for the outermost histories that it brings about itself, and so for all."""
    count = begin.task.samples
    first = count + 1 + round(machine.plant.dead_time / machine.sample_time)
    chosen = outermost(machine)[:2] if quick else outermost(machine)
    ratios = COARSE[:1] if quick else COARSE
    scenarios = tuple(Scenario(machine.plant, machine.friction, i) for i in range(len(chosen)))
    task = CommonTask(
        machine.plant,
        scenarios,
        feedback(machine, first, LOOK_COMMON),
        machine.sample_time,
        count,
        wanted.stroke,
        objective,
    )
    built = build_common(task)
    given = compensate(motion_of(machine, begin), machine.friction, sequence(machine, wanted.stroke))
    states = histories(machine, bare(machine), wanted.stroke, given)[chosen]
    found = solve_common(built, list(states), begin.net, wanted.limits, ratios=ratios)
    for _ in range(0 if quick else ROUNDS - 1):
        states = histories(machine, common_controller(machine, found), wanted.stroke)[chosen]
        found = solve_common(built, list(states), found, wanted.limits, ratios=ratios)
    return found


@dataclass(frozen=True)
class Scheme:
    """How a table is led: all that the controller puts out on its own, for what it takes the friction to be.

    known: the friction as the design has it. references: x_T*, u_ff, u_rf over a target for a friction. path: where
    along the target the compensator's elements are led, (n,) [m].
    """

    controller: Controller
    known: Friction
    references: Callable[[Friction, Array], References]
    path: Callable[[Array], Array]


def paper(controller: Controller) -> Scheme:
    """The paper's scheme: the RFM of the controller follows x_T*."""
    assert controller.friction_compensation is not None

    def put_out(friction: Friction, target: Array) -> References:
        return references(replace(controller, friction_compensation=friction), target)

    known = controller.friction_compensation
    return Scheme(controller, known, put_out, lambda target: put_out(known, target).position)


def history_aware(machine: Machine, motion: Shape) -> Scheme:
    """A history-aware trajectory: the machine's elements follow it in the middle of each sample."""
    middle = replace(motion, position=motion.middle)
    return Scheme(
        bare(machine),
        machine.friction,
        lambda friction, target: compensate(motion, friction, target),
        lambda target: compensate(middle, machine.friction, target).position,
    )


def learned(
    machines: Sequence[Machine], nominal: Machine, scheme: Scheme, stroke: float, seed: int
) -> tuple[list[Friction], list[References]]:
    """For each table its friction as the controller learns it at rest in two periods, and what it then puts out.

    It knows the trajectory that it leads the table along and the thrust that holds the table before the next motion;
    nothing else of the table.
    """
    target = sequence(nominal, stroke, periods=2)
    path = scheme.path(target)
    window = round(REST / nominal.sample_time)
    rests = np.array([one.stop - 1 for one in motions(target)])[nominal.specification.motions :]
    frictions = [scheme.known] * len(machines)
    for _ in range(2):
        given = [scheme.references(friction, target) for friction in frictions]
        responses = respond(machines, scheme.controller, target, given=given, seed=seed)
        frictions = [
            learn(scheme.known, path, rests, [np.mean(r.record.command[k - window : k + 1]) for k in rests])
            for r in responses
        ]
    whole = sequence(nominal, stroke)
    return frictions, [scheme.references(friction, whole) for friction in frictions]


def motion_of(machine: Machine, trajectory: Trajectory) -> Shape:
    """What the history-aware compensator needs of a trajectory."""
    return shape(machine.plant, machine.sample_time, trajectory.net, trajectory.task.stroke)


def feedback(machine: Machine, first: int, look: float) -> Feedback:
    """The machine's loop, with the error counted over `look` [s] from sample `first` on."""
    control = machine.control
    last = first + round(look / machine.sample_time)
    return Feedback(machine.sample_time, control.pid, waiting(machine), first, last)


def bare(machine: Machine) -> Controller:
    """The machine's PID, for references that are given."""
    return machine.feedback_only(waiting(machine))


def common_controller(machine: Machine, found: CommonTrajectory) -> Controller:
    """The controller of a trajectory for all histories."""
    return found.controller(machine.sample_time, machine.control.pid, waiting(machine))


def polynomials(motion: Shape) -> Mapping[str, list[float]]:
    """n_ff [m/m] and d_ff [N/m] whose step response is the motion's x_T* and net thrust."""
    return {
        "n_ff": list(np.diff(motion.position, prepend=0.0) / motion.stroke),
        "d_ff": list(np.diff(motion.net, prepend=0.0) / motion.stroke),
    }
