"""Whether commands are late now and then, and by how much, as repeated motions show it, or all that is left."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from diagnosis.criteria import Criteria
from diagnosis.experiments.confusability import confusability
from diagnosis.experiments.schedules import amplitude_ladder, multisine, repeated_strokes, sequence
from diagnosis.model.fit import Fit
from diagnosis.model.parameters import parameters
from diagnosis.records.units import loop_time
from diagnosis.refit import refit
from diagnosis.which.detectors.command_jitter import Lateness, lateness
from diagnosis.which.detectors.detect import _accounts_for_the_rest
from models.effects.base import Effect
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging, CurrentLoopLag, DacQuantisation, GainAsymmetry, ThrustSaturation, TimingJitter
from models.records.record import Record
from tests.diagnosis.tables import nominal_with, recorded, table

LATE = Criteria().late_commands_min_gain
FINE = replace(table().scale, resolution=5e-9, noise=5e-9)
MACHINE = replace(table(), scale=FINE)
PLAN = (sequence(MACHINE), repeated_strokes(MACHINE, passes=6))


@cache
def fitted(*effects: Effect, seed: int) -> tuple[Fit, tuple[Record, ...]]:
    """Records of the table with these effects, and the re-fit to them."""
    records = tuple(recorded(MACHINE, PLAN, effects, seed=seed))
    return refit(parameters(MACHINE, len(records)), records), records


def found(*effects: Effect, seed: int) -> Lateness:
    return lateness(*fitted(*effects, seed=seed))


@pytest.mark.parametrize("part", [0.01, 0.04])
def test_late_commands_are_found_and_measured(part: float) -> None:
    """A `part` of the commands acts a whole sample late: the lateness has that variance."""
    late = found(TimingJitter(part), seed=31)
    assert late.gain > 10 * LATE
    assert late.size == pytest.approx(MACHINE.sample_time * np.sqrt(part * (1 - part)), rel=0.25)


def test_its_energy_is_what_late_commands_add_to_what_is_left() -> None:
    """The same table, punctual and not: what the re-fit leaves of it differs by that chi-square."""
    late = TimingJitter(0.04)
    fits = fitted(seed=31)[0], fitted(late, seed=31)[0]
    left = [sum(float(one.innovations[60:] @ one.innovations[60:]) for one in fit.residuals) for fit in fits]
    assert found(late, seed=31).energy == pytest.approx(left[1] - left[0], rel=0.35)


@pytest.mark.parametrize(
    ("left", "energy", "rough", "counts"),
    [
        (1500.0, 300.0, False, True),  # most of what is above the floor
        (1500.0, 200.0, False, False),
        (1020.0, 0.0, False, True),  # nothing is surely above it
        (1500.0, 300.0, True, False),
    ],
)
def test_a_little_lateness_counts_where_it_accounts_for_what_is_left(
    left: float, energy: float, rough: bool, counts: bool
) -> None:
    seen: Any = SimpleNamespace(
        baseline=SimpleNamespace(criteria=Criteria(), floors=np.array([990.0, 1010.0])),
        own=SimpleNamespace(e=np.array([np.sqrt(left)])),
        fitted=SimpleNamespace(candidate=SimpleNamespace(rough=rough)),
    )
    assert _accounts_for_the_rest(Lateness(1e-5, 200.0, 1e-12, energy), seen) == counts


COGGING = Cogging(1.5, 0.035, 1.0)


@pytest.mark.parametrize(
    ("effects", "seed"),
    [((), 31), ((), 34), ((COGGING,), 33)],
    ids=["nothing", "nothing again", "cogging"],
)
def test_punctual_commands_are_not_called_late(effects: tuple[Effect, ...], seed: int) -> None:
    """A force that belongs to the place repeats with the motion. On a scale as fine as this, the error of the model
    shows as a lateness that is far below any that is late commands'."""
    late = found(*effects, seed=seed)
    assert late.gain < LATE / 4 or late.size < 0.8 * Criteria().late_commands_min_size * MACHINE.sample_time


def test_parts_of_one_multisine_repeat_nothing() -> None:
    """They differ, and what a law makes of them would pass for late commands."""
    excited = (multisine(MACHINE, duration=6.0),)
    records = recorded(MACHINE, excited, [GainAsymmetry(0.02)], seed=36)
    late = lateness(refit(parameters(MACHINE, 1), records), records)
    assert late.gain == 0.0
    assert np.isinf(late.scatter)


def test_a_law_of_the_thrust_beside_them_is_not_counted_as_lateness() -> None:
    late = found(TimingJitter(0.01), GainAsymmetry(0.02), seed=37)
    assert late.gain > LATE
    assert late.size < 2.2 * MACHINE.sample_time * np.sqrt(0.01)


def test_the_least_lateness_that_shows_is_what_the_records_are_said_to_show() -> None:
    """The same records with commands that are late more and less often than the limit of detection says."""
    said = confusability(*fitted(seed=34))
    limit = said.limits[said.names.index("timing_jitter")][1]
    assert 1e-4 < limit < 0.03
    assert found(TimingJitter(2.5 * limit), seed=34).gain > LATE
    assert found(TimingJitter(0.3 * limit), seed=34).gain < LATE


def of_a_ladder(*effects: Effect, seed: int = 5) -> Lateness:
    """What is told of motions none of which repeats another one."""
    plain = table()
    records = tuple(recorded(plain, (amplitude_ladder(plain),), effects, seed=seed))
    return lateness(refit(parameters(plain, 1), records), records)


@pytest.mark.parametrize("beside", [(), (COGGING,)])
def test_late_commands_are_found_where_no_motion_repeats(beside: tuple[Effect, ...]) -> None:
    part = 0.04
    late = of_a_ladder(TimingJitter(part), *beside)
    assert late.gain > 2 * LATE
    assert late.size == pytest.approx(table().sample_time * np.sqrt(part * (1 - part)), rel=0.25)


@pytest.mark.parametrize(
    "effect",
    [
        None, COGGING, ViscousFriction(60.0), GainAsymmetry(0.02), ThrustSaturation(0.05), CurrentLoopLag(8e-4),
        DacQuantisation(0.5, 0),
    ],
    ids=lambda one: one.name if one else "nothing",
)  # fmt: skip
def test_no_law_is_late_where_no_motion_repeats(effect: Effect | None) -> None:
    """A law leaves more than white noise for as long as it lasts, or goes with something else than the steps."""
    assert of_a_ladder(*([effect] if effect else [])).gain < 0.2 * LATE


@pytest.mark.parametrize("follows", ["every step", "the motion"])
def test_what_follows_the_motion_and_not_every_step_is_no_lateness(follows: str) -> None:
    """On somebody else's simulator, what the file's form of the drive and its friction left beside a true law was as
    large as the motions' steps, and went no further with those by which the loop answers the noise of readings: it was
    told as late commands, by 163."""
    (record,) = recorded(MACHINE, (amplitude_ladder(MACHINE),), seed=5)
    made = refit(parameters(MACHINE, 1), (record,))
    delay = round(MACHINE.plant.dead_time / record.sample_time)
    step = np.diff(record.command, prepend=np.full(delay + 1, record.command[0]))[: record.command.size]
    if follows == "the motion":
        step = gaussian_filter1d(step, 0.5 * loop_time(MACHINE) / record.sample_time)
    unknown = step * np.random.default_rng(3).standard_normal(step.size)
    unknown *= 1.6 / np.std(unknown)
    (residual,) = made.residuals
    left = replace(made, residuals=(replace(residual, force=residual.force + unknown[:, None]),))
    gain = lateness(left, (record,)).gain
    assert gain > 10 * LATE if follows == "every step" else gain == 0.0


def test_a_variance_has_none_to_go_with_on_an_axis_without_friction() -> None:
    plain = table()
    records = tuple(recorded(plain, (amplitude_ladder(plain),), (TimingJitter(0.04),), seed=5))
    made = refit(parameters(plain, 1), records)
    (residual,) = made.residuals
    without = replace(residual, acts=replace(residual.acts, friction=np.zeros_like(residual.acts.friction)))
    assert lateness(replace(made, residuals=(without,)), records).gain > LATE


@pytest.mark.parametrize("size", [0.0, 1e-9])
def test_commands_that_hardly_step_are_not_late(size: float) -> None:
    """Steps that make no force at any lateness had ended in an error of the search for its size."""
    plain = table()
    (record,) = recorded(plain, (amplitude_ladder(plain),), seed=5)
    still = replace(record, command=size * np.random.default_rng(1).standard_normal(record.command.size))
    assert lateness(nominal_with(plain, (), (still,)), (still,)).gain == 0.0
