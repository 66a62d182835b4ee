"""What a sealed machine is asked to achieve: missed by the nominal design, and within what its scale can show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from studies.blind_trial.sealer.machines import cases
from studies.blind_trial.sealer.machines.specifying import (
    DEPARTURE,
    IMPOSSIBLE,
    SHOWN,
    WIDEST,
    departure,
    specification,
)

OFF, CLEAN, FINE = (2, 28), (5, 30), (5, 31)  # seed and case: parameters are off, nothing is wrong, more than can be


def asked(case: tuple[int, int]) -> tuple[cases.Plan, dict[str, Any]]:
    found = cases.plan(*case, "sealed")
    return found, specification(found)


def test_a_tolerance_lies_between_the_departure_and_the_scale() -> None:
    found, wanted = asked(OFF)
    departs, read = departure(found, wanted), found.bench.axis.read
    assert departs is not None
    assert DEPARTURE[0] <= departs / wanted["tolerance_m"] <= DEPARTURE[1]
    assert wanted["tolerance_m"] > SHOWN * read
    assert specification(found) == wanted


def test_where_nothing_is_wrong_the_tolerance_is_drawn_between_the_same_ends() -> None:
    found, wanted = asked(CLEAN)
    assert departure(found, wanted) == 0.0
    assert SHOWN * found.bench.axis.read < wanted["tolerance_m"] < WIDEST * wanted["stroke_m"]
    others = [specification(replace(found, seed=found.seed + 1 + number))["tolerance_m"] for number in range(40)]
    ends = np.log([SHOWN * found.bench.axis.read, WIDEST * wanted["stroke_m"]])
    share = (np.log(others) - ends[0]) / (ends[1] - ends[0])
    assert np.quantile(share[share > 0], 0.25) < 0.5 < np.quantile(share[share > 0], 0.75)


def test_some_are_asked_for_more_than_their_scale_can_show() -> None:
    found, wanted = asked(FINE)
    assert wanted["tolerance_m"] == pytest.approx(IMPOSSIBLE[1] * found.bench.axis.read)
