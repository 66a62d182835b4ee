"""The old design stays unless another is surely better, and comes back where it was worse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from design.redesign.choice import Chosen, chosen, worse
from design.redesign.designs import Design, designed
from design.redesign.outcome import Outcome
from design.redesign.prediction import Prediction
from tests.design.redesign.axes import KNOWN

OLD = designed(KNOWN, "old")
RNG = np.random.default_rng(5)
SETTLING, DISPERSION = 40e-3 + 5e-3 * RNG.random(40), 1e-6 + 1e-7 * RNG.random(40)
BEFORE = Prediction(SETTLING, DISPERSION)


def among(*others: Prediction) -> Chosen:
    designs: Sequence[Design] = [replace(OLD, name=name) for name in ("old", "first", "second")[: 1 + len(others)]]
    return chosen(designs, (BEFORE, *others), KNOWN)


def test_a_design_that_is_better_on_every_machine_is_taken() -> None:
    found = among(Prediction(SETTLING - 10e-3, DISPERSION))
    assert (found.design.name, found.kept, dict(found.reasons)) == ("first", False, {})
    assert found.gains["settling"].low > 9e-3


def test_one_that_is_better_in_the_median_alone_is_not() -> None:
    """Better by 1 ms in the median, and worse on a fifth of the machines."""
    change = np.where(np.arange(40) % 5 == 0, 6e-3, -1e-3)
    found = among(Prediction(SETTLING + change, DISPERSION))
    assert found.kept
    assert "its gain is not sure" in found.reasons["first"]


def test_a_gain_on_too_few_machines_for_its_interval_is_not_sure() -> None:
    """One machine leaves no interval at all, eight one of 78 %, nine one of 80 %."""
    designs = [replace(OLD, name=name) for name in ("old", "new")]
    for count, kept in ((1, True), (8, True), (9, False)):
        before = Prediction(SETTLING[:count], DISPERSION[:count])
        found = chosen(designs, (before, replace(before, settling=before.settling - 10e-3)), KNOWN)
        assert found.kept == kept
        assert ("simulated runs give an interval of" in found.reasons.get("new", "")) == kept


def test_what_one_quantity_gains_the_other_must_not_lose() -> None:
    found = among(Prediction(SETTLING - 10e-3, 1.5 * DISPERSION))
    assert found.kept
    assert "3 sigma gets worse" in found.reasons["first"]


def test_one_that_saturates_the_drive_is_not_taken() -> None:
    found = among(Prediction(SETTLING - 10e-3, DISPERSION, saturated=5))
    assert found.kept
    assert "in 5 of 40 simulated runs" in found.reasons["first"]
    assert not among(Prediction(SETTLING - 10e-3, DISPERSION, saturated=4)).kept


def test_one_of_which_more_motions_never_settle_is_not_taken() -> None:
    """The slowest motion of either never settles, so that its time tells nothing; 3 sigma is half as large."""
    capped = np.full(40, KNOWN.specification.interval)
    designs = [replace(OLD, name=name) for name in ("old", "new")]
    for never, kept in ((1, False), (2, True)):
        new = Prediction(capped, 0.5 * DISPERSION, never=never)
        found = chosen(designs, (Prediction(capped, DISPERSION, never=1), new), KNOWN)
        assert found.kept == kept
    assert found.reasons["new"].startswith("more motions never settle, 2 instead of 1 in the median")


def test_a_richer_design_has_to_be_surely_better_than_the_simpler_one() -> None:
    first = Prediction(SETTLING - 10e-3, DISPERSION)
    assert among(first, first).design.name == "first"
    assert among(first, Prediction(SETTLING - 15e-3, DISPERSION)).design.name == "second"


def test_of_two_new_designs_the_better_one_on_average_runs() -> None:
    """The second is better by far on a quarter of the machines, and slower on the others."""
    first = Prediction(np.where(np.arange(40) % 4 == 0, 30e-3, 10e-3), 0.5 * DISPERSION)
    second = Prediction(np.full(40, 12e-3), 0.4 * DISPERSION)
    found = among(first, second)
    assert found.design.name == "second"
    assert found.reasons["first"] == "second is better on average"
    assert among(second, first).design.name == "first"  # the order does not matter
    slower = Prediction(np.full(40, 16e-3), 0.4 * DISPERSION)
    assert among(first, slower).design.name == "first"
    assert among(first, Prediction(np.full(40, 12e-3), 0.6 * DISPERSION)).design.name == "first"
    assert among(first, Prediction(np.full(40, 12e-3), 0.4 * DISPERSION, saturated=9)).design.name == "first"


def test_another_feedback_has_to_be_surely_better() -> None:
    first = Prediction(np.where(np.arange(40) % 4 == 0, 30e-3, 10e-3), 0.5 * DISPERSION)
    second = Prediction(np.full(40, 12e-3), 0.4 * DISPERSION)
    other = OLD.controller.with_feedback(replace(OLD.controller.pid, kp=0.9 * OLD.controller.pid.kp))
    designs = [replace(OLD, name="old"), replace(OLD, name="first"), replace(OLD, name="second", controller=other)]
    assert chosen(designs, (BEFORE, first, second), KNOWN).design.name == "first"


def test_a_verification_is_worse_beyond_five_per_cent_and_noise() -> None:
    before = Outcome(40e-3, 1e-6, 10, 0)
    assert worse(before, replace(before, settling=41.5e-3), KNOWN) == ()
    assert worse(before, replace(before, settling=44e-3), KNOWN) == (
        "settling of the slowest motion: 44 ms instead of 40 ms",
    )
    assert len(worse(before, Outcome(50e-3, 2e-6, 10, 0), KNOWN)) == 2
    (lost,) = worse(replace(before, settling=145e-3), Outcome(150e-3, before.dispersion, 10, 1), KNOWN)
    assert lost.endswith("never in 1 of 10 motions instead of 145 ms")
    stuck = Outcome(150e-3, before.dispersion, 10, 1)
    (lost,) = worse(stuck, replace(stuck, never=10), KNOWN)
    assert lost.endswith("never in 10 of 10 motions instead of never in 1 of 10 motions")
    assert worse(stuck, replace(stuck, motions=20, never=2), KNOWN) == ()  # of twice as many motions
    assert worse(stuck, replace(stuck, settling=300e-3), KNOWN) == ()  # watched for twice as long
    fine = replace(before, dispersion=1e-9)
    assert worse(fine, replace(fine, dispersion=5e-8), KNOWN) == ()  # below three deviations of a reading
