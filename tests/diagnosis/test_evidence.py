"""What accompanies the named effects: the next experiment in the units of the axis; what records could not show."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis import evidence as module
from diagnosis.experiments.propose import Proposal
from tests.diagnosis.tables import table


@pytest.mark.parametrize(("axis", "said"), [("linear", "moves of 5 mm"), ("rotary", "moves of 5 mrad")])
def test_the_next_experiment_is_asked_for_in_the_units_of_the_axis(
    axis: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """results.json of a worm gear had asked for "moves of 5 mm"."""
    asked = Proposal("Run moves of 5 mm.", (), 1.0)  # type: ignore[arg-type]
    monkeypatch.setattr(module, "_proposal", lambda *_: asked)
    machine = replace(table(), axis=axis)
    found: Any = SimpleNamespace(effects=(), partly=(), baseline=SimpleNamespace(machine=machine))
    looked: Any = (None, None)
    proposal = module._evidence(found, looked, 0).proposal
    assert proposal is not None
    assert proposal.sentence == f"Run {said}."


def test_what_is_named_is_not_listed_as_what_the_records_could_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """The list is of typical sizes: timing jitter had been named with 0.98 and listed in the same results.json."""
    monkeypatch.setattr(module, "_proposal", lambda *_: None)
    monkeypatch.setattr(module, "place", lambda _: {})
    monkeypatch.setattr(module, "confusion", lambda _: {})
    hidden = ("friction_drift", "gain_asymmetry", "timing_jitter", "scale_drift")
    looked: Any = (None, SimpleNamespace(not_identifiable=hidden))
    found: Any = SimpleNamespace(effects=("noncollocated_friction", "timing_jitter"), partly=("scale_drift",))
    verdict = module._evidence(found, looked, 0).to_json()["verdict"]
    assert verdict["not_identifiable"] == ["friction_drift", "gain_asymmetry"]
