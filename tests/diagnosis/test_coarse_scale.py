"""Where the re-fit would move values of a table with nothing wrong, it is weighed until it moves them no more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from diagnosis import baseline as module
from diagnosis.baseline import refit_and_null
from diagnosis.null import DRAWS, Null
from tests.diagnosis.tables import recorded, short, table

MACHINE = table()
BIASED = {"friction_level": -5.4, "payload_mass": -4.2, "dead_time": 1.5}


class Chance:
    """A null whose tables are moved by BIASED, unless their weights are at least those of so rough a drive."""

    def __init__(self, layout: Any, roughness: tuple[float, ...], enough: float) -> None:
        names = [name for name in layout.names if name != "initial_friction_state"]
        size = max(roughness, default=1.0) < enough
        scatter = 0.1 * np.random.default_rng(1).standard_normal((DRAWS, len(names)))
        moved = scatter + np.array([size * BIASED.get(name, 0.0) for name in names])
        self.usual = None
        self.found = Null({}, ((1.0,),) * DRAWS, (4.0,) * DRAWS, (), tuple(map(tuple, moved.tolist())))

    def completed(self, _: object) -> Null:
        return self.found


@pytest.mark.parametrize(("enough", "taken"), [(1.0, ()), (2.0, (3.0,)), (5.0, (10.0,)), (99.0, (10.0,))])
def test_the_weights_are_those_under_which_no_value_is_moved(
    enough: float, taken: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def begun(layout: Any, *_: object, roughness: tuple[float, ...] = (), **__: object) -> Chance:
        asked.append(roughness)
        return Chance(layout, roughness, enough)

    monkeypatch.setattr(module, "begun", begun)
    records = recorded(MACHINE, (short(MACHINE),), seed=3)
    found = refit_and_null(MACHINE, records)
    assert found.nominal.candidate.roughness == taken
    assert asked[-1] == taken
    assert list(found.biased) == (["friction_level", "payload_mass"] if taken else [])
    assert found.null.bias().max() <= (2.0 if enough < 99.0 else 10.0)
    if taken:
        assert found.biased["friction_level"] == pytest.approx(-5.4, abs=0.2)
