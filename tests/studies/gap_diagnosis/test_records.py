"""What only looks wrong about records is refused with the way out in the message, and used where they are trusted."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies.gap_diagnosis.records import check
from studies.options import BadInputError
from tests.models.records.test_checks import MASS, moving

PATHS = (Path("a.csv"), Path("b.csv"))


def test_records_that_look_of_two_machines_are_refused_unless_they_are_trusted() -> None:
    records = [moving(), moving(mass=2 * MASS)]
    with pytest.raises(
        BadInputError, match=r"a.csv and b.csv are of two machines.*right as it is, give --trust-records"
    ):
        check(records, PATHS)
    (doubt,) = check(records, PATHS, trusted=True)
    assert doubt.startswith("Not refused, as the records are trusted: a.csv and b.csv are of two machines")
    assert doubt.endswith("diagnose each with its own machine file.")
    assert check([moving(), moving()], PATHS) == ()


def test_a_position_within_a_few_steps_of_its_scale_may_be_trusted_to_move() -> None:
    records = [moving(2e-5, step=1e-5)]
    with pytest.raises(BadInputError, match=r"a.csv: nothing moves; .* --trust-records"):
        check(records, PATHS[:1])
    assert check(records, PATHS[:1], trusted=True)[0].startswith(
        "Not refused, as the records are trusted: nothing moves"
    )
