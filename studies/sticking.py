"""What a study says of a loop that is unstable while the friction sticks: results, lines of a summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from design.judging.sticking import advice_on, cause_of, state_of, sticking
from models.controller import Feedback
from models.machine import Machine


def found_in(machine: Machine, feedback: Feedback | None = None) -> dict[str, Any]:
    """What is found, for results.json under "sticking" (SI); empty where the loop is stable while the friction sticks.

    feedback: by default the one in place.
    """
    found = sticking(machine, feedback)
    if found is None:
        return {}
    return {
        "sticking": {
            "slope_N_per_m": found.slope,
            "growth_time_s": found.growth_time,
            "frequency_Hz": found.frequency,
            "modes_Hz": [mode.frequency for mode in found.modes],
            "makes_work": found.makes_work,
            "state": state_of(found),
            "cause": cause_of(found),
            "advice": advice_on(found),
        }
    }


def rows(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The warning with its cause and what to do, as lines of a summary; none where nothing was found."""
    found = results.get("sticking")
    if found is None:
        return []
    return [
        ("WARNING, while the friction sticks", found["state"]),
        ("  its cause", found["cause"]),
        ("  what to do", found["advice"]),
    ]
