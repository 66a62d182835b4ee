"""What is said of a name that closes nearly nothing beside others."""

from __future__ import annotations

from typing import Any

import pytest

from studies.gap_diagnosis.too_small import too_small


def results(size: float, share: float, names: tuple[str, ...] = ("cogging", "position_dependent_friction")) -> Any:
    """A rotary table with ripple and cogging, whose third name was none of the truth."""
    row = {"effect": "position_dependent_friction", "parameters": {"part": {"value": size}}}
    limit = {"effect": "position_dependent_friction", "parameter": "part", "limit": 0.0214, "unit": "1"}
    return {
        "verdict": {"effects": names},
        "how_far": {"shares": {"cogging": 1 - share, "position_dependent_friction": share}},
        "confusability": {"limits": [limit]},
        "which": [row],
    }


def test_a_name_below_what_would_show_by_itself_is_told_as_unsure() -> None:
    assert too_small(results(0.00145, -0.001)) == [
        "Not sure, though named: position dependent friction (part 0.00145, where 0.0214 would show). It may be what "
        "the laws of the other names leave, and closes nearly nothing of the gap."
    ]


@pytest.mark.parametrize(
    "given", [results(0.03, 0.0), results(0.00145, 0.02), results(0.00145, 0.0, ("position_dependent_friction",))]
)
def test_a_name_that_shows_or_closes_or_stands_alone_is_not(given: Any) -> None:
    assert too_small(given) == []
