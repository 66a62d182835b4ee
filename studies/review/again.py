"""What a review does in a process of its own; its task is JSON on standard input.

{"do": "run", "study", "options", "files": {option: [path]}, "machine": path or null, ...}: runs the study.
{"do": "render", "study", "results", ...}: makes the report of given results.
{"do": "compare", "before", "after", ...}: two results side by side.
Each has "output", a folder that there is not yet, and "bounds".

Nothing here goes over a network, and the working folder is temporary: what the study keeps for later runs goes there.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import resource
import socket
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.catalogue import find
from studies.command import guarded, parser_of, run, to_text
from studies.folder import is_inside
from studies.interrupt import end_with
from studies.options import BadInputError
from studies.study import Study


def main() -> int:
    """Does the task and returns the exit status of a study."""
    task = json.load(sys.stdin)
    end_with(task.pop("alive"))
    # Its BLAS asks for the memory that it is loaded with again and again, for ever where the bound allows none.
    importlib.import_module("scipy.linalg")
    _bound(**task.pop("bounds"))
    sys.addaudithook(no_network)
    return guarded(lambda: {"run": _run, "render": _render, "compare": _compare}[task["do"]](task))


def _bound(seconds: float, memory: int, file: int) -> None:
    """Limits this process and those that it starts; the time by the clock is limited by who started it."""
    wanted = {
        resource.RLIMIT_CPU: int(seconds * (os.cpu_count() or 1)) + 1,
        resource.RLIMIT_DATA: memory,
        resource.RLIMIT_FSIZE: file,
        resource.RLIMIT_CORE: 0,
    }
    for limit, most in wanted.items():
        hard = resource.getrlimit(limit)[1]
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(limit, (least, least))


def no_network(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook. Raises BadInputError for any connection but one within this computer."""
    if event in {"socket.connect", "socket.bind", "socket.sendto"} and arguments[0].family != socket.AF_UNIX:
        raise BadInputError("a review does not use a network")


def _study(name: str) -> Study:
    study = find(name)
    assert study is not None, name
    return study


def _run(task: Mapping[str, Any]) -> int:
    study = _study(task["study"])
    given: argparse.Namespace = parser_of(study).parse_args([])
    for name, value in task["options"].items():
        setattr(given, name, value)
    for name, files in task["files"].items():
        setattr(given, name, [Path(file) for file in files] if name == "record" else Path(files[0]))
        for file in files:
            check_base(Path(file))
    given.machine = None if task["machine"] is None else Path(task["machine"])
    given.output = Path(task["output"])
    return run(study, given)


def check_base(file: Path) -> None:
    """Raises BadInputError for an ensemble whose base is not a machine file of this project, which lie beside it."""
    if file.suffix != ".toml":
        return
    try:
        base = tomllib.loads(file.read_text(encoding="utf-8")).get("base", "")
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{file.name}: can't be read as TOML") from error
    if not isinstance(base, str) or (base and not (is_inside(base) and "/" not in base)):
        raise BadInputError(f"{file.name}: its base lies outside the folder")


def _render(task: Mapping[str, Any]) -> int:
    from reports.report import render

    results = json.loads(Path(task["results"]).read_text(encoding="utf-8"))
    output = Path(task["output"])
    output.mkdir()
    render(_study(task["study"]).report(results), results, output)
    return 0


def _compare(task: Mapping[str, Any]) -> int:
    from reports.report import render
    from studies.review.compare import compare, tell

    before, after = (json.loads(Path(task[side]).read_text(encoding="utf-8")) for side in ("before", "after"))
    output = Path(task["output"])
    output.mkdir()
    content = compare(before, after)
    report = tell(content)
    content["figures"] = [figure.name for figure in report.figures]
    shown = {key: item for key, item in content.items() if key not in {"before", "after"}}
    (output / "results.json").write_text(to_text(shown), encoding="utf-8")
    render(report, content, output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
