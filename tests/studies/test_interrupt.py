"""A study that is interrupted, at any moment, ends at once with one line; nothing is left that it can't go on from."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from studies.catalogue import every
from studies.command import DONE, NOT_READ, guarded
from studies.interrupt import INTERRUPTED

ROOT = Path(__file__).parents[2]
MOMENTS = 3  # at which each study is interrupted, one in each third of the way to the last
LONGEST = 3.0  # s to the last of them
AT_ONCE = 3.0  # s in which it has to end, and takes 0.1 s where the machine is not busy
RESUMED = {"blind_trial": {"sealed", "answers.json"}, "full_circle": {"sealed"}}  # what a study goes on from

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")


@dataclass(frozen=True)
class Ended:
    """How an interrupted command ended, after so many seconds, and which of its processes are still there."""

    status: int
    said: list[str]
    seconds: float
    alive: list[str]


@pytest.fixture(autouse=True)
def _heeded() -> Iterator[None]:
    """Commands begun here heed SIGINT, though the tests may run in a shell's background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupted(command: list[str], after: float, number: signal.Signals = signal.SIGINT) -> Ended:
    """Runs `python -m command`, and sends it the signal after so many seconds from when it is under way."""
    mark = f"{os.getpid()}-{random.SystemRandom().getrandbits(60)}"  # stands in the environment of all that it begins
    with subprocess.Popen(
        [sys.executable, "-m", *command],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "INTERRUPT_MARK": mark},
    ) as process:
        while process.poll() is None and len(marked(mark)) < 2:  # Python itself begins, which nobody can interrupt well
            time.sleep(0.005)
        time.sleep(after)
        begin = time.monotonic()
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
        seconds = time.monotonic() - begin
        while number == signal.SIGKILL and marked(mark) and time.monotonic() < begin + 60:
            time.sleep(0.1)  # what it began finds out by itself
    return Ended(process.returncode, said.splitlines(), seconds, marked(mark))


def marked(mark: str) -> list[str]:
    """The processes with this mark in their environment that have not ended."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (place / "environ").read_bytes():  # empty for one that has ended
                found.append((place / "cmdline").read_bytes().replace(b"\0", b" ").decode())
        except OSError:
            continue
    return found


@pytest.mark.parametrize("name", sorted(every()))
def test_a_study_ends_at_once_and_leaves_nothing(name: str, tmp_path: Path) -> None:
    moments = random.Random(name)

    def once(number: int) -> tuple[Ended, Path, float]:
        output, after = tmp_path / str(number) / "below" / "out", ((number + moments.random()) / MOMENTS) ** 2 * LONGEST
        return interrupted([f"studies.{name}", "--quick", "--output", str(output)], after), output, after

    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(once, range(MOMENTS)))
    for ended, output, after in runs:
        if ended.status == DONE:  # a short study may be done before
            assert (output / "manifest.json").is_file()
            continue
        assert (ended.status, ended.said[-1]) == (INTERRUPTED, "interrupted"), (after, ended)
        assert not [line for line in ended.said[:-1] if not line.startswith("[")], (after, ended)
        assert ended.seconds < AT_ONCE, (after, ended)
        assert not ended.alive, after
        left = {file.name for file in output.glob("*")}
        assert left <= RESUMED.get(name, set()), (after, left)
        assert left or not output.parents[1].exists(), after


def test_sigterm_ends_a_study_with_its_own_status(tmp_path: Path) -> None:
    ended = interrupted(
        ["studies.trajectory_optimisation", "--quick", "--output", str(tmp_path / "out")], 2.0, signal.SIGTERM
    )
    assert (ended.status, ended.said[-1], ended.alive) == (128 + signal.SIGTERM, "interrupted", [])
    assert not (tmp_path / "out").exists()


def test_a_study_whose_parent_is_killed_ends_too(tmp_path: Path) -> None:
    ended = interrupted(["studies.gap_diagnosis", "--quick", "--output", str(tmp_path / "out")], 1.0, signal.SIGKILL)
    assert ended.status == -signal.SIGKILL
    assert not (tmp_path / "out").exists()
    assert not ended.alive


def test_a_review_ends_with_the_run_that_it_repeats(
    tmp_path: Path, quick_run: Callable[[str], tuple[Path, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """That run is in a group of its own, and its files are in a temporary folder."""
    folder, _ = quick_run("deadbeat_design")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    for number, after in ((signal.SIGINT, 0.3), (signal.SIGINT, 2.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 2.0)):
        ended = interrupted(["studies.review", str(folder)], after, number)
        assert ended.alive == []
        if number != signal.SIGKILL:
            assert (ended.status, ended.said[-1]) == (128 + number, "interrupted")
            assert ended.seconds < AT_ONCE
            assert not list(tmp_path.iterdir())


PLACES = """
from studies.interrupt import supervise
supervise()
import sys, time
from pathlib import Path
from studies import folder
put = folder._put
def slow(*arguments):
    Path(sys.argv[1], "begun").touch()
    time.sleep(1.0)
    put(*arguments)
folder._put = slow
from studies.command import main
from studies.deadbeat_design.__main__ import STUDY
sys.exit(main(STUDY, ["--quick", "--no-report", "--output", sys.argv[1] + "/out"]))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_results_that_are_being_put_in_place_are_all_put_there(number: signal.Signals, tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", PLACES, str(tmp_path)], cwd=ROOT, stdout=subprocess.DEVNULL)
    until = time.monotonic() + 120
    while not (tmp_path / "begun").exists():
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.01)
    process.send_signal(number)
    assert process.wait(timeout=60) == DONE
    assert {"manifest.json", "results.json", "controller.json"} <= {file.name for file in (tmp_path / "out").iterdir()}
    assert not list((tmp_path / "out").glob(".*"))


SCRATCH = """
from studies.interrupt import remove_if_interrupted, supervise
supervise()
import os, sys, time
from pathlib import Path
place = Path(sys.argv[1], "made", "scratch")
remove_if_interrupted(place, [place.parent])
place.mkdir(parents=True)
(place / "half").write_text("of it")
print("begun", flush=True)
{}
"""


def test_what_is_half_written_is_removed(tmp_path: Path) -> None:
    status, said = of_scratch("time.sleep(60)", tmp_path, signal.SIGINT)
    assert (status, said) == (INTERRUPTED, "interrupted\n")
    assert not list(tmp_path.iterdir())


def test_a_child_that_is_killed_is_said_to_be(tmp_path: Path) -> None:
    status, said = of_scratch("os.kill(os.getpid(), 9)", tmp_path, None)
    assert (status, said) == (137, "error: ended by SIGKILL, as it is when memory runs out; nothing was written\n")
    assert not list(tmp_path.iterdir())


def test_a_status_is_passed_on(tmp_path: Path) -> None:
    assert of_scratch("sys.exit(7)", tmp_path, None)[0] == 7


def of_scratch(end: str, folder: Path, number: signal.Signals | None) -> tuple[int, str]:
    command = [sys.executable, "-c", SCRATCH.format(end), str(folder)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        if number is not None:
            process.send_signal(number)
        _, said = process.communicate(timeout=60)
    return process.returncode, said


def test_in_one_process_an_interruption_is_a_line_and_a_status_too(capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> int:
        raise KeyboardInterrupt

    assert guarded(work) == INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"


def test_a_reader_that_has_had_enough_is_no_fault() -> None:
    """`--write-references FOLDER | head` had ended in a traceback."""
    code = (
        "import sys; from studies.command import guarded; sys.exit(guarded(lambda: print(*range(99999), sep=chr(10))))"
    )
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(timeout=60) == NOT_READ
