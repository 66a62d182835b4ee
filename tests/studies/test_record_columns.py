"""--column, --mapping and --recipe give each record its own columns, the same way in every study that reads records."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from models.machine import load
from models.records.columns import Columns
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.identify_machine.options import IdentificationOptions
from studies.options import BadInputError
from studies.record_columns import mapped

MACHINE = replace(load(), record=Columns(time="machine [ms]", position="machine", command="machine"))
SWEEP, MOVES = Path("runs/sweep_1.csv"), Path("runs/moves.mat")


@pytest.mark.parametrize("kind", [IdentificationOptions, DiagnosisOptions])
def test_each_record_has_its_own_columns(kind: type[IdentificationOptions | DiagnosisOptions], tmp_path: Path) -> None:
    (tmp_path / "maps.toml").write_text('[[record]]\nfiles = "sweep*"\nposition = "file"\nfeedforward = "exc [mN]"\n')
    options = kind(
        record=(SWEEP, MOVES),
        recipe="matlab_log",
        mapping=tmp_path / "maps.toml",
        column=("command=all [N]", "moves.mat:command=a:b [N]", "target="),
    )
    found = mapped(MACHINE, options, options.record)
    sweep, moves = found.columns(SWEEP), found.columns(MOVES)
    assert (sweep.time, moves.time) == ("log.t [s]", "log.t [s]")  # of the recipe, before the machine file
    assert (sweep.position, moves.position) == ("file", "log.x [m]")
    assert (sweep.feedforward, moves.feedforward) == ("exc [mN]", "log.uff [N]")
    assert (sweep.command, moves.command) == ("all [N]", "a:b [N]")
    assert (sweep.target, moves.target) == ("target_m", "target_m")


def test_a_pattern_of_a_mapping_file_that_fits_no_record_is_noted(tmp_path: Path) -> None:
    (tmp_path / "maps.toml").write_text('[[record]]\nfiles = "swap*"\nposition = "file"\n[[record]]\ntime = "t [s]"')
    options = IdentificationOptions(record=(SWEEP, MOVES), mapping=tmp_path / "maps.toml")
    (note,) = mapped(MACHINE, options, options.record).notes
    assert "record 1: 'swap*' fits none of the records (sweep_1.csv, moves.mat); it is not used" in note


@pytest.mark.parametrize(
    ("column", "says"),
    [
        (
            "swep*:position=x",
            r"--column swep\*:position=x: 'swep\*' fits none of the records \(sweep_1.csv, moves.mat\)",
        ),
        ("sweep*:speed=x", "'speed' is not a signal"),
        ("sweep*:position", "must be SIGNAL=ENTRY or FILES:SIGNAL=ENTRY"),
        ("runs/sweep_1.csv:position=x", "without its folder"),
    ],
)
def test_a_wrong_column_is_said(column: str, says: str) -> None:
    options = IdentificationOptions(record=(SWEEP, MOVES), column=(column,))
    with pytest.raises(BadInputError, match=says):
        mapped(MACHINE, options, options.record)


def test_an_unknown_recipe_is_said() -> None:
    with pytest.raises(
        BadInputError, match=r"--recipe: 'simulink' is unknown; choose one of .*matlab_log.*; a file .* by --mapping"
    ):
        DiagnosisOptions(recipe="simulink")
