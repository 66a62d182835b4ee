"""The copy of a command's process that sets its report: the same files, its errors are raised, and it may be killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# A process of its own: that of the tests has threads.
PROGRAM = """
import json, multiprocessing, os, sys
from pathlib import Path
from studies import interrupt
from studies.catalogue import every
from studies.rendering import renderer
from studies.study import Progress

interrupt._parent.append(os.open(os.devnull, os.O_WRONLY))  # as in the child of supervise()
whole, output = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
study = every()["deadbeat_design"]

def render(name, content, kill=False):
    (output / name).mkdir()
    with renderer(study, Progress()) as write:
        (copy,) = multiprocessing.active_children()
        if kill:
            copy.kill()
        return write(content, output / name)

found = {"figures": sorted(render("copy", whole)[0]), "drawn_here": "matplotlib" in sys.modules}
for name, kill in (("wrong", False), ("killed", True)):
    try:
        render(name, {**whole, "results": {}}, kill)
    except KeyError as error:
        found[name] = [str(error), *getattr(error, "__notes__", ())]
found["left"] = len(multiprocessing.active_children())
print(json.dumps(found))
"""


@pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="there is no copy without another core"
)
def test_a_copy_sets_the_report_and_what_it_cannot_do_is_done_or_raised_here(
    quick_run: Callable[[str], tuple[Path, int]], tmp_path: Path
) -> None:
    folder, _ = quick_run("deadbeat_design")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder / "results.json"), str(tmp_path)],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    found = json.loads(done.stdout)
    assert not found["drawn_here"]
    assert found["figures"] == sorted(file.stem for file in (folder / "figures").iterdir())
    for name in ("report.html", "report.pdf", *(f"figures/{one}.svg" for one in found["figures"])):
        assert (tmp_path / "copy" / name).read_bytes() == (folder / name).read_bytes()
    fault, where = found["wrong"]
    assert "_serve" in where
    assert found["killed"] == [fault]  # raised here, where it was tried once more
    assert found["left"] == 0
