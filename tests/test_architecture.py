"""The rules of the layout: how imports run, how rooms are kept, what a public docstring says, what the lock pins."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from models.effects.catalogue import every
from tests import conftest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "models": {"models"},
    "design": {"models", "design"},
    "diagnosis": {"models", "diagnosis"},
    "reports": {"reports"},
    "studies": {"models", "design", "diagnosis", "reports", "studies"},
}
# Rooms that the others of their package stand on.
BELOW = {
    "diagnosis/records": {"models", "diagnosis.records"},
    "diagnosis/model": {"models", "diagnosis.records", "diagnosis.model"},
}
# What carries a physical quantity in or out of a function; with one of these, a docstring gives units in brackets.
QUANTITIES = re.compile(r"\b(float|Array|ArrayLike|NDArray)\b")


LIBRARIES = ("models", "design", "diagnosis")
MOST_MODULES = 12  # in one folder: what a reader takes in at a glance


def modules(package: str, root: Path = ROOT) -> Iterator[Path]:
    yield from sorted((root / package).rglob("*.py"))


def dotted(path: Path, root: Path) -> str:
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def imported(path: Path, known: Collection[str]) -> Iterator[str]:
    """Modules among `known` that a file imports anywhere: at its head, inside a function, or for type checking only."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        yield from named(node, known)


def named(node: ast.AST, known: Collection[str]) -> Iterator[str]:
    """Modules among `known`, and others, that a line imports."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module:
        inner = [f"{node.module}.{alias.name}" for alias in node.names]
        yield from (name if name in known else node.module for name in inner)


def wrong_directions(root: Path) -> list[str]:
    """Imports against the one direction models <- design, diagnosis <- studies -> reports, or of what stands on a
    room."""
    return [
        f"{path.relative_to(root)} imports {name}"
        for room, allowed in {**MAY_IMPORT, **BELOW}.items()
        for path in modules(room, root)
        for name in imported(path, ())
        if name.partition(".")[0] in MAY_IMPORT and not any(f"{name}.".startswith(f"{one}.") for one in allowed)
    ]


def cycles(root: Path) -> list[str]:
    """Modules that import one another in a circle."""
    files = {dotted(path, root): path for package in MAY_IMPORT for path in modules(package, root)}
    graph = {name: {other for other in imported(path, files) if other in files} for name, path in files.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [" -> ".join(error.args[1])]
    return []


def crowded(root: Path) -> list[str]:
    """Folders of a library with more modules than a reader takes in at a glance."""
    folders = {path.parent for package in LIBRARIES for path in modules(package, root)}
    counts = {folder: len([p for p in folder.glob("*.py") if p.name != "__init__.py"]) for folder in folders}
    return [f"{folder.relative_to(root)}: {count}" for folder, count in sorted(counts.items()) if count > MOST_MODULES]


def ambiguous(root: Path) -> list[str]:
    """File names that mean two things within one library."""
    found = []
    for package in LIBRARIES:
        counts = Counter(path.name for path in modules(package, root) if path.name != "__init__.py")
        found += [f"{package}: {name}" for name, count in sorted(counts.items()) if count > 1]
    return found


# Constants that mean the same wherever they are defined: a study's declaration and its report's tables, the project's
# folder, periods of the specified sequence, iterations of a fit, and where a study's targets come from.
SAME_EVERYWHERE = {"STUDY", "TABLES", "ROOT", "PERIODS", "ITERATIONS", "SOURCE"}
MOST_DEFINITIONS = 3  # modules that may define a constant of one name


def constants(path: Path) -> Iterator[str]:
    """Upper-case names that a module gives values to; not places of an array, `X, Y = range(2)`, that it counts."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        else:
            continue
        for target in targets:
            of_several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            names = target.elts if isinstance(target, ast.Tuple) and of_several else [target]
            yield from (name.id for name in names if isinstance(name, ast.Name) and name.id.isupper())


def overloaded(root: Path) -> list[str]:
    """Constants with a name that so many modules define that it tells nobody which quantity it bounds.

    The sealer is left out: its packs are known by the hash of its sources, and it imports nothing from elsewhere.
    """
    paths = [path for package in MAY_IMPORT for path in modules(package, root) if "sealer" not in path.parts]
    counts = Counter(name for path in paths for name in set(constants(path)) - SAME_EVERYWHERE)
    return [f"{name}: {count} modules" for name, count in sorted(counts.items()) if count > MOST_DEFINITIONS]


RULES = (wrong_directions, cycles, crowded, ambiguous, overloaded)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_the_layout_keeps_its_rules(rule: Callable[[Path], list[str]]) -> None:
    assert rule(ROOT) == []


def heads(root: Path) -> dict[str, set[str]]:
    """What each module of the project imports as soon as it is imported itself."""
    files = {dotted(path, root): path for package in MAY_IMPORT for path in modules(package, root)}
    found = {}
    for name, path in files.items():
        head = ast.parse(path.read_text(encoding="utf-8")).body
        found[name] = {other for node in head for other in named(node, files)}
    return found


def test_what_computes_does_not_wait_for_what_draws() -> None:
    """Matplotlib takes half a second, which a study that computes need not have: another process sets its report."""
    graph = heads(ROOT)
    for name in graph:
        if name.startswith("studies.") and name.endswith(".compute"):
            reached, ahead = set[str](), {name}
            while ahead:
                reached |= ahead
                ahead = set[str]().union(*(graph.get(one, set()) for one in ahead)) - reached
            assert "studies.study" in reached
            assert not {"reports.style", "matplotlib.figure"} & reached, name


# What proposes one effect, in the detectors, and what simulates the table whose answer is known, in the study.
ABOUT_ONE_EFFECT = {"detect.py", "random_force.py", "command_jitter.py", "own_records.py"}


def special_cases(root: Path) -> list[str]:
    """Where a diagnosis, or what its study says of it, knows one effect of the catalogue by its class or its name."""
    effects = every()
    families = {kind.__module__ for kind in effects.values()}
    found = []
    for path in (*modules("diagnosis", root), *modules("studies/gap_diagnosis", root)):
        if path.name in ABOUT_ONE_EFFECT:
            continue
        found += [f"{path.relative_to(root)} imports {name}" for name in imported(path, families) if name in families]
        texts = {node.value for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Constant)}
        found += [f"{path.relative_to(root)} names {name}" for name in effects if name in texts]
    return found


def test_no_effect_is_special_cased_by_name(tmp_path: Path) -> None:
    assert special_cases(ROOT) == []
    files = {
        "diagnosis/which/detectors/scan.py": "from models.effects.motor import Cogging\n",
        "diagnosis/verdict.py": "def f(names):\n    return 'stribeck' in names\n",
        "diagnosis/which/detectors/random_force.py": "from models.effects.structure import FloorVibration\n",
    }
    assert special_cases(planted(tmp_path, files)) == [
        "diagnosis/verdict.py names stribeck",
        "diagnosis/which/detectors/scan.py imports models.effects.motor",
    ]


def planted(root: Path, files: Mapping[str, str]) -> Path:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    return root


@pytest.mark.parametrize(
    ("rule", "files"),
    [
        (wrong_directions, {"models/plant.py": "from design.deadbeat import synthesise\n"}),
        (wrong_directions, {"design/pid/goal.py": "def f():\n    import diagnosis.diagnose\n"}),
        (wrong_directions, {"diagnosis/model/fit.py": "from diagnosis.handover.gate import adopted\n"}),
        (cycles, {"models/a.py": "from models.b import x\n", "models/b.py": "def f():\n    from models import a\n"}),
        (cycles, {"models/a.py": "import models.b\n", "models/b.py": "if TYPE_CHECKING:\n    import models.a\n"}),
        (crowded, {f"diagnosis/where/m{i}.py": "" for i in range(MOST_MODULES + 1)}),
        (ambiguous, {"models/friction.py": "", "models/effects/friction.py": ""}),
        (overloaded, {f"design/m{i}.py": f"MOST: Final = {i}  # samples\n" for i in range(MOST_DEFINITIONS + 1)}),
        (overloaded, {f"studies/m{i}.py": f"FEW, MANY{i} = {i}, 9\n" for i in range(MOST_DEFINITIONS + 1)}),
    ],
)
def test_a_planted_fault_breaks_its_rule_and_only_that(
    rule: Callable[[Path], list[str]], files: dict[str, str], tmp_path: Path
) -> None:
    root = planted(tmp_path, files)
    assert [one for one in RULES if one(root)] == [rule]


@pytest.mark.parametrize(
    "files",
    [
        {f"design/m{i}.py": f"MOST: Final = {i}\n" for i in range(MOST_DEFINITIONS)},
        {f"design/m{i}.py": f"def f():\n    MOST = {i}\n" for i in range(MOST_DEFINITIONS + 1)},
        {f"models/m{i}.py": "POSITION, SPEED = range(2)\n" for i in range(MOST_DEFINITIONS + 1)},
        {f"studies/m{i}.py": "STUDY = 1\n" for i in range(MOST_DEFINITIONS + 1)},
    ],
)
def test_a_constant_of_few_modules_or_with_one_meaning_is_let_pass(files: dict[str, str], tmp_path: Path) -> None:
    assert overloaded(planted(tmp_path, files)) == []


def test_tests_mirror_the_rooms() -> None:
    rooms = {path.parent.relative_to(ROOT) for package in LIBRARIES for path in modules(package)}
    assert sorted(str(room) for room in rooms if not any((ROOT / "tests" / room).glob("test_*.py"))) == []


def public(package: str) -> Iterator[tuple[str, Any]]:
    for path in modules(package):
        if path.name == "__main__.py":
            continue
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        module: ModuleType = __import__(name, fromlist=["_"])
        yield name, module
        for item in vars(module).values():
            original = getattr(item, "py_func", getattr(item, "__wrapped__", item))
            if getattr(original, "__module__", None) != name or not hasattr(original, "__name__"):
                continue  # of another module, or a value
            if not original.__name__.startswith("_"):
                yield f"{name}.{original.__name__}", original


@pytest.mark.parametrize("package", ["models", "design", "diagnosis", "studies", "reports"])
def test_everything_public_has_a_docstring(package: str) -> None:
    missing = [name for name, item in public(package) if not inspect.getdoc(item) and not name.endswith("__init__")]
    assert missing == []


@pytest.mark.parametrize("package", ["models", "design", "diagnosis"])
def test_docstrings_of_functions_with_quantities_give_units(package: str) -> None:
    silent = [
        name
        for name, item in public(package)
        if inspect.isfunction(item)
        and QUANTITIES.search(str(inspect.signature(item)))
        and not re.search(r"\[[^\]]+\]|SI\b|coefficients", f"{inspect.getdoc(item)}")
    ]
    assert silent == []


def test_the_lock_pins_with_hashes_and_names_no_index() -> None:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    pinned = re.findall(r"^[\w.-]+==", text, re.MULTILINE)
    assert len(pinned) > 20
    assert text.count("--hash=sha256:") > len(pinned)
    assert "://" not in text
    wanted = re.findall(r"^[\w-]+", (ROOT / "requirements.in").read_text(encoding="utf-8"), re.MULTILINE)
    locked = {name.removesuffix("==").replace("-", "_") for name in pinned}
    assert {name.replace("-", "_") for name in wanted} <= locked


def test_a_diagnosis_does_not_wait_for_what_only_designs_and_reports_use() -> None:
    script = "import sys, diagnosis.evidence; print(*sorted({'control', 'matplotlib'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_the_tests_that_are_called_slow_or_quick_are_there() -> None:
    """A path that has moved would put whole studies into `make test-fast` without a word."""
    for name in (*conftest.SLOW, *conftest.QUICK):
        assert (conftest.HERE / name).exists(), name
    assert conftest.slow(conftest.HERE / "studies" / "test_review.py")
    assert not conftest.slow(Path(__file__))
