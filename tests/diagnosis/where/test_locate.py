"""Where: the unknown force's band, the floor, coordinates and sides of known causes, the controller's replay."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.experiments.schedules import Move, multisine, schedule
from diagnosis.model.fit import weights
from diagnosis.model.kalman import SUBSTEPS, discretised, predictor, smoothed
from diagnosis.records.motions import MotionKind, numbered, pieces, repeated
from diagnosis.where.controller import _scaled, replayed
from diagnosis.where.coordinates import Coordinate, coordinates, explain, parity, periodogram, pitches, since_turn
from diagnosis.where.energy import PHASES, Samples, label_samples, shares, wavelengths
from diagnosis.where.force import FAST_WALK, REACH, SLOW_WALK, steady_deviation
from diagnosis.where.locate import Where, locate
from diagnosis.where.sentences import Topic, statements
from diagnosis.where.serialise import pictures, to_json
from diagnosis.where.side import force_or_reading, sides
from diagnosis.which.detectors.scan import partial_out
from models.records.checks import replay
from models.records.record import Record
from studies.command import to_text
from tests.diagnosis.where.cases import case, fitted, run, schedules, table

Array = NDArray[np.float64]
WHITE_FORCE = 0.08  # N
NOISE = 4e-8


def answers(name: str) -> Where:
    records, fit = case(name)
    return locate(fit, records, pieces(records))


@pytest.fixture(scope="module")
def relaxing() -> Where:
    return answers("friction_relaxation")


def samples(motions: int, length: int) -> Samples:
    """Motions of equal length, to and fro, all in one phase."""
    number = np.repeat(np.arange(motions), length)
    return Samples(
        number,
        np.full(number.size, PHASES.index("cruise")),
        np.zeros(number.size, np.int64),
        (MotionKind(1e-5, 1e-3),),
        np.where(number % 2 == 0, 1.0, -1.0),
        np.ones(number.size, bool),
    )


def test_an_error_of_the_scale_that_turns_with_the_motion_is_no_force_for_certain() -> None:
    """0.3 µm times the direction: curves that turn with it describe the reading as well as they do the force."""
    record = case("")[0][1]
    way = np.sign(np.gradient(record.reference))
    way = way[np.maximum.accumulate(np.where(way != 0, np.arange(way.size), 0))]
    off = [replace(record, position=record.position + 0.3e-6 * np.convolve(way, np.full(20, 1 / 20), "same"))]
    fit, known = fitted(table(), off), pieces(off)
    motion = numbered(known, off)
    labels = label_samples(off, known, motion, weights(off), 0.025)
    (place,) = (one for one in coordinates(fit, off, labels) if one.name == "position")
    found = sides(fit, off, partial_out(fit, motion), [place], labels)
    assert force_or_reading(found) == "either"


@pytest.mark.parametrize(
    ("force", "even", "odd"),
    [
        (np.sign, 0.0, 1.0),
        (lambda v: np.sign(v) + 3 * v, 0.0, 1.0),
        (np.abs, 1.0, 0.0),
        (lambda v: np.sign(v) + 50 * (np.abs(v) - 0.055), 0.63, 0.37),
    ],
    ids=["sign", "sign and viscous", "even", "both"],
)
def test_what_turns_with_the_speed_is_odd_though_it_does_not_depend_on_its_size(
    force: Callable[[Array], Array], even: float, odd: float
) -> None:
    """Shares of one energy: of a Coulomb force with a part over |v| of variance 50² 0.09² / 12 they sum up to 1."""
    motions = samples(240, 20)
    speed = motions.direction * np.random.default_rng(0).uniform(0.01, 0.1, motions.direction.size)
    found = parity(force(speed), Coordinate("velocity", "m/s", speed, logarithmic=True), motions)
    assert [one.share for one in found] == pytest.approx([even, odd], abs=0.03)


@pytest.mark.parametrize("walk", [SLOW_WALK * WHITE_FORCE, 0.05])
def test_the_band_holds_a_force_that_walks_as_assumed(walk: float) -> None:
    """The reading of a force that walks by exactly `walk`, through the linear table: 95 % within 1.96 deviations."""
    machine, n = table(), 20000
    draw = np.random.default_rng(1)
    a, b, c = discretised(machine.plant, machine.sample_time)
    state, force, reading = np.zeros(c.size), np.empty(n), np.empty(n)
    for k in range(n):
        force[k], reading[k] = state[-1], c @ state + NOISE * draw.standard_normal()
        state = a @ state + b.sum(axis=1) * WHITE_FORCE * draw.standard_normal()
        state[-1] += walk * draw.standard_normal()
    model = predictor(machine.plant, machine.sample_time, walk=walk, noise=NOISE, white_force=WHITE_FORCE)
    found = smoothed(model, np.zeros((n, SUBSTEPS)), reading, np.zeros(c.size))[:, -1]
    band = steady_deviation(machine.plant, machine.sample_time, walk=walk, noise=NOISE, white_force=WHITE_FORCE)
    error = (found - force)[1000:-1000] / band
    assert np.mean(np.abs(error) < 1.96) == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("walk", [SLOW_WALK * WHITE_FORCE, FAST_WALK * WHITE_FORCE])
def test_the_steady_deviation_is_the_sum_of_what_each_noise_does(walk: float) -> None:
    """By the smoother's answers to one reading, one push and one step of the force, far from the ends."""
    plant, ts = table().plant, table().sample_time
    model = predictor(plant, ts, walk=walk, noise=NOISE, white_force=WHITE_FORCE)
    n, still = 2 * REACH + 1, np.zeros(model.C.size)
    reading, push, step = np.zeros(n), np.zeros((n, SUBSTEPS)), np.zeros((n, SUBSTEPS))
    reading[REACH], push[REACH], step[REACH:] = 1.0, 1.0, 1.0
    read = smoothed(model, 0 * push, reading, still)[:, -1]
    pushed = smoothed(model, push, 0 * reading, still)[:, -1]
    left = smoothed(model, step, 0 * reading, still)[:, -1] + (np.arange(n) >= REACH)
    total = np.sqrt(NOISE**2 * read @ read + WHITE_FORCE**2 * pushed @ pushed + walk**2 * left @ left)
    assert steady_deviation(plant, ts, walk=walk, noise=NOISE, white_force=WHITE_FORCE) == pytest.approx(
        total, rel=0.01
    )


def test_nothing_wrong_leaves_no_more_than_noise() -> None:
    found = answers("")
    assert found.deviation < 1.2 * found.unknown.noise
    assert force_or_reading(found.sides) == "neither"
    assert "there is no force to locate" in statements(found)[0].text
    assert all(one.share < 0.1 for one in found.dependence.coordinates if one.p < 0.02)


def test_a_force_that_decays_at_rest_depends_on_the_time_since_the_start_and_turns(relaxing: Where) -> None:
    best = relaxing.coordinate
    assert best.name == "time_in_motion"
    assert best.turning > 0.5 * best.share > 0.05
    assert force_or_reading(relaxing.sides) == "force"
    assert relaxing.deviation > 10 * relaxing.unknown.noise
    assert relaxing.unknown.floor.repeats is not None
    assert relaxing.unknown.floor.repeats > 0.5


def test_what_depends_on_the_place_is_found_with_its_pitch() -> None:
    found = answers("cogging")
    pitch = next(one for one in found.dependence.coordinates if one.name == "pitch")
    assert found.coordinate.name in {"pitch", "position"}
    assert pitch.share > 0.8
    assert pitch.p < 0.02
    assert pitch.turning < 0.1
    travel = np.ptp(next(one for one in found.coordinates if one.name == "position").values[found.samples.counts])
    others = [one for one in found.dependence.coordinates if one.name not in {"pitch", "position"}]
    for factor, words in ((0.49, "The position modulo"), (0.51, "does not show to repeat"), (1.2, "as a sine with")):
        along = replace(found.dependence, coordinates=(replace(pitch, pitch=factor * travel), *others))
        told = next(one.text for one in statements(replace(found, dependence=along)) if one.topic == Topic.COORDINATE)
        assert words in told, "what does not repeat within the travel is not periodic"
    turning = next(
        one for one in answers("position_dependent_friction").dependence.coordinates if one.name == "position"
    )
    assert turning.turning > 0.5 * turning.share > 0.2


def test_what_depends_on_the_speed_is_odd_in_it() -> None:
    even, odd = answers("viscous_friction").dependence.parity
    assert odd.share > 0.9
    assert even.share < 0.1


def test_an_error_of_the_scale_is_told_from_a_force() -> None:
    found = answers("scale_periodic_error")
    assert force_or_reading(found.sides) == "scale"
    fine = next(one for one in found.sides if one.coordinate == "fine period")
    assert fine.pitch == pytest.approx(np.sqrt(4e-6 * 4e-5), rel=0.01)
    assert fine.reading > 10 * fine.force


def test_shares_add_up_and_lie_in_their_intervals(relaxing: Where) -> None:
    for found in (relaxing.energy.motion, relaxing.energy.phase, relaxing.energy.band, relaxing.energy.wavelength):
        assert found.share.sum() == pytest.approx(1)
        assert np.all((found.low <= found.share) & (found.share <= found.high))
    assert relaxing.energy.motion.time.sum() == pytest.approx(1)
    assert relaxing.energy.motion_and_phase.share.reshape(-1, len(PHASES)).sum(axis=0) == pytest.approx(
        relaxing.energy.phase.share, abs=0.01
    )


def test_the_json_has_the_agreed_keys_and_is_one(relaxing: Where) -> None:
    plain = json.loads(to_text(to_json(relaxing)))
    assert set(plain) >= {"by_motion", "by_phase", "by_band_Hz", "by_coordinate", "statements"}
    assert sum(plain["by_motion"].values()) == pytest.approx(1)
    assert {"time", "position", "velocity", "acceleration", "command", "since_reversal", "dwell"} <= set(
        plain["by_coordinate"]
    )
    assert all(low < high for low, high, _ in plain["by_band_Hz"])
    records, fit = case("friction_relaxation")
    shown = json.loads(to_text(pictures(relaxing, fit.candidate, records, pieces(records))))
    assert len(shown["force"]) == len(records)
    assert shown["courses"][0]["name"].startswith("moves of ")


def test_the_same_seed_gives_the_same_numbers(relaxing: Where) -> None:
    assert to_text(to_json(relaxing)) == to_text(to_json(answers("friction_relaxation")))


def test_energy_lies_where_it_was_put() -> None:
    """Four of five motions quiet, one with a force of 1 N: noise is taken off, the rest is all of that motion's."""
    known = samples(5, 400)
    draw = np.random.default_rng(0)
    force = 0.1 * draw.standard_normal(2000) + (known.motion == 3)
    found = shares(force**2, 0.01, known.motion, [str(i) for i in range(5)], known)
    assert found.share[3] == pytest.approx(1, abs=0.02)
    assert found.deviation[3] == pytest.approx(np.sqrt(1.01), rel=0.02)


def test_a_coordinate_explains_what_depends_on_it_and_chance_nothing() -> None:
    known = samples(24, 200)
    draw = np.random.default_rng(2)
    value, other = draw.uniform(-1, 1, (2, 4800))
    noise = draw.standard_normal(4800)
    signal = np.sin(3 * value) + noise
    expected = 1 - float(np.var(noise) / np.var(signal))
    found = explain(signal, Coordinate("x", "m", value), known)
    assert found.share == pytest.approx(expected, abs=0.03)
    assert found.low < expected < found.high
    assert found.p < 0.01
    assert explain(signal, Coordinate("y", "m", other), known).share < 0.01
    both = Coordinate("x", "m", value, turns=known.direction)
    turned = explain(known.direction * np.sin(3 * value) + noise, both, known)
    assert turned.turning == pytest.approx(turned.share, abs=0.02)


def test_a_way_since_a_reversal_begins_where_the_table_turned_and_not_where_its_reading_trembles() -> None:
    steps = np.arange(60.0)
    path = np.concatenate([steps, 60 - steps[:40], 20 + steps[:10]])
    trembling = path + 0.4 * (-1.0) ** np.arange(path.size)
    gone, way = since_turn(trembling, 0.5)
    assert [way[5], way[50], way[70], way[105]] == [1, 1, -1, 1]
    assert np.count_nonzero(np.diff(way[5:])) == 2
    assert gone[55] == pytest.approx(55, abs=1.5)
    assert gone[90] == pytest.approx(30, abs=1.5)
    assert gone[108] == pytest.approx(8, abs=1.5)


def test_a_hysteresis_over_the_command_is_explained_by_the_command_and_its_branch() -> None:
    """The backlash's place less the command, which no single curve over the command has."""
    known = samples(24, 200)
    command = np.sin(2 * np.pi * np.arange(4800) / 130) * np.repeat(np.random.default_rng(3).uniform(0.5, 1, 24), 200)
    gone, branch = since_turn(command, 0.02)
    lags = -0.2 * branch * (1 - np.exp(-gone / 0.1))
    alone = explain(lags, Coordinate("command", "N", command), known)
    branched = explain(lags, Coordinate("command", "N", command, turns=branch), known)
    assert branched.share > 0.6
    assert alone.share < 0.2


def test_a_periodogram_is_what_sines_of_the_place_take_off() -> None:
    """Against least squares with a sine, a cosine and a constant, period by period."""
    known, draw = samples(10, 100), np.random.default_rng(4)
    place = np.cumsum(draw.standard_normal(1000))
    place *= 0.05 / np.ptp(place)
    signal = np.cos(2 * np.pi * place / 0.011) + draw.standard_normal(1000)
    signal -= np.mean(signal)
    inverse, gain = periodogram(signal, place, known, np.ones(10, bool))
    width = pitches(known)[0] / 8
    middle = place.min() + (np.floor((place - place.min()) / width) + 0.5) * width
    for i in range(0, inverse.size, 7):
        angle, gains = 2 * np.pi * inverse[i] * middle, [0.0]
        basis = np.column_stack([np.ones(1000), np.cos(angle), np.sin(angle)])
        for z in (signal, signal * known.direction):
            onto = basis.T @ z
            gains.append(onto @ np.linalg.solve(basis.T @ basis + np.eye(3), onto) - onto[0] ** 2 / 1000)
        assert gain[i] == pytest.approx(max(gains), abs=1e-9 * np.sum(signal**2))


def test_what_no_coordinate_explains_has_a_size_that_one_does_or_a_course_of_its_own(relaxing: Where) -> None:
    nothing = tuple(replace(one, p=0.5) for one in relaxing.gap)
    of_speed = replace(relaxing.gap[0], name="velocity", p=0.005, share=0.3)
    scatter = (replace(of_speed, name="command_change"), of_speed)
    at_random = replace(relaxing, gap=nothing, course=0.4)
    sized = replace(at_random, dependence=replace(relaxing.dependence, scatter=scatter))
    alone = replace(at_random, dependence=replace(relaxing.dependence, scatter=()))
    little = 0.5 * relaxing.criteria.stated_share  # more than chance, and too little to be told
    some = tuple(replace(of_speed, share=little) if one.name == "velocity" else one for one in nothing)
    steady = replace(alone, gap=some, course=0.0)
    noisy = replace(sized, unknown=replace(relaxing.unknown, noise=10.0 * relaxing.deviation))
    assert noisy.is_noise
    for where, expected in (
        (sized, {"velocity": 0.3}),
        (alone, {"time": 0.4}),
        (steady, {"velocity": little}),
        (replace(steady, course=0.4), {"time": 0.4}),
        (noisy, {"velocity": 0.3}),
    ):
        assert {name: share for name, share in where.by_coordinate.items() if share} == expected
    assert max(relaxing.by_coordinate.values()) == max(one.share for one in relaxing.gap if one.p < 0.02)


def test_pushes_at_random_times_have_a_course_of_their_own_and_a_cogging_depends_on_the_position() -> None:
    machine, draw, pushed = table(), np.random.default_rng(5), []
    for record in case("")[0]:
        kicks = draw.standard_normal(record.position.size) * (draw.random(record.position.size) < 2e-3)
        push = np.convolve(kicks, np.exp(-np.arange(200) / 40))[: kicks.size]
        pushed.append(replace(record, command=record.command - 2.0 * push))
    found = locate(fitted(machine, pushed), pushed, pieces(pushed)).by_coordinate
    assert max(found, key=lambda name: found[name]) == "time"
    cogging = answers("cogging").by_coordinate
    assert max(cogging, key=lambda name: cogging[name]) in {"position", "pitch"}


def test_chance_is_as_often_below_each_p_value_as_that_says() -> None:
    """Slow forces that have nothing to do with the coordinate: p below 0.1 in about a tenth of all."""
    known = samples(20, 50)
    draw = np.random.default_rng(3)
    value = Coordinate("x", "m", np.tile(np.linspace(-1, 1, 50), 20), turns=known.direction)
    found = []
    for _ in range(60):
        walks = np.cumsum(draw.standard_normal((20, 50)), axis=1)
        found.append(explain(walks.ravel() * draw.choice([-1, 1], 20).repeat(50), value, known).p)
    assert 0.02 <= np.mean(np.array(found) < 0.1) <= 0.22


def test_phases_follow_the_reference() -> None:
    machine = table()
    records = run(machine, (), schedules(machine)[1:])
    known = pieces(records)
    number = np.concatenate([np.full(piece.stop - piece.start, i) for i, piece in enumerate(known)])
    found = label_samples(records, known, number, np.ones(number.size), 0.025)
    speed = np.abs(np.gradient(records[0].reference))
    moving = found.phase < PHASES.index("settle")
    assert np.all(speed[moving] > 0)
    assert np.max(speed[~moving]) < 0.02 * np.max(speed)
    rising = found.phase == PHASES.index("accelerate")
    assert np.all(np.gradient(speed)[rising] > 0)


def test_parts_of_one_multisine_do_not_repeat_each_other() -> None:
    machine = table()
    records = run(machine, (), [multisine(machine, duration=4.0)])
    assert len(pieces(records)) == 3
    assert not repeated(pieces(records), records)


def test_without_repeats_the_floor_is_of_the_innovations_and_it_is_said() -> None:
    machine = table()
    moves = [Move(5e-6, 0.03, 0.2), Move(20e-6, 0.03, 0.4), Move(-50e-6, 0.05, 0.3), Move(2e-3, 0.2, 0.3)]
    records = run(machine, (), [schedule("no two alike", machine, moves)])
    assert not repeated(pieces(records), records)
    found = locate(fitted(machine, records), records, pieces(records))
    assert found.unknown.floor.source == "innovations"
    assert found.unknown.floor.repeats is None
    assert found.unknown.floor.position < 2 * machine.scale.resolution
    assert "No motion is repeated" in statements(found)[-1].text


@pytest.fixture(scope="module")
def record() -> Record:
    return case("")[0][1]


def test_the_controller_that_made_the_record_replays(record: Record) -> None:
    found = replayed(table(), record)
    assert found.replays
    assert found.largest < 1e-9


@pytest.mark.parametrize("shift", [-1, 2])
def test_a_shifted_command_is_found_with_its_shift(record: Record, shift: int) -> None:
    found = replayed(table(), replace(record, command=np.roll(record.command, shift)))
    assert not found.replays
    assert found.departs is not None
    when = f"{abs(shift)} sample{'s' * (abs(shift) > 1)} {'late' if shift > 0 else 'early'}"
    assert found.remedy == f"the command logged {when}"
    assert found.remains < 1e-3 * found.rms


def test_a_command_that_is_logged_in_another_unit_is_said_to_be(record: Record) -> None:
    amps = replayed(table(), replace(record, command=record.command / 42))
    assert amps.remedy == "the whole command times 0.02381, as where one of the log's units is 42 N"
    assert amps.remains < 1e-3 * amps.rms
    degrees = replayed(table(), replace(record, command=np.deg2rad(record.command)))
    assert str(degrees.remedy).endswith(
        "one of the log's units is 57.3 N, or where angles in degrees were read as radians"
    )


@pytest.mark.parametrize(("factors", "unit"), [((10.0, 10.0), True), ((10.0, 8.0), False), ((1.01, 1.01), False)])
def test_parts_that_are_off_by_one_factor_are_another_unit(
    record: Record, factors: tuple[float, float], unit: bool
) -> None:
    """P, I and D were "times 10, 10 and 10" of a log whose command had a factor of 10."""
    rng = np.random.default_rng(1)
    columns = [rng.standard_normal(record.position.size) for _ in factors]
    logged = sum(factor * column for factor, column in zip(factors, columns, strict=True))
    told, left = _scaled(replace(record, command=np.asarray(logged)), np.sum(columns, axis=0), "the parts", columns, 0)
    assert ("as where one of the log's units is 0.1 N" in told) == unit
    assert left < 1e-9


def test_a_feedforward_that_is_not_logged_is_told_by_its_mass() -> None:
    machine, ts, length = table(), table().sample_time, 4000
    s = np.clip((np.arange(length) % 1000 - 200) / 300.0, 0.0, 1.0)
    way = 1e-3 * s**3 * (10 - 15 * s + 6 * s**2)
    thrust = 45.0 * np.gradient(np.gradient(way, ts), ts)
    made = Record(ts, way, way, thrust, np.zeros(length), way - 1e-6 * np.sin(np.arange(length) / 50.0))
    control = machine.control
    made = replace(made, command=replay(made, control.feedback, control.reference_delay))
    assert replayed(machine, made).replays
    found = replayed(machine, replace(made, feedforward=np.zeros(length)))
    assert found.remedy == "a feedforward of 45 kg times the reference's acceleration (the log has none)"
    assert found.remains < 0.01 * found.rms


def test_another_delay_and_another_gain_are_found(record: Record) -> None:
    machine = table()
    control = machine.control
    later = replace(machine, control=replace(control, reference_delay=control.reference_delay + 1))
    assert replayed(later, record).remedy == (
        f"a reference delay of {control.reference_delay} samples instead of {control.reference_delay + 1}"
    )
    stronger = replace(machine, control=replace(control, pid=replace(control.pid, ki=1.25 * control.pid.ki)))
    found = replayed(stronger, record)
    assert found.remedy == "the proportional, integral and derivative part times 1, 0.8 and 1"
    assert found.rms > 0.1


def test_a_reading_rounded_after_the_controller_saw_it_is_no_other_law(record: Record) -> None:
    step = table().scale.resolution
    draw = np.random.default_rng(4)
    rounded = replace(record, position=record.position + draw.uniform(-step / 2, step / 2, record.position.size))
    found = replayed(table(), rounded)
    assert found.replays
    assert 0.1 < found.rms < found.largest < found.tolerance
    machine = table()
    control = machine.control
    for pid in (
        replace(control.pid, kd=1.05 * control.pid.kd),
        replace(control.pid, kp=1.05 * control.pid.kp),
        replace(control.pid, derivative_filter=4 * control.pid.derivative_filter),
    ):
        other = replace(machine, control=replace(control, pid=pid))
        assert not replayed(other, record).replays
    coarser = replace(rounded, position=record.position + 5 * (rounded.position - record.position))
    assert not replayed(table(), coarser).replays, "so much noise is no rounding"


def test_another_filter_is_found(record: Record) -> None:
    machine = table()
    control = machine.control
    slower = replace(control.pid, derivative_filter=2 * control.pid.derivative_filter)
    found = replayed(replace(machine, control=replace(control, pid=slower)), record)
    assert found.remedy == "the derivative's filter 0.5 times as slow"
    assert found.remains < 1e-6


def test_a_controller_that_does_not_replay_comes_first(record: Record) -> None:
    records, fit = case("")
    wrong = (records[0], replace(record, command=np.roll(record.command, 1)))
    found = locate(fit, wrong, pieces(wrong))
    assert "did not make record 2" in statements(found)[0].text
    assert "1 sample late" in statements(found)[0].text


def test_a_record_without_a_reference_can_not_be_replayed(record: Record) -> None:
    nothing = np.zeros_like(record.reference)
    found = replayed(table(), replace(record, target=nothing, reference=nothing))
    assert not found.checked
    assert found.replays


@pytest.mark.parametrize(("way", "longest"), [(70e-3, 1e-2), (70e-6, 1e-5), (6.0, 1.0)])
def test_wavelengths_are_told_apart_in_decades_of_the_way(way: float, longest: float) -> None:
    """Of a table, of a stage of a few microns and of a turn in rad alike; without a way nothing is told apart."""
    edges = wavelengths(np.array([0.1, 0.1 + way, 0.1]))
    assert edges == pytest.approx([longest / 1000, longest / 100, longest / 10, longest])
    assert wavelengths(np.full(5, 0.1)) == ()
