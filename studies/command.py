"""What every study's command does alike: options, progress, bad input, and writing its folder in one piece.

Kept light: `--help` imports neither the models nor the reports.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

if TYPE_CHECKING:
    from models.machine import Machine
    from reports.report import Report

DONE: Final = 0
CHECK_MISSED: Final = 1
BAD_INPUT: Final = 2
FAULT: Final = 3


class BadInputError(Exception):
    """Input that a study can't use; the message is one line: what is wrong, where, and what to do."""


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
        """Whether the statement is true; a value that is no number does not hold."""
        return self.value <= self.limit if self.sense == "<=" else self.value >= self.limit


@dataclass(frozen=True)
class Answer:
    """What a study found: plain results (SI numbers, units in their names), checks, files for others: JSON or text."""

    results: Mapping[str, Any]
    checks: tuple[Check, ...]
    files: Mapping[str, Any] = field(default_factory=dict)
    summary: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True)
class Study:
    """One question, answered by the package studies.NAME: `verb` of its compute.py answers it, `tell` of its report.py
    says how the answer is told. Both are imported only when called. `compute` and `report`: others than these two.
    `machine_file`: the machine that the options lead to where --machine is not given (None: the default one).
    """

    name: str
    question: str
    add_options: Callable[[argparse.ArgumentParser], None]
    compute: Callable[[Machine, argparse.Namespace, Progress], Answer] = None  # type: ignore[assignment]
    report: Callable[[Mapping[str, Any]], Report] = None  # type: ignore[assignment]
    verb: str = "compute"
    machine_file: Callable[[argparse.Namespace], Path | None] = lambda _: None

    def __post_init__(self) -> None:
        for part, function in (("compute", self.verb), ("report", "tell")):
            if getattr(self, part) is None:
                object.__setattr__(self, part, _lazily(f"studies.{self.name}.{part}", function))


def _lazily(module: str, function: str) -> Callable[..., Any]:
    """The function of a module that is imported at the first call."""

    def call(*arguments: Any) -> Any:
        return getattr(import_module(module), function)(*arguments)

    return call


class Progress:
    """Says on stderr what is being done, how far it is and, for work over five seconds, how long it still takes."""

    def __init__(self, stream: Any = None) -> None:
        self._stream = stream or sys.stderr
        self._begin = time.monotonic()

    def __call__(self, share: float, text: str) -> None:
        """`share` (0 .. 1) of the work is done; `text` is what comes next."""
        elapsed = time.monotonic() - self._begin
        left = elapsed * (1 / share - 1) if share > 0.02 else 0.0
        rest = f", about {left:.0f} s left" if elapsed + left > 5 and left > 1 else ""
        print(f"[{share:4.0%} after {elapsed:.1f} s{rest}] {text}", file=self._stream, flush=True)


class Parser(argparse.ArgumentParser):
    """argparse, with its complaints as BadInputError: one line, exit status 2."""

    def error(self, message: str) -> NoReturn:
        raise BadInputError(f"{message}; see python -m {self.prog} --help")


def main(study: Study, arguments: Sequence[str] | None = None) -> int:
    """Runs the study as a command and returns its exit status; see `--help` of any study."""
    return guarded(lambda: _run(study, parser_of(study).parse_args(arguments)))


def guarded(work: Callable[[], int]) -> int:
    """The exit status of `work`, or BAD_INPUT with one line on stderr where it raises BadInputError."""
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")  # the matrices are small, and sums keep their order
    try:
        return work()
    except BadInputError as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    except Exception:
        traceback.print_exc()
        print("error: a fault of this tool, not of its input; please report it with the lines above", file=sys.stderr)
        return FAULT


def parser_of(study: Study) -> argparse.ArgumentParser:
    """The study's options and those of all."""
    parser = Parser(
        prog=f"studies.{study.name}",
        usage=f"python -m studies.{study.name} [options]",
        description=study.question,
        epilog="Exit status: 0 done; 1 done, but a check of the study does not hold; 2 bad input.",
    )
    study.add_options(parser)
    parser.add_argument(
        "--machine",
        type=Path,
        metavar="FILE",
        help="machine file, or a pack's nominal.json (default: models/machines/linear_motor_table.toml)",
    )
    parser.add_argument(
        "--controller", type=Path, metavar="FILE", help="controller.json to take the PID from (default: the machine's)"
    )
    parser.add_argument(
        "--output", type=_folder, metavar="FOLDER", help=f"where results go (default: reports/out/{study.name})"
    )
    parser.add_argument("--quick", action="store_true", help="coarser curves, for a smoke test; the report says so")
    parser.add_argument("--seed", type=whole(0), default=0, metavar="N", help="of all that is random (default: 0)")
    parser.add_argument("--no-report", action="store_true", help="write no report, only results.json and the like")
    return parser


def _folder(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty; give a folder")
    return Path(text)


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """The type of an option that takes a whole number [1] from low on, or to high."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < low or (high is not None and int(text) > high):
            span = f"from {low} on" if high is None else f"from {low} to {high}"
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number {span}")
        return int(text)

    return read


def quantity(text: str, unit: str, option: str) -> float:
    """The SI value of an option such as --stroke "20 um". Raises BadInputError naming the option."""
    from models.quantity import QuantityError, parse

    try:
        return parse(text, unit)
    except QuantityError as error:
        raise BadInputError(f"{option}: {error}") from error


def to_text(content: Any) -> str:
    """JSON as the studies write it: sorted keys, numbers to the last digit, infinities and NaN as null."""
    return json.dumps(plain(content), indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"


def plain(content: Any) -> Any:
    """The content as JSON holds it: arrays and tuples as lists, plain numbers, None for what is not finite."""
    if isinstance(content, Mapping):
        return {str(key): plain(item) for key, item in content.items()}
    if hasattr(content, "tolist"):
        return plain(content.tolist())
    if isinstance(content, list | tuple):
        return [plain(item) for item in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content


def _run(study: Study, options: argparse.Namespace) -> int:
    output: Path = options.output or Path("reports/out") / study.name
    require_writable(output)
    from models.machine import DEFAULT, parameters, to_json
    from studies.manifest import manifest

    progress = Progress()
    path = options.machine or study.machine_file(options) or DEFAULT
    machine = machine_of(path)
    if options.controller is not None:
        machine = _with_pid(machine, options.controller)
    answer = study.compute(machine, options, progress)
    checks = [{**vars(check), "holds": bool(check.holds)} for check in answer.checks]
    whole = plain(
        {
            "study": study.name,
            "machine": to_json(machine),
            "parameters": [{**vars(one), "provenance": vars(one.provenance)} for one in parameters(machine)],
            "results": answer.results,
            "checks": checks,
        }
    )
    with in_one_piece(output) as folder:
        for name, content in {"results.json": whole, **answer.files}.items():
            text = content if isinstance(content, str) else to_text(content)
            (folder / name).write_text(text, encoding="utf-8")
        given = _keep_machine(path, folder / "machine.toml")
        if options.controller is not None:
            shutil.copyfile(options.controller, folder / "given_controller.json")
        figures, tables = ({}, {}) if options.no_report else _render(study, whole, folder, progress)
        record = {**manifest(study.name, vars(options), given, folder), "figures": figures, "tables": tables}
        (folder / "manifest.json").write_text(to_text(record), encoding="utf-8")
        written = sorted(file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    progress(1.0, "done")
    _print_summary(answer, output, written)
    return DONE if all(check.holds for check in answer.checks) else CHECK_MISSED


def machine_of(path: Path) -> Machine:
    """The machine in a machine file, or in the nominal.json of a pack. Raises BadInputError."""
    from models import machine
    from models import nominal_file as nominal

    try:
        return nominal.load(path) if path.suffix == ".json" else machine.load(path)
    except machine.MachineError as error:
        raise BadInputError(str(error)) from error


def _keep_machine(path: Path, copy: Path) -> Path:
    """Puts the machine beside the results, a nominal.json as the machine file that it amounts to; the file to be hashed
    as the input."""
    if path.suffix != ".json":
        shutil.copyfile(path, copy)
        return path
    from models.machine_file import to_toml

    copy.write_text(to_toml(machine_of(path)), encoding="utf-8")
    return copy


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
    return with_pid(machine, controller.pid, f"controller file {path.name}")


Keys = dict[str, list[str]]


def _render(study: Study, whole: Mapping[str, Any], folder: Path, progress: Progress) -> tuple[Keys, Keys]:
    """Writes the report from what results.json holds, nothing else; the keys that figures and tables are made from."""
    from reports.report import render

    report = study.report(whole)
    render(report, whole, folder, progress=lambda text: progress(0.85, text))
    return (
        {figure.name: list(figure.keys) for figure in report.figures},
        {name: list(keys) for name, keys in report.tables.items()},
    )


def require_writable(output: Path) -> None:
    """Raises BadInputError, before any work, for a folder that can't be written."""
    existing = next(place for place in (output, *output.absolute().parents) if place.exists())
    if not existing.is_dir():
        raise BadInputError(f"--output {output}: {existing} is a file; give a folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise BadInputError(f"--output {output}: {existing} can't be written to; give another folder")


@contextmanager
def in_one_piece(output: Path) -> Iterator[Path]:
    """A folder that becomes `output` when the block ends, and vanishes when it fails: nothing is left half-written.

    Files of an earlier run, and only those, make way.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".writing-", dir=output))
    except OSError as error:
        raise BadInputError(
            f"--output {output}: can't be written to ({error.strerror}); give another folder"
        ) from error
    try:
        yield folder
        _remove_earlier(output)
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            place = output / file.relative_to(folder)
            place.parent.mkdir(parents=True, exist_ok=True)
            file.replace(place)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _remove_earlier(output: Path) -> None:
    earlier = output / "manifest.json"
    if not earlier.is_file():
        return
    try:
        names = json.loads(earlier.read_text(encoding="utf-8"))["outputs"]
    except (ValueError, KeyError, TypeError):
        return  # not one of ours
    for name in names:
        file = (output / name).resolve()
        if file.is_relative_to(output.resolve()):
            file.unlink(missing_ok=True)


def _print_summary(answer: Answer, output: Path, written: Sequence[Path]) -> None:
    from models.quantity import show

    rows = [*answer.summary]
    for check in answer.checks:
        verdict = "holds " if check.holds else "MISSED"
        sense = {"<=": "at most", ">=": "at least"}[check.sense]
        rows.append(
            (f"{verdict} {check.name}", f"{show(check.value, check.unit)} ({sense} {show(check.limit, check.unit)})")
        )
    width = max((len(name) for name, _ in rows), default=0)
    for name, text in rows:
        print(f"{name:<{width}}  {text}")
    print("written:", *(str(output / name) for name in written if name.parts[0] != "figures"))
