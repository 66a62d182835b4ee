"""What a study's results follow from: hashes of inputs and outputs, options, versions."""

from __future__ import annotations

import hashlib
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
SOURCES: Final = ("models", "design", "diagnosis", "studies", "reports")
PROJECT: Final = "rolling-friction-positioning"
FORMAT: Final = f"{PROJECT}/manifest/1"
"""What says of a manifest.json that it is of a run of this project, and in which form."""
NOT_ASKED: Final = {"output", "overwrite", "tls_ca", "tls_cert", "tls_key", "time_limit"}
"""Options that say where the work is done and its answer goes, not what it is."""
SUFFIXES: Final = {".py", ".toml", ".md", ".css", ".html", ".typ", ".lua", ".j2"}


def manifest(study: str, options: Mapping[str, Any], machine: str, folder: Path) -> dict[str, Any]:
    """What manifest.json says of a run's options and inputs, of the versions, and of the outputs below `folder`.

    The machine file, which is called `machine`, is kept in the folder as machine.toml, as it was when the run began:
    its hash can be checked without that file.
    """
    files = [(name, file) for name, value in sorted(options.items()) if name not in NOT_ASKED for file in _paths(value)]
    shown = {
        name: value
        for name, value in options.items()
        if name not in {*NOT_ASKED, "machine", *(name for name, _ in files)}
    }
    return {
        "format": FORMAT,
        "study": study,
        "options": shown,
        "inputs": {
            "machine": {
                "file": machine,
                "default": options.get("machine") is None,
                "copy": "machine.toml",
                "sha256": sha256(folder / "machine.toml"),
            },
            "files": [
                {"option": name, "file": _named(file), "sha256": sha256(file)}
                for name, file in files
                if name != "machine"
            ],
            "source": {"sha256": tree_hash(source_files()), **_commit()},
            "lock": {"file": "requirements.lock", "sha256": lock_hash()},
        },
        "versions": versions(),
        "outputs": hashes(folder),
    }


def hashes(folder: Path) -> dict[str, str]:
    """The SHA-256 of every file below the folder by its name, which is relative and has forward slashes."""
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): sha256(file) for file in files}


def _paths(value: object) -> list[Path]:
    """The files that an option's value names."""
    items = value if isinstance(value, list | tuple) else [value]
    return [item for item in items if isinstance(item, Path)]


def _named(file: Path) -> str:
    """The file's path from the project's root where it lies below it, else as it was given."""
    whole = file.resolve()
    return (whole.relative_to(ROOT) if whole.is_relative_to(ROOT) else file).as_posix()


def sha256(file: Path) -> str:
    """The hexadecimal SHA-256 of a file's bytes; of a folder, over the names and bytes of all files below it."""
    if file.is_dir():
        below = sorted(one for one in file.rglob("*") if one.is_file())
        return _of_lines(f"{one.relative_to(file).as_posix()} {sha256(one)}\n" for one in below)
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def _of_lines(lines: Iterable[str]) -> str:
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def tree_hash(files: Iterable[Path]) -> str:
    """One SHA-256 over names, relative to the project, and contents of the files, in sorted order."""
    return _of_lines(sorted(f"{file.relative_to(ROOT).as_posix()} {sha256(file)}\n" for file in files))


def source_files() -> list[Path]:
    """Everything that results and reports are computed from."""
    found = (file for part in SOURCES for file in (ROOT / part).rglob("*"))
    generated = ROOT / "reports" / "out"
    return sorted(file for file in found if file.suffix in SUFFIXES and not file.is_relative_to(generated))


def lock_hash() -> str | None:
    """The hash of the pinned versions; None where the project was installed without its lock."""
    lock = ROOT / "requirements.lock"
    return sha256(lock) if lock.is_file() else None


def versions() -> dict[str, str]:
    """Versions of Python and of every package that requirements.in names, or the installed project's metadata."""
    named = ROOT / "requirements.in"
    lines = named.read_text(encoding="utf-8").splitlines() if named.is_file() else metadata.requires(PROJECT) or []
    names = [match.group() for line in lines if (match := re.match(r"[\w-]+", line))]
    return {"python": platform.python_version(), **{name: _version(name) for name in names}}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _commit() -> dict[str, Any]:
    """The commit checked out, and whether the sources are as committed; nulls where there is no repository."""

    def git(*words: str) -> str | None:
        try:
            return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout
        except (OSError, subprocess.CalledProcessError):
            return None

    commit, changed = git("rev-parse", "HEAD"), git("status", "--porcelain", "--", *SOURCES)
    return {"commit": commit.strip() if commit else None, "clean": None if changed is None else not changed.strip()}
