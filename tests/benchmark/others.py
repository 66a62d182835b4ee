"""What one would use instead: an ODE solver of scipy, restarted at every sample, and python-control.

The friction is written as one would for such a solver: every element's displacement z is a state that follows the
motion, z' = v, unless it stands at its limit and moves outwards.
"""

from __future__ import annotations

from collections.abc import Callable

import control
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from models.controller import references
from models.machine import Machine
from models.plant import delay_split, state_space
from models.simulation.kernel import pid_step, quantised
from tests.benchmark.job import Job

Array = NDArray[np.float64]
Derivative = Callable[[Array, float], Array]  # of the state (modes, elements) under a held thrust [N]
Solver = Callable[[Derivative, Array, float, float], Array]  # (derivative, state, thrust, duration) -> state

ABSOLUTE = 1e-6  # absolute tolerance, per relative one: the motion is 20 um


def with_scipy(job: Job, method: str, tolerance: float) -> Array:
    """x (n,) [m] at the samples by solve_ivp at this relative tolerance; undamped elements only."""

    def solve(derivative: Derivative, state: Array, thrust: float, duration: float) -> Array:
        solution = solve_ivp(
            lambda _, y: derivative(y, thrust),
            (0.0, duration),
            state,
            method=method,
            rtol=tolerance,
            atol=ABSOLUTE * tolerance,
        )
        return np.asarray(solution.y[:, -1])

    return _sampled(job, solve)


def with_control(job: Job, tolerance: float) -> Array:
    """x (n,) [m] at the samples by input_output_response, called anew for every sample as its PID is sampled."""
    size = _Dynamics(job.machine).size
    names = [f"y{i}" for i in range(size)]
    dynamics = _Dynamics(job.machine)
    system = control.NonlinearIOSystem(
        lambda _t, y, u, _p: dynamics(np.asarray(y), float(u[0])),
        lambda _t, y, _u, _p: y[:1],
        inputs=["thrust"],
        outputs=["first"],
        states=names,
    )

    def solve(_: Derivative, state: Array, thrust: float, duration: float) -> Array:
        response = control.input_output_response(
            system,
            np.array([0.0, duration]),
            np.full((1, 2), thrust),
            state,
            solve_ivp_kwargs={"rtol": tolerance, "atol": ABSOLUTE * tolerance},
        )
        return np.asarray(response.states[:, -1])

    return _sampled(job, solve)


def with_control_continuous(job: Job, tolerance: float) -> Array:
    """x (n,) [m] at the samples by one call of input_output_response: the whole loop made continuous.

    So it differs from the job: a continuous PID, the dead time and the hold's half sample by a Pade approximation of
    second order, references interpolated linearly between samples, no rounding by the scale.
    """
    machine, controller = job.machine, job.controller
    ts, pid = machine.sample_time, controller.pid
    dynamics = _Dynamics(machine)
    delay = control.ss(control.tf(*control.pade(machine.plant.dead_time + 0.5 * ts, 2)))
    given = references(controller, job.target)
    wait = controller.reference_delay
    waiting = np.concatenate([np.full(wait, given.position[0]), given.position[: given.position.size - wait]])
    inputs = np.vstack([waiting, given.feedforward + given.compensation])
    n, m = dynamics.size, delay.nstates
    a, b, c, d = (np.asarray(matrix, float) for matrix in (delay.A, delay.B, delay.C, delay.D))
    bound = machine.drive.rated_thrust

    def derivative(_time: float, y: Array, u: Array, _parameters: object) -> Array:
        state, under_way, integral, filtered = y[:n], y[n : n + m], y[n + m], y[n + m + 1]
        error = u[0] - dynamics.x @ state[: dynamics.x.size]
        slope = (error - filtered) / pid.derivative_filter
        command = pid.kp * error + integral + pid.kd * slope + u[1]
        thrust = min(max(float((c @ under_way)[0] + d[0, 0] * command), -bound), bound)
        change = [dynamics(state, thrust), a @ under_way + b[:, 0] * command, [pid.ki * error, slope]]
        return np.concatenate(change)

    system = control.NonlinearIOSystem(
        derivative,
        lambda _t, y, _u, _p: np.atleast_1d(dynamics.x @ y[: dynamics.x.size]),
        inputs=["reference", "feedforward"],
        outputs=["position"],
        states=[f"y{i}" for i in range(n + m + 2)],
    )
    response = control.input_output_response(
        system,
        np.arange(job.target.size) * ts,
        inputs,
        np.zeros(n + m + 2),
        solve_ivp_kwargs={"rtol": tolerance, "atol": ABSOLUTE * tolerance},
    )
    return np.asarray(response.outputs, float).ravel()


class _Dynamics:
    """y' of y = (modes' states, z of the elements) under a thrust [N]."""

    def __init__(self, machine: Machine) -> None:
        system, friction = state_space(machine.plant), machine.friction
        if any(friction.damping):
            raise ValueError("the contenders take undamped elements only; give a machine without friction.damping")
        self.a, self.b = np.asarray(system.A, float), np.asarray(system.B, float)[:, 0]
        self.x = np.asarray(system.C, float)[0]
        self.v = self.x @ self.a
        self.stiffness, self.limit = np.array(friction.stiffness), np.array(friction.limit)
        self.size = self.b.size + self.limit.size

    def __call__(self, y: Array, thrust: float) -> Array:
        modes, z = y[: self.b.size], y[self.b.size :]
        velocity = self.v @ modes
        force = self.stiffness @ np.minimum(np.maximum(z, -self.limit), self.limit)
        outwards = z >= self.limit if velocity > 0 else z <= -self.limit
        change = np.empty_like(y)
        change[: self.b.size] = self.a @ modes + self.b * (thrust - force)
        change[self.b.size :] = np.where(outwards, 0.0, velocity)
        return change

    def on_limits(self, y: Array) -> Array:
        """The state with the elements that a step took beyond their limits put back."""
        y[self.b.size :] = np.clip(y[self.b.size :], -self.limit, self.limit)
        return y


def _sampled(job: Job, solve: Solver) -> Array:
    """The closed loop around a solver for the time between two changes of the thrust, from rest without friction."""
    machine, controller, ts = job.machine, job.controller, job.machine.sample_time
    dynamics, given = _Dynamics(machine), references(controller, job.target)
    known = given.feedforward + given.compensation
    pid = controller.pid
    gains = np.array([pid.kp, pid.ki, pid.kd, pid.derivative_filter])
    whole, rest = delay_split(machine.plant.dead_time, ts)
    state, integral, slope, previous = np.zeros(dynamics.size), 0.0, 0.0, 0.0
    position, command = np.empty(job.target.size), np.empty(job.target.size)
    bound = machine.drive.rated_thrust
    for k in range(job.target.size):
        position[k] = dynamics.x @ state[: dynamics.x.size]
        error = given.position[max(k - controller.reference_delay, 0)]
        error -= quantised(position[k], machine.scale.resolution)
        feedback, integral, slope = pid_step(error, previous, integral, slope, gains, ts)
        previous = error
        command[k] = feedback + known[k]
        for sent, duration in ((k - whole - 1, rest), (k - whole, ts - rest)):
            if duration > 0:
                thrust = min(max(float(command[sent]), -bound), bound) if sent >= 0 else 0.0
                state = dynamics.on_limits(solve(dynamics, state, thrust, duration))
    return position
