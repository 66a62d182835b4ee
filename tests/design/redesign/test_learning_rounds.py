"""Iterative learning takes the errors off motions that repeat, within the thrust that it is given."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np

from design.redesign.designs import designed, in_place
from design.redesign.learning_rounds import CORRECTION_SHARE, ROUND_COUNT, corrected, learning_filter
from design.redesign.outcome import judged_motions, judged_target
from models.controller import References
from models.records.record import Record
from models.simulation.simulator import simulate
from tests.design.redesign.axes import KNOWN, TRUE

TARGET = judged_target(KNOWN)
LIMIT = 140.0


def run(feedforward: np.ndarray, reference: np.ndarray, seed: int) -> Record:
    given = References(reference, feedforward, np.zeros(reference.size))
    return simulate(TRUE, TRUE.feedback_only(), TARGET, given=given, seed=seed).record


def off(record: Record) -> float:
    """The error [m] of the motions that are judged, rms, without what the scale's steps and noise add."""
    late, first = KNOWN.control.reference_delay, judged_motions(record, KNOWN)[0].start
    error = record.position[first:] - record.reference[first - late : -late or None]
    return float(np.sqrt(max(float(np.mean(error**2)) - TRUE.scale.deviation**2, 0.0)))


def test_ten_rounds_on_an_axis_that_is_known_wrongly_leave_a_fifth_of_the_error() -> None:
    known = in_place(designed(KNOWN, "old"), KNOWN, TARGET)
    record = run(known.feedforward + known.compensation, known.position, 0)
    before = off(record)
    for number in range(ROUND_COUNT):
        force = corrected(record, KNOWN, LIMIT)
        assert np.max(np.abs(force)) <= LIMIT
        record = run(force, known.position, 1 + number)
    assert off(record) < before / 5


def test_nothing_is_learned_from_what_comes_before_the_judged_motions() -> None:
    known = in_place(designed(KNOWN, "old"), KNOWN, TARGET)
    record = run(known.feedforward + known.compensation, known.position, 0)
    first = judged_motions(record, KNOWN)[0].start
    elsewhere = np.where(np.arange(record.position.size) < first, 3e-6, 0.0)
    moved = replace(record, position=record.position + elsewhere)
    assert np.array_equal(corrected(record, KNOWN, LIMIT), corrected(moved, KNOWN, LIMIT))
    later = replace(record, position=record.position + 3e-6 - elsewhere)
    assert not np.allclose(corrected(record, KNOWN, LIMIT), corrected(later, KNOWN, LIMIT))


def test_no_error_grows_whether_the_friction_yields_like_a_spring_or_slides() -> None:
    """By the rigid loop as python-control has it; an inverse of the loop with the spring alone grows that without."""
    body = KNOWN.plant.modes[KNOWN.plant.rigid]
    stiff = replace(KNOWN.presliding, stiffness_1=10 * KNOWN.presliding.stiffness_1)
    machine = replace(KNOWN, plant=replace(KNOWN.plant, modes=(body,), dead_time=0.0), presliding=stiff)
    ts, pid = machine.sample_time, machine.control.pid
    omega, z, pole = np.geomspace(1.0, np.pi / ts * 0.999, 2000), control.tf("z"), pid.pole(ts)
    feedback = pid.kp + pid.ki * ts * z / (z - 1) + pid.kd * (1 - pole) / ts * (z - 1) / (z - pole)
    found = []
    for spring in (machine.presliding.stiffness_1, 0.0):
        plant = control.c2d(control.tf([1], [machine.plant.mass, 0.0, spring]), ts)
        found.append(control.feedback(plant, feedback)(np.exp(1j * omega * ts)))
    learned = learning_filter(machine, omega)
    assert all(np.max(np.abs(1 - learned * reach)) <= 1 + 1e-9 for reach in found)
    slow = omega < 2 * np.pi * 5
    assert all(np.all(np.abs(1 - learned * reach)[slow] < 1) for reach in found)
    assert np.max(np.abs(1 - CORRECTION_SHARE / found[0] * found[1])) > 1
