"""How much an effect does along records, in newtons and metres, beside what its law says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.how_far import effect_magnitude, errors_of
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate, SmoothedPath, smooth
from diagnosis.model.start_states import static_equilibrium_start
from models.controller import References
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging
from models.effects.scale import ScalePeriodicError
from models.effects.structure import CableSpring
from models.records.record import Record
from models.simulation.simulator import simulate
from tests.diagnosis.tables import recorded, short, table

MACHINE = table()
EFFECTS: tuple[Effect, ...] = (ViscousFriction(40.0), CableSpring(300.0), ScalePeriodicError(1e-7, 4e-5, 1.0))
Seen = tuple[Candidate, tuple[Record, ...], tuple[SmoothedPath, ...]]


@pytest.fixture(scope="module")
def seen() -> Seen:
    """A model with the effects that its records were made with."""
    records = recorded(MACHINE, (short(MACHINE),), EFFECTS, seed=3, wrong=0.0)
    layout = parameters(MACHINE, 1)
    candidate = Candidate(layout, static_equilibrium_start(layout, records), in_order(EFFECTS))
    return candidate, records, smooth(candidate, records)


def rms(signal: object) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(signal)))))


def test_an_effect_of_a_force_acts_in_newtons(seen: Seen) -> None:
    """Drag is in proportion to the speed, and a spring to the way, whatever else acts."""
    candidate, (record,), paths = seen
    drag, spring = (
        effect_magnitude(name, candidate, (record,), paths) for name in ("viscous_friction", "cable_spring")
    )
    assert drag is not None
    assert spring is not None
    assert drag.force == pytest.approx(40.0 * rms(np.diff(record.position) / record.sample_time), rel=0.02)
    assert spring.force == pytest.approx(300.0 * rms(record.position), rel=1e-3)
    assert drag.position is None


def test_an_effect_on_the_reading_acts_in_metres(seen: Seen) -> None:
    candidate, (record,), paths = seen
    ripple = effect_magnitude("scale_periodic_error", candidate, (record,), paths)
    assert ripple is not None
    assert ripple.force is None
    own = 1e-7 * np.sin(2 * np.pi * record.position / 4e-5 + 1.0)
    assert ripple.position == pytest.approx(rms(own), rel=0.02)


def test_what_is_not_in_the_model_does_nothing(seen: Seen) -> None:
    assert effect_magnitude("cogging", *seen) is None


def test_a_closed_loop_begins_where_its_record_does() -> None:
    """A third of a pitch from where the machine has its zero: the model that made the record leaves nothing of it."""
    origin, plan = 0.013, short(MACHINE)
    truth = replace(MACHINE, effects=(Cogging(2.0, 0.04, 1.0),))
    signals = (plan.given.position + origin, plan.given.feedforward, plan.given.compensation)
    given = References(*(np.concatenate([np.full(1000, signal[0]), signal]) for signal in signals))
    target = np.concatenate([np.full(1000, origin), plan.target + origin])
    run = simulate(truth, MACHINE.feedback_only(), target, given=given, seed=3, origin=origin)
    records = (run.record.last(plan.target.size),)
    layout = parameters(MACHINE, 1)
    candidate = Candidate(layout, static_equilibrium_start(layout, records), truth.effects)
    gap = errors_of(candidate, records, smooth(candidate, records)).gap()
    reading = float(np.hypot(MACHINE.scale.resolution / np.sqrt(12), MACHINE.scale.noise))
    assert gap.position < 1.2 * reading
    elsewhere = replace(candidate, effects=(Cogging(2.0, 0.04, 1.0 - 2 * np.pi * origin / 0.04),))
    assert errors_of(elsewhere, records, smooth(elsewhere, records)).gap().position > 3 * reading
