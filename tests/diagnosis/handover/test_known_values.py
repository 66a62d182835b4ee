"""What a file knew of its values stays known where a fit moved them without saying how sure it is."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from diagnosis.handover.known_values import with_known_deviations
from diagnosis.model.parameters import modes_as_stated, parameters
from models.effects.motor import CurrentLoopLag
from models.effects.structure import Gravity
from models.machine import Machine, Provenance
from tests.diagnosis.tables import table

PATH = "plant.modes.2.frequency"
FITTED = Provenance("identified", "a fit")
SHARES = ((0.6, 0.3),)


def stating(machine: Machine, name: str, std: float | tuple[float, ...]) -> Machine:
    return replace(
        machine, sources={**machine.sources, name: Provenance("identified", "a sweep", std=std, shares=SHARES)}
    )


def refitted(machine: Machine, away: float, std: float | None = None) -> Machine:
    """The machine with its first vibration mode moved by so much [Hz] by a fit."""
    rigid, first, *others = machine.plant.modes
    modes = (rigid, replace(first, frequency=first.frequency + away), *others)
    return replace(
        machine,
        plant=replace(machine.plant, modes=modes),
        sources={**machine.sources, PATH: replace(FITTED, std=std)},
    )


@pytest.mark.parametrize(
    ("away", "fitted", "stated"),
    [(0.03, None, 0.05), (-0.4, None, 0.4), (0.03, 0.01, 0.05), (0.03, 0.2, 0.2)],
)
def test_a_deviation_stays_and_covers_the_move(away: float, fitted: float | None, stated: float) -> None:
    given = stating(table(), PATH, 0.05)
    said = with_known_deviations(given, refitted(given, away, fitted), believed=False).sources[PATH]
    assert said.std == pytest.approx(stated)
    assert (said.detail, said.shares) == ("a fit", SHARES)


def test_the_next_diagnosis_knows_the_mode_as_the_first_file_did() -> None:
    given = stating(table(), PATH, 0.05)
    place = parameters(given, 1).of("mode_frequency")[0]
    known = modes_as_stated(parameters(given, 1))[place]
    assert known < parameters(given, 1).deviation[place]
    better = with_known_deviations(given, refitted(given, 0.01), believed=False)
    assert modes_as_stated(parameters(better, 1))[place] == pytest.approx(known, rel=1e-3)


def test_what_a_believed_fit_tells_stays_and_what_it_does_not_tell_is_as_it_was() -> None:
    given = stating(table(), PATH, 0.05)
    told = refitted(given, 0.4, 0.01)
    assert with_known_deviations(given, told, believed=True) == told
    silent = with_known_deviations(given, refitted(given, 0.01), believed=True).sources[PATH]
    assert (silent.std, silent.shares) == (0.05, ())  # as shares are of the errors of one fit


def test_a_value_that_only_its_tolerance_tells_gets_no_deviation_that_may_be_narrower() -> None:
    assert with_known_deviations(table(), refitted(table(), 0.01), believed=False) == refitted(table(), 0.01)


def test_numbers_of_a_list_are_widened_one_by_one() -> None:
    given = stating(table(), "friction.limit", tuple(0.1 * one for one in table().friction.limit))
    limit = tuple(one * (1.5 if i == 1 else 1.01) for i, one in enumerate(given.friction.limit))
    moved = replace(given, friction=replace(given.friction, limit=limit))
    moved = replace(moved, sources={**given.sources, "friction.limit": FITTED})
    std = with_known_deviations(given, moved, believed=False).sources["friction.limit"].std
    shares = [0.5 if i == 1 else 0.1 for i in range(len(limit))]
    assert std == pytest.approx([part * one for part, one in zip(shares, given.friction.limit, strict=True)])


def test_of_an_effect_of_the_file_the_deviation_covers_the_move_too() -> None:
    given = replace(table(), effects=(CurrentLoopLag(100e-6), Gravity(12.0, 0.1)))
    names = ["effects.current_loop_lag.time", "effects.gravity.phase"]
    sources = {**given.sources, **dict.fromkeys(names, replace(FITTED, std=1e-6))}
    better = replace(given, effects=(CurrentLoopLag(130e-6), Gravity(12.0, 0.1 + math.tau - 0.02)), sources=sources)
    found = with_known_deviations(given, better, believed=False).sources
    assert [found[name].std for name in names] == pytest.approx([30e-6, 0.02])
