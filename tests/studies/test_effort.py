"""What a study will take is said before the work, scales with what is asked for, and is refused beyond a bound."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from models.machine import DEFAULT, load
from studies.catalogue import every
from studies.command import BAD_INPUT, main
from studies.effort import MAX_MEMORY_BYTES, SAID, foresee, lasting, more_samples, period, seconds_a_sample
from studies.options import BadInputError, Options
from studies.study import Progress, between

ALONE = "of a processor that does nothing else"
TEXT = DEFAULT.read_text(encoding="utf-8")


def told(seconds: float, memory: float = 0.0, limit: float | None = None) -> list[str]:
    """What is said of a job that takes so long [s] and holds so much [bytes]."""
    lines: list[str] = []
    options = Options(time_limit=limit)
    foresee({"one": 0.25 * seconds, "other": 0.75 * seconds}, memory, options, lambda _, text: lines.append(text))
    return lines


def test_what_takes_long_is_said_and_what_takes_too_long_is_refused() -> None:
    assert told(0.9 * SAID) == []
    assert told(600.0, 2e9) == [f"this will take 3 min to 30 min {ALONE}, and 2 GB, most of the time for other"]
    with pytest.raises(BadInputError, match=r'about 5 h .* more than 4 h; .* or --time-limit "7.5 h"'):
        told(5 * 3600.0)
    assert told(5 * 3600.0, limit=6 * 3600.0) == [
        f"this will take 100 min to 20 h {ALONE}, and 0 GB, most of the time for other"
    ]
    with pytest.raises(BadInputError, match="more than 10 s"):
        told(15.0, limit=10.0)
    with pytest.raises(BadInputError, match=r"9 GB, .* is refused"):
        told(1.0, 2.1 * MAX_MEMORY_BYTES)


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


def announced(steps: Sequence[tuple[float, float]]) -> list[str]:
    """What is said of the time left at each share of the work, told so many seconds after the start."""
    times, stream = iter([0.0, *(time for _, time in steps)]), io.StringIO()
    progress = Progress(stream, clock=lambda: next(times))
    for share, _ in steps:
        progress(share, "x")
    lines = stream.getvalue().splitlines()
    return [found[1] if (found := re.search(r"s, (.*) left\]", line)) else "" for line in lines]


def test_the_time_left_is_told_from_what_was_measured_and_as_a_range() -> None:
    """30 s of compiling before the first word were taken for a twentieth of the work: of 58 s, 610 s were announced."""
    said = announced([(0.05, 32.0), (0.1, 32.3), (0.15, 35.0), (0.3, 37.4), (0.65, 47.0), (0.65, 60.0), (1.0, 70.0)])
    assert said[:3] == ["", "", ""]  # too little is done
    assert said[3] == between(0.25 * 15.12, 4 * 15.12) == "4 s to 60 s"  # 5.4 s for 0.25: 15.1 s for 0.7
    assert said[4] == "2 s to 40 s"  # 15 s for 0.6: 8.75 s for 0.35
    assert said[5:] == ["", ""]  # the share did not grow, so that nothing was measured; done


def test_times_are_told_to_one_digit_in_their_unit() -> None:
    assert between(4.4, 340.0) == "4 s to 6 min"
    assert between(130.0, 8000.0) == "2 min to 2 h"
    assert between(20.0, 21.0) == "20 s"


def test_the_share_that_is_done_never_falls() -> None:
    stream = io.StringIO()
    progress = Progress(stream, clock=lambda: 0.0)
    for share in (0.5, 0.9, 0.85, 1.0):
        progress(share, "x")
    assert re.findall(r"\d+(?=%)", stream.getvalue()) == ["50", "90", "90", "100"]


def test_a_record_that_makes_them_too_many_needs_more_samples_and_memory() -> None:
    machine = load()
    assert not more_samples(machine, 10_000, 50_000, 1, 120_000)
    assert not more_samples(machine, 20_000, 99_000, 1, 120_000)  # 5 % more than the table
    told = more_samples(machine, 20_001, 99_000, 1, 120_000)
    assert told == "give --most-samples 121000, which takes about 2.5 GB of memory"
