"""What is to be run on an axis is in its own sizes and is recognised for what it shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import hilbert

from diagnosis.experiments.menu import menu
from diagnosis.experiments.references import FILE_NAMES, LEVELS, axis_references
from models.friction import elements
from models.identification.motion import START, begin
from models.identification.recognise import recognised
from models.machine import Machine, load
from models.plant import Mode, Plant
from models.records.files import Loaded
from models.records.record import Record
from models.simulation.simulator import simulate
from studies.effort import LOG_LENGTH_RATIO
from studies.gap_diagnosis.options import MOST_SAMPLES


def smaller(machine: Machine, factor: float) -> Machine:
    """The machine with all forces, masses and lengths smaller by a factor; times stay."""
    plant, drive, wanted = machine.plant, machine.drive, machine.specification
    modes = tuple(Mode(factor * one.gain, one.frequency, one.damping) for one in plant.modes)
    lengths = np.array(machine.friction.limit) / factor
    return replace(
        machine,
        plant=Plant(plant.dead_time, plant.thrust_constant, modes),
        drive=replace(drive, rated_thrust=drive.rated_thrust / factor**2, rated_speed=drive.rated_speed / factor),
        friction=elements(np.array(machine.friction.stiffness) / factor, lengths),
        specification=replace(wanted, stroke=wanted.stroke / factor, tolerance=wanted.tolerance / factor),
    )


def run(machine: Machine, name: str) -> Record:
    """A record of the machine's feedback on the references of this name."""
    one = axis_references(machine)[name]
    return simulate(machine, machine.feedback_only(), one.target, given=one.given, seed=0).record


@pytest.mark.parametrize("name", FILE_NAMES)
def test_references_are_in_the_sizes_of_the_machine(name: str) -> None:
    machine = load()
    usual, small = axis_references(machine)[name], axis_references(smaller(machine, 1000.0))[name]
    assert small.target.size == usual.target.size
    np.testing.assert_allclose(1e3 * small.given.position, usual.given.position, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(1e6 * small.given.feedforward, usual.given.feedforward, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "least"), [("slow_loops.csv", 0.01), ("sweep_low.csv", 0.25), ("sweep_high.csv", 0.25)]
)
def test_they_begin_from_rest_so_that_no_feedforward_of_the_controller_s_own_strikes(name: str, least: float) -> None:
    """A step of speed had asked an acceleration feedforward of a user for 100 N m at once. In shares of friction."""
    machine = load()
    path = axis_references(machine)[name].given.position
    force = machine.plant.mass * np.max(np.abs(np.diff(path, 2, prepend=[path[0]] * 2))) / machine.sample_time**2
    assert force < least * machine.friction.coulomb_force


@pytest.mark.parametrize("name", FILE_NAMES)
def test_references_stay_within_the_ratings(name: str) -> None:
    machine = load()
    given = axis_references(machine)[name].given
    friction = machine.friction.coulomb_force
    assert np.max(np.abs(given.feedforward)) < machine.drive.rated_thrust - friction
    assert np.max(np.abs(np.diff(given.position))) / machine.sample_time < machine.drive.rated_speed


@pytest.mark.parametrize("travel", [0.112e-3, 0.15e-3, 0.24e-3, 0.4e-3, 4e-3, 40e-3])
@pytest.mark.parametrize("motions", [5, 1])
def test_references_and_experiments_stay_within_a_stated_travel(motions: int, travel: float) -> None:
    """And where there is room, they are those of an axis whose travel is open. Moves that are made twice in one
    direction had gone up to twice as far. Of an axis for one motion at a time, the motion may be all of the travel."""
    table = load()
    wanted = table.specification
    stroke = wanted.stroke if motions > 1 else min(0.9 * travel, 50 * wanted.stroke)
    machine = replace(table, specification=replace(wanted, motions=motions, stroke=stroke))
    stated = replace(machine, drive=replace(machine.drive, travel=travel))
    planned = [
        [*axis_references(one).values(), *(experiment.schedule for experiment in menu(one))]
        for one in (stated, machine)
    ]
    for within, usual in zip(*planned, strict=True):
        way, far = (float(np.ptp(one.given.position)) for one in (within, usual))
        assert way <= stated.drive.room * (1 + 1e-9), within.name
        assert way == pytest.approx(far) or way > 0.4 * min(travel, far), within.name


def test_the_slow_loops_show_friction_alone() -> None:
    machine = load()
    record = run(machine, "slow_loops.csv")
    assert recognised(machine, Loaded("slow_loops", "", record, (), ())) == "hysteresis"
    # In the second wide loop the axis rolls up and down, with full friction either way.
    second = slice(record.position.size // 4, record.position.size // 2)
    steady = np.convolve(record.command[second], np.full(100, 0.01), "valid")  # without the PID's answer to the scale
    climbed = float(np.ptp(steady))
    assert climbed == pytest.approx(2 * machine.friction.coulomb_force, rel=0.03)


@pytest.mark.parametrize("name", LEVELS)
def test_the_axis_rolls_in_one_direction_under_a_sweep(name: str) -> None:
    machine = load()
    record = run(machine, name)
    assert recognised(machine, Loaded(name, "", record, (), ())) == "excitation"
    tenth = record.position.size // 10
    step = round(2e-3 / machine.sample_time)
    moved = np.sign(record.position[-1]) * (record.position[tenth + step :] - record.position[tenth:-step])
    assert np.min(moved) > 0


@pytest.mark.parametrize("name", LEVELS)
def test_a_sweep_keeps_the_axis_rolling_through_its_modes(name: str) -> None:
    """A mode that rings moves the table several times as far as the rigid body alone: it went backwards there. The
    force's size and frequency are those of its analytic signal, the plant's the sum of its modes."""
    machine, ts = load(), load().sample_time
    rigid, first, *_ = machine.plant.modes
    ringing = replace(first, gain=0.15 * rigid.gain, frequency=0.05 / ts, damping=0.01)
    machine = replace(machine, plant=replace(machine.plant, modes=(rigid, ringing)))
    given = axis_references(machine)[name].given
    begin = np.flatnonzero(given.feedforward)[0]
    wave = hilbert(given.feedforward[begin:])
    omega = np.gradient(np.unwrap(np.angle(wave)), ts)
    own = 2 * np.pi * ringing.frequency
    moves = -rigid.gain / omega**2 + ringing.gain / (own**2 - omega**2 + 2j * ringing.damping * own * omega)
    speed = (np.abs(wave) * omega * np.abs(moves))[1000:-1000]
    rolls = np.ptp(given.position) / (given.position.size * ts)
    assert np.max(speed) < 0.4 * rolls
    assert np.max((np.abs(wave) * rigid.gain / omega)[1000:-1000]) > (0.2 if name == "sweep_high.csv" else 0.05) * rolls


def test_strokes_are_recognised() -> None:
    machine = load()
    record = run(machine, "strokes.csv")
    assert recognised(machine, Loaded("strokes", "", record, (), ())) == "motion"
    assert START < begin(record) < 0.3 * record.position.size  # a fit of it knows the friction's state from there on


@pytest.mark.parametrize(("settling", "rests"), [(0.025, 10.0), (0.1, 10.0), (0.2, 6.9), (0.8, 2.0)])
def test_strokes_and_suite_are_short_enough_for_a_diagnosis_by_default(settling: float, rests: float) -> None:
    """A cascade at 8 kHz was asked for strokes of 156,000 samples, which a diagnosis refused; rests of two settling
    times are the least that show a motion settle."""
    machine = load()
    wanted = replace(machine.specification, settling_time=settling, reference_settling_time=0.6 * settling)
    machine = replace(machine, specification=wanted)
    planned = axis_references(machine)
    strokes, whole = planned["strokes.csv"], sum(planned[name].target.size for name in ("strokes.csv", "suite.csv"))
    last = strokes.target.size - np.flatnonzero(np.diff(strokes.given.position))[-1]
    assert last * machine.sample_time / settling == pytest.approx(rests, rel=0.02)
    assert whole * LOG_LENGTH_RATIO < MOST_SAMPLES or rests == 2.0
