"""What accompanies the named effects: the next experiment in the units of the axis."""

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
    found: Any = SimpleNamespace(baseline=SimpleNamespace(machine=replace(table(), axis=axis)))
    looked: Any = (None, None)
    proposal = module._evidence(found, looked, 0).proposal
    assert proposal is not None
    assert proposal.sentence == f"Run {said}."
