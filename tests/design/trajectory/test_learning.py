"""Learning from an unknown start: exact on noise-free records, and on simulated tables that are off in everything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.deadbeat import synthesise
from design.trajectory.compensator import learn, motion_profile
from design.trajectory.learning import (
    hold_time,
    learned_tables,
    learning_to_json,
    looked_at,
    motions_to_learn,
    path_to_learn,
    position_by_dead_time,
    sensitivities,
    tracking_error,
)
from design.trajectory.schemes import Scheme, history_aware
from design.validation import assess, respond, sequence
from design.wiping import wipe, wipe_references
from models.controller import Controller
from models.friction import follow, reached_states
from models.machine import Machine, load
from models.records.record import Record, motions
from models.variation import Variation, drawn, varied, varied_friction

STROKE = 20e-6


@pytest.fixture(scope="module")
def machine() -> Machine:
    """The default machine with motions of a fifth of a second, to simulate less."""
    table = load()
    return replace(table, specification=replace(table.specification, interval=0.2))


@pytest.fixture(scope="module")
def scheme(machine: Machine) -> Scheme:
    deadbeat = synthesise(machine.plant, machine.sample_time, 22e-3, STROKE)
    return history_aware(machine, motion_profile(machine.plant, machine.sample_time, deadbeat.thrust, STROKE))


@pytest.mark.parametrize(("force", "length", "offset"), [(0.2, -0.1, 0.0), (-0.25, 0.2, 2.0), (0.3, 0.3, -2.0)])
def test_friction_and_constant_force_are_learned_exactly_from_any_start(
    machine: Machine, scheme: Scheme, force: float, length: float, offset: float
) -> None:
    true = varied_friction(machine.friction, Variation(friction_force=force, friction_length=length))
    path = path_to_learn(machine, scheme, STROKE)
    known, rests = wipe_references(machine, wipe(machine))
    ends = np.array([one.stop - 1 for one in motions(sequence(machine, STROKE, 2))])
    rests = np.append(rests, known.position.size + ends)
    for start in reached_states(true, 3, seed=1):
        hold = follow(true, path, start)[0][rests] + offset
        found = learn(machine.friction, path, rests, hold)
        assert found.friction.coulomb_force == pytest.approx(true.coulomb_force, rel=1e-3)
        assert found.friction.limit == pytest.approx(true.limit, rel=1e-3)
        assert found.offset == pytest.approx(offset, abs=1e-3 * true.coulomb_force)


def test_the_wipe_alone_tells_the_forces(machine: Machine) -> None:
    true = varied_friction(machine.friction, Variation(friction_force=-0.2, friction_length=0.3))
    known, rests = wipe_references(machine, wipe(machine))
    start = reached_states(true, 1, seed=2)[0]
    hold = follow(true, known.position, start)[0][rests] + 1.5
    found = learn(machine.friction, known.position, rests, hold, length=False)
    assert found.friction.coulomb_force == pytest.approx(true.coulomb_force, rel=1e-9)
    assert found.offset == pytest.approx(1.5, rel=1e-9)
    assert found.friction.limit == pytest.approx(machine.friction.limit)


def test_tables_that_are_off_in_everything_settle_finely_after_learning(machine: Machine, scheme: Scheme) -> None:
    """And what is learned of mass, dead time, friction and constant force is what the tables have."""
    late, gain = 0.2 * machine.plant.dead_time, (0.0, 0.2, 0.2)
    within = Variation(0.3, 0.3, mass=0.03, modal_gain=gain, frequency=0.03, damping=0.5, dead_time=late, offset=2.0)
    noisy = replace(machine, scale=machine.scale.noisy())
    tables = drawn(noisy, within, 6, seed=3)
    starts = [reached_states(table.friction, 1, seed=i)[0] for i, table in enumerate(tables)]
    taught = learned_tables(tables, machine, scheme, STROKE, 1, starts)
    missed = np.array(
        [
            (
                (1 + one.errors[0]) * machine.plant.mass / table.plant.mass - 1,
                (machine.plant.dead_time + one.errors[1] - table.plant.dead_time) / machine.plant.dead_time,
                one.learned.friction.coulomb_force / table.friction.coulomb_force - 1,
                (one.learned.offset - table.drive.offset) / machine.friction.coulomb_force,
            )
            for table, one in zip(tables, taught, strict=True)
        ]
    )
    rms = np.sqrt(np.mean(missed**2, axis=0))  # of ranges that have 0.017, 0.12, 0.17 and 0.07
    assert np.all(rms < [0.01, 0.01, 0.04, 0.01])
    responses = respond(
        tables,
        [one.controller for one in taught],
        sequence(machine, STROKE),
        given=[one.given for one in taught],
        initial_friction=[one.elements for one in taught],
    )
    for table, response in zip(tables, responses, strict=True):
        judged = assess(table, response, stroke=STROKE)
        assert judged.settling_within(0.5e-6) <= 24e-3  # x_T* rests after 22 ms, the table up to 1.3 ms later
        assert judged.worst_dispersion < 0.4e-6


def test_a_fault_is_told_from_its_own_tracking_error_and_no_other(machine: Machine, scheme: Scheme) -> None:
    known = sensitivities(machine, scheme, STROKE)
    exact = replace(machine, scale=replace(machine.scale, resolution=0.0, noise=0.0))
    faults = [Variation(mass=0.01), Variation(dead_time=50e-6), Variation(friction_force=0.01)]
    target, half = sequence(machine, STROKE, 2), sequence(machine, STROKE, 1).size
    given, tables = scheme.references(machine.friction, target), [varied(exact, fault) for fault in faults]
    for fault, response in zip(faults, respond(tables, scheme.controller, target, given=given), strict=True):
        count = known.faultless.size
        told = known.explain(tracking_error(target[half:], response.record.last(half), scheme.controller, count))
        assert told[0] == pytest.approx(fault.mass, abs=2e-3)
        assert told[1] == pytest.approx(fault.dead_time, abs=5e-6)


def test_the_tracking_error_waits_as_the_feedback_does_and_turns_motions_down() -> None:
    target = np.repeat([1.0, 0.0], 10)
    reading = np.append([0.0, 0.0], target[:-2]) + np.repeat([0.1, -0.1], 10)
    nothing = np.zeros(20)
    record = Record(1e-3, target, target, nothing, nothing, reading)
    law = Controller(1e-3, load().control.pid, 2, (1.0,), (0.0,))
    assert tracking_error(target, record, law, 6) == pytest.approx(np.full(6, 0.1))


@pytest.mark.parametrize(("interval", "samples"), [(0.2, 100), (45e-3, 89)])
def test_the_next_motion_is_no_part_of_a_tracking_error(
    machine: Machine, scheme: Scheme, interval: float, samples: int
) -> None:
    """Twice the settling time of 25 ms is more than 45 ms from one motion to the next, less a sample."""
    quick = replace(machine, specification=replace(machine.specification, interval=interval))
    assert looked_at(quick) == samples
    known = sensitivities(quick, scheme, STROKE)
    assert known.faultless.shape == known.gain[0].shape == (samples,)


def test_the_scheme_for_another_mass_moves_alike_with_more_thrust(machine: Machine, scheme: Scheme) -> None:
    target = sequence(machine, STROKE, 1)
    assert scheme.adapted is not None
    heavier = scheme.adapted(varied(machine, Variation(mass=0.1)))
    before, after = (one.references(machine.friction, target) for one in (scheme, heavier))
    assert after.position == pytest.approx(before.position, abs=1e-12)
    assert after.feedforward == pytest.approx(1.1 * before.feedforward)


def test_controller_json_tells_what_a_drive_needs(machine: Machine, scheme: Scheme) -> None:
    content = learning_to_json(sensitivities(machine, scheme, STROKE), machine, scheme, STROKE)
    sizes = {len(content[key]) for key in ("faultless_error_m", "mass_error_per_m", "dead_time_error_s_per_m")}
    assert sizes == {100}
    assert content["motions"] == motions_to_learn(machine) == 22
    assert content["motions"] == 2 + content["rounds"] * content["motions_per_round"]
    assert 1.0 in content["length_candidates"]
    assert machine.specification.settling_time < content["rest_s"] < machine.specification.interval


@pytest.mark.parametrize("share", [-0.15, -0.05, 0.05, 0.15])
def test_x_t_star_for_another_dead_time_follows_from_two_rows(machine: Machine, scheme: Scheme, share: float) -> None:
    """Also where the reference then waits a sample less or more."""
    per_second, per_square = position_by_dead_time(machine, scheme, STROKE)
    late, step = share * machine.plant.dead_time, np.full(100, STROKE)
    assert scheme.adapted is not None
    other = scheme.adapted(varied(machine, Variation(dead_time=late)))
    waits = other.controller.reference_delay - scheme.controller.reference_delay
    wanted = np.append(np.zeros(3 + waits), other.references(other.known, step).position)
    found = np.append(np.zeros(3), scheme.references(scheme.known, step).position)
    moved = STROKE * late * (per_second + late * per_square)
    found[3 : 3 + moved.size] += moved
    apart = np.max(np.abs(found[:90] - wanted[:90]))
    assert apart < 1e-3 * STROKE < 5 * np.max(np.abs(moved))


def test_a_scheme_that_stays_as_designed_has_no_such_rows(machine: Machine, scheme: Scheme) -> None:
    with pytest.raises(ValueError, match="give a history-aware one"):
        position_by_dead_time(machine, replace(scheme, adapted=None), STROKE)


def test_the_thrust_is_averaged_where_a_motion_has_settled(machine: Machine) -> None:
    wanted = machine.specification
    short = replace(machine, specification=replace(wanted, interval=1.4 * wanted.settling_time))
    assert hold_time(machine) == pytest.approx(0.8 * wanted.settling_time)
    assert hold_time(short) == pytest.approx(0.4 * wanted.settling_time)
