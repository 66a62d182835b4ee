"""The response that is fitted: modes behind a dead time and a current loop of first order, slowed by viscous drag and
held by a spring to ground.

    P(s) = exp(-L s) / (1 + tau s) * P'(s) / (1 + (c s + k) P'(s)),
    P'(s) = K_t sum_i k_i / (s^2 + 2 zeta_i w_i s + w_i^2)

Drag acts on the table's speed and the spring on its position at the thrust's input, as friction does. In partial
fractions, with one pole at 0 taken out, P(s) exp(L s) = sum_j r_j / (s (s - p_j)): without a spring that pole is one of
the rigid body's, with one the sum of r_j / p_j cancels it. That has a closed form behind a zero-order hold too, also
for a dead time that ends within a sample; no matrix exponential, so it is independent of models.plant.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.plant import Plant, delay_split

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SERIES: Final = 1e-2  # |p h| below which (exp(p h) - 1 - p h) / p^2 is summed as a series


def response(
    plant: Plant, frequency: Array, sample_time: float, *, lag: float = 0.0, drag: float = 0.0, spring: float = 0.0
) -> Complex:
    """P (n,) [m/N] at frequencies (n,) [Hz]: behind a zero-order hold at the samples, or continuous for sample_time 0.

    lag: tau [s]; drag: c [N s/m]; spring: k [N/m].
    """
    return expanded(*expansion(plant, lag, drag, spring), frequency, plant.dead_time, sample_time)


def expanded(pole: Complex, weight: Complex, frequency: Array, dead_time: float, sample_time: float) -> Complex:
    """P (n,) [m/N] at frequencies (n,) [Hz] of an `expansion` (J,), as of `response`: the sum of what `units` are,
    times their weights, with all that does not depend on both pole and frequency taken out of it."""
    given, late = (pole[None], weight[None]), np.array([dead_time])
    if sample_time == 0:
        return np.asarray(continuous(*given, frequency, late)[0])
    return np.asarray(sampled(*given, np.exp(-2j * math.pi * frequency * sample_time), late, sample_time)[0])


def continuous(pole: Complex, weight: Complex, frequency: Array, dead_time: Array) -> Complex:
    """P (P, n) [m/N] of P expansions (P, J) behind dead times (P,) [s], without a hold, at frequencies (n,) [Hz]."""
    s = 2j * math.pi * frequency
    total = np.sum(weight[..., None] / (s - pole[..., None]), axis=1)
    return np.asarray(np.exp(-s * dead_time[:, None]) / s * total)


def sampled(pole: Complex, weight: Complex, back: Complex, dead_time: Array, sample_time: float) -> Complex:
    """P (P, n) [m/N] of P expansions (P, J) behind dead times (P,) [s] and the hold, at values b (n,) [1] of
    exp(-s h)."""
    split = [delay_split(float(one), sample_time) for one in dead_time]
    held = _hold(pole, np.array([[rest] for _, rest in split]), sample_time)
    moving = weight * held.gain
    speed = fractions(moving * held.sooner, moving * held.later, -held.decay, np.zeros_like(pole), back)
    still, still_before = (np.sum(weight * one, axis=1)[:, None] for one in (held.still, held.still_before))
    late, index = np.unique([whole + 1 for whole, _ in split], return_inverse=True)
    front = np.stack([back**one / (1 - back) for one in late.tolist()])
    return np.asarray(front[index] * (still + (still_before + speed) * back))


def fractions(now: Complex, before: Complex, first: Complex, second: Complex, back: Complex) -> Complex:
    """sum_j (now_j + before_j b) / (1 + first_j b + second_j b^2) (P, n) at values b (n,) of exp(-s h), for P rows of
    numerators and denominators (P, J); [1] all, but for the unit of the numerators."""
    total = np.empty((len(now), back.size), complex)
    _fractions(now, before, first, second, back, total)
    return total


@compiled
def _fractions(now: Complex, before: Complex, first: Complex, second: Complex, back: Complex, total: Complex) -> None:
    for row in range(now.shape[0]):
        for k in range(back.size):
            re, im = back[k].real, back[k].imag
            square_re, square_im = re * re - im * im, 2.0 * re * im
            sum_re = sum_im = 0.0
            for j in range(now.shape[1]):
                a, b, c, d = now[row, j], before[row, j], first[row, j], second[row, j]
                above_re = a.real + b.real * re - b.imag * im
                above_im = a.imag + b.real * im + b.imag * re
                below_re = 1.0 + c.real * re - c.imag * im + d.real * square_re - d.imag * square_im
                below_im = c.real * im + c.imag * re + d.real * square_im + d.imag * square_re
                size = 1.0 / (below_re * below_re + below_im * below_im)
                sum_re += (above_re * below_re + above_im * below_im) * size
                sum_im += (above_im * below_re - above_re * below_im) * size
            total[row, k] = complex(sum_re, sum_im)


class Parts(NamedTuple):
    """P plants of one structure: rigid bodies (P,) [1/kg]; modes (P, m): gains [1/kg], w [rad/s], damping ratios [1];
    tau (P,) [s], c (P,) [N s/m] and k (P,) [N/m], each 0 in all of them or in none."""

    rigid: Array
    gain: Array
    w: Array
    zeta: Array
    lag: Array
    drag: Array
    spring: Array


def expansion(plant: Plant, lag: float = 0.0, drag: float = 0.0, spring: float = 0.0) -> tuple[Complex, Complex]:
    """(p_j, r_j) (J,) [1/s, 1/(kg)] of the module's head; without drag and spring in closed form."""
    constant = plant.thrust_constant
    rigid = constant * sum(mode.gain for mode in plant.modes if mode.frequency == 0)
    modes = [(constant * m.gain, 2 * math.pi * m.frequency, m.damping) for m in plant.modes if m.frequency > 0]
    each = np.array(modes).reshape(-1, 3).T[:, None]
    pole, weight = expansions(Parts(np.array([rigid]), *each, *(np.array([one]) for one in (lag, drag, spring))))
    return pole[0], weight[0]


def expansions(parts: Parts) -> tuple[Complex, Complex]:
    """`expansion` of each of P plants, (P, J) both."""
    gain, w, zeta, lag = parts.gain, parts.w, parts.zeta, parts.lag[:, None]
    if np.any(parts.drag) or np.any(parts.spring):
        pole, weight = _held_back(parts)
    else:
        upper = w * (-zeta + 1j * np.sqrt(np.maximum(1 - zeta**2, 1e-12)))
        half = gain * upper / (upper - upper.conj())  # of s P', which is k s / ((s - p)(s - conj p))
        none = np.zeros((len(w), 1), complex)
        pole = np.hstack([none, upper, upper.conj()])
        weight = np.hstack([parts.rigid[:, None] + none, half, half.conj()])
    if not np.any(lag):
        return pole, weight
    slow = np.sum(weight / (-1 / lag - pole), axis=1, keepdims=True) / lag
    return np.hstack([pole, -1 / lag]), np.hstack([weight / (1 + lag * pole), slow])


def _held_back(parts: Parts) -> tuple[Complex, Complex]:
    """The expansions of s P' / (1 + (c s + k) P'), from the eigenvalues of v_0' = k_0 u, y_i' = w_i v_i,
    v_i' = -2 zeta_i w_i v_i - w_i y_i + k_i u with u = -c sum v - k (y_0 + sum y_i / w_i). The rigid body's position,
    y_0' = w_0 v_0 in units of w_0 = sqrt(k k_0), is a state with a spring alone: without one it makes the matrix
    defective."""
    rows, count = parts.gain.shape
    sprung = int(np.any(parts.spring))
    size = 1 + 2 * count + sprung
    a, b, c, x = np.zeros((rows, size, size)), np.zeros((rows, size)), np.zeros(size), np.zeros((rows, size))
    b[:, 0], c[0] = parts.rigid, 1.0
    y, v = 1 + 2 * np.arange(count), 2 + 2 * np.arange(count)
    a[:, y, v], a[:, v, y], a[:, v, v] = parts.w, -parts.w, -2 * parts.zeta * parts.w
    b[:, v], c[v], x[:, y] = parts.gain, 1.0, 1 / parts.w
    if sprung:
        own = np.sqrt(parts.spring * parts.rigid)
        a[:, -1, 0], x[:, -1] = own, 1 / own
    back = parts.drag[:, None] * c + parts.spring[:, None] * x
    pole, vectors = np.linalg.eig(a - b[:, :, None] * back[:, None, :])
    weight = (c @ vectors) * np.linalg.solve(vectors, b.astype(complex)[..., None])[..., 0]
    return pole.astype(complex), np.asarray(weight, complex)


def units(pole: Complex, frequency: Array, dead_time: float, sample_time: float) -> Complex:
    """exp(-L s) / (s (s - p_j)) (J, n) [s2] at frequencies (n,) [Hz]: behind the hold, or continuous for time 0."""
    s, p = 2j * math.pi * frequency, pole[:, None]
    if sample_time == 0:
        return np.asarray(np.exp(-s * dead_time) / (s * (s - p)))
    whole, rest = delay_split(dead_time, sample_time)
    held = _hold(p, np.array([[rest]]), sample_time)
    back = np.exp(-s * sample_time)
    speed = (held.sooner + held.later * back) * back / (1 - held.decay * back)
    place = held.gain * speed + held.still + held.still_before * back
    return np.asarray(np.exp(-s * (whole * sample_time)) * back / (1 - back) * place)


class _Hold(NamedTuple):
    """How a pole's speed and place follow a held input behind the rest of a dead time: in the sample interval itself
    the place `still` [s2], in the one after it `still_before` [s2] more; the speed `sooner` and `later` [s], which
    falls by `decay` [1] a sample and moves the place by `gain` [s] of it."""

    still: Complex
    still_before: Complex
    sooner: Complex
    later: Complex
    decay: Complex
    gain: Complex


def _hold(pole: Complex, rest: Array, sample_time: float) -> _Hold:
    """Of poles (P, J) [1/s] and rests (P, 1) of dead times [s], or (J, 1) and (1, 1)."""
    speed, place = _held(pole, np.stack([rest, sample_time - rest, np.full_like(rest, sample_time)]))
    later = (1 + pole * speed[1]) * speed[0]
    still_before = place[0] + speed[1] * speed[0]
    return _Hold(place[1], still_before, speed[1], later, 1 + pole * speed[2], speed[2])


def _held(pole: Complex, duration: Array) -> tuple[Complex, Complex]:
    """What a unit input held for durations (3, P, 1) [s] makes of w' = p w + u and of its integral, from rest
    (3, P, J) [s], [s2]."""
    x = pole * duration
    small = np.abs(x) < SERIES
    safe = np.where(small, 1.0, x)
    first = np.expm1(safe) / safe
    second = (first - 1) / safe
    if small.any():
        first = np.where(small, 1 + x / 2 * (1 + x / 3 * (1 + x / 4 * (1 + x / 5 * (1 + x / 6)))), first)
        second = np.where(small, 0.5 + x / 6 * (1 + x / 4 * (1 + x / 5 * (1 + x / 6 * (1 + x / 7)))), second)
    return np.asarray(duration * first, complex), np.asarray(duration**2 * second, complex)
