"""The improved machine: where its values are from."""

from __future__ import annotations

from diagnosis.handover.files import provenance_of_effects
from models.effects.motor import DacQuantisation


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
