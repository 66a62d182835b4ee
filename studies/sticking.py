"""What a study says of a loop that is unstable while the friction sticks: results, lines of a summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from design.judging.sticking import advice_on, cause_of, state_of, sticking
from diagnosis.records.at_rest import is_quiet
from models.controller import Feedback
from models.machine import Machine
from models.records.record import Record

QUIET: Final = (
    "The axis itself does not swing while its reference stands still, as these records show: its friction damps what "
    "sticks, or acts elsewhere, which the machine file does not know ([friction] damping, friction_driven_mode)"
)


def found_in(machine: Machine, feedback: Feedback | None = None, records: Sequence[Record] = ()) -> dict[str, Any]:
    """What is found, for results.json under "sticking" (SI); empty where the loop is stable while the friction sticks.

    feedback: by default the one in place. records: of the axis under that feedback, which show whether it swings.
    """
    found = sticking(machine, feedback)
    if found is None:
        return {}
    quiet = bool(records) and all(is_quiet(one, machine) for one in records)
    return {
        "sticking": {
            "slope_N_per_m": found.slope,
            "growth_time_s": found.growth_time,
            "frequency_Hz": found.frequency,
            "modes_Hz": [mode.frequency for mode in found.modes],
            "makes_work": found.makes_work,
            "state": state_of(found),
            "cause": cause_of(found),
            "advice": f"{advice_on(found)}. {QUIET}" if quiet else advice_on(found),
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
