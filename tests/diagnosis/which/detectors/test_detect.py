"""Detectors by themselves: a law whose effect is not linear is looked at from afar."""

from __future__ import annotations

from collections.abc import Collection
from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis.criteria import Criteria
from diagnosis.experiments.schedules import dwell_sweep
from diagnosis.model.kalman import Resonance
from diagnosis.which.detectors import detect
from diagnosis.which.detectors.command_jitter import Lateness
from diagnosis.which.detectors.detect import View, _from_afar
from diagnosis.which.detectors.random_force import RandomForce
from diagnosis.which.detectors.scan import Finding
from diagnosis.which.stage import Proposal
from models.effects.base import parameters
from models.effects.motor import Cogging, GainAsymmetry, TimingJitter
from models.effects.scale import ScaleDrift, ScalePeriodicError
from models.effects.structure import AdditionalMode
from models.machine import load
from tests.diagnosis.tables import nominal_with, recorded, table


def seen(drift: float) -> Any:
    """Records of a table whose scale drifts at so many m/s, with nothing of it in the model."""
    machine = table()
    records = recorded(machine, [dwell_sweep(machine, (0.3, 0.9))], [ScaleDrift(drift)], seed=2, wrong=0.0)
    nothing: Any = None
    return View(nominal_with(machine, (), records), SimpleNamespace(records=records), nothing)  # type: ignore[arg-type]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_law_of_the_reading_alone_is_tried_at_large_sizes_of_either_sign(sign: float) -> None:
    (item,) = parameters(ScaleDrift, table().priors)
    found = _from_afar(seen(sign * 4 * item.high), Proposal("scale_drift", -200.0, 20.0, effect=ScaleDrift(1e-9)))
    assert found.effect == ScaleDrift(sign * 5 * item.high)
    assert found.in_sample_gain > 1000
    assert found.gain == -200.0  # on held-out motions it still gains nothing to first order


@pytest.mark.parametrize(
    "effect", [Cogging(1.0, 30e-3, 0.0), GainAsymmetry(0.01), ScalePeriodicError(1e-7, 2e-5, 0.0)], ids=lambda e: e.name
)
def test_no_other_law_is(effect: Any) -> None:
    """One of force does not move the path, and one with a period is looked for along it."""
    proposal = Proposal(effect.name, 5.0, 20.0, effect=effect)
    assert _from_afar(seen(0.0), proposal) is proposal


@pytest.mark.parametrize(("samples", "simulated"), [(0.05, 0.02), (0.2, 0.04), (1.5, 0.1)])
def test_commands_that_are_late_by_more_than_a_sample_are_simulated_as_such(
    samples: float, simulated: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all of them late by one, 1.5 samples were a dead time that does not vary at all."""
    step = 5e-4
    monkeypatch.setattr(detect, "lateness", lambda *_: Lateness(samples * step, 1e4, 0.0))
    fitted: Any = SimpleNamespace(candidate=SimpleNamespace(added_effects=()))
    record = SimpleNamespace(sample_time=step, every=1)
    baseline: Any = SimpleNamespace(criteria=Criteria(), thresholds={}, records=(record,))
    nothing: Any = None
    (found,) = detect.command_jitter(View(fitted, baseline, nothing)).proposals
    part = found.random_part
    assert part is not None
    assert isinstance(part.effect, TimingJitter)
    assert part.effect.part == pytest.approx(simulated)
    assert part.part * simulated == pytest.approx(samples**2)


@pytest.mark.parametrize(
    ("disabled", "frequency", "gain", "proposed"),
    [
        ((), 270.0, 5e3, True),
        (("additional_mode",), 270.0, 5e3, False),
        (("additional_mode",), 120.0, 5e3, True),
        (("additional_mode",), 270.0, 1e3, True),
        (("cogging",), 270.0, 5e3, True),
    ],
)
def test_what_a_mode_that_must_not_be_used_rings_is_no_floor(
    disabled: tuple[str, ...], frequency: float, gain: float, proposed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mode rings with the noise of the commands as well at rest as in motion: 150 N at 268 Hz of a floor were named
    in its place on an axis of 3 N of friction (seed 202636)."""
    kinds = {kind.name: kind for kind in (AdditionalMode, Cogging)}
    line = RandomForce(Resonance(268.0, 0.5, 5.0), 1e4)
    mode = Finding(AdditionalMode(1e-3, frequency, 0.02), 0.0, gain)

    def scanned(_fitted: Any, _records: Any, _own: Any, left_out: Collection[str]) -> tuple[list[Finding], Any]:
        assert set(left_out) == {"cogging"}
        return [mode], {}

    monkeypatch.setattr(detect, "strongest_random_force", lambda *_: line)
    monkeypatch.setattr(detect, "is_locked", lambda *_: False)
    monkeypatch.setattr(detect, "gain_in_time", lambda *_: 0.0)
    monkeypatch.setattr(detect, "scan", scanned)
    fitted: Any = SimpleNamespace(candidate=SimpleNamespace(added_effects=(), random_forces=()))
    baseline: Any = SimpleNamespace(
        criteria=Criteria(),
        thresholds={},
        records=(SimpleNamespace(every=1),),
        machine=SimpleNamespace(kinds=kinds),
        delivered=load(),
    )
    nothing: Any = None
    found = detect.random_force(View(fitted, baseline, nothing, disabled)).proposals
    assert [one.name for one in found] == (["floor_vibration"] if proposed else [])
