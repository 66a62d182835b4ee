"""What a study can't use is one line that says what is wrong, where, and what to do; nothing is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models.machine import DEFAULT
from studies.catalogue import every
from studies.command import BAD_INPUT, main

RECORD = "RECORD"  # stands for a readable record of an axis that is pushed to and fro
EMPTY, BROKEN, TWICE = "EMPTY", "BROKEN", "TWICE"  # stand for folders: without records, with a bad one, and one twice
EVERYWHERE = (
    (["--seed", "x"], "--seed"),
    (["--colour", "red"], "unrecognized arguments"),
    (["--machine", "nowhere.toml"], "nowhere.toml: can't be read"),
    (["--controller", "nowhere.json"], "nowhere.json: can't be read"),
    (["--output", ""], "--output"),
)
OWN = {
    "deadbeat_design": (
        (["--stroke", "0 um"], "the stroke is 0 m"),
        (["--stroke", "20 kg"], "--stroke: '20 kg' is in kg, but this is a quantity in m"),
        (["--stroke", "nan um"], "not a finite number"),
        (["--settling-time", "15 ms"], "the shortest that can is "),
        (["--settling-time", "2 ms"], "no thrust does it"),
        (["--settling-time", ""], "--settling-time: '' must be a number with a unit"),
        (["--settling-time", "1000 s"], "longer than a motion"),
        (["--thrust-limit", ""], "--thrust-limit: '' must be a number with a unit"),
        (["--stroke", "1e-12 m"], "must be from 1 nm to 1 km"),
        (["--settling-time", "20.2 ms"], "must be a whole number of samples"),
        (["--settling-time", "20"], "--settling-time: '20' has no unit"),
        (["--thrust-limit", "200 N"], "--thrust-limit: 200 N must be between 0 and the rated 150 N"),
        (["--overshoot", "-0.1"], "--overshoot: -0.1 must be at least 0"),
        (["--objective", "beauty"], "invalid choice: 'beauty'"),
    ),
    "gap_diagnosis": (
        (["nowhere.csv"], "nowhere.csv: can't be read"),
        (["--disable", "coging"], "--disable coging: is not an effect that is looked for; did you mean cogging?"),
        (["--column", "speed=v", RECORD], "'speed' is not a signal"),
        (["--column", "position=x [kg]", RECORD], "quantity in m"),
        (["--column", "swep*:position=x", RECORD], "'swep*' fits none of the records"),
        (["--mapping", "nowhere.toml", RECORD], "nowhere.toml: can't be read"),
        (["--recipe", "nobody", RECORD], "--recipe: 'nobody' is unknown"),
        ([RECORD], "is too few"),
    ),
    "full_circle": (
        (["--cases", "0"], "--cases: '0' must be a whole number from 1 on"),
        (["--machine", str(DEFAULT)], "--machine: is for the records of one's own axis; give --records FOLDER as well"),
        (["--records", "nowhere"], "--records: needs the file of the machine that they are of; give --machine"),
        (["--records", "nowhere", "--machine", str(DEFAULT)], "--records nowhere: is not a folder"),
        (["--records", EMPTY, "--machine", str(DEFAULT)], "holds no record"),
        (["--records", BROKEN, "--machine", str(DEFAULT)], "or move broken.csv out of --records"),
        (["--records", TWICE, "--machine", str(DEFAULT)], "b.csv: has the same content as a.csv; remove one of them"),
        (["--records", EMPTY, "--machine", str(DEFAULT), "--cases", "2"], "--cases: counts withheld machines"),
        (["--disable", "coging"], "--disable coging: is not an effect that is looked for; did you mean cogging?"),
        (["--column", "position=x"], "--column: is for the records of one's own axis"),
    ),
    "identify_machine": (
        (["nowhere.csv"], "nowhere.csv: can't be read"),
        (["--tables", "0"], "--tables: '0' must be a whole number from 1 on"),
        (["--pass-band", "0 Hz"], "--pass-band: 0 Hz must be above 0 Hz"),
        (["--column", "speed=v", RECORD], "'speed' is not a signal"),
        (["--column", "position=x [kg]", RECORD], "quantity in m"),
        (["--column", "swep*:position=x", RECORD], "'swep*' fits none of the records"),
        (["--mapping", "nowhere.toml", RECORD], "nowhere.toml: can't be read"),
        (["--recipe", "nobody", RECORD], "--recipe: 'nobody' is unknown"),
        (["--kinds", "song", RECORD], "--kinds song"),
        (["--kinds", "response", "--pass-band", "3 m", RECORD], "--pass-band"),
    ),
    "pid_tradeoff": (
        (["--ms", "1"], "--ms: 1 must be above 1"),
        (["--ms", "two"], "--ms"),
        (
            ["--noise", "1 N/m"],
            "--noise: 1 N/m is too little; with an integral |CS| is at least the steepest contact stiffness",
        ),
        (["--mt", "1.001", "--mode-error", "0", "--mass-error", "0"], "--ms, --mt, --noise: no PID with |S| <= 3"),
        (["--mode-error", "-0.1"], "--mode-error: -0.1 must be at least 0"),
        (["--mass-error", "0.7"], "--mass-error: 0.7 must be below 0.5"),
        (["--noise", "5 N"], "--noise"),
        (["--objective", "beauty"], "invalid choice"),
        (["--ensemble", "nowhere.toml"], "--ensemble"),
    ),
    "response_variation": (
        (["--members", "1"], "must be a whole number from 2 to 160"),
        (["--ensemble", "nowhere.toml"], "nowhere.toml"),
    ),
    "trajectory_optimisation": (
        (["--stroke", "0 um"], "--stroke: 0 m must be above 0 m"),
        (["--tolerance", "2 kg"], "--tolerance: '2 kg' is in kg"),
        (["--thrust-limit", "200 N"], "must be between 0 and the rated 150 N"),
        (["--settling-time", "400 ms"], "must be well below"),
        (["--objective", "beauty"], "invalid choice: 'beauty'"),
        (["--tables", "0"], "must be a whole number from 1 on"),
        (["--thrust-limit", "5 N"], "friction alone takes 16.5 N of 5 N; allow more"),
    ),
}
CASES = [(name, *case) for name in sorted(every()) for case in (*EVERYWHERE, *OWN.get(name, ()))]


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record in the agreed format."""
    path = tmp_path_factory.mktemp("record") / "rest.csv"
    time = 5e-4 * np.arange(4000)
    nothing = np.zeros(time.size)
    rows = np.column_stack(
        [time, nothing, nothing, nothing, 10 * np.sin(31.4 * time), 1e-5 * (1 - np.cos(31.4 * time))]
    )
    head = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def folders(record: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The folders that the capitals stand for."""
    base = tmp_path_factory.mktemp("folders")
    found = {name: base / name.lower() for name in (EMPTY, BROKEN, TWICE)}
    for folder in found.values():
        folder.mkdir()
        (folder / "notes.md").write_text("no record", encoding="utf-8")
    (found[BROKEN] / "broken.csv").write_text("nothing, here\n", encoding="utf-8")
    for name in ("a.csv", "b.csv"):
        (found[TWICE] / name).write_bytes(record.read_bytes())
    return {name: str(folder) for name, folder in found.items()}


@pytest.mark.parametrize(("name", "options", "says"), CASES)
def test_bad_input_is_one_line_and_nothing_is_written(
    name: str,
    options: list[str],
    says: str,
    record: Path,
    folders: dict[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [str(record) if option == RECORD else folders.get(option, option) for option in options]
    arguments = ["--quick", "--no-report", "--output", str(tmp_path / "out"), *given]
    assert main(every()[name], arguments) == BAD_INPUT
    captured = capsys.readouterr()
    errors = [line for line in captured.err.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert says in errors[0]
    assert captured.out == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", sorted(every()))
def test_a_folder_that_cannot_be_written_is_said_before_any_work(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    for output in (tmp_path / "file", tmp_path / "file" / "below"):
        assert main(every()[name], ["--output", str(output)]) == BAD_INPUT
    captured = capsys.readouterr()
    assert captured.err.count("error: --output") == 2
    assert "give a folder" in captured.err
    assert captured.out == ""


def test_own_cases_are_of_studies_that_there_are() -> None:
    assert set(OWN) <= set(every())
