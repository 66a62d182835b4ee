"""The public API: every name resolves, type checkers see the same names, and importing it is quick."""

from __future__ import annotations

import ast
import contextlib
import doctest
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import positioning as pos
from models.controller import to_json
from models.effects.friction_laws import ViscousFriction

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "design", "diagnosis", "studies", "reports")

README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the notebook runs: beside a record of a table with viscous friction, which its model lacks."""
    folder = tmp_path_factory.mktemp("notebook")
    machine = pos.load_machine()
    dragged = replace(machine, effects=(ViscousFriction(40.0),))
    controller = pos.assemble(machine, pos.design_deadbeat(machine))
    (folder / "controller.json").write_text(json.dumps(to_json(controller, 20e-6, 20e-3)), encoding="utf-8")
    record = pos.simulate(dragged, controller, pos.feeding_sequence(200e-6, 5, 0.1, machine.sample_time)).record
    time = machine.sample_time * np.arange(record.position.size)
    signals = (time, record.target, record.reference, record.feedforward, record.command, record.position)
    head = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
    np.savetxt(folder / "moves.csv", np.column_stack(signals), delimiter=",", header=head, comments="", fmt="%.17g")
    return folder


@pytest.fixture(scope="module")
def notebook(folder: Path) -> dict[str, Any]:
    """What the README's notebook leaves behind."""
    (cells,) = re.findall(r"```python\n(import positioning as pos\n.*?)```", README, re.DOTALL)
    assert len(cells.strip().splitlines()) == 12  # with the import and an empty line
    names: dict[str, Any] = {}
    with contextlib.chdir(folder):
        exec(compile(cells, "README.md", "exec"), names)
    return names


def test_the_notebook_of_the_readme_does_what_it_says(notebook: dict[str, Any]) -> None:
    assert notebook["deadbeat"].position[-1] == pytest.approx(20e-6)
    assert notebook["validation"].slowest.settling_time < notebook["machine"].specification.settling_time
    assert notebook["tuning"].ms == pytest.approx(2.0, rel=1e-3)
    assert notebook["diagnosis"].effects == ("viscous_friction",)
    assert [axes.get_ylabel() for axes in notebook["figure"].axes] == ["position [µm]", "command [N]"]
    assert "</svg>" in notebook["figure"]._repr_svg_()


def test_what_a_notebook_shows_of_an_object_is_one_line(notebook: dict[str, Any], folder: Path) -> None:
    names = ("machine", "deadbeat", "controller", "response", "validation", "tuning", "diagnosis")
    machine, trajectory = notebook["machine"], _names("Trajectory", notebook, folder)
    parts = [machine.plant, machine.plant.modes[1], machine.friction, machine.control.pid, notebook["response"].record]
    made = [pos.Variation(mass=0.03), pos.Columns(position="qm [mm]"), pos.Criteria(), pos.Constraints()]
    solved = [trajectory[name] for name in ("task", "trajectory")] + [pos.TrajectoryLimits(thrust=100.0)]
    for item in [*(notebook[name] for name in names), *parts, *made, *solved]:
        shown = repr(item)
        assert shown.startswith(f"{type(item).__name__}(")
        assert "\n" not in shown
        assert len(shown) <= 160, shown


@pytest.mark.parametrize("name", pos.__all__)
def test_every_name_has_an_example_that_runs(name: str, notebook: dict[str, Any], folder: Path) -> None:
    item = getattr(pos, name)
    text = inspect.getdoc(item) or ""
    examples = doctest.DocTestParser().get_doctest(text, _names(name, notebook, folder), name, None, 0)
    assert examples.examples
    said: list[str] = []
    with contextlib.chdir(folder):
        doctest.DocTestRunner(optionflags=EXAMPLES).run(examples, out=said.append)
    assert not said, "".join(said)


def _inside() -> list[tuple[str, str]]:
    """Module and name of all with an example that the public API does not lead to."""
    public = {
        (getattr(pos, name).__module__, getattr(getattr(pos, name), "__name__", "Studies")) for name in pos.__all__
    }
    files = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    modules = {".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text("utf-8") for path in files}
    nodes = [(module, node) for module, text in modules.items() if ">>>" in text for node in ast.walk(ast.parse(text))]
    found = [
        (module, node.name)
        for module, node in nodes
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and ">>>" in (ast.get_docstring(node) or "")
    ]
    return [one for one in found if one not in public]


@pytest.mark.parametrize(("module", "name"), _inside())
def test_an_example_elsewhere_runs_beside_what_its_module_has(
    module: str, name: str, notebook: dict[str, Any], folder: Path
) -> None:
    """So no example calls what was renamed, or is not in the public API."""
    around = vars(importlib.import_module(module))
    text = inspect.getdoc(around[name]) or ""
    examples = doctest.DocTestParser().get_doctest(
        text, {"pos": pos, **notebook, **around, "folder": folder}, name, None, 0
    )
    said: list[str] = []
    with contextlib.chdir(folder):
        doctest.DocTestRunner(optionflags=EXAMPLES).run(examples, out=said.append)
    assert not said, "".join(said)


def _names(name: str, notebook: dict[str, Any], folder: Path) -> dict[str, Any]:
    """What an example may use: what the notebook made, and for trajectories a problem that is solved."""
    names = {**notebook, "folder": folder}
    if "rajectory" in name:
        machine = names["machine"]
        task = pos.TrajectoryTask(machine.plant, machine.friction, machine.sample_time, 38, 20e-6, "peak_thrust")
        built = pos.build_trajectory(task)
        names |= {"task": task, "built": built}
        if name == "Trajectory":
            names["trajectory"] = pos.solve_trajectory(built, [machine.friction.limit])
    return names


def test_every_name_is_what_its_module_calls_so() -> None:
    for name in pos.__all__:
        item: Any = getattr(pos, name)
        assert getattr(item, "__module__", "").partition(".")[0] in {
            "models",
            "design",
            "diagnosis",
            "studies",
            "reports",
        }
    assert set(pos.__all__) <= set(dir(pos))
    assert set(pos.__all__) == set(pos._WHERE)
    with pytest.raises(AttributeError, match="no attribute 'Machin'"):
        _ = pos.Machin  # type: ignore[attr-defined]


def test_a_type_checker_sees_the_same_names_from_the_same_places() -> None:
    tree = ast.parse(Path(inspect.getfile(pos)).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == {
        name: (place.partition(":")[0], place.partition(":")[2] or name) for name, place in pos._WHERE.items()
    }


def test_it_is_imported_from_any_folder_without_what_it_leads_to(tmp_path: Path) -> None:
    said = "import sys, positioning as pos; print(*(name.partition('.')[0] for name in sys.modules)); pos.Machine"
    around = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", said], cwd=tmp_path, env=around, capture_output=True, text=True, check=True
    )
    assert not {"numpy", "casadi", "models", "design", "diagnosis", "studies"} & set(done.stdout.split())


def test_an_installed_project_has_every_file_that_its_code_reads() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    patterns = setuptools["package-data"]["*"]
    kept = {ROOT / "reports" / name for name in ("out", "baseline", "trial", "withheld")}
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").is_file()
        for file in (ROOT / package).rglob("*"):
            if file.is_file() and not kept & set(file.parents) and file.suffix not in {".py", ".pyc", ".nbi", ".nbc"}:
                assert any(file.match(pattern) for pattern in patterns), file
