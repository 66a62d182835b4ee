"""Effects that may not stand in the model, whatever they gain: those that only mend the form of another law."""

from __future__ import annotations

import pytest

from diagnosis.which.admissible import inadmissible
from diagnosis.which.stage import Proposal, Stage, Trial
from models.effects.base import Effect
from models.effects.friction_laws import DirectionalFriction, FrictionDrift
from models.effects.motor import Cogging, ThrustRipple
from models.effects.structure import AdditionalMode, FrictionDrivenMode
from tests.diagnosis.which.planned import START, Planned, leaving


@pytest.mark.parametrize(
    ("members", "opposed"),  # the first may be the machine file's own
    [
        ([DirectionalFriction(-0.3, 5e-6, 0), DirectionalFriction(0.1, 6e-5, 1)], True),
        ([DirectionalFriction(-0.3, 5e-6, 0), DirectionalFriction(-0.1, 6e-5, 1)], False),
        ([DirectionalFriction(-0.3, 5e-6, 0), Cogging(1.0, 0.03, 0.0), Cogging(0.5, 0.02, 0.0)], False),
        ([DirectionalFriction(-0.3, 5e-6, 0), FrictionDrift(1e-3)], False),  # of different classes
        ([AdditionalMode(2e-3, 180.0, 0.02), AdditionalMode(-2e-3, 330.0, 0.02)], False),  # far apart
        ([AdditionalMode(2e-3, 180.0, 0.02), AdditionalMode(-2e-3, 190.0, 0.02)], True),
    ],
)
@pytest.mark.parametrize("owned", [0, 1])
def test_members_of_one_class_that_take_from_each_other_are_the_form_of_one(
    members: list[Effect], opposed: bool, owned: int
) -> None:
    own, effects = members[:owned], members[owned:]
    name = members[-1].name
    trial = Trial(Proposal(name, 1.0, 1.0), leaving(0.0, effects, own))
    search = Planned({}, {}, {}, {})
    assert inadmissible([trial], [Stage(leaving(START, own=own))], search) == ({name} if opposed else set())


@pytest.mark.parametrize(("part", "possible"), [(0.9, True), (1.02, False)])
def test_an_effect_larger_than_any_can_be_mends_the_form_of_another(part: float, possible: bool) -> None:
    """A ripple of 102 % of the thrust had stood beside a Stribeck curve of another form."""
    trial = Trial(Proposal("thrust_ripple", 1.0, 1.0), leaving(0.0, [ThrustRipple(part, 0.03, 1.0)], []))
    search = Planned({}, {}, {}, {})
    assert inadmissible([trial], [Stage(leaving(START))], search) == (set() if possible else {"thrust_ripple"})


@pytest.mark.parametrize(("gain", "possible"), [(2.5e-3, True), (-2.6e-4, False)])
def test_an_effect_of_a_sign_that_none_has_is_the_form_of_another(gain: float, possible: bool) -> None:
    """A page told a second friction-driven mode of negative gain, which its file held as none."""
    members = [FrictionDrivenMode(2.5e-3, 62.0, 0.02), FrictionDrivenMode(gain, 180.0, 0.02)]
    trial = Trial(Proposal(FrictionDrivenMode.name, 1.0, 1.0), leaving(0.0, members))
    found = inadmissible(
        [trial], [Stage(leaving(START)), Stage(leaving(0.8 * START, members[:1]))], Planned({}, {}, {}, {})
    )
    assert found == (set() if possible else {FrictionDrivenMode.name})


@pytest.mark.parametrize(
    ("before", "after", "draws"),  # pitches [of the travel]
    [
        ([0.1], [0.1, 0.8], True),
        ([0.1], [0.1, 0.4], False),
        ([0.8], [0.8, 0.1], False),  # the first one repeats no more than the travel shows either
        ([], [0.8], False),
    ],
)
@pytest.mark.parametrize("owned", [False, True])  # those before, by the machine file
def test_a_further_member_has_to_repeat_within_the_travel(
    before: list[float], after: list[float], draws: bool, owned: bool
) -> None:
    """Beside friction along the guide of 12 mm, injected into a measured drive, a second member of 154 mm along 0.2 m
    took off 288 of chi-square, and with it four right names, as nothing tells the form of such a member."""
    search = Planned({}, {}, {}, {})
    first, last = ([Cogging(1.0, search.travel * pitch, 0.0) for pitch in pitches] for pitches in (before, after))
    made = leaving(0.0, last[len(first) :], first) if owned else leaving(0.0, last)
    here = leaving(0.8 * START, (), first) if owned else leaving(0.8 * START, first)
    found = inadmissible([Trial(Proposal("cogging", 1.0, 1.0), made)], [Stage(leaving(START)), Stage(here)], search)
    assert found == ({"cogging"} if draws else set())
