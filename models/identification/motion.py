"""Prediction-error fit of a motion record: the closed loop is simulated with the controller replayed.

The model of the command is the simulated loop, over the record's reference and feedforward, and an autoregressive
disturbance (Box-Jenkins with C = 1; Ljung, System Identification, 4.2):

    u[k] = u_sim[k; theta] - offset + v[k],    A(q) v[k] = e[k]

What is minimised are the one-step prediction errors e = A(q) (u - u_sim + offset); A is fitted to what is left, twice.
In closed loop the position hides what the model leaves out and the command carries it, so the command is predicted.
theta scales the mass, the friction and its presliding lengths, and shifts the dead time; the friction's displacement at
the start is identified too. n samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from models.controller import Controller, References
from models.friction import Friction
from models.identification.estimate import Estimate
from models.machine import Machine
from models.record import Record
from models.simulator import simulate

Array = NDArray[np.float64]

ORDER: Final = 30  # of A(q)
START: Final = 60  # samples left out at the start, in which the controller's state is unknown
UNSTATED: Final = 0.3  # of a scale's step: the noise of a scale whose file states none
DRAWS: Final = 60  # of the noise, for the covariance
NAMES: Final = ("mass", "friction level", "presliding length", "dead time", "offset")
UNITS: Final = ("1", "1", "1", "s", "N")
STEPS: Final = np.array([2e-3, 5e-3, 1e-2, 1e-5, 2e-7])  # of the numerical derivatives; the last is the start's


@dataclass(frozen=True)
class MotionFit:
    """The estimate (mass, friction level and presliding length relative to the machine given [1], dead time [s], offset
    [N]), the machine with it, and the command [N] as logged and as modelled (n,), its residual and the white e (n,)."""

    estimate: Estimate
    machine: Machine
    command: Array
    modelled: Array
    prediction_error: Array


def identify(record: Record, machine: Machine, *, iterations: int = 6) -> MotionFit:
    """Fits a motion record to the machine that is nominally known, its PID among it; see the module's head.

    Raises ValueError if the record's sample time is another than the machine's, or nothing moves [s].
    """
    if abs(record.sample_time / machine.sample_time - 1) > 1e-3:
        raise ValueError(
            f"the record is sampled at {record.sample_time:g} s and the machine's controller at "
            f"{machine.sample_time:g} s; give records of the controller's own samples"
        )
    if np.ptp(record.reference) == 0:
        raise ValueError("the record's reference does not move: nothing of a motion shows; give the reference's column")
    still = replace(machine, scale=replace(machine.scale, noise=0.0, resolution=0.0))
    theta = np.array([1.0, 1.0, 1.0, machine.plant.dead_time, 0.0])
    filter_ = np.array([1.0, -1.0])
    for iteration in range(iterations):
        left, slopes = _linearised(record, still, theta)
        for _ in range(2):  # A(q) and the step depend on each other
            white = lfilter(filter_, 1.0, np.column_stack([left, slopes]), axis=0)[START + ORDER :]
            step = np.linalg.lstsq(white[:, 1:] / _scale(white), -white[:, 0], rcond=None)[0] / _scale(white)
            filter_ = _autoregression((left + slopes @ step)[START:])
        moved = np.clip(step[:-1], -_largest(record.sample_time), _largest(record.sample_time))
        theta = theta + moved
        if iteration > 1 and np.all(np.abs(moved) < 1e-3 * STEPS):
            break
    left, slopes = _linearised(record, still, theta)
    white = lfilter(filter_, 1.0, np.column_stack([left, slopes]), axis=0)[START + ORDER :]
    scale = _scale(white)
    estimator = -np.linalg.pinv(white[:, 1:] / scale) / scale[:, None]
    offset = float((estimator @ white[:, 0])[-1])
    error = white[:, 0] + white[:, -1] * offset
    covariance = _covariance(record, machine, theta, filter_, estimator, error)
    order = [0, 1, 2, 3, 5]
    estimate = Estimate(NAMES, UNITS, np.append(theta[:4], offset), covariance[np.ix_(order, order)])
    modelled = record.command - left - offset
    return MotionFit(estimate, _changed(machine, theta), record.command, modelled, error)


def _covariance(
    record: Record, machine: Machine, theta: Array, filter_: Array, estimator: Array, error: Array
) -> Array:
    """Covariance (6, 6): the fitted loop simulated with the scale's noise and rounding, through the estimator.

    The noise goes through the friction's memory, which no stationary disturbance model follows. If the record's errors
    e (n,) [N] are larger than these, so is the covariance, by the ratio of their variances.
    """
    scale = machine.scale
    machine = replace(machine, scale=replace(scale, noise=scale.noise or UNSTATED * scale.resolution))
    still = replace(machine, scale=replace(scale, noise=0.0, resolution=0.0))
    clean = _simulated(record, still, theta)
    runs = [_simulated(record, machine, theta, seed) - clean for seed in range(1, DRAWS + 1)]
    white = lfilter(filter_, 1.0, np.column_stack(runs), axis=0)[START + ORDER :]
    draws = estimator @ white
    size = float(np.var(error)) / max(float(np.var(white)), 1e-300)
    return np.asarray(draws @ draws.T / DRAWS * max(1.0, size))


def _scale(white: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(white[:, 1:], axis=0), 1e-300), float)


def _largest(sample_time: float) -> Array:
    """By how much an iteration may move each parameter."""
    return np.array([0.2, 0.3, 0.3, 0.3 * sample_time, 2e-5])


def _changed(machine: Machine, theta: Array) -> Machine:
    """The machine with the first four of theta put in."""
    modes = tuple(replace(mode, gain=mode.gain / theta[0]) for mode in machine.plant.modes)
    plant = replace(machine.plant, modes=modes, dead_time=max(float(theta[3]), 0.0))
    friction = machine.friction
    stiffness = tuple(k * float(theta[1] / theta[2]) for k in friction.stiffness)
    limit = tuple(x * float(theta[2]) for x in friction.limit)
    return replace(machine, plant=plant, friction=Friction(stiffness, limit, friction.damping))


def _linearised(record: Record, machine: Machine, theta: Array) -> tuple[Array, Array]:
    """u - u_sim (n,) [N] and its slopes (n, 6) by theta and by the offset."""
    trials = [theta]
    for i, step in enumerate(STEPS):
        for sign in (1, -1):
            trials.append(theta + sign * step * (np.arange(theta.size) == i))  # noqa: PERF401
    runs = [_simulated(record, machine, trial) for trial in trials]
    slopes = [-(runs[1 + 2 * i] - runs[2 + 2 * i]) / (2 * step) for i, step in enumerate(STEPS)]
    return record.command - runs[0], np.column_stack([*slopes, np.ones(record.command.size)])


def _simulated(record: Record, machine: Machine, theta: Array, seed: int = 0) -> Array:
    """u (n,) [N] of the loop over the record's reference and feedforward, from rest where the record starts."""
    changed = _changed(machine, theta)
    control = machine.control
    controller = Controller(machine.sample_time, control.pid, control.reference_delay, (1.0,), (0.0,))
    origin = record.reference[0]
    given = References(record.reference - origin, record.feedforward, np.zeros(record.feedforward.size))
    limit = np.array(changed.friction.limit)
    start = np.clip(theta[4], -limit, limit)
    run = simulate(
        changed, controller, record.target - origin, given=given, initial_friction=start, substeps=6, seed=seed
    )
    return run.record.command


def _autoregression(signal: Array) -> Array:
    """A(q) (ORDER + 1,) by Yule and Walker's equations."""
    from scipy.linalg import solve_toeplitz  # noqa: PLC0415

    centred = signal - np.mean(signal)
    n = centred.size
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[: ORDER + 1] / n
    correlation[0] *= 1 + 1e-9
    return np.concatenate([[1.0], -solve_toeplitz(correlation[:-1], correlation[1:])])
