"""Motion records that another controller made, or whose columns are shifted, are said to be so and miss a check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.machine import load
from models.records.files import Loaded
from models.records.record import Record
from studies.identify_machine import own_records
from studies.identify_machine.controllers import judged

MACHINE = load()
RECORD = own_records.motions(MACHINE, 1)


def loaded(record: Record) -> Loaded:
    return Loaded("moves.csv", "0", record, ("time", "reference", "feedforward", "command", "position"), ())


def test_what_the_stated_controller_made_holds() -> None:
    said, (check,) = judged(MACHINE, [("motion", loaded(RECORD))])
    assert said == []
    assert check.holds


def test_a_shifted_command_is_said_and_misses_the_check() -> None:
    late = replace(RECORD, command=np.roll(RECORD.command, 3))
    ((name, said),), (check,) = judged(MACHINE, [("motion", loaded(RECORD)), ("motion", loaded(late))])
    assert name == "moves.csv"
    assert said.startswith("the logged command is not what the stated controller makes")
    assert "with the command logged 3 samples late" in said
    assert (check.value, check.holds) == (1.0, False)


def test_records_that_are_identified_without_the_controller_are_not_judged() -> None:
    assert judged(MACHINE, [("hysteresis", loaded(RECORD))]) == ([], [])
    assert judged(MACHINE, [("motion", replace(loaded(RECORD), given=("time", "command", "position")))]) == ([], [])
