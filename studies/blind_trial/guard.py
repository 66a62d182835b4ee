"""Isolates an answering process from the sealed files, and detects signs that a trial was compromised.

A trial that seals its own cases needs no isolation from their key, which does not exist before the answers are
committed (see sealing.py). A given --key and the sealer's code exist: they are closed by the kernel where it has
Landlock, and everywhere by a hook that also reports the attempt.

Imports only the standard library: an answering process calls `forbid` before it imports anything else of this program.
"""

from __future__ import annotations

import ast
import gzip
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import Any, Final

from studies.blind_trial import landlock

SEALER: Final = "studies.blind_trial.sealer"
SEALER_FOLDER: Final = Path(__file__).with_name("sealer")
# Audit events whose first argument, or first two, are paths.
PATHS: Final = {
    "open",
    "os.listdir",
    "os.scandir",
    "os.link",
    "os.symlink",
    "os.rename",
    "os.truncate",
    "shutil.copyfile",
}
# Audit events that would start code or connections outside this hook's control.
SPAWNS: Final = (
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.spawn",
    "os.fork",
    "os.forkpty",
    "pty.spawn",
    "socket.connect",
)
CHUNK_BYTES: Final = 1 << 20  # Bytes of a file that are searched at a time.
MAX_SEARCHED_BYTES: Final = 2_000_000_000  # Bytes of a file after decompression, up to which it is searched.
WORTH_COMPARING: Final = 60  # Syntax-tree nodes of a function; shorter functions may coincide by chance.


class RefusedError(PermissionError):
    """The answering process tried to open something sealed."""


def forbid(files: Iterable[str | os.PathLike[str]], modules: Sequence[str] = (SEALER,)) -> list[str]:
    """Forbids this process, irrevocably, to open these files and folders, import these modules, or start processes.

    The returned list grows by one line with every refusal, so that code which catches the error is detected too. The
    hook stops neither machine code nor paths relative to an open folder, Landlock both.
    """
    _list_fonts()
    places = tuple(os.path.realpath(file) for file in files)
    landlock.close(places)
    names = {Path(place).name for place in places if not Path(place).is_dir()}
    refused: list[str] = []

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event in PATHS:
            wanted = [os.fsdecode(one) for one in arguments[:2] if isinstance(one, str | bytes | os.PathLike)]
            asked = any(_within(one, places, names) for one in wanted)
        elif event == "import":
            wanted = [str(arguments[0])]
            asked = any(wanted[0] == name or wanted[0].startswith(f"{name}.") for name in modules)
        else:
            wanted, asked = [str(one)[:80] for one in arguments[:1]], event in SPAWNS
        if not asked:
            return
        refused.append(f"{event} {' '.join(wanted)}")
        raise RefusedError(f"{event} of {wanted}: an answering process must not open it")

    sys.addaudithook(hook)
    return refused


def _list_fonts() -> None:
    """Lets matplotlib list the fonts now: on a new machine it asks another program for them when a design first imports
    it, which from here on would count as an attempt to reach what is sealed.
    """
    import matplotlib.font_manager  # noqa: F401  # before anything is forbidden, not with this module


def _within(path: str, places: Sequence[str], names: Iterable[str]) -> bool:
    """Whether a path leads to or into one of the places; a relative path may start elsewhere, so its name counts."""
    whole = os.path.realpath(path)
    if any(whole == place or whole.startswith(place + os.sep) for place in places):
        return True
    return not os.path.isabs(path) and os.path.basename(path) in names  # noqa: PTH117, PTH119


def leaks(pack: Path, names: Iterable[str], largest: int = MAX_SEARCHED_BYTES) -> list[str]:
    """Where a pack reveals a label: names of effects in its files' names or contents, except in disabled.json, which is
    one in the open (`reports/guide/trials.md`).

    A file is searched up to so many bytes after decompression; that it has more is said, as it hides what follows.
    """
    found = []
    words = [name.encode() for name in names]
    for file in sorted(one for one in pack.rglob("*") if one.is_file() and one.name != "disabled.json"):
        place = str(file.relative_to(pack))
        held, whole = _held(file, words, largest)
        found += [f"{place} holds {word.decode()!r}" for word in words if word in held or word in place.encode()]
        if not whole:
            found.append(f"{place} expands to more than {largest / 1e9:g} GB, and so was not searched to its end")
    return found


def _held(file: Path, words: Sequence[bytes], largest: int) -> tuple[set[bytes], bool]:
    """Which words a file holds, read chunk by chunk, and whether it was read to its end."""
    held, longest, size, last = set[bytes](), max(map(len, words), default=1), 0, b""
    with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as content:
        while part := content.read(CHUNK_BYTES):
            size += len(part)
            if size > largest:
                return held, False
            text = last + part
            held.update(word for word in words if word in text)
            last = text[1 - longest :] if longest > 1 else b""
    return held, True


def shared_code(one: Path, others: Iterable[Path], packages: Sequence[str]) -> list[str]:
    """Code shared by two programs: an import of `packages` in folder `one`, or a function that a folder of `others` has
    too, whatever its names.
    """
    found = [f"{file.name} imports {name}" for file in _sources(one) for name in imports(file) if _any(name, packages)]
    own = {shape: f"{file.name}: {name}" for file in _sources(one) for name, shape in _functions(file)}
    for folder in others:
        for file in _sources(folder):
            found += [f"{own[shape]} is {file.name}: {name}" for name, shape in _functions(file) if shape in own]
    return found


def imports(file: Path) -> Iterator[str]:
    """Every module that a source file imports, by either kind of statement."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def _any(name: str, packages: Sequence[str]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _sources(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


def _functions(file: Path) -> tuple[tuple[str, str], ...]:
    """Name and shape of every function worth comparing: its statements without names, docstrings and types."""
    return _functions_in(file.read_text(encoding="utf-8"))


@cache
def _functions_in(source: str) -> tuple[tuple[str, str], ...]:
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef):
            continue
        body = node.body[1:] if ast.get_docstring(node) is not None else node.body
        nodes = chain.from_iterable(map(ast.walk, body))
        if next(islice(nodes, WORTH_COMPARING - 1, None), None) is not None:  # it has as many, or more
            order: dict[str, int] = {}
            found.append((node.name, " ".join(_shape(part, order) for part in body)))
    return tuple(found)


def _shape(node: ast.AST, order: dict[str, int]) -> str:
    """A syntax tree as text, with names replaced by their order of first appearance."""
    parts = [type(node).__name__]
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_comment", "ctx"):
            continue
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, ast.AST):
                parts.append(_shape(item, order))
            elif isinstance(item, str) and name in ("id", "arg", "attr", "name"):
                parts.append(str(order.setdefault(item, len(order))))
            elif item is not None:
                parts.append(repr(item))
    return f"({' '.join(parts)})"
