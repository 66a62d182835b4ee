"""A floor's vibration is not locked to the motion: what repeats with equal motions and rests with them is a law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.model.fit import fit
from diagnosis.model.kalman import Resonance
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.null import Null
from diagnosis.records.motions import pieces, repeated
from diagnosis.which.detectors import detect
from diagnosis.which.detectors.detect import catalogue_scan, is_locked, random_force, view
from diagnosis.which.detectors.random_force import RandomForce
from models.effects.structure import AdditionalMode, FloorVibration
from models.plant import antiresonances
from models.simulation.simulator import simulate
from tests.diagnosis.slow import leg, moved
from tests.diagnosis.tables import recorded, short, table

MACHINE = table()
FREQUENCY = 8.0  # Hz


@pytest.fixture(scope="module")
def begun() -> Baseline:
    records = recorded(MACHINE, (short(MACHINE),), seed=1, wrong=0.0)
    layout = parameters(MACHINE, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), records, iterations=0)
    return Baseline(fitted, records, pieces(records), Null({}, (), ()))


@pytest.mark.parametrize(
    ("everywhere", "in_phase", "locked"), [(False, True, True), (True, True, False), (False, False, False)]
)
def test_what_rests_with_the_motion_and_repeats_with_it_is_locked(
    everywhere: bool, in_phase: bool, locked: bool, begun: Baseline
) -> None:
    (seen,), ts = begun.nominal.residuals, MACHINE.sample_time
    made, rng = np.zeros(seen.innovations.size), np.random.default_rng(0)
    assert sum(map(len, repeated(begun.pieces, begun.records))) >= Criteria().min_equal_motions
    for piece in begun.pieces:
        time = ts * np.arange(piece.stop - piece.start)
        start = 0.0 if in_phase else rng.uniform(0, 2 * np.pi)
        size = 0.0 if piece.kind.rests and not everywhere else 5.0
        made[piece.start : piece.stop] = size * np.sin(2 * np.pi * FREQUENCY * time + start)
    given = replace(begun.nominal, residuals=(replace(seen, innovations=made),))
    assert is_locked(given, begun, FREQUENCY) == locked


@pytest.mark.parametrize(("frequency", "proposed"), [(110.0, False), (150.0, True)])
def test_where_an_added_mode_rings_no_random_force_is_proposed(
    frequency: float, proposed: bool, begun: Baseline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It rings to forces that nobody knows, too."""
    found = RandomForce(Resonance(frequency, 0.1, 0.1), 1e4)
    monkeypatch.setattr(detect, "strongest_random_force", lambda *_: found)
    monkeypatch.setattr(detect, "is_locked", lambda *_: False)
    candidate = replace(begun.nominal.candidate, effects=(AdditionalMode(1e-3, 118.0, 0.02),))
    fitted = fit(candidate, begun.records, iterations=0)
    assert bool(random_force(view(fitted, begun, (), (), {})).proposals) == proposed


@pytest.mark.parametrize(("even", "proposed"), [((-1.5, 0.6), False), ((-0.4, 0.6), True), ((0.0, np.inf), True)])
def test_a_force_that_loses_at_rest_what_it_gains_in_motion_is_no_floor(
    even: tuple[float, float], proposed: bool, begun: Baseline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first is of a drawn machine with wrong nominal values only (seed 202624), whose line gained 45."""
    found = RandomForce(Resonance(468.0, 0.1, 0.1), 45.0, 1.0, even)
    monkeypatch.setattr(detect, "strongest_random_force", lambda *_: found)
    monkeypatch.setattr(detect, "is_locked", lambda *_: False)
    assert bool(random_force(view(begun.nominal, begun, (), (), {})).proposals) == proposed


@pytest.mark.parametrize(("ratio", "proposed"), [(0.92, False), (4.0, True)])
def test_where_the_structure_rings_while_friction_holds_it_a_floor_has_to_be_evener(
    ratio: float, proposed: bool, begun: Baseline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The carriage of a user's belt axis swung on after each motion, at 0.92 of an antiresonance of its file."""
    lowest = antiresonances(begun.delivered.plant)[0]
    found = RandomForce(Resonance(ratio * lowest, 0.1, 0.1), 1e4, 1.0, (0.63, 0.75))
    monkeypatch.setattr(detect, "strongest_random_force", lambda *_: found)
    monkeypatch.setattr(detect, "is_locked", lambda *_: False)
    assert bool(random_force(view(begun.nominal, begun, (), (), {})).proposals) == proposed
    floor = replace(found, even=(0.8, 0.93))
    monkeypatch.setattr(detect, "strongest_random_force", lambda *_: floor)
    assert random_force(view(begun.nominal, begun, (), (), {})).proposals


@pytest.mark.parametrize(
    ("cycles", "varied", "proposed"), [(30.04, False, False), (30.5, False, True), (30.04, True, True)]
)
def test_a_tone_that_keeps_time_with_equal_motions_is_no_floor(cycles: float, varied: bool, proposed: bool) -> None:
    """Strokes to and fro for 12 s, beside a tone of 30.04 or of 30.5 cycles a period, and varied motions beside the
    first: a heavy motion that was repeated left nearly its harmonics, whose phase drifts, which had a floor's name."""
    machine = leg(500.0)
    machine = replace(machine, scale=replace(machine.scale, resolution=1e-7, noise=3e-8))
    shaken = replace(machine, effects=(FloorVibration(0.2, cycles / 0.8, 0.0),))
    share = np.linspace(0, 1, 120)
    stroke = 0.3 * share**3 * (10 - 15 * share + 6 * share**2)
    path = np.tile(np.concatenate([stroke, np.full(80, 0.3), 0.3 - stroke, np.zeros(80)]), 15)
    record = moved(shaken, 2, 6000) if varied else simulate(shaken, shaken.feedback_only(), path, seed=2).record
    layout = parameters(machine, 1)
    fitted = fit(Candidate(layout, np.zeros(layout.count)), [record])
    seen = view(fitted, Baseline(fitted, (record,), pieces([record]), Null({}, (), ())), (), (), {})
    found = random_force(seen).proposals
    assert bool(found) == proposed
    (sine,) = catalogue_scan(replace(seen, negligible=machine.kinds.keys() - {FloorVibration.name})).proposals
    assert (sine.gain > Criteria().min_gain) == proposed
    if found:
        assert found[0].random_force is not None
        assert found[0].random_force.frequency == pytest.approx(cycles / 0.8, abs=0.2)
