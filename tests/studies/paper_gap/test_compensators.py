"""Designs of the compensator, how likely each kind of cause is, and what exchanging the compensator tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.controller import default_controller
from design.friction_compensation import simplify
from models.friction import branch
from models.machine import load
from studies.paper_gap.candidates import EFFECTS, PARAMETERS
from studies.paper_gap.compensators import Design, compensator, named, of_name, slope_error, spaced, two_slopes
from studies.paper_gap.exchange import FRICTION, OTHER, exchanged, says
from studies.paper_gap.explore import BEYOND, Case, Draw, draw
from studies.paper_gap.likelihood import evidence
from studies.paper_gap.pattern import Outcome, Pattern
from studies.paper_gap.report import _likely

PAPER = Pattern(tolerance=2e-6, step=1e-7, dispersion=2.4e-6, margin=0.24e-6)


def test_the_default_design_is_the_projects_own() -> None:
    machine = load()
    made, own = compensator(machine, machine.friction, Design()), simplify(machine.friction, 5)
    assert made.limit == pytest.approx(own.limit)
    assert made.stiffness == pytest.approx(own.stiffness)
    assert slope_error(machine, made) < 0.03


def test_limits_go_from_even_ratios_to_even_steps() -> None:
    assert spaced(1.0, 16.0, 5, 0.0) == pytest.approx([1, 2, 4, 8, 16])
    assert spaced(1.0, 16.0, 4, 1.0) == pytest.approx([1, 6, 11, 16])
    assert spaced(1.0, 16.0, 4, 0.5) == pytest.approx([1, 4, 9, 16])
    assert list(spaced(1.0, 16.0, 1, 0.5)) == [16.0]


def test_every_named_design_keeps_the_coulomb_force() -> None:
    machine = load()
    for one in named(machine):
        rfm = of_name(machine, one)
        assert rfm.coulomb_force == pytest.approx(machine.friction.coulomb_force), one.name
        assert min(rfm.stiffness) >= 0, one.name
    even = next(one for one in named(machine) if one.name == "even steps")
    assert np.diff(of_name(machine, even).limit) == pytest.approx(np.diff(of_name(machine, even).limit)[0])


def test_the_two_slopes_are_the_published_ones_up_to_twice_the_coulomb_force() -> None:
    climbed = two_slopes(load(), np.array([10e-6, 20e-6, 100e-6, 190e-6, 300e-6]))
    assert climbed == pytest.approx([8.0, 16.0, 24.0, 33.0, 33.0])


def test_even_steps_leave_the_published_dispersion_with_the_reversal_in_time_and_bend_the_slopes() -> None:
    """On the default table: the field's finding, and what it costs."""
    machine = load()
    table = machine, default_controller(machine)
    even = draw([table], Case("limit_spacing"), PAPER, (0, (1.0, 0.0)), False)
    assert even.disperses
    assert not even.shows
    assert even.without_off < 0.03
    assert 0.1 < even.slopes_off < 0.2
    assert not even.fits(0.1)
    ratios = draw([table], Case("limit_spacing"), PAPER, (0, (0.0, 0.0)), False)
    assert ratios.outcome.dispersion < 0.8e-6


def one(name: str, distance: float, *, without: float = 0.0, loose: float = 0.0) -> Draw:
    """A draw of a candidate at these distances [m]."""
    return Draw(Case(name), 0, (), (1.0,), Outcome(0, (0,), 0, 0, 2e-6), distance, False, loose, without)


def test_the_odds_are_those_of_the_shares() -> None:
    """Two of four draws of a design agree, one of four of a parameter, none of an effect; with one found by search.

    Each probability is within its interval, also that of a kind of which no draw agrees.
    """
    found = replace(one("dead_time", 0.0), found=True)
    explored = {
        "limit_spacing": {"alone": [one("limit_spacing", 0.0)] * 2 + [one("limit_spacing", 1e-6, loose=1e-6)] * 2},
        "dead_time": {"alone": [one("dead_time", 0.0), *[one("dead_time", 1e-6, loose=1e-6)] * 3, found]},
        "cogging": {"alone": [one("cogging", 0.0, without=0.5), *[one("cogging", 1e-6, loose=1e-6)] * 3]},
    }
    told = evidence(explored, 0.1, 1)
    shares = {kind: row["pattern_fits"]["share"] for kind, row in told["kinds"].items()}
    assert shares == {"compensator": 0.5, PARAMETERS: 0.25, EFFECTS: 0.0}
    assert told["kinds"][EFFECTS]["pattern"]["share"] == 0.25
    odds = told["odds"]["pattern_fits"]
    for row in odds.values():
        assert row["interval"][0] < row["probability"] < row["interval"][1]
    many = {name: {"alone": ways["alone"][:4] * 250} for name, ways in explored.items()}
    odds = evidence(many, 0.1, 1)["odds"]["pattern_fits"]
    assert odds["compensator"]["probability"] == pytest.approx(2 / 3, abs=2e-3)
    assert 0 < odds[EFFECTS]["interval"][0] < odds[EFFECTS]["probability"] < odds[EFFECTS]["interval"][1] < 4e-3
    none = {name: {"alone": [one(name, 1e-6, loose=1e-6)]} for name in explored}
    assert evidence(none, 0.1, 1)["odds"]["pattern_fits"] == dict.fromkeys(shares)


def test_the_first_page_gives_no_odds_of_a_few_draws() -> None:
    shares = {"compensator": (6, 0.6), PARAMETERS: (3, 0.3), EFFECTS: (1, 0.1)}
    kinds = {kind: {"loose_fits": {"count": count, "of": 100}} for kind, (count, _) in shares.items()}
    odds = {kind: {"probability": share, "interval": [0.0, 1.0]} for kind, (_, share) in shares.items()}
    told = {"kinds": kinds, "odds": {"loose_fits": odds}}
    assert _likely(told, "loose_fits").startswith("it is the compensator's design with 60 %")
    kinds[EFFECTS]["loose_fits"]["count"] = 0
    assert _likely(told, "loose_fits") == "9 of the 300 draws agree, too few for odds"


def test_an_exchange_tells_design_friction_and_effect_apart() -> None:
    assert [says(pair, 1.2e-6) for pair in ((1e-6, 2e-6), (2e-6, 1e-6), (2e-6, 2e-6))] == [
        "compensator",
        FRICTION,
        OTHER,
    ]
    machine = load()
    tables = [(machine, default_controller(machine))]
    sizes = [("limit_spacing", (1.0,)), ("identified_friction", (-0.3, -0.3)), ("thrust_saturation", (0.3,))]
    draws = [
        replace(
            one(name, 0.0),
            case=Case(name, BEYOND if name == "thrust_saturation" else "alone"),
            point=(0.0,),
            values=values,
        )
        for name, values in sizes
    ]
    rows = exchanged(tables, draws, 2.4e-6, None)["rows"]
    assert [row["cause"] for row in rows] == ["compensator", FRICTION, OTHER]
    assert rows[0]["says"] == "compensator"
    assert rows[1]["says"] == FRICTION
    assert rows[2]["dispersions_m"][1:] == pytest.approx([rows[2]["dispersions_m"][1]] * 2)


def test_the_branch_of_the_designs_ends_where_the_frictions_does() -> None:
    machine = load()
    end = np.array([2 * max(machine.friction.limit)])
    for design in named(machine):
        assert branch(of_name(machine, design), end) == pytest.approx(33.0, rel=1e-3), design.name
