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
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final

from studies.folder import EVERY, Place, atomic_folder, is_full, require_free
from studies.interrupt import INTERRUPTED
from studies.options import BadInputError, Parser, add_options
from studies.rendering import renderer
from studies.study import Answer, Progress, Study, machine_for, machine_of

DONE: Final = 0
CHECK_MISSED: Final = 1
BAD_INPUT: Final = 2
FAULT: Final = 3
NOT_READ: Final = 141  # as after SIGPIPE


def main(study: Study, arguments: Sequence[str] | None = None) -> int:
    """Runs the study as a command and returns its exit status; see `--help` of any study."""
    return guarded(lambda: run(study, parser_of(study).parse_args(arguments)))


def guarded(work: Callable[[], int]) -> int:
    """The exit status of `work`, or BAD_INPUT with one line on stderr where it raises BadInputError."""
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")  # the matrices are small, and sums keep their order
    try:
        return work()
    except BadInputError as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # whoever read the output has had enough, as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # where Python flushes it on its way out
        return NOT_READ
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if is_full(error):
            print("error: the disk is full, nothing was written; make room and run it again", file=sys.stderr)
            return BAD_INPUT
        traceback.print_exc()
        print("error: a fault of this tool, not of its input; please report it with the lines above", file=sys.stderr)
        return FAULT


def parser_of(study: Study) -> argparse.ArgumentParser:
    """The study's options and those of all."""
    parser = Parser(
        prog=f"studies.{study.name}",
        usage=f"python -m studies.{study.name} [options]",
        description=study.question,
        epilog="Exit status: 0 done; 1 done, but a check of the study does not hold; 2 bad input; 3 a fault of this "
        "tool; 130 interrupted (143 by SIGTERM); 141 nobody reads the output.",
    )
    add_options(parser, study.options, study.name)
    return parser


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


def run(study: Study, given: argparse.Namespace) -> int:
    """Runs the study with what `parser_of` made of the command line; the exit status. Raises BadInputError."""
    options = study.options(**vars(given))
    output = options.output or Path("reports/out") / study.name
    place = Place(output, study.name, (*EVERY, *study.writes), study.keeps, options.overwrite)
    require_free(place)
    from models.machine import parameters, to_json
    from studies.manifest import manifest

    progress = Progress()
    with renderer(study, progress) if not options.no_report else nullcontext() as render:
        machine, path = machine_for(options)
        assert path is not None  # on the command line a machine is a file
        content = _machine_file(path)  # which may be edited while the study runs
        answer = study.compute(machine, options, progress)
        whole = plain(
            {
                "study": study.name,
                "machine": to_json(machine),
                "parameters": [{**vars(one), "provenance": one.provenance.plain} for one in parameters(machine)],
                "results": answer.results,
                "checks": [{**vars(check), "holds": bool(check.holds)} for check in answer.checks],
            }
        )
        with atomic_folder(place) as folder:
            _write(folder, {"results.json": whole, **answer.files})
            (folder / "machine.toml").write_bytes(content)
            if options.controller is not None:
                shutil.copyfile(options.controller, folder / "given_controller.json")
            figures, tables = render(whole, folder) if render is not None else ({}, {})
            record = {**manifest(study.name, vars(given), path.name, folder), "figures": figures, "tables": tables}
            (folder / "manifest.json").write_text(to_text(record), encoding="utf-8")
            written = sorted(file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    progress(1.0, "done")
    _print_summary(answer, output, written)
    return DONE if all(check.holds for check in answer.checks) else CHECK_MISSED


def _write(folder: Path, files: Mapping[str, Any]) -> None:
    """Writes bytes and text as they are, anything else as JSON; names may lead into folders that are not there yet."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, bytes):
            (folder / name).write_bytes(content)
        else:
            text = content if isinstance(content, str) else to_text(content)
            (folder / name).write_text(text, encoding="utf-8")


def _machine_file(path: Path) -> bytes:
    """What machine.toml beside the results holds: the machine file, or that which a nominal.json amounts to."""
    if path.suffix != ".json":
        return path.read_bytes()
    from models.machine_file import to_toml

    return to_toml(machine_of(path)).encode()


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
