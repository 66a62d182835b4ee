"""A stage on flexures, whose file states a straight spring and a thrust constant that is the same everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.diagnose import Diagnosis, diagnose
from diagnosis.verdict import Outcome
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.effects.measured import Measured
from models.effects.motor import ThrustFallOff
from models.effects.structure import HardeningSpring
from models.machine import FROM_ELEMENTS, Machine
from models.plant import Mode
from studies.identify_machine import own_records
from tests.models.identification.test_flexure import TRUE

WIDEST = 1.5e-3  # m
HEAVIER = (Mode(1 / 1.22, 0.0, 0.0), *TRUE.plant.modes[1:])
FILE = replace(TRUE, presliding=FROM_ELEMENTS, plant=replace(TRUE.plant, modes=HEAVIER))


def stage(effects: Sequence[Effect]) -> Machine:
    return replace(TRUE, effects=in_order([*TRUE.effects, *effects]))


def moves() -> np.ndarray:
    """Moves of 30 ms with rests [m]."""
    ts, at = TRUE.sample_time, 0.0
    s = np.linspace(0, 1, round(0.03 / ts))
    way = [np.zeros(round(0.3 / ts))]
    for to in (1e-3, -1e-3, WIDEST, 0.0, -WIDEST, 5e-4, -2e-4, 2e-5, 0.0, 1e-3, WIDEST, -WIDEST, 0.0):
        way += [at + (to - at) * (10 * s**3 - 15 * s**4 + 6 * s**5), np.full(round(0.08 / ts), to)]
        at = to
    return np.concatenate(way)


def diagnosed(*effects: Effect) -> Diagnosis:
    target = moves()
    return diagnose(FILE, [own_records.run(stage(effects), target, np.zeros(target.size), 3)])


def test_a_heavier_stage_is_no_bent_spring() -> None:
    found = diagnosed()
    assert (found.outcome, found.effects) == (Outcome.PARAMETERS, ("payload_mass",))


@pytest.mark.parametrize(
    "effect",
    [
        HardeningSpring(0.06 * 15350 / WIDEST**2),
        HardeningSpring(-0.04 * 15350 / WIDEST**2),
        ThrustFallOff(0.05 / WIDEST**2),
    ],
    ids=["hardens", "softens", "weakens"],
)
def test_what_a_flexure_or_a_voice_coil_does_far_out_is_named_with_its_size(effect: Effect) -> None:
    """Each was named thrust saturation. Beside a sine of one period over the whole way a cube is ambiguous at most."""
    found = diagnosed(effect)
    assert found.outcome in (Outcome.ATTRIBUTED, Outcome.AMBIGUOUS)
    assert found.effects == (effect.name,)
    assert all(set(group) <= {effect.name, "cogging"} for group in found.equivalent)
    (fitted,) = (one for one in found.final.candidate.effects if one.name == effect.name)
    assert fitted.values() == pytest.approx(effect.values(), rel=0.01)
    assert found.how_far.closure > 0.99


FAR = np.linspace(-2e-3, 2e-3, 81)
BENT = {
    "stops": np.where(np.abs(FAR) > 0.7e-3, -np.sign(FAR) * (np.abs(FAR) - 0.7e-3) * 2500, 0.0),
    "slack": -15350 * 0.04 * np.tanh(FAR / 0.4e-3) * 0.4e-3,
}


@pytest.mark.parametrize("law", BENT)
def test_a_spring_bent_in_another_form_is_not_told_from_a_cogging_of_one_period(law: str) -> None:
    """Soft stops, and a spring that is stiffer about its middle: two sines of place close both, and had been named."""
    found = diagnosed(Measured("position", tuple(FAR), tuple(BENT[law])))
    assert found.outcome is Outcome.AMBIGUOUS
    assert ("cogging", "hardening_spring") in found.equivalent
