"""What a study will take is said before the work, scales with what is asked for, and is refused beyond a bound."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from models.machine import DEFAULT, load
from studies.catalogue import every
from studies.command import BAD_INPUT, main
from studies.effort import MOST, SAID, foresee, lasting, period, seconds_a_sample
from studies.options import BadInputError, Options

TEXT = DEFAULT.read_text(encoding="utf-8")


def told(seconds: float, memory: float = 0.0, limit: float | None = None) -> list[str]:
    """What is said of a job that takes so long [s] and holds so much [bytes]."""
    lines: list[str] = []
    options = Options(time_limit=limit)
    foresee({"one": 0.25 * seconds, "other": 0.75 * seconds}, memory, options, lambda _, text: lines.append(text))
    return lines


def test_what_takes_long_is_said_and_what_takes_too_long_is_refused() -> None:
    assert told(0.9 * SAID) == []
    assert told(600.0, 2e9) == ["this will take about 10 min and 2 GB, most of the time for other"]
    with pytest.raises(BadInputError, match=r'about 5 h .* more than 4 h; .* or --time-limit "7.5 h"'):
        told(5 * 3600.0)
    assert told(5 * 3600.0, limit=6 * 3600.0) == ["this will take about 5 h and 0 GB, most of the time for other"]
    with pytest.raises(BadInputError, match="more than 10 s"):
        told(15.0, limit=10.0)
    with pytest.raises(BadInputError, match=r"9 GB, .* is refused"):
        told(1.0, 2.1 * MOST)


def test_a_time_is_told_so_that_it_can_be_given_back() -> None:
    for seconds in (3.0, 200.0, 9000.0, 1e6):
        assert Options(time_limit=lasting(seconds)).time_limit == pytest.approx(seconds, rel=0.05)  # type: ignore[arg-type]


def test_a_period_is_counted_and_a_sample_takes_its_time() -> None:
    machine = load()
    assert period(machine) == pytest.approx(10_000)
    assert 0 < seconds_a_sample(machine) < 1e-3


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("deadbeat_design", ()),
        ("response_variation", ()),
        ("trajectory_optimisation", ("--tables", "100000000")),
        ("pid_tradeoff", ()),
        ("identify_machine", ("--tables", "100000000")),
        ("gap_diagnosis", ()),
        ("paper_gap", ()),
        ("blind_trial", ("--cases", "100000000")),
        ("full_circle", ("--cases", "100000000")),
    ],
)
def test_every_study_foresees_what_it_takes(
    name: str, options: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Refused within moments, before any work; without many tables to ask for, against a limit of almost nothing."""
    text, count = re.subn('interval = { value = "0.5 s"', 'interval = { value = "4 s"', TEXT)
    assert count == 1
    machine = tmp_path / "axis.toml"
    machine.write_text(text, encoding="utf-8")
    given = () if name in {"blind_trial", "full_circle"} else ("--machine", str(machine))
    limit = () if options else ("--time-limit", "10 ms")
    quick = () if options else ("--quick",)
    output = tmp_path / "out"
    assert main(every()[name], [*given, *options, *limit, *quick, "--output", str(output)]) == BAD_INPUT
    error = capsys.readouterr().err.splitlines()[-1]
    assert re.match(r"error: --(time-limit|machine): this would take about ", error)
    assert not output.exists()
