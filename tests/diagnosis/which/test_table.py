"""The table of candidates: which members of an effect it shows, in which order."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.criteria import Criteria
from diagnosis.model.fit import coordinates
from diagnosis.model.kalman import Resonance
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.which import table as candidates
from diagnosis.which.table import EffectRow, probability, unsure
from models.effects.catalogue import in_order
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.effects.motor import AmplifierDeadband, Cogging
from models.effects.priors import USUAL
from models.machine import load


def test_the_stronger_member_comes_first_and_the_machine_files_own_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    own = (ViscousFriction(200.0), Cogging(9.0, 0.05, 0.0))
    found = (DirectionalFriction(0.05, 1e-6, 0), DirectionalFriction(-0.1, 2e-6, 0), Cogging(1.0, 0.03, 0.0))
    layout = parameters(replace(load(), effects=own), 1)
    effects = in_order((*own, *found))
    fitted: Any = SimpleNamespace(candidate=Candidate(layout, np.zeros(layout.count), effects))
    monkeypatch.setattr(candidates, "deviations_of", lambda *_: [{"number": float(i)} for i in range(len(effects))])
    members = candidates._members(fitted)
    assert set(members) == {"directional_friction", "cogging"}
    assert [effect for effect, _ in members["directional_friction"]] == [found[1], found[0]]
    assert [effect for effect, _ in members["cogging"]] == [found[2]]
    assert members["directional_friction"][0][1] == {"number": float(effects.index(found[1]))}


def test_a_random_force_is_shown_as_it_is_written() -> None:
    """Not at the best point of the grid: 2.9 Hz stood on page one and 122 Hz in improved.toml."""
    layout = parameters(load(), 1)
    lines = (Resonance(112.0, 5.0, 0.05), Resonance(122.0, 5.0, 0.1))
    fitted: Any = SimpleNamespace(candidate=Candidate(layout, np.zeros(layout.count), (), lines))
    ((first, none), (second, _)) = candidates._sines(fitted, "floor_vibration")
    assert (first.frequency, second.frequency) == (122.0, 112.0)  # type: ignore[attr-defined]
    assert first.strength() == pytest.approx(2**0.5 * 0.1)
    assert none == {}
    assert candidates._sines(fitted, "cogging") == ()


def test_a_phase_beside_the_end_of_its_turn_has_the_deviation_that_it_has_elsewhere() -> None:
    covariance = np.diag([1e-4, 1e-4, 1e-10])  # of the sine's and the cosine's part, and of the pitch
    stds = []
    for phase in (1.0, 1e-6, 2 * np.pi - 1e-6):
        effect = Cogging(2.0, 0.03, phase)
        here = coordinates(effect)
        stds.append(candidates._spread_of(effect, here, covariance[: here.size, : here.size], USUAL)["phase"])
    assert stds[0] == pytest.approx(1e-2 / 2.0, rel=0.02)
    assert stds[1:] == pytest.approx([stds[0]] * 2, rel=0.01)


def test_a_further_name_is_unsure_whose_size_is_within_its_deviations_of_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the surest size of the surest member; what has no size, or is the machine file's own, is not asked for it."""
    own, found = (Cogging(9.0, 0.05, 0.0),), (Cogging(1.0, 0.03, 0.0), Cogging(-0.2, 0.04, 0.0), AmplifierDeadband(0.2))
    layout = parameters(replace(load(), effects=own), 1)
    effects = in_order((*own, *found))
    fitted: Any = SimpleNamespace(candidate=Candidate(layout, np.zeros(layout.count), effects))
    spread = {"amplitude": 0.4, "pitch": 1e-9, "phase": 1e-9, "width": 0.01}
    monkeypatch.setattr(candidates, "deviations_of", lambda *_: [spread for _ in effects])
    names = ["cogging", "amplifier_deadband", "controller_mismatch"]
    assert unsure(fitted, names, np.zeros(1, int), 3.0) == {"cogging"}
    assert unsure(fitted, names, np.zeros(1, int), 2.4) == set()
    assert unsure(fitted, names, np.zeros(1, int), 30.0) == {"cogging", "amplifier_deadband"}
    assert unsure(fitted, ["controller_mismatch"], np.zeros(1, int), 30.0) == set()


def test_an_effect_is_as_strong_as_its_amplitude_or_width() -> None:
    assert DirectionalFriction(-0.1, 2e-6, 0).strength() == 0.1
    assert AmplifierDeadband(0.2).strength() == 0.2


CRITERIA = Criteria()


def _row(name: str, over: float) -> EffectRow:
    """An effect that gains so many times its threshold."""
    return EffectRow(name, (), 20.0 * over, 20.0, 0.0, adequate=False)


def test_a_name_is_as_likely_as_names_were_right_and_rivals_share_that() -> None:
    named = CRITERIA.probability_named
    assert probability(_row("play", 50.0), 0, ["play"], (), CRITERIA) == named
    assert probability(_row("play", 1.1), 0, ["play"], (), CRITERIA) == named
    rivals = (("play", "cogging"),)
    assert [probability(_row(name, 2.0), i, ["play"], rivals, CRITERIA) for i, name in enumerate(rivals[0])] == [
        named / 2,
        named / 2,
    ]


def test_a_name_that_the_trials_say_nothing_of_is_less_likely() -> None:
    """Where the drive is rougher than its model, or the law has another form."""
    rows = [probability(_row("play", 50.0), 0, ["play"], (), CRITERIA, doubtful) for doubtful in ((), ("play",))]
    assert rows == [CRITERIA.probability_named, CRITERIA.probability_doubtful]
    assert CRITERIA.probability_doubtful < CRITERIA.probability_named


def test_beside_a_name_and_behind_the_first_nothing_is_likely() -> None:
    other = CRITERIA.probability_other
    assert probability(_row("cogging", 50.0), 1, ["play"], (), CRITERIA) == other
    assert probability(_row("cogging", 50.0), 1, [], (), CRITERIA) == other


def test_the_first_without_a_name_is_likely_by_its_gain_over_the_threshold() -> None:
    def first(over: float) -> float:
        return probability(_row("play", over), 0, [], (), CRITERIA)

    assert first(2.0) == CRITERIA.probability_first
    assert first(1.01 * CRITERIA.far_above) == CRITERIA.probability_far_above
    assert first(1.0) == CRITERIA.probability_below
    assert first(0.5) == CRITERIA.probability_below / 8
    assert first(-1.0) == 0.0
    below = [first(over) for over in np.linspace(0.0, 1.0, 9)]
    assert below == sorted(below)
