"""Records of 62.5 to 200 Hz: their low-passes have room, and what is identified is right or refused in a sentence."""

from __future__ import annotations

import pytest

from models.identification.force.by_elements import identify
from models.identification.force.signals import SMOOTHING, Terms, usable_band
from models.identification.pipeline import identify as identify_machine
from models.records.files import Loaded
from studies.identify_machine.shown import results_of
from tests.diagnosis.slow import leg, moved


@pytest.mark.parametrize("rate", [62.5, 200.0])
def test_a_slowly_sampled_axis_is_identified_and_reported(rate: float) -> None:
    machine = leg(rate)
    record = moved(machine, count=1200)
    found = identify_machine(machine, [Loaded("moves.csv", "none", record, (), ())], kinds=["dynamics"])
    assert found.machine.plant.mass == pytest.approx(0.5, rel=0.05)
    shown = results_of(found)["dynamics"]
    assert shown["cutoff_Hz"] == pytest.approx(0.1 * rate)
    by_the_authors = next(one for one in shown["published"] if not one["by_direction"])
    mass = next(one["number"] for one in by_the_authors["values"] if one["name"] == "mass")
    assert mass == pytest.approx(0.5, rel=0.2)


def test_low_passes_keep_below_half_the_rate_and_usual_records_to_the_usual_band() -> None:
    assert usable_band(40.0, 0.5e-3) == 40.0
    assert usable_band(40.0, 1e-3) == 40.0
    for rate in (62.5, 100.0, 200.0):
        assert max(SMOOTHING) * usable_band(40.0, 1 / rate) < 0.5 * rate


def test_a_handful_of_samples_is_refused_in_a_sentence() -> None:
    machine = leg(62.5)
    with pytest.raises(ValueError, match="30 samples are too few to show friction"):
        identify(moved(machine).part(40, 70), Terms(), pass_band=4.0)
