"""The law of every stated feedback: against its own equations in plain Python, in the loop, and at the rating."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from models.controller import PID, Controller
from models.feedback.forms import NO_FILTERS, Cascade, Filters, law_of
from models.feedback.law import follow, law_from_json, law_to_json
from models.friction import elements
from models.machine import Machine, load
from models.plant import Mode, Plant
from models.simulation.exact import respond
from models.simulation.simulator import simulate, simulate_many
from tests.models.feedback.axis import CASCADE, FILTERS, TS, axis
from tests.models.feedback.oracle import Feedback

STATED: dict[str, PID | Cascade] = {
    "cascade": CASCADE,
    "cascade, filtered speed": replace(CASCADE, velocity_filter=0.4e-3, velocity_feedforward=0.7),
    "I-P cascade": replace(CASCADE, proportional_weight=0.0, acceleration_feedforward=0.0),
    "cascade without an integral": replace(CASCADE, integral_time=0.0, velocity_filter=0.2e-3),
    "PID": PID(4e5, 3e7, 4e3, 0.3e-3),
    "PID with set-point weights": PID(4e5, 3e7, 4e3, 0.3e-3, 0.5, 0.0),
    "PD": PID(4e5, 0.0, 4e3, 0.0),
}


def signals(count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """r, x and u_ff that know nothing of each other."""
    noise = np.random.default_rng(3)
    r, x = (np.cumsum(noise.normal(0, size, count)) for size in (2e-6, 3e-6))
    return r, x, noise.normal(0, 20.0, count)


@pytest.mark.parametrize("name", STATED)
@pytest.mark.parametrize("filters", [NO_FILTERS, FILTERS], ids=["", "filters"])
@pytest.mark.parametrize("anti_windup", [0.0, TS, 5e-3])
def test_the_law_is_what_its_equations_say(name: str, filters: Filters, anti_windup: float) -> None:
    stated, limit = STATED[name], 60.0
    r, x, known = signals()
    r, x = np.concatenate([[0.0], r]), np.concatenate([[0.0], x])
    known = np.concatenate([[0.0], known])
    law = law_of(stated, filters, anti_windup, TS)
    held = 11.0 if law.has_integral else 0.0
    anti = anti_windup if law.has_integral else 0.0
    oracle = Feedback(stated, filters, TS, anti_windup=anti, limit=limit, held=held)
    expected = [oracle.step(*now) for now in zip(r, x, known, strict=True)]
    found = follow(law, r, x, known, limit=limit, start=held)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-8)
    if anti:
        assert np.count_nonzero(np.abs(found) == limit) > 5  # the rating is reached


def test_a_plain_pid_is_one_case_of_the_law() -> None:
    table = load()
    target = np.repeat([1e-5, 3e-5, 0.0], 200)
    controller = table.feedback_only()
    law = law_of(table.control.pid, NO_FILTERS, 0.0, table.sample_time)
    plain, general = (simulate(table, one, target).record.command for one in (controller, replace(controller, law=law)))
    assert general == pytest.approx(plain, abs=1e-9)
    assert table.control.law is None


def test_a_run_begins_at_rest_with_the_offset_and_the_friction_held() -> None:
    machine = axis(filters=FILTERS)
    strained = 0.3 * np.array(machine.friction.limit)
    still = simulate(machine, machine.feedback_only(), np.zeros(300), initial_friction=strained)
    held = float(np.array(machine.friction.stiffness) @ strained) + machine.drive.offset
    assert still.record.command == pytest.approx(np.full(300, held), rel=1e-9)
    assert np.max(np.abs(still.position)) < 1e-12


@pytest.mark.parametrize("filters", [NO_FILTERS, FILTERS], ids=["", "filters"])
def test_second_order_against_the_oracle(filters: Filters) -> None:
    machine = axis(filters=filters, anti_windup=2e-3)
    machine = replace(machine, scale=replace(machine.scale, resolution=0.0))
    target, substeps = np.repeat([20e-6, -5e-6], 60), np.array([4, 8, 16, 32])
    truth, force = respond(machine, machine.feedback_only(), target)
    runs = [simulate(machine, machine.feedback_only(), target, substeps=int(count)) for count in substeps]
    errors = [np.max(np.abs(run.position - truth)) for run in runs]
    assert -np.polyfit(np.log(substeps), np.log(errors), 1)[0] > 1.8
    assert runs[-1].friction == pytest.approx(force, abs=1e-3)


def rolling(anti_windup: float = 0.0, rated: float = 1e9, cascade: Cascade = CASCADE) -> Machine:
    """A rigid mass of 12 kg that hardly rubs."""
    machine = axis(cascade, anti_windup=anti_windup)
    plant = Plant(TS, 1.0, (Mode(1 / 12, 0.0, 0.0),))
    drive = replace(machine.drive, rated_thrust=rated, offset=0.0)
    scale = replace(machine.scale, resolution=0.0)
    return replace(machine, plant=plant, drive=drive, scale=scale, friction=elements([1e-9], [1.0]))


def test_a_step_on_a_rigid_mass_is_that_of_the_loop_s_algebra() -> None:
    """x = (1 + P Cx)^-1 P Cr r, with each of them as the matrix of its impulse response."""
    cascade = replace(CASCADE, velocity_filter=0.3e-3, velocity_feedforward=0.8, acceleration_feedforward=3.0)
    machine, target = rolling(cascade=cascade), np.full(200, 1e-5)

    def system(b: list[float], a: list[float]) -> np.ndarray:
        return np.asarray(toeplitz(lfilter(b, a, np.eye(1, 200)[0]), np.zeros(200)))

    keep = 0.3e-3 / (0.3e-3 + TS)
    slope, filtered = system([1 / TS, -1 / TS], [1]), system([(1 - keep) / TS, (keep - 1) / TS], [1, -keep])
    pi = 4000.0 * (np.eye(200) + system([TS / 12e-3], [1, -1]))
    from_position = pi @ (85.0 * np.eye(200) + filtered)
    from_reference = pi @ (85.0 * np.eye(200) + 0.8 * slope) + 3.0 * slope @ slope
    plant = system([0, 0, TS**2 / 24, TS**2 / 24], [1, -2, 1])  # behind its hold and a sample of dead time
    expected = np.linalg.solve(np.eye(200) + plant @ from_position, plant @ from_reference @ target)
    found = simulate(machine, machine.feedback_only(), target, substeps=1).position
    assert found == pytest.approx(expected, abs=1e-14)


def test_an_anti_windup_returns_from_the_rating_without_more_overshoot_than_the_linear_loop() -> None:
    target = np.full(1200, 2e-3)

    def overshoot(machine: Machine) -> float:
        return float(np.max(simulate(machine, machine.feedback_only(), target).position) / 2e-3 - 1)

    cascade = replace(CASCADE, velocity_feedforward=0.0, acceleration_feedforward=0.0)
    linear, limited = overshoot(rolling(cascade=cascade)), overshoot(rolling(rated=60.0, cascade=cascade))
    saved = [overshoot(rolling(anti, 60.0, cascade)) for anti in (TS, 4e-3)]
    assert max(saved) < linear < limited
    command = simulate(rolling(TS, 60.0, cascade), rolling(TS, 60.0, cascade).feedback_only(), target).record.command
    assert np.max(np.abs(command)) == 60.0


def test_many_machines_with_laws_are_each_its_own_run() -> None:
    machines = [axis(filters=one) for one in (NO_FILTERS, FILTERS)] + [replace(axis(None), control=load().control)]
    machines[2] = replace(machines[2], control=replace(machines[2].control, sample_time=TS))
    laws = [one.feedback_only() for one in machines]
    target = np.repeat([1e-5, 0.0], 50)
    for one, machine, law in zip(simulate_many(machines, laws, target), machines, laws, strict=True):
        assert np.array_equal(one.position, simulate(machine, law, target).position)


def test_a_law_of_the_error_puts_out_nothing_on_its_reference_and_keeps_the_loop() -> None:
    law = law_of(replace(CASCADE, velocity_filter=1e-3), FILTERS, 0.0, TS)
    r = signals()[0]
    assert np.max(np.abs(follow(law, r, r, np.zeros(r.size)))) > 1
    assert np.max(np.abs(follow(law.of_error(), r, r, np.zeros(r.size)))) < 1e-8
    for one, other in zip(law.feedback_matrices(), law.of_error().feedback_matrices(), strict=True):
        assert np.array_equal(one, other)


def test_a_law_survives_its_file() -> None:
    law = law_of(CASCADE, FILTERS, 1e-3, TS)
    assert law_from_json(json.loads(json.dumps(law_to_json(law))), TS) == law
    spoilt: tuple[dict[str, object], ...] = ({"c": []}, {"d": [1.0]}, {"hold": [math.nan] * len(law.c)}, {"a": [[1.0]]})
    for spoil in spoilt:
        with pytest.raises(ValueError, match=r"^law: "):
            law_from_json({**law_to_json(law), **spoil}, TS)
    with pytest.raises(KeyError, match="reset"):
        law_from_json({key: one for key, one in law_to_json(law).items() if key != "reset"}, TS)


def test_a_controller_runs_its_law_in_place_of_its_pid() -> None:
    machine = axis()
    controller = machine.feedback_only()
    assert isinstance(controller, Controller)
    assert controller.feedback == machine.control.law == machine.control.feedback
    assert controller.with_feedback(PID(1.0, 2.0, 3.0, 0.0)).feedback == PID(1.0, 2.0, 3.0, 0.0)
    commands = [
        simulate(machine, one, np.full(50, 1e-5)).record.command for one in (controller, replace(controller, law=None))
    ]
    assert all(not np.array_equal(one, other) for one, other in pairwise(commands))
