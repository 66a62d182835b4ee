"""Replays of controllers of every structure, and the structure that is named where the stated one does not replay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.where.controller import replayed, starting
from diagnosis.where.structure import MAX_FITTED_SAMPLES, judged_samples, structure
from models.controller import PID
from models.feedback.forms import NO_FILTERS, Cascade, Filters, LowPass, Notch
from models.machine import Machine
from models.records.record import Record
from models.simulation.simulator import simulate
from tests.models.feedback.axis import CASCADE, FILTERS, TS, axis

BARE = Cascade(85.0, 4000.0, 12e-3)


def moves(count: int = 3000) -> np.ndarray:
    """Smooth strokes of two lengths to and fro, with rests."""
    noise, path = np.random.default_rng(0), [np.zeros(80)]
    while sum(map(len, path)) < count:
        share = np.linspace(0, 1, noise.integers(40, 200))
        stroke = noise.choice([20e-6, -20e-6, 1e-3, -1e-3]) * share**3 * (10 - 15 * share + 6 * share**2)
        path += [path[-1][-1] + stroke, np.full(noise.integers(50, 150), path[-1][-1] + stroke[-1])]
    return np.concatenate(path)[:count]


def recorded(machine: Machine, noise: float = 5e-9, count: int = 3000) -> Record:
    """What the machine does under its own controller, with a scale that rounds and is noisy."""
    noisy = replace(machine, scale=replace(machine.scale, noise=noise))
    return simulate(noisy, machine.feedback_only(), moves(count), seed=1).record


def under(pid: PID, reference_delay: int = 0) -> Machine:
    machine = axis(None)
    return replace(machine, control=replace(machine.control, pid=pid, reference_delay=reference_delay))


def rounded(record: Record) -> Record:
    """As a log with three decimals of a micrometre and two of a newton has it."""
    return replace(record, position=np.round(record.position, 8), command=np.round(record.command, 2))


@pytest.mark.parametrize("filters", [NO_FILTERS, FILTERS], ids=["", "filters"])
@pytest.mark.parametrize("anti_windup", [0.0, 2e-3])
def test_the_machine_s_own_law_replays_also_from_the_middle_and_at_the_rating(
    filters: Filters, anti_windup: float
) -> None:
    machine = axis(filters=filters, anti_windup=anti_windup)
    limited = replace(machine, drive=replace(machine.drive, rated_thrust=60.0 if anti_windup else 1e4))
    record = recorded(limited)
    assert np.count_nonzero(np.abs(record.command) == 60.0) > 50 or not anti_windup
    assert replayed(limited, record).replays
    assert replayed(limited, record.part(40 if anti_windup else 700, 3000)).replays
    assert not replayed(axis(replace(CASCADE, position_gain=86.0)), record).replays


def test_a_slow_filter_s_state_before_the_record_accuses_no_controller() -> None:
    """A record that begins in motion, on machines with a derivative filter of up to 20 samples."""
    for samples in (1, 6, 20):
        machine = under(PID(3e5, 2e7, 4e3, samples * TS))
        assert starting(machine.control.pid, TS) >= 60
        assert replayed(machine, recorded(machine).part(300, 3000)).replays


FITS = {
    "a cascade": (axis(BARE), "a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms"),
    "its speed filtered": (
        axis(replace(CASCADE, velocity_filter=0.5e-3, velocity_feedforward=0.8)),
        "a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms, a velocity filter of 500 µs, 80 % of velocity feedforward, "
        "an acceleration feedforward of 12 kg",
    ),
    "full feedforward": (
        axis(),
        "a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms, 100 % of velocity feedforward, an acceleration feedforward of "
        "12 kg (or 83.33 1/s and 11.76 ms, which makes the same commands)",
    ),
    "no integral": (axis(replace(BARE, integral_time=0.0)), "a P/PI cascade with 85 1/s, 4000 N s/m"),
    "a late PID": (
        under(PID(3e5, 2e7, 4e3, 0.3e-3), 2),
        "a PID with 300 N/mm, 2e+07 N/(m s), 4000 N s/m, a derivative filter of 300 µs, its reference 2 samples late",
    ),
    "a PID with weights": (
        under(PID(3e5, 2e7, 4e3, 0.3e-3, 0.5, 0.0)),
        "a PID with 300 N/mm, 2e+07 N/(m s), 4000 N s/m, a derivative filter of 300 µs, set-point weights of 0.5 and 0",
    ),
}


@pytest.mark.parametrize("case", FITS)
def test_the_structure_that_made_a_record_is_named_with_its_figures(case: str) -> None:
    machine, words = FITS[case]
    record = recorded(machine)
    found = structure(record, 60)
    assert found is not None
    assert found.words == words
    assert found.leaves < 1e-6 * float(np.std(record.command))


def test_a_coarse_scale_excuses_no_other_filter() -> None:
    """Its rounding makes more noise of the command than the filter changes it, but is not what another law undoes."""
    coarse = 4e-7
    stated = axis(replace(CASCADE, velocity_filter=0.475e-3))
    stated = replace(stated, scale=replace(stated.scale, resolution=coarse))
    filtered = axis(replace(CASCADE, velocity_filter=0.5e-3))
    record = recorded(replace(filtered, scale=stated.scale))
    assert not replayed(stated, record).replays
    assert replayed(stated, record).other is not None
    own = recorded(stated)
    draw = np.random.default_rng(1).uniform(-coarse / 2, coarse / 2, own.position.size)
    late = replayed(stated, replace(own, position=own.position + draw))
    assert late.replays
    assert late.rms > replayed(stated, record).rms


def test_noise_of_the_log_that_is_not_everywhere_is_what_it_is_where_a_structure_is_fitted() -> None:
    """A log of ten digits has coarser steps far from zero; two drawn machines had been accused of their controllers."""
    coarse = 4e-7
    machine = axis(CASCADE)
    machine = replace(machine, scale=replace(machine.scale, resolution=coarse))
    record = recorded(machine, count=3 * MAX_FITTED_SAMPLES)
    part = judged_samples(record, 60)
    assert part.stop - part.start == MAX_FITTED_SAMPLES - 60
    draw = np.random.default_rng(1).uniform(-coarse / 4, coarse / 4, record.position.size)
    draw[part.start - 60 : part.stop] /= 20
    logged = replace(record, position=record.position + draw)
    found, best = replayed(machine, logged), structure(logged, 60)
    assert best is not None
    assert best.leaves < 0.2 * found.rms  # which is no better controller
    assert found.replays


def test_a_cascade_is_found_on_a_way_along_which_position_and_reference_are_all_but_the_same() -> None:
    """Full feedforward on 1.5 m, behind which the axis stays by some micrometres."""
    machine = axis(replace(CASCADE, velocity_filter=0.2e-3))
    share = np.linspace(0, 1, round(1.2 / TS))
    way = 1.5 * share**3 * (10 - 15 * share + 6 * share**2)
    target = np.concatenate([np.zeros(100), way, np.full(300, 1.5), way[::-1], np.zeros(300)])
    strong = replace(machine, drive=replace(machine.drive, rated_thrust=1e4))
    record = simulate(strong, machine.feedback_only(), target, seed=1).record
    assert np.std(record.reference - record.position) < 2e-4 * 1.5
    found = structure(record, 60)
    assert found is not None
    assert found.words.startswith("a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms, a velocity filter of 200 µs, 100 %")
    assert found.leaves < 1e-6 * float(np.std(record.command))


def test_figures_are_right_to_the_noise_of_a_rounded_log() -> None:
    found = structure(rounded(recorded(axis(BARE))), 60)
    assert found is not None
    assert found.words.startswith("a P/PI cascade with ")
    gain, velocity, time = (
        float(one.split()[0]) for one in found.words.removeprefix("a P/PI cascade with ").split(",")
    )
    assert (gain, velocity, time) == pytest.approx((85.0, 4000.0, 12.0), rel=5e-3)
    lost = 5e-9 / 2**0.5  # rms of the position: every second step of the scale lies between two of the log's
    step = lost * 4000.0 / TS * 2**0.5
    assert found.leaves == pytest.approx(step, rel=0.1)


def test_a_replay_that_fails_names_the_structure_that_fits() -> None:
    record = recorded(axis(BARE))
    wrong = replayed(under(PID(3e5, 2e7, 4e3, 0.0)), record)
    assert not wrong.replays
    assert wrong.other is not None
    assert wrong.other.startswith("a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms leaves ")
    filtered = replayed(
        under(PID(3e5, 2e7, 4e3, 0.0)), recorded(axis(BARE, Filters((Notch(300.0, 1.0),), (LowPass(150.0),))))
    )
    assert filtered.other is not None
    assert filtered.other.startswith("no PID and no P/PI cascade fits, the best of which leaves ")


def test_a_change_that_leaves_rounding_alone_needs_no_other_structure() -> None:
    machine = under(PID(3e5, 2e7, 4e3, 0.3e-3), 2)
    late = replayed(replace(machine, control=replace(machine.control, reference_delay=1)), recorded(machine))
    assert late.remedy == "a reference delay of 2 samples instead of 1"
    assert late.other is None


def test_a_reference_that_was_logged_late_is_told() -> None:
    """Which no delay of the law's own can make good, where it has none."""
    machine = under(PID(3e5, 2e7, 4e3, 0.3e-3), 0)
    record = recorded(machine)
    late = np.concatenate([np.full(2, record.reference[0]), record.reference[:-2]])
    found = replayed(machine, replace(record, reference=late))
    assert not found.replays
    assert found.remedy == "the reference logged 2 samples late"
    assert found.remains < 0.01 * found.rms
    assert found.other is None


@pytest.mark.parametrize("shift", [1, -2])
def test_a_position_that_was_logged_at_another_time_is_told(shift: int) -> None:
    """A user's log had it one sample late, and a reference delay was blamed beside the acceleration feedforward."""
    machine = axis(CASCADE)
    record = recorded(machine)
    index = np.clip(np.arange(record.position.size) - shift, 0, record.position.size - 1)
    found = replayed(machine, replace(record, position=record.position[index]))
    assert not found.replays
    assert found.remedy == f"the position logged {'1 sample late' if shift > 0 else '2 samples early'}"
    assert found.remains < 0.01 * found.rms
    assert found.mislogged


@pytest.mark.parametrize("factor", [2**0.5, 2.0])
def test_commands_in_another_unit_are_a_log_to_be_mended(factor: float) -> None:
    """Ampere rms that were taken for peaks, whose re-fit had a mass of 17.6 kg for 12.2."""
    machine = axis(CASCADE)
    record = recorded(machine)
    found = replayed(machine, replace(record, command=record.command / factor))
    assert not found.replays
    assert found.remedy is not None
    assert found.remedy.startswith(f"the whole command times {1 / factor:.4g}")
    assert found.mislogged
    other = replayed(replace(machine, control=replace(machine.control, reference_delay=3)), record)
    assert other.remedy is not None
    assert not other.mislogged, "another law is no fault of the log"


def test_a_law_that_takes_longer_to_settle_than_the_samples_that_are_fitted_is_judged_all_the_same() -> None:
    record = recorded(axis(CASCADE), count=4 * MAX_FITTED_SAMPLES)
    part = judged_samples(record, MAX_FITTED_SAMPLES)
    assert part.stop - part.start == MAX_FITTED_SAMPLES
    found = structure(record, MAX_FITTED_SAMPLES)
    assert found is not None
    assert found.leaves < 1e-6 * float(np.std(record.command))


def test_too_little_is_not_fitted() -> None:
    record = recorded(axis(BARE))
    assert structure(record.part(0, 150), 60) is None
    assert structure(replace(record, reference=np.zeros(3000)), 60) is None


@pytest.mark.parametrize("samples", [5, 64, 70, 125])
def test_of_a_short_record_nobody_says_which_controller_made_it(samples: int) -> None:
    """A shift of the commands is looked for over 8 samples either way, behind the 60 in which the replay settles."""
    machine = under(PID(3e5, 2e7, 4e3, 0.3e-3))
    made = recorded(machine)
    part = {name: getattr(made, name)[100 : 100 + samples] for name in ("target", "reference", "feedforward")}
    part |= {"command": 1.3 * made.command[100 : 100 + samples], "position": made.position[100 : 100 + samples]}
    found = replayed(machine, replace(made, **part))
    assert not found.checked
    assert found.why_not == f"it is too short to replay: {samples} samples, of at least {min(samples - 1, 60) + 66}"
    longer = replayed(machine, replace(made, command=1.3 * made.command))
    assert (longer.checked, longer.replays, longer.why_not) == (True, False, "")
