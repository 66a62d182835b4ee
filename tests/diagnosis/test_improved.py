"""The improved machine: where its values are from."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.handover.files import provenance_of_effects
from diagnosis.improved import at_limit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from models.effects.motor import DacQuantisation
from models.machine import load


@pytest.mark.parametrize(
    ("name", "dotted"),
    [
        ("dead_time", {"plant.dead_time"}),
        ("presliding_limit", {"friction.limit"}),
        ("mode_damping", {"plant.modes.2.damping"}),
    ],
)
def test_values_at_the_end_of_their_range_have_their_names_in_the_file(name: str, dotted: set[str]) -> None:
    layout = parameters(load(), 1)
    place = int(layout.of(name)[0])
    theta = np.zeros(layout.count)
    theta[place] = layout.high[place]
    assert at_limit(Candidate(layout, theta, ()), [place]) == dotted
    assert at_limit(Candidate(layout, theta, ()), []) == set()


def test_an_identified_size_carries_its_deviation_and_a_switch_says_what_it_is() -> None:
    effect = DacQuantisation(0.05, 1)
    found = dict(provenance_of_effects([effect], [effect], [{"step": 1e-3}], (), "gap_diagnosis of a.csv"))
    said = {name.rpartition(".")[2]: (one.kind, one.detail, one.std) for name, one in found.items()}
    assert said == {
        "step": ("identified", "gap_diagnosis of a.csv", 1e-3),
        "rise": ("identified", "gap_diagnosis of a.csv; the best of its laws", None),
    }
    given = dict(
        provenance_of_effects([effect], [effect], [{"step": 1e-3}], {"dac_quantisation"}, "gap_diagnosis of a.csv")
    )
    assert [name.rpartition(".")[2] for name in given] == ["step"]  # whose law the machine file gave
