"""The contacts' damping is a value of the re-fit where the file says how well it is known, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.model.at_bounds import at_bounds
from diagnosis.model.parameters import applied, parameters, priors
from diagnosis.model.residual import Candidate, evaluate, nominal_slopes, smooth
from diagnosis.refit import refit
from models.friction import elements
from models.machine import Machine, Provenance
from tests.diagnosis.tables import recorded, short, table

LAG, STD = 400e-6, 160e-6  # D_i / K_i [s]


def damped(*, stated: bool = True) -> Machine:
    """The table, whose contacts have no damping, with a file that says they have."""
    machine = table()
    stiffness = np.array(machine.friction.stiffness)
    machine = replace(machine, friction=elements(stiffness, machine.friction.limit, LAG * stiffness))
    said = Provenance("identified", "a test", std=tuple((STD * stiffness).tolist()))
    return machine.with_value("friction.damping", machine.friction.damping, said) if stated else machine


def test_it_falls_to_none_at_most_which_is_no_bound_that_is_told() -> None:
    layout = parameters(damped(), 1)
    (place,) = layout.of("contact_damping")
    assert (layout.low[place], layout.high[place]) == pytest.approx((-LAG, 3 * STD))
    theta = np.where(np.arange(layout.count) == place, layout.low, 0.0)
    assert max(applied(layout, theta).friction.damping) == pytest.approx(0.0, abs=1e-9 * max(damped().friction.damping))
    assert at_bounds(Candidate(layout, theta)) == ()
    assert [one.name for one in at_bounds(Candidate(layout, -theta * 3 * STD / LAG))] == ["contact_damping"]
    (prior,) = (one for one in priors(layout) if one.name == "contact_damping")
    assert (prior.unit, prior.origin) == ("s", "value")
    assert prior.deviations == pytest.approx((STD, STD))
    assert parameters(damped(stated=False), 1).of("contact_damping").size == 0


def test_the_innovations_change_with_it_as_a_difference_says() -> None:
    machine = damped()
    records = recorded(machine, [short(machine)], seed=5)
    layout = parameters(machine, 1)
    (place,) = layout.of("contact_damping")
    here = Candidate(layout, np.zeros(layout.count))
    paths = smooth(here, records)
    slope = nominal_slopes(here, records, evaluate(here, records, paths))[:, place]
    step = 1e-5
    low, high = (
        evaluate(replace(here, theta=side * step * (np.arange(layout.count) == place)), records, paths)[0].innovations
        for side in (-1, 1)
    )
    differs = (high - low) / (2 * step)
    assert np.linalg.norm(slope - differs) < 0.05 * np.linalg.norm(differs)


def test_damping_that_is_not_there_is_re_fitted_away_where_the_file_says_that_it_is_unsure() -> None:
    """A user's file had 208 +- 82 us that an identification had found in an axis without any: the diagnosis named a
    frictional lag, which takes it off again. Without the deviation a tenth more is left to explain."""
    records = recorded(table(), [short(table())], seed=3)
    unsure, sure, without = (refit(parameters(file, 1), records) for file in (damped(), damped(stated=False), table()))
    friction = unsure.candidate.machine.friction
    assert sum(friction.damping) < 0.1 * LAG * sum(friction.stiffness)
    assert unsure.cost < without.cost + 10 < sure.cost - 1000
