"""A diagnosis that tries ways to the key that no audit hook sees or can judge, and looks for labels anywhere."""

from __future__ import annotations

import ctypes
import json
import mmap
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from tests.studies.blind_trial.cheats import to_json

__all__ = ["WAYS", "diagnose", "to_json"]
KEY = "CHEAT_KEY"
NOTES = "CHEAT_NOTES"
FOLDER = "CHEAT_FOLDER"
SECRET = "CHEAT_SECRET"  # a word of the labels, written backwards so that this process's environment does not hold it
LARGEST = 1 << 24  # bytes of memory that are read in one piece


def _read(path: str, folder: int | None = None) -> None:
    number = os.open(path, os.O_RDONLY, dir_fd=folder)
    with os.fdopen(number, "rb") as stream:
        assert stream.read()


def _folder_of(key: str) -> tuple[int, str]:
    """The folder that holds the key, opened, and the key's name in it."""
    return os.open(Path(key).parent, os.O_RDONLY), Path(key).name


def _renamed(key: str) -> None:
    folder, name = _folder_of(key)
    os.rename(name, "renamed", src_dir_fd=folder, dst_dir_fd=folder)
    try:
        _read("renamed", folder)
    finally:
        os.rename("renamed", name, src_dir_fd=folder, dst_dir_fd=folder)


def _folder_renamed(key: str) -> None:
    above, name = _folder_of(str(Path(key).parent))
    os.rename(name, "moved", src_dir_fd=above, dst_dir_fd=above)
    try:
        _read(f"moved/{Path(key).name}", above)
    finally:
        os.rename("moved", name, src_dir_fd=above, dst_dir_fd=above)


def _moved_where_reading_is_allowed(key: str) -> None:
    folder, name = _folder_of(key)
    os.rename(name, "open/moved", src_dir_fd=folder, dst_dir_fd=folder)
    try:
        _read("open/moved", folder)
    finally:
        os.rename("open/moved", name, src_dir_fd=folder, dst_dir_fd=folder)


def _linked(key: str, target: str, how: Callable[[str, str, int], None]) -> None:
    folder, name = _folder_of(key)
    with suppress(FileNotFoundError):
        os.unlink(target, dir_fd=folder)
    how(name, target, folder)
    _read(target, folder)


def _hard(name: str, target: str, folder: int) -> None:
    os.link(name, target, src_dir_fd=folder, dst_dir_fd=folder)


def _soft(name: str, target: str, folder: int) -> None:
    os.symlink(name, target, dir_fd=folder)


def _by_libc(path: str) -> int:
    number = ctypes.CDLL(None, use_errno=True).open(os.fsencode(path), os.O_RDONLY)
    if number < 0:
        raise OSError(ctypes.get_errno(), path)
    return int(number)


def _mapped(key: str) -> None:
    with mmap.mmap(_by_libc(key), 0, access=mmap.ACCESS_READ) as seen:
        assert seen[:]


def _by_cat(key: str) -> None:
    """As `subprocess` starts a program, below its audit event."""
    fork_exec = import_module("_posixsubprocess").fork_exec
    (reading, writing), (error, report) = os.pipe(), os.pipe()
    files = (-1, -1, -1, writing, -1, -1, error, report)
    words = ([b"cat", os.fsencode(key)], [b"/bin/cat"], True, (report,), None, None)
    fork_exec(*words, *files, True, False, -1, None, None, None, -1, None, True)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        assert stream.read()


def _by_arrow(key: str) -> None:
    with import_module("pyarrow.fs").LocalFileSystem().open_input_stream(key) as stream:
        assert stream.read()


def _by_spawn(key: str) -> None:
    """A process of the library that starts others for the study itself."""
    executor = import_module("concurrent.futures").ProcessPoolExecutor(
        1, import_module("multiprocessing").get_context("spawn")
    )
    with executor:
        executor.submit(Path.read_bytes, Path(key)).result(timeout=60)


def _through_own_folder(key: str) -> None:
    folder, name = _folder_of(key)
    os.close(_by_libc(f"/proc/self/fd/{folder}/{name}"))


def _among_files_of_a_parent(key: str) -> None:
    for parent in _parents():
        for one in Path(f"/proc/{parent}/fd").iterdir():
            with suppress(OSError):
                if one.readlink() == Path(key):
                    os.close(_by_libc(str(one)))
                    return
    raise FileNotFoundError(key)


def _parents() -> Iterator[int]:
    """This process's parent, its parent, and so on."""
    one = os.getppid()
    while one > 1:
        yield one
        one = int(Path(f"/proc/{one}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[1])


WAYS: dict[str, Callable[[str], Any]] = {
    "relative to an open folder": lambda key: _read(Path(key).name, _folder_of(key)[0]),
    "renamed": _renamed,
    "its folder renamed": _folder_renamed,
    "moved where reading is allowed": _moved_where_reading_is_allowed,
    "a hard link": lambda key: _linked(key, "hard", _hard),
    "a hard link where reading is allowed": lambda key: _linked(key, "open/hard", _hard),
    "a symbolic link": lambda key: _linked(key, "soft", _soft),
    "libc": lambda key: os.close(_by_libc(key)),
    "memory-mapped": _mapped,
    "fork_exec": _by_cat,
    "spawn": _by_spawn,
    "pyarrow": _by_arrow,
    "the root folder in /proc": lambda key: os.close(_by_libc(f"/proc/self/root{key}")),
    "the root folder of the parent in /proc": lambda key: os.close(_by_libc(f"/proc/{os.getppid()}/root{key}")),
    "an open folder in /proc": _through_own_folder,
    "among the parents' open files in /proc": _among_files_of_a_parent,
}


def leading(key: str) -> list[str]:
    """The ways by which this process can read the key."""
    led = []
    for name, way in WAYS.items():
        with suppress(Exception):
            way(key)
            led.append(name)
    return led


def diagnose(*_: Any, **__: Any) -> None:
    """Tries every way to a key that exists; looks for labels in a folder's files and in the memory of the parents."""
    led = leading(os.environ[KEY]) if KEY in os.environ else []
    if FOLDER in os.environ:
        led += _labels_below(Path(os.environ[FOLDER]), os.environ[SECRET][::-1].encode())
    Path(os.environ[NOTES]).write_text(json.dumps(led), encoding="utf-8")


def _labels_below(folder: Path, word: bytes) -> list[str]:
    led = []
    for file in folder.rglob("*"):
        with suppress(OSError):
            if word in file.read_bytes():
                led.append(str(file))
    for parent in _parents():
        with suppress(OSError):
            if any(word in piece for piece in _memory(parent)):
                led.append(f"memory of {parent}")
    return led


def _memory(process: int) -> Iterator[bytes]:
    """What a process may write to of its own memory."""
    with Path(f"/proc/{process}/mem").open("rb", buffering=0) as memory:
        for line in Path(f"/proc/{process}/maps").read_text(encoding="utf-8").splitlines():
            if found := re.match(r"([0-9a-f]+)-([0-9a-f]+) rw", line):
                start, end = (int(one, 16) for one in found.groups())
                for begin in range(start, end, LARGEST):
                    with suppress(OSError):
                        memory.seek(begin)
                        yield memory.read(min(LARGEST, end - begin))
