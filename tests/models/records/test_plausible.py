"""Scales and jumps that a machine can't have made are doubted, judged by its own quantities; what it makes is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from models.controller import PID
from models.effects.base import Effect
from models.effects.measured import Measured
from models.effects.motor import Cogging
from models.effects.structure import CableSpring
from models.machine import Machine, load
from models.quantity import show
from models.records.checks import Facts
from models.records.files import known_of
from models.records.plausible import doubts
from models.records.record import Record
from models.simulation.simulator import simulate
from studies.identify_machine import own_records

MACHINE = load()
GIVEN = {"time", "target", "reference", "feedforward", "command", "position"}
FACTS = Facts(
    mass=MACHINE.plant.mass,
    limit=MACHINE.drive.rated_thrust,
    resolution=MACHINE.scale.resolution,
    stiffness=float(sum(MACHINE.friction.stiffness)),
    friction=MACHINE.friction.coulomb_force,
)


@pytest.fixture(scope="module")
def records() -> Mapping[str, Record]:
    """A record of each kind of the paper's table."""
    table = own_records.noisy(MACHINE)
    made = {
        "excitation": own_records.excitation(table, 1),
        "hysteresis": own_records.hysteresis(table, 1),
        "motions": own_records.motions(table, 1),
    }
    return {**made, "short": made["motions"].part(0, 400)}


KINDS = ("excitation", "hysteresis", "motions", "short")
OF_THE_LOOP = replace(FACTS, pid=MACHINE.control.feedback, reference_delay=MACHINE.control.reference_delay)


@pytest.mark.parametrize("kind", KINDS)
def test_what_the_table_makes_is_not_doubted(kind: str, records: Mapping[str, Record]) -> None:
    assert list(doubts(records[kind], GIVEN, FACTS)) == []
    assert list(doubts(records[kind], GIVEN, OF_THE_LOOP)) == []


def test_an_axis_that_counts_against_its_command_is_told_how_to_turn_it(records: Mapping[str, Record]) -> None:
    """To a feedback of the error, beside a feedforward, it is the same as reference and position exchanged."""
    record = records["motions"]
    ahead = 5.0 * np.sign(np.sin(np.arange(record.position.size) / 300))
    record = replace(record, feedforward=record.feedforward + ahead, command=record.command + ahead)
    late = np.append(np.full(OF_THE_LOOP.reference_delay, record.reference[0]), record.reference)[: ahead.size]
    turned = replace(record, target=-record.target, reference=-late, position=-record.position)
    (told,) = (doubt for doubt in doubts(turned, GIVEN, replace(OF_THE_LOOP, reference_delay=0)) if "swapped" in doubt)
    assert 'turn both by "NAME * -1"' in told


SIGNALS = ("target", "reference", "feedforward", "command", "position")
HUNG = 2 * MACHINE.friction.coulomb_force  # N, which friction does not hold
HANGING = replace(MACHINE, drive=replace(MACHINE.drive, offset=HUNG))


def _strokes(machine: Machine, *turned: str) -> Record:
    """Strokes of an axis whose log has the sign of some signals turned."""
    record = own_records.motions(machine, 1, MACHINE)
    return replace(record, **{name: -getattr(record, name) for name in turned})


def test_an_axis_whose_log_counts_down_as_positive_is_told_by_the_force_that_it_holds() -> None:
    """No loop shows it. On a user's it had passed for a cause that is not in the catalogue, with twice the offset as
    unknown force."""
    facts = Facts(**known_of(HANGING))
    assert list(doubts(_strokes(HANGING), GIVEN, facts)) == []
    (told,) = doubts(_strokes(HANGING, *SIGNALS), GIVEN, facts)
    assert f"where the machine file has an offset of {show(HUNG, 'N', 3)}: all signs of the log look turned" in told
    assert 'turn each signal but the time by "NAME * -1"' in told
    (alone,) = doubts(_strokes(HANGING, "command"), GIVEN, facts)
    assert alone.startswith("the sign of the command looks turned")


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("turned", [("command",), ("command", "feedforward"), ("target", "reference", "position")])
def test_a_command_that_takes_energy_out_is_turned_whoever_made_it(turned: tuple[str, ...], factor: float) -> None:
    """A cascade's log without its feedforward had passed for a saturation of the whole thrust. The friction is hardly
    known: by a factor of two."""
    facts = replace(FACTS, friction=factor * MACHINE.friction.coulomb_force)
    rolls = _back_and_forth()
    assert list(doubts(rolls, GIVEN - {"feedforward"}, facts)) == []
    log = replace(rolls, **{name: -getattr(rolls, name) for name in turned})
    assert any("takes energy out of the axis" in doubt for doubt in doubts(log, GIVEN - {"feedforward"}, facts))


def test_a_path_that_ends_elsewhere_tells_nothing_of_the_sign() -> None:
    """A load that drives the axis gives its energy back only where it returns."""
    rolls = _back_and_forth()
    half = rolls.part(0, rolls.position.size // 8)
    assert abs(half.position[-1] - half.position[0]) > 0.1 * np.ptp(half.position)
    assert list(doubts(replace(half, command=-half.command), {"command", "position"}, FACTS)) == []


def _back_and_forth() -> Record:
    """Strokes that return, by a controller that nobody states."""
    t = MACHINE.sample_time * np.arange(8000)
    return simulate(MACHINE, MACHINE.feedback_only(), 5e-3 * np.sin(2 * np.pi * 0.5 * t), seed=1).record


@pytest.mark.parametrize("factor", [-0.5, 0.0, 0.5, 3.0])
def test_an_offset_that_is_another_one_is_no_turned_log(factor: float) -> None:
    facts = Facts(**known_of(HANGING))
    other = replace(HANGING, drive=replace(HANGING.drive, offset=factor * HUNG))
    assert list(doubts(_strokes(other), GIVEN, facts)) == []


@pytest.mark.parametrize(
    ("offset", "effects"),
    [
        (0.4 * HUNG, ()),  # less than the friction
        (HUNG, (CableSpring(0.6 * HUNG / MACHINE.specification.stroke),)),  # a spring may hold the axis
        (HUNG, (Cogging(0.6 * HUNG, 0.03, 0.0),)),
        (HUNG, (Measured("position", (0.0, 1.0), (0.0, 0.0)),)),
    ],
)
def test_where_something_else_may_hold_the_axis_no_log_looks_turned(offset: float, effects: tuple[Effect, ...]) -> None:
    stated = replace(HANGING, drive=replace(HANGING.drive, offset=offset), effects=effects)
    turned = _strokes(replace(HANGING, drive=stated.drive), *SIGNALS)
    assert not any("signs" in doubt for doubt in doubts(turned, GIVEN, Facts(**known_of(stated))))


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("signal", ["position", "reference"])
@pytest.mark.parametrize("kind", ["excitation", "hysteresis", "motions"])
def test_a_position_that_a_loop_can_not_have_kept_so_far_from_its_reference_is_doubted(
    kind: str, signal: str, factor: float, records: Mapping[str, Record]
) -> None:
    wrong = replace(records[kind], **{signal: factor * getattr(records[kind], signal)})
    assert any("times as far as the reference" in doubt for doubt in doubts(wrong, GIVEN, OF_THE_LOOP))


def test_a_loop_that_its_contacts_hold_has_no_swapped_columns() -> None:
    """Half the motion stays behind, creeping, so it is the command that goes with the reference; but it is rougher."""
    pid = PID(kp=0.3 * sum(MACHINE.friction.stiffness), ki=0.0, kd=200.0, derivative_filter=1e-3)
    soft = replace(MACHINE, control=replace(MACHINE.control, pid=pid))
    t = MACHINE.sample_time * np.arange(6000)
    record = simulate(soft, soft.feedback_only(), 5e-6 * np.sign(np.sin(2 * np.pi * 2 * t)), seed=1).record
    creep = np.cumsum(record.position) * 4.0 * MACHINE.sample_time  # as contacts give way in time
    record = replace(record, position=0.3 * record.position + creep - creep.mean())
    command, position = (np.corrcoef(record.reference, one)[0, 1] for one in (record.command, record.position))
    assert command > 0.9
    assert command > position + 0.2
    assert not any("swapped" in doubt for doubt in doubts(record, GIVEN, FACTS))


def test_slow_loops_without_a_control_have_no_swapped_columns() -> None:
    """Steps of 0.1 um at 20 kHz, of which one comes in 25 samples, had passed for the roughness of a force."""
    time = 5e-5 * np.arange(80_000)
    wave = np.sin(2 * np.pi * 0.5 * time)
    nothing, position = np.zeros(time.size), 1e-7 * np.round(40e-6 * wave / 1e-7)
    record = Record(5e-5, nothing, nothing, nothing, 8.0 * wave, position)
    given = {"time", "command", "position"}
    assert not any("swapped" in doubt for doubt in doubts(record, given, Facts()))
    noisy = 8.0 * wave + np.random.default_rng(1).standard_normal(time.size)
    turned = replace(record, command=position, position=noisy)
    assert any("swapped" in doubt for doubt in doubts(turned, given, Facts()))


def test_a_loop_that_is_too_soft_to_follow_is_not_doubted() -> None:
    """Against a spring, a controller without an integral stays behind by its share of the stiffness, as it says."""
    pid, reference = PID(1e4, 0.0, 0.0, 1e-3), 1e-5 * np.sin(np.arange(4000) / 100)
    position = 0.2 * reference
    record = Record(5e-4, reference, reference, np.zeros(4000), pid.kp * (reference - position), position)
    facts = Facts(pid=pid)
    assert list(doubts(record, GIVEN, facts)) == []
    assert any("times as far" in doubt for doubt in doubts(replace(record, position=10 * reference), GIVEN, facts))


def test_without_a_feedback_that_acts_a_position_may_go_its_own_way(records: Mapping[str, Record]) -> None:
    record = records["motions"]
    alone = replace(record, feedforward=record.command, position=2 * record.position)
    assert not any("as far as" in doubt for doubt in doubts(alone, GIVEN, OF_THE_LOOP))
    constant = replace(record, reference=np.zeros(record.position.size))
    assert not any("as far as" in doubt for doubt in doubts(constant, GIVEN, OF_THE_LOOP))


@pytest.mark.parametrize("factor", [1e-9, 1e-6, 1e6, 1e9])
@pytest.mark.parametrize("signals", [("position",), ("position", "reference", "target"), ("command", "feedforward")])
@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_wrong_by_a_million_is_doubted(
    kind: str, signals: tuple[str, ...], factor: float, records: Mapping[str, Record]
) -> None:
    wrong = replace(records[kind], **{name: factor * getattr(records[kind], name) for name in signals})
    assert any("unit" in doubt for doubt in doubts(wrong, GIVEN, FACTS))


def test_the_force_that_accelerates_an_axis_is_no_sign_that_friction_holds_it() -> None:
    """An air bearing: its cable chain gives way by 82 mm under what takes 18 kg over 20 um and back. A command that is
    a thousand times too large is told all the same."""
    ts, mass = 250e-6, 18.0
    s = np.linspace(0.0, 1.0, 80)
    there = 20e-6 * s**3 * (10 - 15 * s + 6 * s**2)
    once = np.concatenate([np.zeros(400), there, np.full(400, 20e-6), there[::-1]])
    way = np.tile(once, 6)
    force = mass * np.gradient(np.gradient(way, ts), ts) + 0.2 * np.sin(np.arange(way.size) / 300.0)
    record = Record(ts, way, way, force, force, way)
    facts = Facts(mass=mass, limit=300.0, resolution=5e-9, stiffness=133.0)
    assert np.ptp(force) / facts.stiffness > 1000 * np.ptp(way)
    assert list(doubts(record, GIVEN, facts)) == []
    wrong = replace(record, command=1e3 * force, feedforward=1e3 * force)
    assert any("unit" in doubt for doubt in doubts(wrong, GIVEN, replace(facts, limit=None)))


def test_a_force_that_the_file_does_not_have_is_no_wrong_unit() -> None:
    """A file that knows of 10 mN of friction, on an axis that cogging holds by 1.5 N; its strokes are short. A command
    that is a thousand times too large is told all the same, and a position that is as much too small."""
    ts = 250e-6
    way = 20e-6 * np.sin(np.arange(8000) * ts * 5.0)
    force = 1.5 * np.sin(2 * np.pi * np.arange(8000) * ts / 0.7)
    record = Record(ts, way, way, 0 * force, force, way)
    facts = Facts(mass=18.0, limit=300.0, resolution=5e-9, stiffness=70.0, friction=0.01)
    assert list(doubts(record, GIVEN, facts)) == []
    assert any("let it move by" in doubt for doubt in doubts(record, GIVEN, replace(facts, friction=None)))
    wrong = replace(record, command=1e3 * force)
    assert any("unit" in doubt for doubt in doubts(wrong, GIVEN, facts))
    held = replace(record, position=1e-3 * way, reference=1e-3 * way, target=1e-3 * way)
    assert any("let it move by" in doubt for doubt in doubts(held, GIVEN, replace(facts, stiffness=7e4, friction=1.0)))


def test_a_stated_spring_holds_an_axis_too() -> None:
    """A voice coil's stage on flexures of 15 N/mm, over a millimetre: the friction of its file alone would let it go
    by 20 m."""
    ts, spring = 125e-6, 15.35e3
    t = np.arange(8000) * ts
    way = 1e-3 * np.sin(2 * np.pi * 2 * t)
    record = Record(ts, way, way, 0 * way, spring * way, way)
    facts = Facts(mass=1.2, limit=72.0, resolution=5e-9, stiffness=spring + 1.5, friction=1e-5)
    assert list(doubts(record, GIVEN, facts)) == []
    assert any("state it as stiffness" in doubt for doubt in doubts(record, GIVEN, replace(facts, stiffness=1.5)))


def moved(mass: float, current: float, feedforward: float) -> Record:
    """A free mass [kg] under a PD that goes 20 mm there and back; the command and the feedforward are logged as so many
    times what they are."""
    ts, x, v, old = 5e-4, 0.0, 0.0, 0.0
    s = np.clip(np.linspace(-0.3, 1.3, 800), 0.0, 1.0)
    way = 20e-3 * s**3 * (10 - 15 * s + 6 * s**2)
    way = np.concatenate([way, way[::-1]])
    ahead = 0.8 * mass * np.gradient(np.gradient(way, ts), ts)
    position, thrust = np.zeros(way.size), np.zeros(way.size)
    for k in range(way.size):
        position[k], error = x, way[k] - x
        thrust[k] = mass * (3600.0 * error + 84.0 * (error - old) / ts) + ahead[k]
        old = error
        x, v = x + ts * v + 0.5 * ts**2 * thrust[k] / mass, v + ts * thrust[k] / mass
    return Record(ts, way, way, feedforward * ahead, current * thrust, position)


def test_a_position_in_counts_is_called_that(records: Mapping[str, Record]) -> None:
    record = records["motions"]
    counts = replace(record, position=record.position / MACHINE.scale.resolution)
    told = next(one for one in doubts(counts, GIVEN, FACTS) if "as far as" in one)
    step = f"{show(MACHINE.scale.resolution, 'm')}"
    assert f"as it would in counts of {step}: the unit of one of them is wrong; give it, as in" in told
    assert told.endswith(f'"NAME * {step}"')


@pytest.mark.parametrize("of_feedforward", [1.0, 1 / 42])
def test_a_command_in_amperes_is_told_by_the_controller_and_the_mass(of_feedforward: float) -> None:
    mass = 18.0
    pid = PID(3600.0 * mass, 0.0, 84.0 * mass, 0.0)
    facts = Facts(pid=pid, mass=mass, limit=300.0, sample_time=5e-4)
    record = moved(mass, 1.0, 1.0)
    assert list(doubts(record, GIVEN, facts)) == []
    (told,) = doubts(moved(mass, 1 / 42, of_feedforward), GIVEN, facts)
    assert told.startswith("the command is 0.02381 times what the stated controller makes, and moves 0.4")
    assert told.endswith('one of its units is 42 N; give the factor, as in "NAME * 42 N"')
    # The controller's gains in another unit are not the log's fault, and the mass says so.
    soft = replace(facts, pid=PID(3600.0 * mass / 42, 0.0, 2.0 * mass, 0.0))
    assert not any("one of its units" in doubt for doubt in doubts(record, GIVEN, soft))


@pytest.mark.parametrize("kind", KINDS)
def test_the_machine_s_own_units_do_not_matter(kind: str, records: Mapping[str, Record]) -> None:
    """The same table a thousand times as large in way and force, and so as heavy, makes what it makes."""
    record = records[kind]
    large = {
        name: 1e3 * getattr(record, name) for name in ("target", "reference", "feedforward", "command", "position")
    }
    ten = replace(record, **large)
    facts = replace(FACTS, limit=1e3 * MACHINE.drive.rated_thrust, resolution=1e3 * MACHINE.scale.resolution)
    assert list(doubts(ten, GIVEN, facts)) == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("length", [1, 10_000])
def test_a_jump_that_no_thrust_makes_is_doubted_with_its_place(
    length: int, kind: str, records: Mapping[str, Record]
) -> None:
    position = records[kind].position.copy()
    position[300 : 300 + length] += 0.1
    jumped = replace(records[kind], position=position)
    doubt = next(doubt for doubt in doubts(jumped, GIVEN, FACTS) if "jumps" in doubt)
    assert "the position jumps by 100 mm at 150 ms after the start (row 301, line 302 of a CSV)" in doubt
    assert "150 N move 44.74 kg by less than" in doubt
    small = position.copy()
    small[300 : 300 + length] -= 0.1 - 5e-6  # a count that is lost, which is to be diagnosed
    assert list(doubts(replace(jumped, position=small), GIVEN, FACTS)) == []


def test_samples_that_a_logger_repeated_are_doubted_with_their_place() -> None:
    """While the table moves at its fastest, position and command stand for 20 samples and then go on."""
    target = np.concatenate([np.zeros(200), 0.02 * (1 - np.cos(np.linspace(0, np.pi, 600))) / 2, np.full(200, 0.02)])
    record = simulate(MACHINE, MACHINE.feedback_only(), target, seed=1).record
    assert not any("stand still" in doubt for doubt in doubts(record, GIVEN, FACTS))
    held = {name: getattr(record, name).copy() for name in ("position", "command")}
    for signal in held.values():
        signal[500:520] = signal[500]
    (doubt,) = (doubt for doubt in doubts(replace(record, **held), GIVEN, FACTS) if "stand still" in doubt)
    assert "stand still for 20 samples from 250 ms after the start on (row 501, line 502 of a CSV)" in doubt
    assert "at once, once: the log repeats old samples" in doubt
    slower = replace(FACTS, sample_time=record.sample_time / 4)  # between whose samples a motion may begin and end
    assert not any("stand still" in doubt for doubt in doubts(replace(record, **held), GIVEN, slower))
    lost = replace(record, **held, reference=np.full(record.position.size, 0.01))  # at rest, a count may be lost
    assert not any("stand still" in doubt for doubt in doubts(lost, GIVEN, FACTS))
    position = replace(record, position=held["position"])  # whose command goes on: the axis may stick
    assert not any("stand still" in doubt for doubt in doubts(position, GIVEN, FACTS))


def test_samples_that_are_missing_are_doubted_where_only_the_rows_are_counted() -> None:
    """Of a user's log 40 were lost, and its time was mapped to the rows: 358 um between steps of 13."""
    target = np.concatenate([np.zeros(200), 0.02 * (1 - np.cos(np.linspace(0, np.pi, 1200))) / 2, np.full(200, 0.02)])
    record = simulate(MACHINE, MACHINE.feedback_only(), target, seed=1).record
    names = ("target", "reference", "feedforward", "command", "position")

    def without(lost: slice) -> list[str]:
        left = Record(record.sample_time, *(np.delete(getattr(record, name), lost) for name in names))
        return [doubt for doubt in doubts(left, GIVEN, FACTS) if "samples are missing" in doubt]

    (doubt,) = without(slice(800, 840))
    assert "beside it, 400 ms after the start (row 801, line 802 of a CSV), once: samples are missing" in doubt
    assert without(slice(0, 0)) == []
    position = record.position.copy()
    position[1500:] += 1e-3
    counts = replace(record, position=position)  # that the scale lost at rest: they are to be diagnosed
    assert not any("samples are missing" in doubt for doubt in doubts(counts, GIVEN, FACTS))


def test_without_knowing_the_machine_nothing_is_doubted_by_it(records: Mapping[str, Record]) -> None:
    position = records["motions"].position.copy()
    position[300:] += 0.1
    assert not any("jumps" in doubt for doubt in doubts(replace(records["motions"], position=position), GIVEN, Facts()))
