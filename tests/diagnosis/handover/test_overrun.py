"""Values that a re-fit moved farther than the machine file knows them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnosis.handover.overrun import overrun
from models.machine import Provenance, load


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
