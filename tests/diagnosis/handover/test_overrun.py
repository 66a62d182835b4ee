"""Values that a re-fit moved farther than the machine file knows them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnosis.handover.overrun import as_reported, overrun
from models.machine import Provenance, load
from models.plant import Mode


def test_values_that_were_moved_farther_than_the_file_knows_them_come_farthest_first() -> None:
    nominal = load()
    known = Provenance("identified", "a frequency response", std=1e-6)
    limits = nominal.friction.limit
    loops = Provenance("identified", "loops", std=0.1), Provenance("identified", "loops", std=(1e-8,) * len(limits))
    sources = {**nominal.sources, "plant.dead_time": known, "drive.offset": loops[0], "friction.limit": loops[1]}
    stated = replace(nominal, sources=sources)
    plant = replace(nominal.plant, dead_time=nominal.plant.dead_time + 20e-6)
    longer = replace(nominal.friction, limit=(*limits[:-2], limits[-2] + 1e-8, limits[-1] + 12e-8))
    drive = replace(nominal.drive, offset=nominal.drive.offset + 1.5)
    moved = replace(nominal, plant=plant, drive=drive, friction=longer)
    found = overrun(stated, moved, 10.0)
    assert [one.name for one in found] == ["plant.dead_time", "drive.offset", "friction.limit"]
    assert [one.deviations for one in found] == pytest.approx([20.0, 15.0, 12.0])
    assert found[-1].before == limits[-1]
    assert overrun(stated, moved, 25.0) == ()
    assert overrun(nominal, moved, 10.0) == ()  # whose file states no deviations


def test_the_mass_comes_first_and_is_told_as_one() -> None:
    """Whatever its deviations: a motor's constant 6 % lower had been behind three values of a mode, and "5 more"."""
    nominal = load()
    rigid, first, *rest = nominal.plant.modes
    known = Provenance("identified", "a sweep", std=1e-5), Provenance("identified", "a sweep", std=1e-3)
    names = "plant.modes.1.gain", "plant.modes.2.frequency"
    stated = replace(nominal, sources={**nominal.sources, **dict(zip(names, known, strict=True))})
    moved_modes = (Mode(rigid.gain * 1.03, 0.0, 0.0), replace(first, frequency=first.frequency + 1.0), *rest)
    found = overrun(stated, replace(stated, plant=replace(stated.plant, modes=moved_modes)), 10.0)
    assert [one.name for one in found] == [*names]
    assert found[0].deviations < found[1].deviations
    mass, other = (as_reported(one, stated) for one in found)
    assert (mass.name, mass.unit, other) == ("plant.mass", "kg", found[1])
    assert (mass.before, mass.now) == pytest.approx((1 / rigid.gain, 1 / rigid.gain / 1.03))
    assert mass.std / mass.before == pytest.approx(1e-5 / rigid.gain)
