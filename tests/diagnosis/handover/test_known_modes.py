"""Modes that a sweep told are handed over as it told them, unless the structure has changed since."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.baseline import Baseline
from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.handover import known_modes
from diagnosis.handover.final_fit import Finished, finished
from diagnosis.handover.known_modes import with_known_modes
from diagnosis.handover.overrun import OVERRUN
from diagnosis.model.fit import Fit
from diagnosis.model.parameters import modes_as_stated, parameters
from diagnosis.null import Null
from diagnosis.records.motions import pieces
from diagnosis.records.units import loop_time, with_units
from diagnosis.refit import refit_within
from models.effects.base import Effect
from models.effects.friction_laws import FrictionRelaxation, Stribeck
from models.machine import Machine, Provenance
from models.records.record import Record
from tests.diagnosis.tables import recorded, table

FINE = replace(table(), scale=replace(table().scale, resolution=5e-9, noise=3e-9))
PLAN = (together("short", [amplitude_ladder(FINE, (5e-6, 20e-6, 100e-6)), strokes(FINE, 45e-3, (0.2,))]),)
SHARES = {"gain": 2e-3, "frequency": 1e-4, "damping": 3e-3}


def stating(machine: Machine) -> Machine:
    """The machine whose file states deviations of its vibration modes, as a sweep gives them."""
    stated = {
        f"plant.modes.{i + 1}.{name}": Provenance("identified", "a sweep", std=share * abs(getattr(mode, name)))
        for i in machine.plant.flexible
        for mode in (machine.plant.modes[i],)
        for name, share in SHARES.items()
    }
    return replace(machine, sources={**machine.sources, **stated})


def files(truth: Machine, effects: tuple[Effect, ...]) -> tuple[Finished, Finished]:
    """The fit behind the re-fitted file by the records alone, and with what the file knows of the modes."""
    records = recorded(truth, PLAN, effects, seed=4, wrong=0.0)
    machine = with_units(stating(FINE), records)
    baseline = Baseline(
        refit_within(machine, records), records, pieces(records, loop_time(machine)), Null({}, ((0.9,),), (4.0,))
    )
    found = finished(baseline.nominal, records)
    return found, with_known_modes(found, baseline)


def off(found: Finished) -> float:
    """By how many stated deviations the modes are off the file's, at most [1]."""
    deviation = modes_as_stated(parameters(stating(FINE), 1))
    known = deviation < parameters(stating(FINE), 1).deviation
    return float(np.max(np.abs(found.candidate.theta[known]) / deviation[known]))


def test_modes_do_not_make_up_for_a_friction_that_the_model_lacks() -> None:
    alone, kept = files(FINE, (Stribeck(0.12, 2e-3), FrictionRelaxation(0.1, 0.3, 0)))
    assert off(alone) > OVERRUN
    assert off(kept) < 1.0
    assert kept.modes_kept == pytest.approx(off(alone))
    assert kept.frequency_alone is not None
    before, now = kept.frequency_alone
    assert (before, now) in [
        (FINE.plant.modes[i].frequency, alone.candidate.machine.plant.modes[i].frequency) for i in FINE.plant.flexible
    ]


def test_modes_that_a_rough_record_moves_all_the_same_are_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's belt axis: 36.10 +- 0.24 Hz had become 24.2 Hz under "the modes are as the machine file knows them", as
    the records outweighed the deviations that it states."""

    def stubborn(given: Fit, records: Sequence[Record]) -> Finished:
        tight = np.min(given.candidate.layout.deviation / modes_as_stated(alone.candidate.layout)) < 0.1
        return finished(given, records) if tight else alone

    records = recorded(FINE, PLAN, (Stribeck(0.12, 2e-3), FrictionRelaxation(0.1, 0.3, 0)), seed=4, wrong=0.0)
    machine = with_units(stating(FINE), records)
    base = Baseline(
        refit_within(machine, records), records, pieces(records, loop_time(machine)), Null({}, ((0.9,),), (4.0,))
    )
    alone = finished(base.nominal, records)
    monkeypatch.setattr(known_modes, "finished", stubborn)
    kept = with_known_modes(alone, base)
    assert off(alone) > OVERRUN
    assert off(kept) < 0.01
    assert kept.modes_kept == pytest.approx(off(alone))


def test_a_structure_that_has_changed_has_its_new_modes() -> None:
    first, second, third = FINE.plant.modes
    changed = replace(second, gain=1.3 * second.gain, frequency=0.93 * second.frequency)
    truth = replace(FINE, plant=replace(FINE.plant, modes=(first, changed, third)))
    alone, kept = files(truth, ())
    assert kept is alone
    assert kept.candidate.machine.plant.modes[1].frequency == pytest.approx(changed.frequency, rel=5e-3)


def test_modes_without_a_deviation_of_their_own_are_as_before() -> None:
    layout = parameters(FINE, 1)
    assert modes_as_stated(layout).tolist() == layout.deviation.tolist()
