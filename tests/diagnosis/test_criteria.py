"""The list of thresholds: complete, each with a unit, a meaning and an origin."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import pytest

from diagnosis.criteria import Criteria


def test_every_threshold_says_what_it_means_and_where_it_was_chosen() -> None:
    rows = list(Criteria().listed())
    assert [name for name, *_ in rows] == [field.name for field in fields(Criteria)]
    for name, value, unit, meaning, chosen in rows:
        assert isinstance(value, float | int), name
        assert unit, name
        assert len(meaning.split()) > 3, name
        assert chosen, name


def test_only_what_was_changed_is_shown() -> None:
    assert repr(Criteria()) == "Criteria(defaults)"
    assert repr(Criteria(max_effects=2)) == "Criteria(max_effects=2)"
    with pytest.raises(FrozenInstanceError):
        Criteria().max_effects = 4  # type: ignore[misc]
