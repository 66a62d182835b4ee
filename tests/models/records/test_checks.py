"""What a record shows of the machine that made it: whether it moved, its mass, whether two are of one machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from models.friction import elements
from models.machine import load as load_machine
from models.records.checks import (
    SAME_MASS,
    SIGNALS,
    Facts,
    _saturation,
    check_length,
    check_movement,
    check_one_machine,
    check_sample_time,
    findings,
    kept_to,
    rolling,
    scatter_at_rest,
)
from models.records.files import known_of
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.identify_machine import own_records

TS = 5e-4
MASS, FRICTION, OFFSET = 20.0, 3.0, 0.5
PRESLIDING = 1e-4  # m


def moving(amplitude: float = 0.02, mass: float = MASS, step: float = 0.0) -> Record:
    """Two seconds of 3 Hz sinusoidal motion [m] of a mass [kg] with Coulomb friction; step: of the scale [m]."""
    phase = 2 * np.pi * 3.0 * TS * np.arange(4000)
    x, v = amplitude * np.sin(phase), amplitude * 2 * np.pi * 3.0 * np.cos(phase)
    command = -mass * (2 * np.pi * 3.0) ** 2 * x + FRICTION * np.sign(v) + OFFSET
    read = np.round(x / step) * step if step else x
    return Record(TS, x, x, np.zeros_like(x), command, read)


def shown_mass(record: Record, presliding: float) -> float | None:
    found = rolling(record, presliding)
    return None if found is None else found.mass


def test_a_rolling_record_shows_its_mass_beside_friction_and_offset() -> None:
    assert shown_mass(moving(), PRESLIDING) == pytest.approx(MASS, rel=0.01)


def test_motions_of_micrometres_show_no_mass() -> None:
    assert shown_mass(moving(20e-6), PRESLIDING) is None, "the axis never leaves the presliding region"
    crawling = moving(0.02, mass=1e-3)
    assert shown_mass(crawling, PRESLIDING) is None, "friction is nearly all of its command"


def test_whether_an_axis_rolls_is_a_matter_of_its_friction_and_not_of_its_speed() -> None:
    """The same motions of 20 um, on contacts that slip within 0.1 um, and strokes of 20 mm on contacts of 50 mm."""
    assert shown_mass(moving(20e-6, 1e3 * MASS), 1e-7) == pytest.approx(1e3 * MASS, rel=0.01)
    assert shown_mass(moving(), 0.05) is None


def strokes(mass: float = MASS, late: int = 3) -> Record:
    """Forty strokes of 20 mm, 24 samples each and as long at rest, under friction; the force is late by so many
    samples."""
    s = np.clip(np.arange(48) / 24, 0, 1)
    shape = 0.02 * s**3 * (10 - 15 * s + 6 * s**2)
    x = np.tile(np.append(shape, 0.02 - shape), 20)
    v = np.gradient(x, TS)
    force = mass * np.gradient(v, TS) + FRICTION * np.sign(v)
    return Record(TS, x, x, np.zeros_like(x), np.append(force[late:], np.zeros(late)), x)


def test_strokes_of_a_few_samples_show_the_mass_behind_a_late_force() -> None:
    """As of a galvo, with its dead time and current loop of three samples: taken as they are, these strokes show
    13.8 kg of 20, and the tool's own strokes were refused beside its own suite as of two machines."""
    far = 4e-3  # presliding [m]
    assert shown_mass(strokes(late=0), far) == pytest.approx(MASS, rel=1e-3)
    assert shown_mass(strokes(), far) == pytest.approx(MASS, rel=1e-3)
    check_one_machine([moving(), strokes()], "ab", far)
    for other in (MASS / 1.5, 1.5 * MASS):
        with pytest.raises(RecordError, match="of two machines"):
            check_one_machine([moving(), strokes(other)], "ab", far)


def on_a_spring(record: Record, stiffness: float, drag: float = 0.0) -> Record:
    """A record whose axis is held by a spring [N/m], relaxed at 3 mm, with a drag [N s/m]."""
    speed = np.gradient(record.position, record.sample_time)
    return replace(record, command=record.command + stiffness * (record.position - 3e-3) + drag * speed)


def two_sines(mass: float = MASS, fast: float = 3.0) -> Record:
    """Two seconds of motion of 1 Hz and of a faster one [Hz], of a mass [kg] with Coulomb friction."""
    phase = 2 * np.pi * TS * np.arange(4000)
    x = 0.02 * np.sin(phase) + 0.045 / fast * np.sin(fast * phase)
    speed = np.gradient(x, TS)
    return replace(moving(), position=x, command=mass * np.gradient(speed, TS) + FRICTION * np.sign(speed))


def test_a_spring_makes_no_second_machine_of_slow_motions() -> None:
    """Beside a spring of 1.5 kN/m motions of 1 and 3 Hz show less than the mass, and strokes of 12 ms nearly all of
    it."""
    pair = [on_a_spring(record, 1.5e3, 10.0) for record in (two_sines(), strokes())]
    masses = [shown_mass(record, PRESLIDING) for record in pair]
    assert masses[0] is not None
    assert masses[0] < MASS / SAME_MASS, "the spring hides in the mass"
    assert masses[1] == pytest.approx(MASS, rel=0.01)
    check_one_machine(pair, "ab", PRESLIDING)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (two_sines(0.58 * MASS), strokes()),
        (on_a_spring(two_sines(), 1.5e3, 10.0), on_a_spring(strokes(2 * MASS), 1.5e3, 10.0)),
        (on_a_spring(two_sines(), 0.0, 300.0), on_a_spring(two_sines(1.5 * MASS, 5.0), 0.0, 300.0)),
        (on_a_spring(two_sines(), -3e3), strokes()),
        (on_a_spring(moving(), 3e3), strokes()),
    ],
    ids=["no spring", "beside a spring", "beside a drag", "what pushes away is no spring", "one sine tells no spring"],
)
def test_two_masses_are_two_machines(one: Record, other: Record) -> None:
    with pytest.raises(RecordError, match="of two machines"):
        check_one_machine([one, other], "ab", PRESLIDING)


def resting(noise: float, step: float = 0.0) -> Record:
    """Strokes of 20 mm, each with a rest of a second that begins with a vibration of 300 Hz; noise, step [m] of the
    scale."""
    rng, t = np.random.default_rng(4), TS * np.arange(2000)
    shape = 0.02 * np.clip(np.arange(2400) / 400, 0, 1)
    ring = np.append(np.zeros(400), 1e-5 * np.exp(-t / 0.01) * np.sin(2 * np.pi * 300 * t))
    reference = np.tile(np.append(shape, 0.02 - shape), 3)
    x = reference + np.tile(np.append(ring, -ring), 3) + noise * rng.standard_normal(reference.size)
    read = np.round(x / step) * step if step else x
    return Record(TS, reference, reference, np.zeros_like(x), 20 * np.sin(np.arange(x.size)), read)


@pytest.mark.parametrize(("noise", "step"), [(6e-9, 0.0), (6e-9, 5e-9), (2e-7, 1e-8)])
def test_a_rest_shows_what_the_scale_adds(noise: float, step: float) -> None:
    expected = np.hypot(noise, step / 12**0.5)
    assert scatter_at_rest(resting(noise, step)) == pytest.approx(expected, rel=0.1)
    assert scatter_at_rest(moving()) is None, "it never rests"


def test_a_scale_that_is_noisier_than_the_file_says_is_told() -> None:
    """A user's encoder of 5 nm with a noise of 6 nm, which the machine file did not state: its drive had passed for one
    that is rougher than its model by 2.7 N."""
    record = resting(6e-9, 5e-9)
    (told,) = (one for one in findings(record, {"reference"}, Facts(scatter=2.1e-9)) if "scatters" in one)
    assert "by 6.1 nm from sample to sample" in told
    assert "2.1 nm" in told
    for given, facts in (({"reference"}, Facts()), ({"reference"}, Facts(scatter=6e-9)), ((), Facts(scatter=2.1e-9))):
        assert not any("scatters" in one for one in findings(record, given, facts))


@pytest.mark.parametrize("frequency", [20.0, 200.0, 400.0])
def test_what_shakes_under_a_reference_that_stands_still_is_not_the_scales(frequency: float) -> None:
    """An excitation that the log does not hold, of a fifth of a micrometre."""
    record = resting(6e-9)
    shaken = record.position + 2e-7 * np.sin(2 * np.pi * frequency * TS * np.arange(record.position.size))
    found = scatter_at_rest(replace(record, position=shaken))
    assert found is None or found < 12e-9


def test_a_log_without_all_samples_is_not_blamed_for_the_controller() -> None:
    """From one of two samples it can't be replayed, so that nothing is said of its gains, delay or columns."""
    machine = load_machine()
    known, record = Facts(**known_of(machine)), own_records.hysteresis(machine, 1)
    wrong = replace(known, pid=replace(machine.control.pid, kd=3 * machine.control.pid.kd))
    assert known.seen_in(record) == known
    assert known.seen_in(record.thinned(2)) == replace(known, pid=None)
    assert known.seen_in(record.filled(4)) == replace(known, pid=None)  # a log that is faster, as of an oscilloscope
    for one, blamed in ((record, True), (record.thinned(2), False)):
        assert any("controller" in said for said in findings(one, SIGNALS, wrong.seen_in(one))) == blamed


@pytest.mark.parametrize(("coarse", "top", "told"), [(True, 12.5, False), (True, 200.0, True), (False, 12.5, True)])
def test_a_coarse_command_is_saturated_only_at_its_limit(coarse: bool, top: float, told: bool) -> None:
    """One in steps of 0.5 N stands at its highest level as at any other; "cut those parts out" had been advised."""
    angle = np.linspace(0, 20, 4000)
    wave = (1.2 if told else 1.0) * top * np.sin(angle)
    command = np.clip(np.round(wave / 0.5) * 0.5 if coarse else wave, -top, top)
    said = list(_saturation(replace(moving(), command=command), 200.0))
    assert any("is saturated" in one for one in said) == told


STILL = replace(moving(), position=np.full(4000, 1e-5))


@pytest.mark.parametrize(
    ("check", "records", "says"),
    [
        (check_length, [moving().part(0, 600)], "600 samples are too short"),
        (check_movement, [STILL], "nothing moves"),
        (lambda records: check_sample_time(records[0], 1e-3), [moving()], "is sampled every 500 µs"),
        (
            lambda records: check_one_machine(records, "ab", PRESLIDING),
            [moving(), moving(mass=2 * MASS)],
            "a and b are of two",
        ),
        (
            lambda records: check_one_machine(records, "ab", PRESLIDING),
            [moving(step=1e-4), moving(step=2e-4)],
            "their scales",
        ),
    ],
)
def test_what_can_not_be_diagnosed_is_said(
    check: Callable[[Sequence[Record]], None], records: Sequence[Record], says: str
) -> None:
    with pytest.raises(RecordError, match=says):
        check(records)


def test_an_axis_that_creeps_where_nothing_is_asked_of_it_rests() -> None:
    """A user's log of 20 s at rest, over which the axis gave way by 1.5 um under commands of 1.9 N, made a machine file
    with 0.35 N of friction and an offset of 1.4 N. One that is pushed by more than its friction is asked to move."""
    friction = elements([1e6], [10e-6])
    slow = np.sin(np.arange(4000) / 900.0)
    creeping = replace(moving(), position=1e-5 + 1.5e-6 * slow, command=1.9 * slow)
    rests = replace(creeping, reference=np.full(4000, 1e-5), feedforward=np.zeros(4000))
    check_movement([rests])
    with pytest.raises(RecordError, match="nothing moves"):
        check_movement([rests], friction)
    check_movement([creeping], friction)  # as it follows a reference
    check_movement([replace(rests, command=10.0 * slow)], friction)
    check_movement([replace(rests, position=20 * rests.position)], friction)


def test_records_of_one_machine_pass() -> None:
    records = [moving(), moving(0.03, mass=1.1 * MASS)]
    check_length(records)
    check_movement(records)
    check_one_machine(records, "ab", PRESLIDING)
    check_sample_time(records[0], TS)


@pytest.mark.parametrize(("low", "limit"), [(-12.5, 12.5), (-11.0, None)])
def test_commands_that_stop_at_a_force_either_way_are_kept_to_it(low: float, limit: float | None) -> None:
    """A drive's torque limit of 22 %: of a log at 1 kHz, whose commands stand still at rest, it had not been told."""
    command = np.clip(np.round(20 * np.sin(np.linspace(0, 20, 4000)) / 0.5) * 0.5, low, 12.5)
    assert kept_to(command) == limit
    said = list(_saturation(replace(moving(), command=command), 200.0))
    assert any("a drive that keeps to this has it as rated_thrust, not 200 N" in one for one in said) == bool(limit)
    assert kept_to(np.zeros(10)) is None
