"""A command with a wrong force constant: what it scales is said, with both numbers, and what could be the cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.machine import Machine, Provenance, load
from models.records.files import Loaded
from models.records.record import Record
from studies.identify_machine import own_records
from studies.identify_machine.size_of_force import doubts, proportion

MACHINE = load()
RECORD = own_records.motions(MACHINE, 1)
GAIN = "plant.modes.1.gain"


def loaded(record: Record) -> list[tuple[str, Loaded]]:
    given = ("time", "reference", "feedforward", "command", "position")
    return [("excitation", Loaded("sweep.csv", "0", record, given, ()))]


def scaled(factor: float) -> Record:
    return replace(RECORD, command=factor * RECORD.command, feedforward=factor * RECORD.feedforward)


def with_mass(factor: float, kind: str = "identified") -> Machine:
    source = Provenance("identified" if kind == "identified" else "given", "a response")
    return MACHINE.with_value(GAIN, MACHINE.plant.rigid_gain / factor, source)


def test_commands_of_the_stated_size_say_nothing() -> None:
    assert doubts(with_mass(1, "given"), with_mass(1.3), loaded(RECORD)) == []
    assert proportion(MACHINE, RECORD) == pytest.approx(1.0, abs=0.01)


def test_a_force_constant_that_is_wrong_shows_in_mass_and_gain() -> None:
    """A tenth of it had passed with exit status 0: a tenth of the mass that the file gives, and gains ten times off."""
    (of, mass), (named, gain) = doubts(with_mass(1, "given"), with_mass(0.1), loaded(scaled(0.1)))
    assert (of, named) == ("mass", "gain of sweep.csv")
    assert mass.startswith("the records show 4.47 kg, 0.1 times the 44.7 kg that the machine file states (given):")
    assert "force constant" in mass
    assert mass.endswith("or another payload")
    assert gain.startswith("the logged command is 0.1 times what the stated feedback computes:")


def test_a_mass_that_was_only_assumed_or_never_identified_may_be_any() -> None:
    guess = MACHINE.with_value(GAIN, MACHINE.plant.rigid_gain, Provenance("assumed", "a guess"))
    assert doubts(guess, with_mass(0.1), []) == []
    assert doubts(with_mass(1, "given"), with_mass(0.1, "given"), []) == []


def test_another_controller_is_no_factor() -> None:
    noise = np.random.default_rng(0).standard_normal(RECORD.command.size)
    other = replace(RECORD, command=RECORD.command + float(np.std(RECORD.command)) * noise)
    assert proportion(MACHINE, other) is None
    assert doubts(MACHINE, MACHINE, loaded(other)) == []
