"""Every effect of the catalogue, put into a simulated table whose nominal values are off: does the scan name it?

Late commands, which no scan shows, have tests of their own: test_lateness.py.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnosis.criteria import Criteria
from diagnosis.model.fit import fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.start_states import search, static_equilibrium_start
from diagnosis.records.motions import numbered, pieces
from diagnosis.where.controller import replayed
from diagnosis.which.detectors.scan import Finding, partial_out, scan
from models.effects.base import VISIBLE_SIGNALS, Effect
from models.effects.base import parameters as parameters_of
from models.machine import Machine
from models.records.record import Record
from tests.diagnosis.tables import asking, recorded, short, table
from tests.models.effects.laws import laws

CRITERIA = Criteria()
SEVERITIES = (0.5, 2.0)  # of the typical amplitude or width
ALIKE = {  # Effects that a record as short as this cannot discriminate, with the reason.
    "cogging": {"thrust_ripple", "cable_spring"},  # hardly a period, and thrust in proportion to place
    "thrust_ripple": {"cogging"},
    "dwell_breakaway": {"friction_relaxation"},  # three dwells
}
MACHINE = table()
ASKING = asking(MACHINE)
PLAN = (short(MACHINE),)


def _sized(law: str, factor: float) -> Effect:
    effect = laws()[law]
    sizes = {
        item.name: factor * getattr(effect, item.name)
        for item in parameters_of(type(effect))
        if item.role in {"amplitude", "width"}
    }
    return replace(effect, **sizes)


def _scanned(records: tuple[Record, ...], machine: Machine = MACHINE) -> list[Finding]:
    layout = parameters(machine, 1)
    start = fit(Candidate(layout, static_equilibrium_start(layout, records)), records, iterations=3, walk=0.125)
    fitted = fit(search(start, records), records, paths=start.paths, iterations=5, walk=0.05)
    return scan(fitted, records, partial_out(fitted, numbered(pieces(records), records)), ())[0]


@pytest.fixture(scope="module")
def by_chance() -> dict[str, float]:
    """The most that each effect gains on tables without any: a sine of place fits the scale's rounding, too."""
    most: dict[str, float] = {}
    for seed in range(20, 25):
        for finding in _scanned(recorded(MACHINE, PLAN, [], seed=seed), ASKING):
            most[finding.effect.name] = max(most.get(finding.effect.name, 0.0), finding.held_out)
    return most


@pytest.mark.parametrize(
    "law",
    [
        law
        for law, effect in laws().items()
        if effect.shown_in() in VISIBLE_SIGNALS
        and law != "gravity"
        and not effect.beside
        and effect.placed(MACHINE.plant) != ()
    ],
)
def test_the_effect_that_is_in_the_table_is_the_strongest_finding(law: str, by_chance: dict[str, float]) -> None:
    first, name = [], laws()[law].name
    machine = MACHINE if "linear" in laws()[law].common_on else ASKING
    for severity in (1.0, 2.0):  # the usual size where it shows
        best, *_ = _scanned(recorded(MACHINE, PLAN, [_sized(law, severity)], seed=10), machine)
        if best.held_out > max(CRITERIA.min_gain, CRITERIA.null_safety * by_chance[best.effect.name]):
            first.append(best.effect.name)
        if name in first:
            break
    assert first, "no severity is seen at all"
    assert set(first) <= {name, *ALIKE.get(name, ())}
    assert name in first


@pytest.mark.parametrize("severity", SEVERITIES)
def test_a_wrong_scale_is_no_effect_on_records_that_can_not_show_it(
    severity: float, by_chance: dict[str, float]
) -> None:
    """A longer scale equals a stronger thrust on a softer contact: nominal values explain it, no false positive."""
    wrong = recorded(MACHINE, PLAN, [_sized("scale_gain_error", severity)], seed=40)
    for finding in _scanned(wrong):
        assert finding.held_out < max(CRITERIA.min_gain, CRITERIA.null_safety * by_chance[finding.effect.name])


@pytest.mark.parametrize("severity", [0.0, *SEVERITIES])
def test_another_law_than_the_stated_one_shows_in_its_own_log(severity: float) -> None:
    (record,) = recorded(MACHINE, PLAN, [_sized("controller_mismatch", severity)], seed=41)
    assert replayed(MACHINE, record).replays == (severity == 0.0)
