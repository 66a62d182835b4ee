"""`--machine-process`: a diagnosis that asks a machine for its records, and what is kept and told of it.

What was asked and what came back stays beside --output, in a folder of the same name with BESIDE behind it: the
references, the records, what the machine's program wrote, and LOOKS, the course of the looks. The study itself then
diagnoses these records like any others, and keeps a copy of them among its results, so that `review` and --continue do
not need the machine.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from diagnosis.experiments.active import Asked, Budget, NotRun, Settings, ask, to_json
from diagnosis.experiments.schedules import Schedule
from diagnosis.experiments.within_limits import Bounds
from models.machine import Machine
from models.records.checks import derivative_of_error
from models.records.record import Record
from studies.command import to_text
from studies.folder import require_writable
from studies.gap_diagnosis.compute import CACHE
from studies.gap_diagnosis.course import LOOKS
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import disabled, loaded
from studies.machine_process import MachineProcess, Ran, Tripped, started
from studies.options import BadInputError
from studies.study import Progress, machine_for, machine_of

BESIDE: Final = "-machine"


def asked_for(given: argparse.Namespace) -> argparse.Namespace:
    """The options of a run over the records that the machine made when it was asked. Raises BadInputError."""
    options = DiagnosisOptions(**{**vars(given), "machine_process": None, "seconds": None})
    output = Path(given.output or Path("reports/out") / "gap_diagnosis")
    work, progress = output.with_name(output.name + BESIDE), Progress()
    require_writable(output)
    if work.exists():
        raise BadInputError(
            f"--output {output}: {work} holds what a machine made before; give another folder, or its records as RECORD"
        )
    work.mkdir(parents=True)
    try:
        path, result, files = _course(given, options, work, progress)
    except BaseException:
        if not any(work.glob("asked-*")):  # nothing was run
            shutil.rmtree(work)
        raise
    (work / LOOKS).write_text(to_text(to_json(result)), encoding="utf-8")
    if not files:
        raise BadInputError(f"--machine-process: no record was made; {result.reason}; see {work / LOOKS}")
    whole = argparse.Namespace(**vars(given))
    whole.machine_process, whole.seconds = None, None
    whole.record, whole.machine, whole.looks = [*given.record, *files], path, work / LOOKS
    whole.trust_records = True  # what looks wrong is said, as the records can't be made again
    return whole


def _course(
    given: argparse.Namespace, options: DiagnosisOptions, work: Path, progress: Progress
) -> tuple[Path, Asked, list[Path]]:
    """The machine file, how it went, and the records' files."""
    with started(given.machine_process, work, columns=_columns(options)) as process:
        path = options.machine if isinstance(options.machine, Path) else process.nominal
        if path is None:
            raise BadInputError("--machine-process: its program writes no nominal.json; give --machine FILE")
        machine = machine_for(options)[0] if options.machine is not None else machine_of(path)
        seconds = DiagnosisOptions(seconds=given.seconds).seconds
        return (path, *_asked(machine, process, options, seconds, progress))


def _columns(options: DiagnosisOptions) -> Any:
    return None if options.machine is None else machine_for(options)[0].record


def _asked(
    machine: Machine, process: MachineProcess, options: DiagnosisOptions, seconds: float | None, progress: Progress
) -> tuple[Asked, list[Path]]:
    files = list[Path]()

    def run(references: Schedule) -> Record | NotRun:
        result = process.run(references, machine.sample_time)
        if isinstance(result, Ran):
            files.append(result.file)
            return _as_diagnosed(machine, result.record)
        return NotRun(result.why, isinstance(result, Tripped))

    found = loaded(machine, options, progress) if options.record else ()
    have = tuple(one.content for one in found if isinstance(one.content, Record))
    if any(record.every > 1 for record in have):
        raise BadInputError(
            "--machine-process: begins with records that hold all samples of the controller; leave out those that don't"
        )
    return (
        ask(
            machine,
            run,
            budget_of(process, machine, seconds, options.most_samples),
            Settings(seed=options.seed, disabled=disabled(options.disable, machine), cache=CACHE),
            have=have,
            say=lambda share, text: progress(0.05 + 0.9 * share, text),
        ),
        files,
    )


def _as_diagnosed(machine: Machine, record: Record) -> Record:
    """The record as the study reads it from its file."""
    if machine.record is None or machine.record.derivative != "position":
        return record
    return derivative_of_error(record, machine.control.pid, machine.control.reference_delay)


def budget_of(process: MachineProcess, machine: Machine, seconds: float | None, samples: int) -> Budget:
    """What may be taken of a machine within its limits: at most so many seconds [s] (None: a minute), and so many
    samples that a diagnosis can take them."""
    limits, usual = process.limits, Budget(Bounds(0.0, 0.0, 0.0))
    longest = min(seconds or usual.seconds, process.left.machine_time, samples * machine.sample_time)
    return replace(
        usual,
        bounds=Bounds(limits.distance, limits.speed, limits.feedforward),
        seconds=longest,
        records=min(usual.records, process.left.records),
    )
