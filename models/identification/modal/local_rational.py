"""The power of the noise in a spectrum, whatever the system is, by the local rational method.

Near one line a single record obeys A X = B R + T + A V: V is the noise, R the excitation, T what the record's two ends
leave, and A, B and T are polynomials of degree 2 in the frequency. A takes a sharp mode, whose own ends decay as slowly
as it rings; polynomials alone would count both as noise, at low and at resonant lines by many decades (McKelvey and
Guerin, Non-parametric frequency response estimation using a local rational model, IFAC SYSID 2012; Pintelon and
Schoukens, System Identification, 2012, 7.2). X is multiplied by (z - 1)^2 beforehand, so that the rigid body and its
ends, which are a ramp, are polynomials, too. Linear least squares with A as a weight, repeated (Sanathanan and Koerner,
1963).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]

LOCAL: Final = 10  # lines on each side
DEGREE: Final = 2  # of the polynomials
PASSES: Final = 3
# Of A at a line over that in the middle: a zero of A on a line must not hide its error.
MIN_DENOMINATOR_RATIO: Final = 1e-3
OCTAVES: Final = 2.0  # to either side, as far as what repeats with an excitation may act alike as a thrust
MIN_DISTURBANCE_NOISE_RATIO: Final = 3.0  # times the noise's power, from which on they show more than noise
SHOW: Final = 5  # lines that are not excited, which show it at least
AT_A_TIME: Final = 4096  # lines, to bound the memory


def noise_under_sweep(position: Complex, command: Complex, swept: Complex, z: Complex, lines: Indices) -> Array:
    """Power [m2] of the noise of X (n,) [m] at some of the lines (k,), over which an excitation R (n,) sweeps.

    command: U (n,) [the unit of R], which holds R and what feedback makes of the noise; so B is sought under R, which
    is free of noise, of what X is beyond the plant of the middle line times U. z (n,): exp(2 pi j f T_s) of each line.
    """
    offsets = np.arange(-LOCAL, LOCAL + 1)

    def part(some: Indices) -> Array:
        near = np.clip(some, LOCAL + 1, position.size - LOCAL - 1)[:, None] + offsets  # without that of 0 Hz
        given = swept[near] / np.sqrt(np.mean(np.abs(swept[near]) ** 2, axis=1, keepdims=True))
        rest = _beyond(position, command, z, some, near)
        return _power(rest, given, z[near], (near - some[:, None]) / LOCAL)[0]

    return _in_parts(part, lines)


def noise_between_lines(position: Complex, command: Complex, z: Complex, lines: Indices, periods: int) -> Array:
    """Power [m2] of the noise of X (n,) [m] at the excited `lines` (k,) of a record of so many whole periods.

    A periodic excitation leaves the lines between its own, those that are not multiples of `periods`, to the noise and
    to what the ends leave. What feedback makes of the noise there, U, acts through the plant of the excited line.
    """
    free = np.flatnonzero(np.arange(position.size) % periods)

    def part(some: Indices) -> Array:
        middle = np.clip(np.searchsorted(free, some), LOCAL, free.size - LOCAL)
        near = free[middle[:, None] + np.arange(-LOCAL, LOCAL)]
        rest = _beyond(position, command, z, some, near)
        away = np.abs(near - some[:, None]).max(axis=1, keepdims=True)
        return _power(rest, None, z[near], (near - some[:, None]) / away)[0]

    return _in_parts(part, lines)


def distortion_between_lines(position: Complex, command: Complex, z: Complex, lines: Indices, periods: int) -> Array:
    """Power [m2] of what repeats with a periodic excitation without being the plant's answer, at its `lines` (k,).

    Friction that the shaking bends, or a ripple that the axis rolls over as often in each period, stands in the
    multiples of `periods` that are not excited, too; there the nearest ones show it, as a thrust that moves a rigid
    body (Pintelon and Schoukens, System Identification, 2012, 4.3: detection lines). 0 where fewer than SHOW of
    those are within OCTAVES, or where they are as quiet as the lines between.
    """
    quiet = np.setdiff1d(np.arange(periods, lines[-1] + LOCAL * periods, periods), lines)
    quiet = quiet[quiet < position.size - LOCAL * periods]
    if quiet.size < SHOW:
        return np.zeros(lines.size)
    free = np.flatnonzero(np.arange(position.size) % periods)
    nearest = lines[np.abs(np.log(quiet[:, None] / lines)).argmin(axis=1)]

    def thrust(some: Indices) -> Array:
        """Of some quiet lines the power of (z - 1)^2 X [m2] beside what the ends leave, and over that of the noise."""
        middle = np.clip(np.searchsorted(free, quiet[some]), LOCAL, free.size - LOCAL)
        near = free[middle[:, None] + np.arange(-LOCAL, LOCAL)]
        away = np.abs(near - quiet[some, None]).max(axis=1, keepdims=True)
        rest = _beyond(position, command, z, nearest[some], near)
        noise, ends = _power(rest, None, z[near], (near - quiet[some, None]) / away)
        shaped = (z[quiet[some]] - 1) ** 2
        own = np.abs(_beyond(position, command, z, nearest[some], quiet[some, None])[:, 0] * shaped - ends) ** 2
        return np.stack([own, own / (noise * np.abs(shaped) ** 2)], axis=1)

    power, over = _in_parts(thrust, np.arange(quiet.size)).T
    found = np.zeros(lines.size)
    for i, line in enumerate(lines):
        beside = np.argsort(np.abs(quiet - line), kind="stable")[: 2 * LOCAL]
        beside = beside[np.abs(np.log2(quiet[beside] / line)) < OCTAVES]
        if beside.size >= SHOW and np.median(over[beside]) > MIN_DISTURBANCE_NOISE_RATIO * math.log(2):
            found[i] = np.median(power[beside]) / math.log(2) / np.abs(z[line] - 1) ** 4
    return found


def _beyond(position: Complex, command: Complex, z: Complex, lines: Indices, near: Indices) -> Complex:
    """X less the plant of each line, as a rigid body's, times U at the lines near it (k, w) [m]."""
    plant = position[lines] / command[lines] * (z[lines] - 1) ** 2
    return np.asarray(position[near] - plant[:, None] / (z[near] - 1) ** 2 * command[near])


def _in_parts(part: Callable[[Indices], Array], lines: Indices) -> Array:
    return np.concatenate([part(lines[i : i + AT_A_TIME]) for i in range(0, lines.size, AT_A_TIME)])


def _power(rest: Complex, given: Complex | None, z: Complex, offset: Array) -> tuple[Array, Complex]:
    """Power (k,) of what A X = B R + T leaves of X (k, w) around each of k lines, by the degrees of freedom left, and
    (z - 1)^2 T / A (k,) on each line itself."""
    shaped = (z - 1) ** 2
    size = 1 / np.abs(shaped)
    target = rest * shaped
    level = np.sqrt(np.mean(np.abs(target) ** 2, axis=1, keepdims=True))
    target = target / np.maximum(level, 1e-300)
    powers = offset[:, :, None] ** np.arange(DEGREE + 1)
    columns = [powers.astype(complex), -target[:, :, None] * powers[:, :, 1:]]
    if given is not None:
        columns.append(given[:, :, None] * powers)
    whole = np.concatenate(columns, axis=2)
    first, last = DEGREE + 1, 2 * DEGREE + 1  # where A's coefficients stand
    weight, left, ends = size, target, target[:, 0]
    for _ in range(PASSES):
        q, triangle = np.linalg.qr(whole * weight[:, :, None])
        share = q.conj().swapaxes(1, 2) @ (target * weight)[:, :, None]
        left = target * weight - (q @ share)[:, :, 0]
        solved = np.linalg.solve(triangle, share)[:, :, 0]
        ends = solved[:, 0]
        poles = np.abs(1 + (powers[:, :, 1:] @ solved[:, first:last, None])[:, :, 0])
        noise = left * (size / weight) / np.maximum(poles, MIN_DENOMINATOR_RATIO)
        weight = size / np.maximum(poles, MIN_DENOMINATOR_RATIO)
    free = offset.shape[1] - whole.shape[2]
    return np.asarray(np.sum(np.abs(noise) ** 2, axis=1) / free * level[:, 0] ** 2), ends * level[:, 0]
