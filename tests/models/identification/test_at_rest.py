"""The noise of the scale from readings at rest."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.identification.joint.at_rest import with_noise
from models.identification.joint.steps import Identified
from models.machine import Machine, Provenance, load
from models.records.files import Loaded
from models.records.record import Record
from studies.identify_machine import own_records

MACHINE = load()


def motions(noise: float, seed: int, name: str) -> Loaded:
    """Motions of the default table with a scale of this noise [steps]."""
    scale = replace(MACHINE.scale, noise=noise * MACHINE.scale.resolution)
    return Loaded(name, "0", own_records.motions(replace(MACHINE, scale=scale), seed), (), ())


@pytest.mark.parametrize("noise", [0.4, 1.5])
def test_the_noise_at_rest_goes_into_a_file_that_only_assumes_one(noise: float) -> None:
    records = [motions(noise, seed, f"{seed}.csv") for seed in (1, 2)]
    found = with_noise(Identified(MACHINE), records)
    size, source = found.machine.scale.noise, found.machine.sources["scale.noise"]
    assert size == pytest.approx(noise * MACHINE.scale.resolution, rel=0.15)
    assert isinstance(source.std, float)
    assert abs(size - noise * MACHINE.scale.resolution) < 3 * source.std
    assert (source.kind, source.detail) == ("identified", "reading at rest")
    assert source.record in {"1.csv", "2.csv"}
    assert "2 records show" in found.remarks[-1]


def test_a_noise_that_is_known_stays_and_so_does_one_that_no_record_shows() -> None:
    scale = replace(MACHINE.scale, noise=1e-7)
    given = Identified(replace(MACHINE, scale=scale, sources={"scale.noise": Provenance("given", "a datasheet")}))
    assert with_noise(given, [motions(0.4, 1, "a.csv")]) == given
    plain = Identified(MACHINE)
    short = motions(0.4, 1, "a.csv")
    assert isinstance(short.content, Record)
    cut = replace(short, content=short.content.part(0, 300))
    assert with_noise(plain, [cut]) == plain


def test_a_reading_that_only_rounds_has_no_noise() -> None:
    still: Machine = replace(MACHINE, scale=replace(MACHINE.scale, noise=1e-15))
    only = Loaded("a.csv", "0", own_records.motions(still, 1), (), ())
    found = with_noise(Identified(MACHINE), [only])
    assert found.machine.scale.noise == MACHINE.scale.noise == 0.0
