"""The sampled loop: against the PID's and the plant's own steps, python-control's margins, finer grids and a proof."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import sosfreqz

from design.loop import (
    SENSITIVITIES,
    assess,
    closed_loop,
    controller_model,
    controller_response,
    disturbance_response,
    dominant_pole,
    frequency_response,
    grid,
    intersample,
    peaks,
    rms,
    sensitivities,
    sensitivity,
    spectral_radius,
    stays_below,
)
from models.controller import PID, Controller
from models.ensemble import load_ensemble
from models.feedback.forms import nearest_pid, sections
from models.friction import elements
from models.machine import Machine, load
from models.plant import Mode, Plant, sampled
from models.plant import frequency_response as continuous_response
from models.simulation.kernel import pid_step
from models.simulation.simulator import simulate
from tests.models.feedback.axis import CASCADE, FILTERS, PLANT, axis
from tests.models.feedback.axis import TS as CASCADE_TS

Array = NDArray[np.float64]

TS = 5e-4
STAND = Plant(1.2e-3, 1.0, (Mode(1 / 45, 0.0, 0.0), Mode(1 / 900, 38.0, 0.01), Mode(5e-4, 81.0, 0.02)))
GAINS = PID(1.6e6, 7e7, 1.05e4, 2e-4)
SLOPES = (0.0, 1e5, 8e5, 1.7e6)


def model(slope: float) -> control.StateSpace:
    return sampled(STAND, TS, slope)


def test_the_pid_is_the_one_that_runs() -> None:
    """The step of models.controller, sample by sample, and the closed form, bin by bin."""
    errors = np.random.default_rng(0).standard_normal(50)
    gains = np.array([GAINS.kp, GAINS.ki, GAINS.kd, GAINS.derivative_filter])
    integral = slope = previous = 0.0
    expected = []
    for error in errors:
        command, integral, slope = pid_step(error, previous, integral, slope, gains, TS)
        previous = error
        expected.append(command)
    c, state, found = controller_model(GAINS, TS), np.zeros(2), []
    for error in errors:
        found.append(float(c.C[0] @ state + c.D[0, 0] * error))
        state = c.A @ state + c.B[:, 0] * error
    assert found == pytest.approx(expected, rel=1e-10)
    omega = np.geomspace(1, math.pi / TS, 40)
    assert controller_response(GAINS, TS, omega) == pytest.approx(frequency_response(c, omega), rel=1e-9)


@pytest.mark.parametrize("slope", SLOPES)
def test_the_closed_loops_frequency_responses_are_those_of_the_diagram(slope: float) -> None:
    omega = np.geomspace(20, math.pi / TS, 60)
    expected = sensitivities(frequency_response(model(slope), omega), controller_response(GAINS, TS, omega))
    for name in SENSITIVITIES:
        found = frequency_response(sensitivity(model(slope), GAINS, name), omega)
        assert np.max(np.abs(found / expected[name] - 1)) < 1e-6
    assert np.max(np.abs(expected["S"] + expected["T"] - 1)) < 1e-12


@pytest.mark.parametrize("slope", SLOPES)
def test_peaks_margins_and_stability_agree_with_python_control(slope: float) -> None:
    found, loop = assess(model(slope), GAINS, count=2000), model(slope) * controller_model(GAINS, TS)
    # From the frequency response: the polynomials of three poles at z = 1 have crossings made of round-off there.
    omega = grid(model(slope), GAINS, 2000)[:-1]
    gains, phases, *_ = control.stability_margins(control.frd(loop, omega), returnall=True)
    factors = [max(g, 1 / g) for g in gains if g > 0]
    assert found.gain_margin == pytest.approx(min(factors), rel=1e-3)
    assert found.phase_margin == pytest.approx(math.radians(min(np.abs(phases))), rel=1e-3)
    disk, *_ = control.disk_margins(loop, grid(model(slope), GAINS, 4000))
    assert found.disk_margin == pytest.approx(disk, rel=1e-4)
    assert found.phase_margin >= 2 * math.asin(1 / (2 * found.ms.value)) - 1e-4
    assert (
        found.gain_margin >= found.ms.value / (found.ms.value - 1) - 1e-3 or found.gain_margin >= 1 + 1 / found.ms.value
    )
    poles = control.feedback(loop, 1).poles()
    assert found.spectral_radius == pytest.approx(np.max(np.abs(poles)), rel=1e-6)
    assert found.stable


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize("name", SENSITIVITIES)
def test_a_peak_is_proved_at_all_frequencies_and_held_on_a_ten_times_finer_grid(slope: float, name: Any) -> None:
    found = assess(model(slope), GAINS)
    top = {"S": found.ms, "T": found.mt, "PS": found.mps, "CS": found.mcs}[name]
    omega = grid(model(slope), GAINS, 2000)
    values = sensitivities(frequency_response(model(slope), omega), controller_response(GAINS, TS, omega))
    assert np.max(np.abs(values[name])) <= top.value * (1 + 1e-6)
    system = sensitivity(model(slope), GAINS, name)
    assert stays_below(system, top.value * (1 + 1e-5))
    assert not stays_below(system, top.value * (1 - 1e-5))


def test_the_largest_t_of_a_sluggish_loop_is_its_1_at_rest() -> None:
    """A soft integrator against the friction's spring: |T| falls from 1 on, which a grid from above 0 on misses."""
    soft = PID(1e-4 * GAINS.kp, 1e-4 * GAINS.ki, 0.0, GAINS.derivative_filter)
    found = assess(model(SLOPES[-1]), soft)
    assert found.stable
    assert found.mt.value == 1.0
    assert found.mt.omega == 0.0
    assert stays_below(sensitivity(model(SLOPES[-1]), soft, "T"), 1 + 1e-6)
    assert not stays_below(sensitivity(model(SLOPES[-1]), soft, "T"), 1 - 1e-4)


def test_a_narrow_peak_between_grid_points_is_found() -> None:
    """1 / sqrt(x^2 + w^2) has a peak of 1 / w, 1000 times narrower than the grid's spacing of its neighbours."""

    def narrow(omega: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.asarray(1 / np.hypot(omega - 3.14159, 0.05))

    omega = np.linspace(1, 6, 60)
    assert np.max(narrow(omega)) < 19.9  # the grid alone misses it
    (found,) = peaks(lambda points: narrow(points)[None], omega)
    assert found.value == pytest.approx(20, rel=1e-6)
    assert found.omega == pytest.approx(3.14159, abs=1e-4)


def test_an_unstable_loop_is_called_one() -> None:
    aggressive = PID(20 * GAINS.kp, GAINS.ki, GAINS.kd, GAINS.derivative_filter)
    assert not assess(model(0.0), aggressive).stable
    assert np.max(np.abs(np.linalg.eigvals(closed_loop(model(0.0), aggressive).A))) > 1


def test_rms_of_a_first_order_filter_is_the_closed_form() -> None:
    """y[k] = a y[k-1] + (1 - a) e[k-1]: variance (1 - a)^2 / (1 - a^2)."""
    a = 0.8
    assert rms(control.StateSpace([[a]], [[1 - a]], [[1.0]], [[0.0]], TS)) == pytest.approx(
        (1 - a) / math.sqrt(1 - a**2)
    )


@pytest.mark.parametrize("ki", [0.0, 2e7])
def test_between_the_samples_the_path_passes_through_the_samples(ki: float) -> None:
    """The plant at seven points a sample under the PID, and the closed loop's matrices, which know samples only."""
    machine = load()
    pid = replace(machine.control.pid, ki=ki)
    path = intersample(sampled(machine.plant, TS / 7, 8e5), pid, TS, 100)
    expected = disturbance_response(sampled(machine.plant, TS, 8e5), pid, 99)
    assert path[0] == 0.0
    assert path[7::7] == pytest.approx(expected, rel=1e-9, abs=1e-15)


def tuned(pid: PID, factor: float) -> PID:
    """The PID with all gains times `factor`."""
    return PID(factor * pid.kp, factor * pid.ki, factor * pid.kd, pid.derivative_filter)


def slopes_of(machine: Machine) -> tuple[float, ...]:
    """Those of P_l, P_e1 and P_e2."""
    return 0.0, machine.presliding.stiffness_1, machine.presliding.stiffness_2


def by_aliasing(machine: Machine, slope: float, frequency: Array) -> Array:
    """|S| (n,) [1] of the sampled loop at frequencies (n,) [Hz] by sampling's own formula,
    P_d(jw) = sum_n P(j(w + n w_s)) H(j(w + n w_s)) / T_s.

    H is the zero-order hold; the PID is its difference equation on z^k. Nothing is discretised in state space.
    """
    ts, pid = machine.sample_time, machine.control.pid
    w = 2 * math.pi * frequency
    shifted = w + 2 * math.pi / ts * np.arange(-200, 201)[:, None]
    p = continuous_response(machine.plant, np.abs(shifted).ravel(), slope).reshape(shifted.shape)
    hold = (1 - np.exp(-1j * shifted * ts)) / (1j * shifted)
    plant = np.sum(np.where(shifted > 0, p, np.conj(p)) * hold / ts, axis=0)
    z = np.exp(1j * w * ts)
    keep = pid.derivative_filter / (pid.derivative_filter + ts)
    slope_of_error = (1 - keep) * (1 - 1 / z) / ts / (1 - keep / z)
    law = pid.kp + pid.ki * ts / (1 - 1 / z) + pid.kd * slope_of_error
    return np.asarray(1 / np.abs(1 + law * plant))


@pytest.mark.parametrize("index", [None, 0, 21, 47])
def test_the_peak_of_the_sensitivity_is_that_of_another_computation(index: int | None) -> None:
    machine = load() if index is None else load_ensemble()[index]
    frequencies, ts = np.geomspace(2.0, 900.0, 300), machine.sample_time
    for slope in slopes_of(machine):
        top = frequencies[np.argmax(by_aliasing(machine, slope, frequencies))]
        expected = float(np.max(by_aliasing(machine, slope, top * np.linspace(0.97, 1.03, 61))))
        assert 1.1 < expected < 2.3
        found = assess(sampled(machine.plant, ts, slope), machine.control.pid).ms.value
        assert found == pytest.approx(expected, rel=3e-3)


def test_the_peak_of_the_sensitivity_has_its_closed_form() -> None:
    """PD on a free mass: S = (z - 1)^2 / ((z - 1)^2 + T_s^2 (z + 1) C / 2 M), C = kp + kd (1 - 1/z) / T_s; or 1."""
    mass, kp, kd = 40.0, 2e6, 8e3
    free = sampled(Plant(0.0, 1.0, (Mode(1 / mass, 0.0, 0.0),)), TS)
    z = np.exp(2j * math.pi * np.geomspace(1.0, 0.499 / TS, 20000) * TS)
    loop = TS**2 * (z + 1) * (kp + kd * (1 - 1 / z) / TS) / (2 * mass)
    expected = float(np.max(np.abs((z - 1) ** 2 / ((z - 1) ** 2 + loop))))
    assert expected > 1.1
    assert assess(free, PID(kp, 0.0, kd, 0.0)).ms.value == pytest.approx(expected, rel=1e-6)


def rings_down(machine: Machine, pid: PID, slope: float) -> bool:
    """Whether the simulated loop around P_e(s) comes to rest: friction that is a spring, and thrust without a limit."""
    spring = elements([max(slope, 1e-6)], [1e3])
    linear = replace(
        machine,
        friction=spring,
        drive=replace(machine.drive, rated_thrust=1e12),
        scale=replace(machine.scale, resolution=0.0),
    )
    law = Controller(machine.sample_time, pid, 0, (1.0,), (0.0,))
    x = simulate(linear, law, np.full(4000, 1e-6)).position - 1e-6
    return bool(np.max(np.abs(x[-500:])) < 0.1 * np.max(np.abs(x[:500])))


def is_stable(machine: Machine, pid: PID, slope: float) -> bool:
    """By the eigenvalues of the closed loop."""
    return spectral_radius(sampled(machine.plant, machine.sample_time, slope), pid) < 1


@pytest.mark.parametrize(("factor", "stable"), [(0.1, False), (0.5, True), (1.0, True), (2.5, True), (4.0, False)])
def test_stability_is_what_the_simulated_loop_shows(factor: float, stable: bool) -> None:
    machine = load()
    pid = tuned(machine.control.pid, factor)
    for slope in slopes_of(machine):
        assert is_stable(machine, pid, slope) is rings_down(machine, pid, slope)
    assert all(is_stable(machine, pid, slope) for slope in slopes_of(machine)) is stable


def test_the_bound_of_stability_is_where_the_simulated_loop_begins_to_ring() -> None:
    """The largest factor on all gains, by halving: from the eigenvalues, and from what the simulated loop does."""
    machine = load()

    def largest(stable: Callable[[Machine, PID, float], bool], slope: float) -> float:
        low, high = 1.0, 8.0
        for _ in range(9):
            middle = math.sqrt(low * high)
            fine = stable(machine, tuned(machine.control.pid, middle), slope)
            low, high = (middle, high) if fine else (low, middle)
        return low

    simulated = [largest(rings_down, slope) for slope in slopes_of(machine)]
    assert 2.0 < min(simulated) < 4.0
    assert [largest(is_stable, slope) for slope in slopes_of(machine)] == pytest.approx(simulated, rel=0.01)


def test_a_cascade_s_loop_is_assessed_as_that_of_the_pid_with_the_same_loop() -> None:
    """Without a filter of its speed the cascade's loop is a PID's, whose response is a closed form."""
    plant, law = sampled(PLANT, CASCADE_TS), axis().control.law
    assert law is not None
    found, expected = (assess(plant, one) for one in (law, nearest_pid(CASCADE)))
    assert found.stable
    for name in ("ms", "mt", "mps", "mcs"):
        assert getattr(found, name).value == pytest.approx(getattr(expected, name).value, rel=1e-6)
    for name in ("crossover", "bandwidth", "gain_margin", "phase_margin", "disk_margin", "spectral_radius"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-6)
    assert abs(dominant_pole(PLANT, law, CASCADE_TS)) == pytest.approx(found.spectral_radius, rel=1e-9)


def test_a_filtered_cascade_s_peaks_and_margins_are_those_of_its_own_response() -> None:
    """From P and C at each frequency, with C the product of the cascade's and the filters' closed forms in z."""
    cascade = replace(CASCADE, velocity_filter=0.4e-3)
    law = axis(cascade, FILTERS).control.law
    assert law is not None
    plant = sampled(PLANT, CASCADE_TS)
    found = assess(plant, law)
    omega = grid(plant, law, 20_000)[:-1]
    z = np.exp(1j * omega * CASCADE_TS)
    keep = 0.4e-3 / (0.4e-3 + CASCADE_TS)
    speed = (1 - keep) / (1 - keep / z) * (1 - 1 / z) / CASCADE_TS
    core = 4000.0 * (1 + CASCADE_TS / 12e-3 / (1 - 1 / z)) * (85.0 + speed)
    _, filtered = sosfreqz(sections(FILTERS, CASCADE_TS), omega, fs=2 * math.pi / CASCADE_TS)
    loop = frequency_response(plant, omega) * core * filtered
    assert found.ms.value == pytest.approx(np.max(np.abs(1 / (1 + loop))), rel=1e-4)
    assert found.mt.value == pytest.approx(np.max(np.abs(loop / (1 + loop))), rel=1e-4)
    crossings = omega[1:][(np.abs(loop[1:]) < 1) & (np.abs(loop[:-1]) >= 1)]
    assert found.crossover == pytest.approx(crossings[-1], rel=1e-2)
    path = np.abs(disturbance_response(plant, law, 4000))
    assert found.stable
    assert path[-1] < 1e-3 * np.max(path)  # the step of the friction is held in the end
