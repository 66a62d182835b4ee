"""What only looks wrong about records is refused with the way out in the message, and used where they are trusted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models.machine import load as load_machine
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import check, loaded
from studies.identify_machine import own_records
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


def test_how_each_record_was_read_is_told_before_the_work(tmp_path: Path) -> None:
    machine = load_machine()
    record = own_records.motions(machine, 1)
    signals = {
        "Zeit [ms]": 1e3 * machine.sample_time * np.arange(record.position.size),
        "Soll [um]": 1e6 * record.reference,
        "Kraft [N]": record.command,
        "Ist [um]": 1e6 * record.position,
    }
    path = tmp_path / "moves.csv"
    rows = np.column_stack(list(signals.values()))
    np.savetxt(path, rows, fmt="%.12g", delimiter=";", header=";".join(signals), comments="Logger 4\n")
    told: list[str] = []
    column = ("time=Zeit", "reference=Soll", "command=Kraft", "position=Ist")
    options = DiagnosisOptions(record=(path,), column=column)
    loaded(machine, options, lambda _share, text: told.append(text))
    assert told[0].startswith(
        f"read {path}\nASCII, columns separated by semicolons, names in line 2, numbers from line 3"
    )
    assert "  position   Ist     um    1e-06 m" in told[0].split("\n")
    assert f"{record.position.size:,} samples every 500 µs" in told[0]
