"""What the loop does with one motion when table or history are not those of the design: copies of the smoothed loop.

A scenario is a table that the motion may meet. Its loop is lifted (lifted.py) and its friction follows its own path,
so that both the feedback and the friction's reaction to an error act within the motion. Symbols: n samples of the copy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.trajectory.lifted import lift
from design.trajectory.nlp import Program
from models.controller import PID
from models.friction import Friction
from models.plant import Plant, delay_split, state_space, transition
from models.smooth_friction import law
from models.variation import Variation, at_mode, varied_friction, varied_plant

Array = NDArray[np.float64]

SPEED_SAMPLES: Final = 10  # samples. A speed is measured in strokes per so many, which only scales the program.


@dataclass(frozen=True)
class Scenario:
    """A table: `plant` with `friction`, met at history number `history`; `weight` [1] in a mean over scenarios."""

    plant: Plant
    friction: Friction
    history: int
    weight: float = 1.0


@dataclass(frozen=True)
class Feedback:
    """The loop's sample time [s], PID and its reference's wait [samples]; samples [first, last) whose error counts."""

    sample_time: float
    pid: PID
    reference_delay: int
    first: int
    last: int


@dataclass(frozen=True)
class Errors:
    """Relative errors [1], one standard deviation each, of friction force, presliding length, mass and frequencies."""

    force: float
    length: float
    mass: float
    frequency: float


def tables(plant: Plant, friction: Friction, errors: Errors) -> tuple[tuple[Plant, Friction, float], ...]:
    """(plant, friction, weight): each error [1] at plus and minus its standard deviation, one at a time.

    The weights sum the mean squares of independent errors.
    """
    found: list[tuple[Plant, Friction, float]] = []
    for sign in (-1, 1):
        if errors.force:
            found.append((plant, varied_friction(friction, Variation(friction_force=sign * errors.force)), 0.5))
        if errors.length:
            found.append((plant, varied_friction(friction, Variation(friction_length=sign * errors.length)), 0.5))
        if errors.mass:
            found.append((varied_plant(plant, Variation(mass=sign * errors.mass)), friction, 0.5))
        if errors.frequency:
            wrong = [Variation(frequency=at_mode(plant, i, sign * errors.frequency)) for i in plant.flexible]
            found += [(varied_plant(plant, one), friction, 0.5) for one in wrong]
    return tuple(found)


def follow_loop(
    program: Program,
    name: str,
    scenario: Scenario,
    feedback: Feedback,
    stroke: float,
    thrust: ca.MX,
    reference: ca.MX,
    ratio: ca.MX,
) -> tuple[Any, Any]:
    """(error (last - first,) [m], command (n,) [N]) of the scenario's loop under u_ff (n,) [N] and x_T* (n,) [m].

    Adds the loop's variables to `program` and a parameter z_`name`: its elements' state at the start. What `respond`
    knows as whole matrices stands here sample by sample: more variables, but each touches its neighbours only, which
    halves the time of a solve.
    """
    n, loop = feedback.last, _sampled(scenario.plant, feedback)
    stiffness, limit = np.array(scenario.friction.stiffness), np.array(scenario.friction.limit)
    unit, modes = float(stiffness @ limit), loop.phi.shape[0]
    start = program.parameter(f"start_{name}", limit.size)
    units = np.tile([stroke, stroke / (SPEED_SAMPLES * feedback.sample_time)], modes // 2)
    state = ca.reshape(program.variable(f"state_of_{name}", np.tile(units, n)), modes, n)  # at each interval's end
    position = program.variable(f"position_of_{name}", np.full(n, stroke))  # from sample 1 on
    pid = program.variable(f"pid_of_{name}", np.full(n, unit))
    middle = program.variable(f"middle_of_{name}", np.full(n, stroke))
    force = program.variable(f"force_of_{name}", np.full(n, unit))  # from the start's on
    z = ca.reshape(program.variable(f"z_of_{name}", np.tile(limit, n)), limit.size, n)
    command, before = thrust + pid, ca.horzcat(ca.MX(modes, 1), state[:, :-1])
    net = (command - force).T
    program.subject_to(ca.vec(state - loop.phi @ before - loop.gamma @ net), 0, 0, np.tile(units, n))
    program.subject_to(middle - (loop.predict @ before).T, 0, 0, stroke)
    sampled = (loop.output @ before + loop.through * net).T
    program.subject_to(position - _later(sampled, loop.whole), 0, 0, stroke)
    waiting = ca.vertcat(ca.repmat(reference[0], feedback.reference_delay, 1), reference)[:n]
    error = waiting - _later(position, 1)
    acting = sum(float(c) * _later(error, k) for k, c in enumerate(loop.zeros))
    program.subject_to(sum(float(c) * _later(pid, k) for k, c in enumerate(loop.poles)) - acting, 0, 0, unit)
    moved = ca.diff(ca.vertcat(0, middle)).T
    constants = (ca.repmat(one, 1, n) for one in (ratio, stiffness, limit))
    after, pull = law(limit.size).map(n)(ca.horzcat(start, z[:, :-1]), moved, *constants)
    program.subject_to(ca.vec(z - after), 0, 0, np.tile(limit, n))
    program.subject_to(force - (pull.T - ca.dot(stiffness, start)), 0, 0, unit)
    return position[_counted(feedback)] - stroke, command + ca.dot(stiffness, start)


def guess_loop(
    name: str, scenario: Scenario, feedback: Feedback, start: Array, thrust: Array, reference: Array
) -> dict[str, Array]:
    """Values of the copy's variables (SI) on the exact elements' path; see `respond`."""
    n, loop = feedback.last, _sampled(scenario.plant, feedback)
    found = respond(scenario, feedback, start, thrust, reference)
    lifted = lift(scenario.plant, feedback.sample_time, n, feedback.pid, feedback.reference_delay)
    command = lifted.command @ np.concatenate([thrust, reference, found.force])
    modes = np.zeros((n + 1, loop.phi.shape[0]))
    for k in range(n):
        modes[k + 1] = loop.phi @ modes[k] + loop.gamma[:, 0] * (command[k] - found.force[k])
    return {
        f"state_of_{name}": modes[1:].ravel(),
        f"position_of_{name}": found.position[1:],
        f"pid_of_{name}": command - thrust,
        f"middle_of_{name}": found.middle,
        f"force_of_{name}": found.force,
        f"z_of_{name}": found.states.ravel(),
    }


def error_of(values: Mapping[str, Array], name: str, feedback: Feedback, stroke: float) -> Array:
    """The copy's error (last - first,) [m] of values (SI) of the program, for a motion over `stroke` [m]."""
    return np.asarray(values[f"position_of_{name}"][_counted(feedback)] - stroke, float)


@dataclass(frozen=True)
class _Sampled:
    """The loop sample by sample. Over an interval of the thrust: state+ = phi state + gamma net; predict: the position
    half-way; output, through: at the sample that falls into it, `whole` samples later than the thrust was put out.

    PID: poles(z^-1) u_fb = zeros(z^-1) e.
    """

    phi: Array
    gamma: Array
    predict: Array
    output: Array
    through: float
    whole: int
    poles: Array
    zeros: Array


def _sampled(plant: Plant, feedback: Feedback) -> _Sampled:
    ts, pid, continuous = feedback.sample_time, feedback.pid, state_space(plant)
    whole, rest = delay_split(plant.dead_time, ts)
    phi, gamma = transition(continuous.A, continuous.B, ts)
    phi_part, gamma_part = transition(continuous.A, continuous.B, ts - rest)
    output = np.asarray(continuous.C)
    keep = pid.pole(ts)
    zeros = pid.kp * np.array([1.0, -1.0 - keep, keep]) + pid.ki * ts * np.array([1.0, -keep, 0.0])
    return _Sampled(
        phi=phi,
        gamma=gamma,
        predict=output @ (np.eye(continuous.nstates) + 0.5 * ts * np.asarray(continuous.A)),
        output=output @ phi_part,
        through=(output @ gamma_part).item(),
        whole=whole,
        poles=np.array([1.0, -1.0 - keep, keep]),
        zeros=zeros + pid.kd * (1 - keep) / ts * np.array([1.0, -2.0, 1.0]),
    )


def _later(signal: Any, samples: int) -> Any:
    """The signal, so many samples later; zero before it begins."""
    return ca.vertcat(ca.MX(samples, 1), signal[: signal.shape[0] - samples])


def _counted(feedback: Feedback) -> slice:
    """Where in a signal from sample 1 on the error counts."""
    return slice(feedback.first - 1, feedback.last - 1)


@dataclass(frozen=True)
class LoopResponse:
    """A loop's position (n + 1,) [m] at the samples and middle (n,) [m] half-way through each interval of the thrust.

    force (n,) [N]: the friction less that at the start; states (n, N) [m]: of its elements, at the middles.
    """

    middle: Array
    force: Array
    states: Array
    position: Array


def respond(
    scenario: Scenario, feedback: Feedback, start: Array, thrust: Array, reference: Array, ratio: float = 0.0
) -> LoopResponse:
    """The loop's response to u_ff (n,) [N] and x_T* (n,) [m] from element states `start` (N,) [m].

    ratio [1]: smoothing width over each limit; 0 is the exact law.
    """
    n = feedback.last
    lifted = lift(scenario.plant, feedback.sample_time, n, feedback.pid, feedback.reference_delay)
    stiffness, limit = np.array(scenario.friction.stiffness), np.array(scenario.friction.limit)
    element = law(limit.size)
    known = lifted.on_thrust(lifted.middle) @ thrust + lifted.on_reference(lifted.middle) @ reference
    reaction = lifted.on_friction(lifted.middle)
    middle, force, states, state = np.zeros(n), np.zeros(n), np.zeros((n, limit.size)), start
    for k in range(n):
        middle[k] = known[k] + reaction[k, :k] @ force[:k]
        moved = middle[k] - (middle[k - 1] if k else 0.0)
        if ratio > 0:
            state = np.asarray(element(state, moved, ratio, stiffness, limit)[0]).ravel()
        else:
            state = np.clip(state + moved, -limit, limit)
        states[k], force[k] = state, stiffness @ (state - start)
    position = lifted.position @ np.concatenate([thrust, reference, force])
    return LoopResponse(middle, force, states, position)
