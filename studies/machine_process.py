"""A machine behind a program that runs what it is asked: an axis in a laboratory, or a sealed one.

The program is started as `CMD --folder FOLDER`, FOLDER being new. It writes into it limits.json and, unless the machine
file is given, nominal.json:

    {"distance_m", "speed_m_per_s", "feedforward_N", "machine_time_s", "records"}

Of these the first three bound one run (from 0, in either direction), the others all runs together. Then it reads lines,
each the path of a table of references (time_s, target_m, reference_m, feedforward_N; one row a sample). It has the axis
follow them, from rest at 0, and answers each with one line of JSON on its standard output, flushed:

    {"record": PATH, "left": {"machine_time_s", "records"}}     or "refused": WHY, or "tripped": WHY, in place of PATH

A program that can load another PID into the drive also takes lines of JSON, for one run each, and one that cannot
refuses them: {"references": PATH, "controller": PATH of a controller.json}. The record may be in any format and under
any names that the machine file's [record] maps. The program ends when its input does; SIGTERM asks it to stop the axis
at once. What is beyond the limits is never asked.
"""

from __future__ import annotations

import json
import os
import queue
import shlex
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from diagnosis.experiments.schedules import Schedule, to_csv
from models.quantity import listed, show
from models.records.columns import Columns
from models.records.files import read_record
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.options import BadInputError

STARTING: Final = 600.0  # s within which a program has to write its limits
PATIENCE: Final = (300.0, 20.0)  # s for the answer to a run, and times the run's length
ENDING: Final = 10.0  # s for a program to end by itself
LOOKING: Final = 0.02  # s between two looks for the limits
SAID: Final = 300  # characters of what a program said before it ended
PRINTED_ROUNDING: Final = 5e-9  # by which what is written in nine digits may be beyond a limit: half of the last one
OF_A_RUN: Final = ("distance_m", "speed_m_per_s", "feedforward_N")
OF_ALL_RUNS: Final = ("machine_time_s", "records")


class MachineProcessError(BadInputError):
    """A program that does not do as the protocol says, or has ended."""


@dataclass(frozen=True)
class Limits:
    """Of one run: the largest distance from 0 [m], speed [m/s] and feedforward [N]; of all runs together: machine time
    [s] and records."""

    distance: float
    speed: float
    feedforward: float
    machine_time: float
    records: int


@dataclass(frozen=True)
class Left:
    """What is left of the machine time [s] and of the records."""

    machine_time: float
    records: int


@dataclass(frozen=True)
class Ran:
    """A run: its record, the file that it is in, and what is left."""

    record: Record
    file: Path
    left: Left


@dataclass(frozen=True)
class Refused:
    """A run that was not begun, why, and what is left: as much as before."""

    why: str
    left: Left


@dataclass(frozen=True)
class Tripped:
    """A run that ended before its time, why, and what is left: its time and its record are spent."""

    why: str
    left: Left


Outcome = Ran | Refused | Tripped


def beyond(asked: Schedule, sample_time: float, limits: Limits, left: Left) -> str:
    """What of a run is beyond the limits or beyond what is left of them, in one sentence; empty where nothing is.
    sample_time in [s]."""
    given = asked.given
    force = given.feedforward + given.compensation
    way = np.abs(np.diff(given.position, prepend=0.0))
    checked = (
        ("distance", max(np.abs(given.position).max(), np.abs(asked.target).max()), limits.distance, "m"),
        ("speed", way.max() / sample_time, limits.speed, "m/s"),
        ("feedforward", np.abs(force).max(), limits.feedforward, "N"),
        ("machine time", duration(asked, sample_time), left.machine_time, "s"),
        ("records", 1, left.records, "1"),
    )
    over = [
        f"{name}: {show(float(wanted), unit, 4)} is beyond the {show(float(most), unit, 4)} that there are"
        for name, wanted, most, unit in checked
        if not wanted <= most * (1 + PRINTED_ROUNDING)
    ]
    return "; ".join(over)


def duration(asked: Schedule, sample_time: float) -> float:
    """How long a run lasts [s]; sample_time in [s]."""
    return asked.target.size * sample_time


@dataclass(frozen=True)
class Channel:
    """The lines to a machine's program and from it, and whether it has ended."""

    requests: IO[str]
    answers: IO[str]
    ended: Callable[[], bool]


class MachineProcess:
    """A machine that can do one thing: run references. It keeps to its limits, and so does this side of it.

    limits: as the program stated them at its start; left: as it told last; folder: where it puts its records, with
    nominal.json where it wrote one.
    """

    def __init__(self, channel: Channel, command: str, work: Path, columns: Columns | None = None) -> None:
        """Waits for the limits; command: as messages have it; work: a folder for what is asked, in which the machine's
        folder is. Raises MachineProcessError."""
        self._channel, self._command, self._work, self._columns = channel, command, work, columns
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=_pass_on, args=(channel.answers, self._lines), daemon=True).start()
        self._asked = 0
        self.folder = work / "machine"
        self.limits = self._stated_limits()
        self.left = Left(self.limits.machine_time, self.limits.records)

    @property
    def nominal(self) -> Path | None:
        """What the program says of the machine, as a nominal.json; None where it says nothing."""
        place = self.folder / "nominal.json"
        return place if place.is_file() else None

    def run(self, references: Schedule, sample_time: float, controller: Path | None = None) -> Outcome:
        """Has the machine follow references at its controller's sample time [s]. controller: a controller.json whose
        PID it is to run with, if it can. What is beyond its limits is refused here and not asked. Raises
        MachineProcessError where the program does not keep to the protocol.
        """
        over = beyond(references, sample_time, self.limits, self.left)
        if over:
            return Refused(over, self.left)
        self._asked += 1
        table = self._work / f"asked-{self._asked}.csv"
        table.write_text(to_csv(references, sample_time), encoding="utf-8")
        line = str(table)
        if controller is not None:
            line = json.dumps({"references": line, "controller": str(controller.absolute())})
        answer = self._answer(line, PATIENCE[0] + PATIENCE[1] * duration(references, sample_time))
        machine_time, records = self._numbers(answer.get("left"), '"left" in its answer', OF_ALL_RUNS)
        self.left = Left(machine_time, int(records))
        for key, kind in (("refused", Refused), ("tripped", Tripped)):
            if key in answer:
                return kind(" ".join(str(answer[key]).split()), self.left)
        if not isinstance(answer.get("record"), str):
            raise self._fault('answered without "record", "refused" or "tripped"')
        file = self.folder / str(answer["record"])  # an absolute path stays one
        try:
            return Ran(read_record(file, self._columns, trusted=True), file, self.left)
        except RecordError as error:
            raise self._fault(f"its record can't be used: {error}") from error

    def _stated_limits(self) -> Limits:
        place, until = self.folder / "limits.json", time.monotonic() + STARTING
        while time.monotonic() < until:
            try:
                content = json.loads(place.read_text(encoding="utf-8"))
            except (OSError, ValueError):  # not there yet, or half-written
                content = None
            if content is not None:
                distance, speed, force = self._numbers(content, "limits.json", OF_A_RUN)
                machine_time, records = self._numbers(content, "limits.json", OF_ALL_RUNS)
                return Limits(distance, speed, force, machine_time, int(records))
            if self._channel.ended():
                raise self._fault("ended before it had written limits.json")
            time.sleep(LOOKING)
        raise self._fault(f"has written no limits.json in {STARTING:g} s")

    def _numbers(self, content: Any, where: str, names: Sequence[str]) -> tuple[float, ...]:
        """What a JSON object of the program's states under these names; no run is within a limit of 0."""
        if not isinstance(content, dict):
            raise self._fault(f"{where} must be an object with {listed(names)}")
        for name in names:
            number = content.get(name)
            if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number < np.inf:
                raise self._fault(f"{where} must give {name} as a number from 0 on")
            if number == 0 and name in OF_A_RUN:
                raise self._fault(f"{where} must give {name} as more than 0: no experiment stays within that")
        return tuple(float(content[name]) for name in names)

    def _answer(self, line: str, seconds: float) -> Mapping[str, Any]:
        try:
            self._channel.requests.write(line + "\n")
            self._channel.requests.flush()
            text = self._lines.get(timeout=seconds)
        except (BrokenPipeError, queue.Empty) as error:
            ended = isinstance(error, BrokenPipeError)
            raise self._fault("has ended" if ended else f"has not answered in {seconds:.0f} s") from error
        if not text:
            raise self._fault("has ended")
        try:
            answer = json.loads(text)
        except ValueError as error:
            raise self._fault(f"answered {text.strip()[:60]!r}, which is not JSON") from error
        if not isinstance(answer, dict):
            raise self._fault("answered something other than an object")
        return answer

    def _fault(self, what: str) -> MachineProcessError:
        with suppress(OSError):
            said = " ".join((self._work / "stderr.txt").read_text(encoding="utf-8", errors="replace").split())[-SAID:]
            what += f"; it said: {said}" if said else ""
        return MachineProcessError(f"--machine-process {self._command}: {what}")


def _pass_on(stream: IO[str], lines: queue.Queue[str]) -> None:
    """Puts each line of a stream into a queue, and an empty one at its end, whatever ends it."""
    try:
        with stream:
            for line in stream:
                lines.put(line)
    finally:
        lines.put("")


@contextmanager
def started(
    command: str | Sequence[str], work: Path, *, first: str | None = None, columns: Columns | None = None
) -> Iterator[MachineProcess]:
    """A machine whose program is ended when the block is left.

    work: an existing folder for what is asked and the machine's own folder. first: a line that the program reads before
    all others, as a sealed machine does. columns: how its records call their signals. Raises MachineProcessError.
    """
    shown = command if isinstance(command, str) else shlex.join(command)
    with program(command, work, first) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        channel = Channel(process.stdin, process.stdout, lambda: process.poll() is not None)
        yield MachineProcess(channel, shown, work.absolute(), columns)


@contextmanager
def program(command: str | Sequence[str], work: Path, first: str | None = None) -> Iterator[subprocess.Popen[str]]:
    """A machine's program, with its folder in `work`, ended when the block is left; first: as in `started`.

    Raises MachineProcessError where it can't be started.
    """
    words = _words(command)
    folder = (work / "machine").absolute()
    folder.mkdir()
    with (work / "stderr.txt").open("wb") as errors:
        try:
            process = subprocess.Popen(
                [*words, "--folder", str(folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                encoding="utf-8",
                errors="replace",  # a stray byte is no reason to wait for an answer that is there
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )
        except OSError as error:
            raise MachineProcessError(
                f"--machine-process {shlex.join(words)}: can't be started ({error.strerror}); give a command that can"
            ) from error
    try:
        if first is not None:
            assert process.stdin is not None
            with suppress(BrokenPipeError):
                process.stdin.write(first + "\n")
                process.stdin.flush()
        yield process
    except BaseException:
        process.terminate()  # the axis may move: it is told to stop before it is waited for
        raise
    finally:
        _end(process)


def _words(command: str | Sequence[str]) -> list[str]:
    """The words of a command, as a shell takes it apart. Raises MachineProcessError."""
    if not isinstance(command, str):
        return list(command)
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise MachineProcessError(f"--machine-process {command}: can't be read ({error}); close its quotes") from error
    if not words:
        raise MachineProcessError("--machine-process: is empty; give the command that starts the machine's program")
    return words


def _end(process: subprocess.Popen[str]) -> None:
    """Ends the program with its input, or else by force."""
    assert process.stdin is not None
    with suppress(BrokenPipeError):
        process.stdin.close()
    for ask in (process.terminate, process.kill):
        try:
            process.wait(ENDING)
            break
        except subprocess.TimeoutExpired:
            ask()
    process.wait()
    assert process.stdout is not None
    with suppress(OSError, ValueError):
        process.stdout.close()
