"""A study: one question, what it is asked, and its answer. From Python, a study is called like a function."""

from __future__ import annotations

import dataclasses
import inspect
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from models.quantity import keeps_to, span, turned
from studies.options import BadInputError, Options

if TYPE_CHECKING:
    from models.machine import Machine
    from reports.report import Report


@dataclass(frozen=True)
class Check:
    """A statement of the study that holds or not: `value` against `limit` (SI), by `sense` ("<=" or ">=")."""

    name: str
    value: float
    unit: str
    limit: float
    source: str
    sense: str = "<="

    @property
    def holds(self) -> bool:
        """Whether the statement is true, but for the rounding of whole samples; what is not a number does not hold."""
        return keeps_to(self.value, self.limit) if self.sense == "<=" else keeps_to(self.limit, self.value)


@dataclass(frozen=True, repr=False)
class Answer:
    """What a study found: plain results (SI numbers, units in their names), checks, files: JSON, text or bytes."""

    results: Mapping[str, Any]
    checks: tuple[Check, ...]
    files: Mapping[str, Any] = field(default_factory=dict)
    summary: Sequence[tuple[str, str]] = ()

    def __repr__(self) -> str:
        hold = sum(bool(check.holds) for check in self.checks)
        return f"Answer({hold} of {len(self.checks)} checks hold; results: {', '.join(sorted(self.results))})"


@dataclass(frozen=True, repr=False)
class Study:
    """One question, answered by the package studies.NAME: `compute` of its compute.py answers it, `tell` of its
    report.py composes its report; both are imported only when called. `options`: what it can be asked;
    `writes`: names of the files, beyond those of every study, that it may write; `keeps`: those of them that it writes
    while it works, and goes on from.
    """

    name: str
    question: str
    options: type[Options] = Options
    writes: tuple[str, ...] = ()
    keeps: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"{self.name}: {self.question}"

    def __call__(
        self,
        machine: Machine | Path | str | None = None,
        *,
        progress: Callable[[float, str], None] | None = None,
        **options: Any,
    ) -> Answer:
        """The answer for a machine, or its file (None: the default one); nothing is written.

        options: those of `--help`, with underscores, as SI numbers or as text with a unit. progress receives the share
        of the work that is done, 0 .. 1, and what comes next. Raises BadInputError for what the study can't use.
        """
        asked = self.options(**{**options, "machine": machine})
        return self.compute(machine_for(asked)[0], asked, progress or (lambda _share, _text: None))

    @property
    def __signature__(self) -> inspect.Signature:
        """What a notebook completes: the study's options and their defaults."""
        own = [one for one in dataclasses.fields(self.options) if one.name not in {"machine", "output", "no_report"}]
        either, word = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY
        return inspect.Signature(
            [
                inspect.Parameter("machine", either, default=None),
                *(inspect.Parameter(one.name, word, default=one.default) for one in own),
                inspect.Parameter("progress", word, default=None),
            ]
        )

    def compute(self, machine: Machine, options: Options, progress: Callable[[float, str], None]) -> Answer:
        """Answers the question for a machine, in the units of its axis. Raises BadInputError."""
        work: Callable[..., Answer] = import_module(f"studies.{self.name}.compute").compute
        if machine.axis != "rotary":
            return work(machine, options, progress)
        try:
            answer = work(machine, options, lambda share, text: progress(share, machine.wording(text)))
        except BadInputError as error:
            raise BadInputError(machine.wording(str(error))) from error
        return dataclasses.replace(
            answer,
            checks=tuple(
                dataclasses.replace(check, name=turned(check.name), unit=machine.unit(check.unit))
                for check in answer.checks
            ),
            summary=[(turned(name), turned(said)) for name, said in answer.summary],
        )

    def report(self, results: Mapping[str, Any]) -> Report:
        """The report of the content of results.json, in the units of its machine's axis."""
        report: Report = import_module(f"studies.{self.name}.report").tell(results)
        return dataclasses.replace(report, wording=turned) if results["machine"].get("axis") == "rotary" else report


MIN_DONE_SHARE: Final = 0.2  # of the work that has to be done before the rest is estimated from it
# Factor by which it may be off, either way: in five of six on eleven runs of another axis.
TIME_LEFT_FACTOR: Final = 4.0
SHORT: Final = 5.0  # s below which nothing is said of the time left


class Progress:
    """Says on stderr what is being done, how far it is and, for work over five seconds, how long it may still take.

    The shares are those of the default machine, so that a time is told as a range. What goes before the first word,
    such as compiling, says nothing of the rest.
    """

    def __init__(self, stream: Any = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream or sys.stderr, clock
        self._begin = clock()
        self._first: tuple[float, float] | None = None
        self._share = 0.0

    def __call__(self, share: float, text: str) -> None:
        """`share` (0 .. 1) of the work is done, and not less than was said before; `text` is what comes next."""
        elapsed = self._clock() - self._begin
        rest = self._left(share, elapsed)
        line = f"[{self._share:4.0%} after {elapsed:.1f} s{rest}] {text}\n"
        self._stream.write(line)  # in one piece, so that an interruption does not come between a line and its end
        self._stream.flush()

    def _left(self, share: float, elapsed: float) -> str:
        """What may be left, where enough is done and the share has grown since it was last told."""
        grown, self._share = share > self._share, max(share, self._share)
        if self._first is None:
            self._first = share, elapsed
        done = share - self._first[0]
        if not grown or done < MIN_DONE_SHARE:
            return ""
        left = (elapsed - self._first[1]) * (1 - share) / done
        return f", {between(left / TIME_LEFT_FACTOR, left * TIME_LEFT_FACTOR)} left" if left > SHORT else ""


def between(least: float, most: float) -> str:
    """A range of times [s] in words, each to one digit, as nobody knows them better: "30 s to 5 min"."""

    def told(time: float) -> str:
        size, unit = next(((size, unit) for size, unit in ((3600, "h"), (60, "min")) if time >= 2 * size), (1, "s"))
        return f"{float(f'{time / size:.1g}'):g} {unit}"

    return span(told(least), told(most))


def machine_for(options: Options) -> tuple[Machine, Path | None]:
    """The machine that the options ask for, with the PID of --controller, and its file if it is from one.

    Raises BadInputError.
    """
    from models.machine import DEFAULT, Machine

    if isinstance(options.machine, Machine):
        machine, path = options.machine, None
    else:
        path = options.machine or options.usual_machine() or DEFAULT
        machine = machine_of(path)
    options.check_units(machine)
    return (machine if options.controller is None else _with_pid(machine, options.controller)), path


def machine_of(path: Path) -> Machine:
    """The machine in a machine file, or in the nominal.json of a pack. Raises BadInputError."""
    from models import machine
    from models import nominal_file as nominal

    try:
        return nominal.load(path) if path.suffix == ".json" else machine.load(path)
    except machine.MachineError as error:
        raise BadInputError(str(error)) from error


def _with_pid(machine: Machine, path: Path) -> Machine:
    """The machine with the PID of a controller file. Raises BadInputError for one that can't be used."""
    from models.controller import ControllerError, load
    from models.machine import with_pid

    try:
        controller = load(path)
    except ControllerError as error:
        raise BadInputError(f"--controller {error}") from error
    if controller.sample_time != machine.sample_time:
        raise BadInputError(
            f"--controller {path}: runs at {controller.sample_time:g} s and the machine at {machine.sample_time:g} s; "
            "design it for this machine's sample time"
        )
    if controller.law is not None:
        raise BadInputError(
            f"--controller {path}: its feedback is not a plain PID; state it in the machine file, as [control.cascade] "
            "or [control.filters], and leave --controller out"
        )
    return with_pid(machine, controller.pid, f"controller file {path.name}")
