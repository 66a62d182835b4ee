"""Published PI and PID optima, confirmed by a dense search in continuous time, and found again by the sampled program.

The search shares nothing with the program: P(j omega) as it is printed, every gain on a grid, the integral gain in
closed form. It is what the quoted figures stand on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import control
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from design.family import Member
from design.pid.goal import Goal
from design.pid.problem import Bounds
from design.pid.tuning import pose, tune
from models.controller import PID
from studies.pid_tradeoff.published import PUBLISHED, Optimum, find_again

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Circle = tuple[float, float]  # L keeps `radius` away from `centre`, on the negative real axis
ONE = Polynomial([1, 1])  # s + 1
PLANTS = {  # numerator and denominator in s, as they are printed
    "1/(s+1)³": (Polynomial([1]), ONE**3),
    "1/((s+1)(0.2s+1)(0.04s+1)(0.008s+1))": (
        Polynomial([1]),
        ONE * Polynomial([1, 0.2]) * Polynomial([1, 0.04]) * Polynomial([1, 0.008]),
    ),
    "(1−2s)/(s+1)³": (Polynomial([1, -2]), ONE**3),
    "1/(s+1)⁴": (Polynomial([1]), ONE**4),
    "1/((s+1)(0.1s+1)(0.01s+1)(0.001s+1))": (
        Polynomial([1]),
        ONE * Polynomial([1, 0.1]) * Polynomial([1, 0.01]) * Polynomial([1, 0.001]),
    ),
}
OMEGA = np.geomspace(0.05, 2000, 12001)
TOUCH = 1e-4  # of the radius: nearer to the circle counts as touching it


def circles(optimum: Optimum) -> tuple[Circle, ...]:
    m = optimum.bound
    if optimum.circle == "Ms":
        return ((-1.0, 1 / m),)
    # Through the leftmost point of the circle of |T| = m and the rightmost of that of |S| = m.
    left, right = -m / (m - 1), -(m - 1) / m
    return (((left + right) / 2, (right - left) / 2),)


def response(name: str) -> Complex:
    numerator, denominator = PLANTS[name]
    return np.asarray(numerator(1j * OMEGA) / denominator(1j * OMEGA))


def stable(name: str, kp: float, ki: float, kd: float) -> bool:
    numerator, denominator = PLANTS[name]
    loop = Polynomial([0, 1]) * denominator + numerator * Polynomial([ki, kp, kd])
    return bool(np.max(loop.roots().real) < 0)


@dataclass(frozen=True)
class Entries:
    """Where ki enters and leaves a circle at every frequency of OMEGA, for one kd and any kp: the roots of
    a ki^2 + 2 half(kp) ki + c(kp), whose coefficients (n,) of powers of kp are ascending."""

    a: Array
    half: tuple[Array, Array]
    c: tuple[Array, Array, Array]

    def intervals(self, kp: float) -> Array:
        """Of ki, lower and upper ends (k, 2), as far as they reach above 0."""
        half, c = self.half[0] + kp * self.half[1], self.c[0] + kp * (self.c[1] + kp * self.c[2])
        inside = half**2 > self.a * c
        a, half, c = self.a[inside], half[inside], c[inside]
        root = np.sqrt(half**2 - a * c)
        # The lower root without cancellation where it is positive.
        upper = (root - half) / a
        lower = np.where(half < 0, c / (root - half), -(root + half) / a)
        return np.asarray(np.column_stack([lower, upper])[upper > 0])


def entries(p: Complex, kd: float, circle: Circle) -> Entries:
    s, (centre, radius) = 1j * OMEGA, circle
    base, step = kd * s * p - centre, p / s
    return Entries(
        np.abs(step) ** 2,
        (np.real(base * np.conj(step)), np.real(p * np.conj(step))),
        (np.abs(base) ** 2 - radius**2, 2 * np.real(base * np.conj(p)), np.abs(p) ** 2),
    )


def largest_ki(name: str, kp: float, kd: float, kept: Sequence[Entries]) -> float:
    """The largest ki with which the loop is stable and L in no circle; 0 if there is none.

    At every frequency ki enters a circle at one root of a quadratic and leaves it at the other; what remains between
    these intervals are gaps, of which the highest stable one counts.
    """
    edges = np.concatenate([one.intervals(kp) for one in kept])
    edges = edges[np.argsort(edges[:, 0])]
    reached = np.concatenate([[0.0], np.maximum.accumulate(edges[:, 1])[:-1]])
    for top in edges[edges[:, 0] > np.maximum(reached, 0.0), 0][::-1]:
        if stable(name, kp, float(top), kd):
            return float(top)
    return 0.0


def best(name: str, kd: float, kept: tuple[Circle, ...], highest: float) -> tuple[float, float]:
    """(kp, ki) of the largest ki on grids of kp from nearly 0 on, each ten times finer than the one before."""
    p = response(name)
    shut = [entries(p, kd, circle) for circle in kept]
    low, high = 1e-3 * highest, highest
    for _ in range(4):
        gains = np.linspace(low, high, 61)
        values = [largest_ki(name, float(kp), kd, shut) for kp in gains]
        top, width = int(np.argmax(values)), 3 * (high - low) / 60
        low, high = max(gains[top] - width, 1e-3 * highest), gains[top] + width
    return float(gains[top]), float(values[top])


def touches(name: str, pid: tuple[float, float, float], kept: tuple[Circle, ...]) -> int:
    """How often L touches the circle, at minima of its distance."""
    s, ((centre, radius),) = 1j * OMEGA, kept
    distance = np.abs((pid[0] + pid[1] / s + pid[2] * s) * response(name) - centre) / radius - 1
    minima = (distance[1:-1] < distance[:-2]) & (distance[1:-1] < distance[2:]) & (distance[1:-1] < TOUCH)
    return int(np.sum(minima))


def searched(optimum: Optimum) -> tuple[float, float, float]:
    """(kp, ki, kd) of the dense search; kd the first, in steps of 0.4 %, at which L touches a second time."""
    kept = circles(optimum)
    kd = 0.94 * optimum.kp * optimum.derivative_time
    while True:
        kp, ki = best(optimum.name, kd, kept, 4 * optimum.kp)
        if optimum.derivative_time == 0 or touches(optimum.name, (kp, ki, kd), kept) > 1:
            return kp, ki, kd
        kd *= 1.004


def label(optimum: Optimum) -> str:
    kind = "PID" if optimum.derivative_time else "PI"
    return f"{kind} {optimum.name} {optimum.circle}={optimum.bound:g}"


@pytest.mark.parametrize("optimum", PUBLISHED, ids=label)
def test_a_dense_search_finds_what_is_quoted(optimum: Optimum) -> None:
    kp, ki, kd = searched(optimum)
    assert kp == pytest.approx(optimum.kp, rel=0.01)
    assert kp / ki == pytest.approx(optimum.integral_time, rel=0.01)
    assert kd / kp == pytest.approx(optimum.derivative_time, rel=0.01)


def test_the_search_would_not_confirm_other_figures() -> None:
    """A bound that is 3 % off is seen in both gains."""
    kp, ki, _ = searched(replace(PUBLISHED[0], bound=1.03 * PUBLISHED[0].bound))
    assert kp > 1.03 * PUBLISHED[0].kp
    assert ki > 1.03 * PUBLISHED[0].kp / PUBLISHED[0].integral_time


@pytest.mark.parametrize("optimum", PUBLISHED, ids=label)
def test_the_program_finds_the_published_optimum_again(optimum: Optimum) -> None:
    found = find_again(optimum)
    assert found.kp == pytest.approx(optimum.kp, rel=0.01)
    assert found.kp / found.ki == pytest.approx(optimum.integral_time, rel=0.01)
    assert found.kd / found.kp == pytest.approx(optimum.derivative_time, rel=0.01)


@pytest.mark.parametrize("optimum", [PUBLISHED[0], PUBLISHED[1], PUBLISHED[5]], ids=label)
def test_the_distance_to_the_optimum_shrinks_with_the_sample_time(optimum: Optimum) -> None:
    """At first order: a quarter of the sample time leaves a quarter of what changes."""
    gains = [find_again(optimum, ts).ki for ts in (0.08, 0.02, 0.005)]
    assert 2.5 < (gains[0] - gains[1]) / (gains[1] - gains[2]) < 6
    assert gains[2] == pytest.approx(optimum.kp / optimum.integral_time, rel=0.01)


def test_all_three_gains_of_a_free_pid_are_those_of_the_dense_search() -> None:
    """|S| and |T| up to 1.4 for 1 / (s + 1)^4: the optimum has a kink, and touches more than once."""
    m = 1.4
    kept = ((-1.0, 1 / m), (-(m**2) / (m**2 - 1), m / (m**2 - 1)))
    low, high = 1.0, 3.0
    for _ in range(4):
        derivative = np.linspace(low, high, 13)
        found = [best("1/(s+1)⁴", float(kd), kept, 3.0) for kd in derivative]
        top = int(np.argmax([ki for _, ki in found]))
        low, high = derivative[top] - (high - low) / 8, derivative[top] + (high - low) / 8
    (kp, ki), kd = found[top], derivative[top]
    a = -np.eye(4) + np.diag(np.ones(3), 1)
    plant = control.sample_system(control.ss(a, np.eye(4)[:, [-1]], np.eye(4)[[0]], 0), 1e-3)
    problem = pose([Member("chain", plant)], Goal(), PID(1.0, 0.5, 1.0, 0.0), derivative_filter=0.0, lowest=1e-5)
    ours = tune(problem, Bounds(m, m), [("slow", PID(0.3, 0.1, 0.3, 0.0))], tolerance=1e-5).pid
    assert ours.ki == pytest.approx(ki, rel=0.01)
    assert ours.kp == pytest.approx(kp, rel=0.01)
    assert ours.kd == pytest.approx(kd, rel=0.01)
