"""Forward selection: which proposals are tried, which are kept, and when it ends, whatever proposes and fits."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from diagnosis.model.fit import Fit, parameters_at_bounds
from diagnosis.model.kalman import Resonance
from diagnosis.which.detectors.scan import Columns
from diagnosis.which.select import grown, min_gain_beside_others
from diagnosis.which.stage import Proposal, Stage, Trial
from models.effects.base import Effect
from models.effects.catalogue import every
from models.effects.friction_laws import DirectionalFriction, DwellBreakaway
from models.effects.motor import Cogging
from models.effects.structure import AdditionalMode
from tests.diagnosis.which.planned import CRITERIA, MACHINE, START, Planned, leaving


def _searched(
    promises: Mapping[int, Mapping[str, float]],
    costs: Mapping[str, float],
    own: Sequence[Effect] = (),
    effects: Mapping[str, Effect] | None = None,
    forces: Mapping[int, Proposal] | None = None,
) -> list[list[str]]:
    """Names in the model at each stage."""
    stages = grown(leaving(START, own=own), Planned(promises, costs, effects or {}, forces or {}))
    assert [stage.added is None for stage in stages] == [i == 0 for i in range(len(stages))]
    return [[effect.name for effect in stage.fitted.candidate.added_effects] for stage in stages]


def test_an_effect_whose_fit_gains_nothing_makes_room_for_the_next() -> None:
    promises = {0: {"play": 900.0, "cogging": 200.0}}
    assert _searched(promises, {"play": START + 1, "cogging": 1500.0}) == [[], ["cogging"]]


def test_of_those_tried_the_one_that_leaves_least_is_kept_and_the_others_are_its_rivals() -> None:
    promises = {0: {"play": 900.0, "cogging": 800.0, "stribeck": 700.0, "cable_spring": 600.0}}
    costs = {"play": 1200.0, "cogging": 1100.0, "stribeck": 1300.0}
    stages = grown(leaving(START), Planned(promises, costs, {}, {}))
    assert stages[-1].added == "cogging"
    assert stages[-1].rivals == (("cogging", 1100.0), ("play", 1200.0), ("stribeck", 1300.0))


def test_a_law_that_has_nothing_but_its_amplitude_has_one_member() -> None:
    """A report had told one friction away from the scale twice, with the same advance."""
    promises = {0: {"viscous_friction": 900.0}, 1: {"viscous_friction": 800.0}}
    assert _searched(promises, {"viscous_friction": 1000.0}) == [[], ["viscous_friction"]]
    ripples = {0: {"thrust_ripple": 900.0}, 1: {"thrust_ripple": 800.0}}
    stages = grown(leaving(START), Falling(ripples, {}, {}, {}))
    assert [stage.added for stage in stages] == [None, "thrust_ripple", "thrust_ripple"]


@dataclass(frozen=True)
class Falling(Planned):
    """One in which whatever is tried leaves half of what was left."""

    def tried(self, stage: Stage, proposals: Sequence[Proposal]) -> list[Trial]:
        here, half = stage.fitted, stage.fitted.cost / 2
        return [Trial(one, replace(here, candidate=one.added_to(here.candidate), cost=half)) for one in proposals]


@dataclass(frozen=True)
class Forceful(Planned):
    """One in which what leaves the more of chi-square leaves the less unknown force."""

    def force(self, fitted: Fit) -> float:
        return 1 / fitted.cost


def test_a_rival_near_in_chi_square_that_leaves_no_more_force_is_one_by_force() -> None:
    """Of a worm's friction that varies once a turn, a torque ripple had 12 % more of the gain and left more force."""
    promises = {0: {"play": 900.0, "cogging": 800.0, "stribeck": 700.0}}
    costs = {"play": 1150.0, "cogging": 1000.0, "stribeck": 1250.0}  # 0.15 and 0.25 of the gain apart
    stages = grown(leaving(START), Forceful(promises, costs, {}, {}))
    assert (stages[-1].added, stages[-1].by_force) == ("cogging", ("play",))
    assert grown(leaving(START), Planned(promises, costs, {}, {}))[-1].by_force == ()


@dataclass(frozen=True)
class Overlooking(Planned):
    """One whose drift of the scale gains so much over all motions, and nothing on held-out ones."""

    in_sample: float = 0.0

    def examined(
        self, stage: Stage, negligible: Collection[str] = (), known: Columns | None = None
    ) -> tuple[Stage, Columns]:
        found, columns = super().examined(stage, negligible, known)
        gains = {"scale_drift": self.in_sample}
        told = [replace(one, in_sample_gain=gains.get(one.name, one.gain)) for one in found.proposals]
        return replace(found, proposals=tuple(told)), columns


@pytest.mark.parametrize(
    ("in_sample", "cost", "found"),
    [
        (1000.0, 300.0, "scale_drift"),
        (1000.0, 1100.0, "directional_friction"),  # which does not take off half of it
        (500.0, 300.0, "directional_friction"),  # which is not looked at
    ],
)
def test_what_gains_over_all_motions_alone_is_fitted_and_has_to_take_off_half(
    in_sample: float, cost: float, found: str
) -> None:
    """A drift of 4 um/s, which moved the contacts itself, was in truth all that was left; it had no name."""
    promises = {0: {"directional_friction": 900.0, "scale_drift": -250.0}}
    costs = {"directional_friction": 1200.0, "scale_drift": cost}
    start = replace(leaving(START), innovations=np.full(3, (START / 3) ** 0.5))
    stages = grown(start, Overlooking(promises, costs, {}, {}, in_sample=in_sample))
    assert stages[1].added == found
    assert grown(start, Planned(promises, costs, {}, {}))[1].added == "directional_friction"


@dataclass(frozen=True)
class Hasty(Planned):
    """One that does not look at what it is told to leave out."""

    def examined(
        self, stage: Stage, negligible: Collection[str] = (), known: Columns | None = None
    ) -> tuple[Stage, Columns]:
        stage, columns = super().examined(stage, (), known)
        return replace(stage, proposals=tuple(one for one in stage.proposals if one.name not in negligible)), columns


@pytest.mark.parametrize(("left", "found"), [(10.0, ["cogging", "play", "stribeck"]), (0.0, ["play", "stribeck"])])
def test_what_gained_nothing_beside_few_effects_is_looked_at_again_while_something_is_left(
    left: float, found: list[str]
) -> None:
    """A cogging of the pitch of a ripple gained nothing before the ripple was in the model, and most of it then."""
    promises = {0: {"stribeck": 900.0, "cogging": 0.0}, 1: {"play": 800.0, "cogging": 0.0}, 2: {"cogging": 700.0}}
    costs = {"stribeck": 1500.0, "play": 1000.0, "cogging": 100.0}
    begin = replace(leaving(START), innovations=np.full(3, left))
    stages = grown(begin, Hasty(promises, costs, {}, {}))
    assert sorted(effect.name for effect in stages[-1].fitted.candidate.added_effects) == found


@pytest.mark.parametrize("own", [(), ("viscous_friction",), ("viscous_friction", "cogging", "play")])
@pytest.mark.parametrize(("share", "found"), [(0.9, 3), (1.1, 4)])  # of what a fourth class has to take off
def test_three_effects_are_looked_for_and_more_if_they_take_off_force(
    own: Sequence[str], share: float, found: int
) -> None:
    wanted = ["stribeck", "cable_spring", "thrust_ripple", "gain_asymmetry"]
    promises = {len(own) + i: {name: 900.0} for i, name in enumerate(wanted)}
    costs = {name: 1500.0 - 400.0 * i for i, name in enumerate(wanted[:3])}
    costs[wanted[3]] = costs[wanted[2]] * (1 - share * CRITERIA.min_force_share_further)
    stages = _searched(promises, costs, [every()[name].typical() for name in own])
    assert [set(stage) for stage in stages] == [set(wanted[:count]) for count in range(found + 1)]


def test_more_classes_than_draw_anything_are_no_answer() -> None:
    wanted = ["stribeck", "cable_spring", "thrust_ripple", "gain_asymmetry", "play", "cogging", "backlash"]
    promises = {i: {name: 900.0} for i, name in enumerate(wanted)}
    costs = {name: START / 2 ** (i + 1) for i, name in enumerate(wanted)}
    assert len(_searched(promises, costs)) == CRITERIA.max_effects_by_force + 1


def test_the_first_effect_beside_the_machine_files_own_needs_no_more_than_any_first_one() -> None:
    least = 0.5 * (CRITERIA.min_gain + CRITERIA.min_gain_further)
    costs = {"cogging": START - least}
    assert _searched({1: {"cogging": least}}, costs, [every()["play"].typical()]) == [[], ["cogging"]]


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_a_second_effect_at_its_bounds_counts_only_if_it_is_large(factor: float) -> None:
    gained, bent = START - 1000.0, Cogging(1.0, 9.0, 0.0)
    assert parameters_at_bounds(bent, MACHINE.priors)
    costs = {"play": 1000.0, "cogging": 1000.0 - gained * factor * CRITERIA.min_gain_at_bound}
    found = _searched({0: {"play": 900.0}, 1: {"cogging": 400.0}}, costs, effects={"cogging": bent})
    assert [set(stage) for stage in found] == [set(), {"play"}, *([{"play", "cogging"}] if factor > 1 else [])]


@pytest.mark.parametrize(("factor", "kept"), [(0.95, "friction_drift"), (1.05, "cogging")])
def test_a_law_within_its_range_goes_before_one_at_its_bounds(factor: float, kept: str) -> None:
    """A friction that warmed was none of these: one that varied once in 1.5 travels left 4 % less."""
    gain, bent = 500.0, Cogging(1.0, 9.0, 0.0)
    costs = {"friction_drift": START - gain, "cogging": START - gain * factor * CRITERIA.min_ratio_at_bound}
    promises = {0: {"friction_drift": 900.0, "cogging": 800.0}}
    stages = grown(leaving(START), Planned(promises, costs, {"cogging": bent}, {}))
    assert [stage.added for stage in stages] == [None, kept]
    assert [name for name, _ in stages[-1].rivals] == [kept, *(["friction_drift"] if kept == "cogging" else [])]
    alone = grown(leaving(START), Planned({0: {"cogging": 800.0}}, costs, {"cogging": bent}, {}))
    assert alone[-1].added == "cogging"


@dataclass(frozen=True)
class Forced(Planned):
    """One in which a second effect leaves such a part of the unknown force of the first alone."""

    left: float = 1.0

    def force(self, fitted: Fit) -> float:
        return self.left if len(fitted.candidate.added_effects) > 1 else 1.0


@pytest.mark.parametrize(
    ("second", "left", "found"),
    [
        (DwellBreakaway(0.1, 1e-3, 1e-5), 0.5, True),
        (DwellBreakaway(0.1, 1e-3, 1e-5), 0.9, False),
        (Cogging(1.0, 9.0, 0.0), 0.5, False),  # a long sine takes off any slow force
    ],
)
def test_a_law_of_the_rest_may_have_a_time_at_its_bound_where_it_takes_off_the_force(
    second: Effect, left: float, found: bool
) -> None:
    """A friction that healed with two time constants, and a relaxation with five, were refused beside right names: the
    best single one was shorter than any usual one."""
    assert parameters_at_bounds(second, MACHINE.priors)
    costs = {"play": 1000.0, second.name: 1000.0 - 0.5 * (START - 1000.0) * CRITERIA.min_gain_at_bound}
    promises = {0: {"play": 900.0}, 1: {second.name: 400.0}}
    stages = grown(leaving(START), Forced(promises, costs, {second.name: second}, {}, left=left))
    assert (second.name in {one.name for one in stages[-1].fitted.candidate.added_effects}) == found


def test_such_a_member_is_put_aside_and_the_search_goes_on() -> None:
    promises = {0: {"directional_friction": 900.0}, 1: {"directional_friction": 500.0, "cogging": 450.0}}
    costs = {"directional_friction": 1000.0, "cogging": 500.0}
    own = [DirectionalFriction(-0.3, 5e-6, 0)]  # of the machine file, so that the second takes from it
    promises = {count + 1: promised for count, promised in promises.items()}
    assert _searched({1: {"directional_friction": 900.0, "cogging": 850.0}}, costs, own) == [[], ["cogging"]]
    agreeing = {"directional_friction": DirectionalFriction(-0.1, 5e-6, 0)}
    assert _searched(promises, costs, own, agreeing)[1] == ["directional_friction"]


def _force(gain: float) -> Proposal:
    return Proposal("floor_vibration", gain, CRITERIA.random_force_min_gain, random_force=Resonance(8.0, 0.1, 0.1))


@pytest.mark.parametrize(("gain", "first"), [(300.0, True), (200.0, False)])
def test_a_random_force_goes_first_unless_an_effect_gains_far_more(gain: float, first: bool) -> None:
    """And whatever its chi-square: what two filters leave cannot be compared."""
    costs = {"floor_vibration": START + 50.0, "cogging": 1000.0}
    stages = grown(leaving(START), Planned({0: {"cogging": 1000.0}}, costs, {}, {0: _force(gain)}))
    assert next(stage.added for stage in stages[1:]) == ("floor_vibration" if first else "cogging")
    assert {stage.added for stage in stages[1:]} == {"floor_vibration", "cogging"}
    assert len(stages[-1].fitted.candidate.random_forces) == 1


@pytest.mark.parametrize(("even", "by_force", "first"), [(True, 0.9, True), (True, 0.1, False), (False, 0.9, False)])
def test_a_force_that_is_there_at_rest_is_tried_beside_what_gains_far_more(
    even: bool, by_force: float, first: bool
) -> None:
    """A floor 45 times the noise: chi-square promised 346,549 of a friction over position, and the floor 457 beside
    forces that walk faster; fitted, it left 39,380 of 6.3 million, and the friction 5.8 million."""
    costs = {"floor_vibration": (1 - by_force) * START, "cogging": 0.5 * START}
    force = replace(_force(0.1 * START), even=even)
    stages = grown(leaving(START), Planned({0: {"cogging": 0.5 * START}}, costs, {}, {0: force}))
    assert stages[1].added == ("floor_vibration" if first else "cogging")


@pytest.mark.parametrize(
    ("gain", "frequency", "by_mode", "first"),
    [
        (100.0, 8.5, 320.0, True),
        (100.0, 8.5, 280.0, False),  # it rings to the commands that answer a tone: 45.8 Hz had been named for 47
        (80.0, 8.5, 320.0, False),
        (100.0, 12.0, 320.0, False),
    ],
)
def test_a_mode_goes_before_the_random_force_that_stands_in_for_it(
    gain: float, frequency: float, by_mode: float, first: bool
) -> None:
    """What shakes the axis by itself doesn't answer its motions, but the loop answers it; the likelihood tells."""
    mode = AdditionalMode(1e-3, frequency, 0.02)
    costs = {"floor_vibration": START - 300.0, "additional_mode": START - by_mode}
    plan = Planned({0: {"additional_mode": gain}}, costs, {"additional_mode": mode}, {0: _force(300.0)})
    stages = grown(leaving(START), plan)
    assert stages[1].added == ("additional_mode" if first else "floor_vibration")


@pytest.mark.parametrize(
    ("frequency", "by_line", "name"),
    [
        (8.4, 320.0, "floor_vibration"),  # a fan of 47 Hz had been handed over as a mode of 46.4 Hz
        (8.4, 280.0, "additional_mode"),
        (12.0, 320.0, "additional_mode"),
    ],
)
def test_a_mode_competes_with_what_shakes_the_axis_about_its_frequency(
    frequency: float, by_line: float, name: str
) -> None:
    """Though no detector proposes a line there, as beside a mode that the file knows none is looked for."""
    mode = AdditionalMode(1e-3, frequency, 0.02)
    costs = {"floor_vibration": START - by_line, "additional_mode": START - 300.0}
    plan = Planned({0: {"additional_mode": 300.0}}, costs, {"additional_mode": mode}, {}, line=_force(300.0))
    assert grown(leaving(START), plan)[1].added == name


def test_a_further_effect_has_to_gain_more_than_the_form_of_the_first_may_be_wrong_by() -> None:
    floors = np.array([900.0, 1000.0])
    # Nothing is surely left: all of it may be form error.
    assert min_gain_beside_others(1e5, 990.0, floors, CRITERIA) == CRITERIA.form_error * 1e5
    assert min_gain_beside_others(1e5, 5000.0, floors, CRITERIA) == CRITERIA.form_error_of_excess * 4000.0
    assert min_gain_beside_others(100.0, 5000.0, floors, CRITERIA) == CRITERIA.min_gain_further


@pytest.mark.parametrize("gain", [0.99, 1.01])
def test_an_effect_has_to_gain_more_than_chance_does(gain: float) -> None:
    search = Planned({0: {"cogging": gain * 300.0}}, {"cogging": 1000.0}, {}, {}, threshold=300.0)
    assert len(grown(leaving(START), search)) == (2 if gain > 1 else 1)


@pytest.mark.parametrize(
    (
        "first",
        "share",
        "found",
    ),  # chi-square, as which forces count here, that the first effect leaves; what a second takes
    [
        (1000.0, 1.02 * CRITERIA.force_share_of_slow, True),
        (1000.0, 0.98 * CRITERIA.force_share_of_slow, False),
        (0.5 * CRITERIA.min_force_share_slow * START, 0.9, False),  # most of next to nothing
    ],
)
def test_a_slow_force_that_gains_little_is_added_for_what_it_takes_off(first: float, share: float, found: bool) -> None:
    assert CRITERIA.min_gain < 50.0 < CRITERIA.min_gain_further
    costs = {"play": first, "friction_drift": first * (1 - share)}
    names = _searched({0: {"play": 900.0}, 1: {"friction_drift": 50.0}}, costs)
    assert [set(stage) for stage in names] == [set(), {"play"}, *([{"play", "friction_drift"}] if found else [])]


def test_alone_such_a_force_has_to_gain_as_much_as_any_and_few_are_tried_for_it() -> None:
    assert CRITERIA.shortlist_size == 3
    slow = {"friction_drift": 50.0, "cable_spring": 49.0, "stribeck": 48.0, "cogging": 47.0}
    costs = {"play": 1000.0, **dict.fromkeys(["friction_drift", "cable_spring", "stribeck"], 900.0)}
    assert _searched({0: {"play": 900.0}, 1: slow}, costs) == [[], ["play"]]  # a fourth has no cost to look up
    costs = {"friction_drift": START - 50.0}
    large = Planned({0: {"friction_drift": 50.0}}, costs, {}, {}, threshold=60.0)
    assert len(grown(leaving(START), large)) == 1
