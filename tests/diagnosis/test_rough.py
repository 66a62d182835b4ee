"""A drive that is rougher than the model's own noise: weights that its records bear out, a floor from what repeats."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.closure import measured, signal
from diagnosis.criteria import Criteria
from diagnosis.diagnose import Diagnosis, diagnose
from diagnosis.experiments.propose import virtual
from diagnosis.experiments.schedules import amplitude_ladder, repeated_strokes, sequence
from diagnosis.how_far import errors_of
from diagnosis.model.fit import Fit, unrepeated
from diagnosis.model.parameters import applied, parameters
from diagnosis.model.roughness import WhiteForce, steady_variance, variance_by_record
from diagnosis.null import NULL_DRAWS, _white_force
from diagnosis.records.motions import MotionKind, Piece, numbered, pieces, rms, scatter
from diagnosis.records.units import white_force
from diagnosis.refit import noise_alone, refit_within, weighed, whiteness, within_rating
from diagnosis.verdict import Outcome
from diagnosis.which.detectors import random_force
from diagnosis.which.detectors.random_force import strongest_random_force
from diagnosis.which.detectors.scan import partial_out
from diagnosis.which.kinds import above_floor, of_kind
from models.effects.base import Effect, Numbers, Place, T, hook
from models.effects.friction_laws import ViscousFriction
from models.effects.parameter import parameter
from models.machine import Machine
from models.records.record import Record
from tests.diagnosis.tables import recorded, table

MACHINE = table()
PLAN = (sequence(MACHINE, repeats=2), repeated_strokes(MACHINE, passes=4))
STROKES = PLAN[1:]  # enough for a whole diagnosis
SIZE = 2.0  # N
SEED = 21


@hook
def _knocking(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    chance = 43758.5453 * math.sin(12.9898 * math.floor(now[T] / p[1]))
    return float(value + p[0] * 12.0**0.5 * (chance - math.floor(chance) - 0.5))


@dataclass(frozen=True)
class Knocks(Effect):
    """A force that is another in every sample, and no other time the same."""

    name: ClassVar = "knocks"
    family: ClassVar = "structure"
    equation: ClassVar = "d"
    source: ClassVar = "a test"
    hooks: ClassVar = {Place.FORCE: _knocking}
    depends_on_time: ClassVar = True
    size: float = parameter("N", "deviation", 0.1, 10.0, "amplitude")
    period: float = parameter("s", "how long each lasts", 1e-4, 1e-3, "shape", above=0)


KNOCKS = Knocks(SIZE, MACHINE.sample_time)
WHITE_FORCE = white_force(MACHINE)


def _off() -> Machine:
    """A machine file whose mass is 5 % off, and whose contacts are 8 %."""
    layout = parameters(MACHINE, 1)
    theta = np.zeros(layout.count)
    theta[layout.of("payload_mass")], theta[layout.of("friction_level")] = 0.05, -0.08
    return applied(layout, theta)


@pytest.fixture(scope="module")
def rough() -> tuple[Record, ...]:
    return recorded(MACHINE, PLAN, [KNOCKS], seed=SEED, wrong=0.0)


@pytest.fixture(scope="module")
def fitted(rough: tuple[Record, ...]) -> Fit:
    return refit_within(_off(), rough)


@pytest.fixture(scope="module")
def found(null_cache: Path) -> Diagnosis:
    return diagnose(MACHINE, recorded(MACHINE, STROKES, [KNOCKS], seed=SEED, wrong=0.0), cache=null_cache)


def test_the_white_force_of_a_rough_drive_is_found(fitted: Fit) -> None:
    assert fitted.candidate.white_force == pytest.approx(SIZE, rel=0.15)
    assert np.mean(fitted.innovations**2) == pytest.approx(1.0, abs=0.12)


def test_a_white_force_that_the_first_guess_overshoots_is_found() -> None:
    """From 0.08 N the first guess goes beyond the commands; the answer, 11 N, does not."""
    records = recorded(MACHINE, PLAN, [Knocks(11.0, MACHINE.sample_time)], seed=SEED, wrong=0.0)
    assert refit_within(MACHINE, records).candidate.white_force == pytest.approx(11.0, rel=0.15)


def test_what_is_nominal_is_found_on_a_rough_drive(fitted: Fit, rough: tuple[Record, ...]) -> None:
    """Under the usual weights the knocks pass for what is nominal."""
    usual = refit_within(_off(), rough, Criteria(rough_variance=np.inf))
    assert fitted.candidate.machine.plant.mass == pytest.approx(MACHINE.plant.mass, rel=0.01)
    stiffness = [sum(one.candidate.machine.friction.stiffness) for one in (fitted, usual)]
    true = sum(MACHINE.friction.stiffness)
    assert stiffness[0] == pytest.approx(true, rel=0.04)
    assert abs(stiffness[0] - true) < 0.5 * abs(stiffness[1] - true)


def test_a_drive_that_is_as_smooth_as_its_model_keeps_its_weights() -> None:
    records = recorded(MACHINE, PLAN, seed=SEED)
    found = refit_within(MACHINE, records)
    assert found.candidate.white_force == WHITE_FORCE
    assert weighed(found, records) is found


@pytest.mark.parametrize("times", [4.0, 6.0])  # the usual white force
def test_noise_that_is_all_that_is_left_is_told_by_its_size(times: float) -> None:
    """A healthy axis whose thrust scatters by 0.8 % had a cause out of the catalogue, and on two of three tries a floor
    vibration that was not there."""
    records = recorded(MACHINE, PLAN, [Knocks(times * WHITE_FORCE, MACHINE.sample_time)], seed=SEED, wrong=0.0)
    fitted = within_rating(MACHINE, records)
    assert not weighed(fitted, records).candidate.rough, "too smooth a drive for other weights"
    sizes = noise_alone(fitted, records, Criteria(), (0.95, 0.95))
    assert sizes == pytest.approx(times * WHITE_FORCE, rel=0.25)
    force = strongest_random_force(fitted, records, partial_out(fitted, numbered(pieces(records), records)))
    assert force is None or force.gain < 0


def test_a_line_gains_no_more_than_a_larger_white_force_where_that_is_what_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    records = recorded(MACHINE, PLAN, [Knocks(2 * WHITE_FORCE, MACHINE.sample_time)], seed=SEED, wrong=0.0)
    fitted = within_rating(MACHINE, records)
    own = partial_out(fitted, numbered(pieces(records), records))
    beside = strongest_random_force(fitted, records, own)
    monkeypatch.setattr(random_force, "WHITER_FACTORS", ())
    alone = strongest_random_force(fitted, records, own)
    assert beside is not None
    assert alone is not None
    assert beside.gain < 0 < Criteria().random_force_min_gain < alone.gain


def test_what_a_law_leaves_is_no_noise() -> None:
    records = recorded(MACHINE, PLAN, [ViscousFriction(150.0)], seed=SEED, wrong=0.0)
    fitted = within_rating(MACHINE, records)
    assert noise_alone(fitted, records, Criteria(), (0.95, 0.95)) is None
    assert min(whiteness(fitted, records)) < 0.3


def test_the_floor_of_a_rough_drive_is_what_does_not_repeat(fitted: Fit, rough: tuple[Record, ...]) -> None:
    """The knocks are all that is wrong: as much as there is left does not repeat."""
    least = measured(fitted, rough, pieces(rough))
    assert least.source == "repeats"
    (own,) = least.innovations
    known = ~np.isnan(own)
    left = signal(fitted.residuals, fitted.candidate.machine)
    assert np.mean(own[known] ** 2) == pytest.approx(np.mean(left[known] ** 2), rel=0.1)
    assert least.gap().force == pytest.approx(errors_of(fitted.candidate, rough, fitted.paths).gap().force, rel=0.3)


def test_a_reading_that_drops_out_is_no_force() -> None:
    """As much as that does not repeat; yet no white force as large as the commands is enough, and the weights stay."""
    records = recorded(MACHINE, PLAN, seed=SEED, wrong=0.0)
    rng = np.random.default_rng(SEED)
    broken = tuple(
        replace(one, position=np.where(rng.random(one.position.size) < 5e-3, one.position[0], one.position))
        for one in records
    )
    found = refit_within(MACHINE, broken)
    apart = unrepeated(found, broken, pieces(broken), Criteria().min_equal_motions)
    assert np.nanmean(apart**2) > Criteria().rough_variance
    assert found.candidate.white_force == WHITE_FORCE


def test_a_rough_drive_shows_in_one_pass_of_motions_too(rough: tuple[Record, ...]) -> None:
    """Where nothing repeats, what is steadily left at all times tells; a strong effect leaves it at times only."""
    once = (rough[0].part(0, rough[0].position.size // 2),)
    found = refit_within(MACHINE, once)
    assert np.isnan(unrepeated(found, once, pieces(once), Criteria().min_equal_motions)).all()
    assert found.candidate.white_force == pytest.approx(SIZE, rel=0.25)
    assert variance_by_record(found) == pytest.approx([1.0], abs=0.25)


def test_a_strong_effect_in_one_pass_of_motions_makes_it_no_rough_one() -> None:
    (record,) = recorded(MACHINE, PLAN[:1], [ViscousFriction(400.0)], seed=SEED, wrong=0.0)
    once = (record.part(0, record.position.size // 2),)
    assert refit_within(MACHINE, once).candidate.white_force == WHITE_FORCE


def test_each_record_has_the_white_force_that_it_needs() -> None:
    """A smooth and a rough one of the same table."""
    smooth, shaken = (recorded(MACHINE, PLAN[1:], effects, seed=SEED, wrong=0.0)[0] for effects in ([], [KNOCKS]))
    found = refit_within(MACHINE, (smooth, shaken))
    assert found.candidate.roughness_of(0) == 1.0
    assert found.candidate.roughness_of(1) * WHITE_FORCE == pytest.approx(SIZE, rel=0.2)
    assert variance_by_record(found) == pytest.approx([1.0, 1.0], abs=0.25)


def test_what_is_steadily_there_in_one_record_alone_is_no_roughness_of_the_drive(rough: tuple[Record, ...]) -> None:
    """Where nothing repeats: of a joint's two records one had been taken for noise, with the law that its motions
    showed, and weighed 60,000 times less than the other."""
    once = rough[0].part(0, rough[0].position.size // 2)
    smooth = recorded(MACHINE, PLAN[1:], seed=SEED, wrong=0.0)[0]
    smooth = smooth.part(0, smooth.position.size // 2)
    assert refit_within(MACHINE, (smooth, once)).candidate.roughness_of(1) == 1.0
    assert refit_within(MACHINE, (once, once)).candidate.roughness_of(1) > 10


@pytest.mark.parametrize(("size", "seed"), [(0.1, 1), (1.0, 2), (10.0, 3)])
def test_lines_and_bursts_do_not_count_as_steady(size: float, seed: int) -> None:
    """Beside white noise: what a law of the position leaves at one speed, and what one leaves at halts."""
    rng, n, loop = np.random.default_rng(seed), 20_000, 3.6e-3
    still = np.zeros(n)
    record = Record(5e-4, still, still, still, still, still)
    noise, t = rng.standard_normal(n), 5e-4 * np.arange(n)
    line = 3.0 * np.sin(2 * np.pi * 90.0 * t)
    burst = 30.0 * rng.standard_normal(n) * (t % 1.0 < 0.05)
    assert steady_variance(size * noise, record, loop) == pytest.approx(size**2, rel=0.1)
    assert steady_variance(noise + line + burst, record, loop) < 3.0
    assert math.isnan(steady_variance(noise[:300], record.part(0, 300), loop)), "too short to tell"


@pytest.mark.parametrize("first", [0.0, 10_000.0, 9e8])
def test_the_white_force_of_a_simulated_drive_is_white(first: float) -> None:
    ts, n = MACHINE.sample_time, 4000
    law = WhiteForce(SIZE, ts, first)
    now: Any = np.zeros(8)
    nothing: Any = np.zeros((3, 1))
    p: Any = law.values()
    drawn = np.empty(n)
    for k in range(n):
        now[T] = (k + 0.5) * ts
        drawn[k] = law.hooks[Place.FORCE](0.0, p, now, nothing[0], nothing)
    assert np.std(drawn) == pytest.approx(SIZE, rel=0.05)
    assert abs(np.mean(drawn)) < 0.1 * SIZE
    for late in (1, 2, 7):
        assert abs(np.corrcoef(drawn[late:], drawn[:-late])[0, 1]) < 0.06


def test_no_two_records_of_the_null_share_a_stretch_of_the_white_force() -> None:
    """Each of up to a million samples."""
    candidate = SimpleNamespace(
        roughness_of=lambda _: 2.0, usual_white_force=SIZE, nominal=SimpleNamespace(sample_time=1e-3)
    )
    seeds = [1000 * draw + record for draw in range(NULL_DRAWS) for record in range(6)]
    begins = sorted(law.first for seed in seeds for law in _white_force(candidate, 0, seed))  # type: ignore[arg-type]
    gaps = np.diff([*begins, begins[0] + 2**31])
    assert min(gaps) > 1e6


def test_a_force_without_a_law_is_no_effect_and_not_nothing(found: Diagnosis) -> None:
    assert (found.outcome, found.effects, found.partly) == (Outcome.NONE, (), ())
    assert found.how_far.source == "repeats"
    whole = sum(record.position.size - 60 for record in found.baseline.records)
    assert np.min(found.baseline.floors) >= whole
    assert found.baseline.floors == pytest.approx(whole, rel=0.1)  # of simulated tables as rough as this one


def test_on_a_rough_drive_shares_are_of_what_a_law_s_own_kind_gains(found: Diagnosis) -> None:
    """The weights leave one per sample, as many as the floor: of that difference any law would have a large share."""
    begun, proposals = found.baseline, found.stages[0].scanned
    assert above_floor(begun.nominal.innovations, begun) == 0
    for proposal in proposals[:3]:
        assert proposal.effect is not None
        one = of_kind(proposal.effect, begun.nominal, proposals, begun)
        assert one.share in {0.0, 1.0}
        assert one.rival >= 0.0


def test_an_effect_on_a_rough_drive_is_named(null_cache: Path) -> None:
    records = recorded(MACHINE, STROKES, [KNOCKS, ViscousFriction(200.0)], seed=SEED, wrong=0.0)
    found = diagnose(MACHINE, records, cache=null_cache)
    assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("viscous_friction",))
    (drag,) = found.final.candidate.effects
    assert drag.values()[0] == pytest.approx(200.0, rel=0.1)
    begun = found.baseline
    assert of_kind(drag, begun.nominal, found.stages[0].scanned, begun).share == 1.0
    assert found.how_far.interval[0] > 0.5


def test_a_strong_effect_on_a_smooth_table_makes_it_no_rough_one(null_cache: Path) -> None:
    """It leaves as much as a rough drive does, and every time the same."""
    records = recorded(MACHINE, STROKES, [ViscousFriction(400.0)], seed=SEED, wrong=0.0)
    found = diagnose(MACHINE, records, cache=null_cache)
    assert np.mean(found.baseline.nominal.innovations**2) > 10.0
    assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("viscous_friction",))
    assert found.baseline.nominal.candidate.white_force == WHITE_FORCE
    assert found.how_far.source == "simulated"


def test_an_experiment_shows_less_of_a_rough_drive() -> None:
    """The linearisation that experiments are compared by takes the white force that the records showed."""
    planned = amplitude_ladder(MACHINE, (10e-6,))
    sizes = [np.linalg.norm(virtual(MACHINE, planned, white_force=size)[0].slopes) for size in (WHITE_FORCE, SIZE)]
    assert sizes[1] < 0.5 * sizes[0]


@given(st.integers(2, 6), st.floats(0.1, 10.0), st.integers(0, 2**16))
def test_what_does_not_repeat_has_the_deviation_of_the_noise(count: int, size: float, seed: int) -> None:
    """Whatever the mean course is, and whatever lies between the motions."""
    rng, length = np.random.default_rng(seed), 20000
    course = np.tile(rng.standard_normal(length) * 100.0, count + 1)
    noisy = course + size * rng.standard_normal(course.size)
    equal = [Piece(0, i * length, (i + 1) * length, MotionKind(), 1, 0.0) for i in range(count)]
    (found,) = scatter([range(count)], equal, [noisy])
    assert np.isnan(found[count * length :]).all()
    assert rms([found]) == pytest.approx(size, rel=0.03)
