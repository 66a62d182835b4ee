"""By how much values are off, and what the file handed over costs, in words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from studies.gap_diagnosis.how_far import MIN_SETTLING_ERROR_RATIO, _slower
from studies.gap_diagnosis.moved_most import refit_is_most
from studies.gap_diagnosis.shifts import _less_bias, _most_moved, _of_all_contacts
from studies.wording import in_percent
from tests.diagnosis.tables import table


def test_of_contacts_that_make_up_for_one_another_little_is_off_in_all() -> None:
    machine = table()
    layout = parameters(machine, 1)
    theta = np.zeros(layout.count)
    where = layout.of("presliding_stiffness")[:2]
    first, second = machine.friction.stiffness[:2]
    theta[where] = np.log1p([0.4, -0.4 * first / second])
    assert _of_all_contacts("presliding_stiffness", Candidate(layout, theta)) == pytest.approx(0.0, abs=1e-12)
    theta[layout.of("presliding_limit")] = np.log1p(0.1)
    assert _of_all_contacts("presliding_limit", Candidate(layout, theta)) == pytest.approx(0.1)
    assert _of_all_contacts("payload_mass", Candidate(layout, theta)) is None


def test_what_a_re_fit_moves_where_nothing_is_wrong_is_not_told_of_the_machine() -> None:
    """Of a log of every second sample the mass had been "off by 20 %", of which 13 % are of interpolation."""
    machine = table()
    layout = parameters(machine, 1)
    own = np.flatnonzero(np.array(layout.names) != "initial_friction_state")
    theta, bias = np.zeros(layout.count), np.zeros(own.size)
    mass, delay = layout.of("payload_mass"), layout.of("dead_time")
    theta[mass], theta[delay] = -12 * layout.deviation[mass], 2 * layout.deviation[delay]
    bias[mass], bias[delay] = -8.6, 0.5
    baseline: Any = SimpleNamespace(biased={"payload_mass": -8.6}, null=SimpleNamespace(bias=lambda: bias))
    fitted = Candidate(layout, theta)
    less = _less_bias(fitted, baseline)
    assert _most_moved("payload_mass", fitted) == pytest.approx(12)
    assert _most_moved("payload_mass", less) == pytest.approx(3.4)
    assert _most_moved("dead_time", less) == pytest.approx(2)
    baseline.biased = {}
    assert _less_bias(fitted, baseline) is fitted
    assert _less_bias(None, baseline) is None


@pytest.mark.parametrize(("left", "most"), [(1.88, True), (5.0, False), (13.7, False)])
def test_values_are_told_where_they_are_most_of_the_gap(left: float, most: bool) -> None:
    """On a rack whose friction differed by direction by 12.5 N, an offset of 12.3 N had stood among "4 more"."""
    forces = {"gap_as_delivered": 13.7, "gap_refitted": left, "floor": 0.29}
    assert refit_is_most({"how_far": {name: {"force_N": force} for name, force in forces.items()}}) == most


def test_a_share_is_written_out() -> None:
    assert [in_percent(size) for size in (0.0413, 9.98, 25.2)] == ["4.1 %", "1000 %", "25 times"]


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (10e-3, 15e-3, True),
        (10e-3, MIN_SETTLING_ERROR_RATIO * 9.99e-3, False),
        (None, 15e-3, False),
        (10e-3, None, False),
    ],
)
def test_a_larger_error_of_settling_is_told_of_the_file_handed_over(
    before: float | None, after: float | None, said: bool
) -> None:
    """As of a gantry, where it was within chance, so that no gate held it back."""
    errors = {"as delivered": before, "re-fitted": after}
    files = [{"file": name, "held_out": {"settling_s": size}} for name, size in errors.items()]
    told = _slower({"files": files, "adopted_file": "re-fitted"})
    assert bool(told) == said
    begins = "Of settling, on motions held out, it leaves 15 ms where the machine as delivered leaves 10 ms"
    assert not said or told[0].startswith(begins)
    assert _slower({"files": files, "adopted_file": "as delivered"}) == []
