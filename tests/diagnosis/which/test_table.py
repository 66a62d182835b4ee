"""The table of candidates: which members of an effect it shows, in which order."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.which import table as candidates
from models.effects.catalogue import in_order
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.effects.motor import AmplifierDeadband, Cogging
from models.machine import load


def test_the_stronger_member_comes_first_and_the_machine_files_own_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    own = (ViscousFriction(200.0), Cogging(9.0, 0.05, 0.0))
    found = (DirectionalFriction(0.05, 1e-6, 0), DirectionalFriction(-0.1, 2e-6, 0), Cogging(1.0, 0.03, 0.0))
    layout = parameters(replace(load(), effects=own), 1)
    effects = in_order((*own, *found))
    fitted: Any = SimpleNamespace(candidate=Candidate(layout, np.zeros(layout.count), effects))
    monkeypatch.setattr(candidates, "deviations_of", lambda _: [{"number": float(i)} for i in range(len(effects))])
    members = candidates._members(fitted)
    assert set(members) == {"directional_friction", "cogging"}
    assert [effect for effect, _ in members["directional_friction"]] == [found[1], found[0]]
    assert [effect for effect, _ in members["cogging"]] == [found[2]]
    assert members["directional_friction"][0][1] == {"number": float(effects.index(found[1]))}


def test_an_effect_is_as_strong_as_its_amplitude_or_width() -> None:
    assert DirectionalFriction(-0.1, 2e-6, 0).strength() == 0.1
    assert AmplifierDeadband(0.2).strength() == 0.2
