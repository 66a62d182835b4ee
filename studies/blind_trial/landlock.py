"""Closes files to this process in the kernel, by Linux's Landlock: to machine code and to started programs as well.

Landlock only grants. So everything is granted except the closed files and the folders above them, of which what else
they hold is granted, and nothing can be moved out of them. A closed file therefore stays closed under another name: by
a link, or relative to an open folder. The kernel also keeps the process from reading the memory of those that are not
restricted. What has a hard link or a copy elsewhere already is open there. Imports only the standard library, as
`guard` does.
"""

from __future__ import annotations

import ctypes
import os
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

# linux/landlock.h and linux/prctl.h; the numbers of these system calls are the same on every architecture.
CREATE_RULESET: Final = 444
ADD_RULE: Final = 445
RESTRICT_SELF: Final = 446
ASK_VERSION: Final = 1
PATH_BENEATH: Final = 1
READ_FILE: Final = 1 << 2
REMOVE: Final = 0b11 << 4  # files and folders
TCP: Final = 0b11  # to bind and to connect
SCOPES: Final = 0b11  # abstract sockets and signals of processes that are not restricted
NO_NEW_PRIVILEGES: Final = 38


class _Ruleset(ctypes.Structure):
    """What a set of rules forbids where no rule grants it."""

    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scopes", ctypes.c_uint64))


class _Beneath(ctypes.Structure):
    """Grants rights to everything below a folder, or to a file."""

    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("rights", ctypes.c_uint64), ("folder", ctypes.c_int32))


def version() -> int:
    """The version of the kernel's Landlock; 0 where there is none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(_call(CREATE_RULESET, None, 0, ASK_VERSION), 0)


def close(files: Sequence[str]) -> bool:
    """Closes these files and folders, given by their real paths, to this process and all that it starts, irrevocably,
    with the network; False, and nothing done, where the kernel has no Landlock.
    """
    known = version()
    if known == 0:
        return False
    forbids = _Ruleset(READ_FILE | REMOVE, TCP if known >= 4 else 0, SCOPES if known >= 6 else 0)
    rules = _call(CREATE_RULESET, ctypes.byref(forbids), ctypes.sizeof(forbids), 0)
    if rules < 0:
        return False
    try:
        for path in granted(files):
            with suppress(OSError):  # it has gone
                _grant(rules, path)
        libc = ctypes.CDLL(None, use_errno=True)
        return libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0 and _call(RESTRICT_SELF, rules, 0) == 0
    finally:
        os.close(rules)


def granted(closed: Sequence[str]) -> Iterator[str]:
    """What lies beside closed files or folders, or beside those that hold them: everything else lies below it. Another
    name of a closed file beside it is not granted either."""
    shut = {Path(one) for one in closed}
    same = {(one.stat().st_dev, one.stat().st_ino) for one in shut if one.exists()}
    for folder in {above for one in shut for above in one.parents}:
        if shut & {folder, *folder.parents}:
            continue
        with suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                path = Path(entry.path)
                if entry.is_symlink() or path in shut or any(path in one.parents for one in shut):
                    continue
                about = entry.stat(follow_symlinks=False)
                if (about.st_dev, about.st_ino) not in same:
                    yield entry.path


def _grant(rules: int, path: str) -> None:
    place = os.open(path, os.O_PATH | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        rule = _Beneath(READ_FILE | (REMOVE if stat.S_ISDIR(os.fstat(place).st_mode) else 0), place)
        _call(ADD_RULE, rules, PATH_BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(place)


def _call(number: int, *arguments: object) -> int:
    """The result of a system call; -1 where it fails."""
    return int(ctypes.CDLL(None, use_errno=True).syscall(ctypes.c_long(number), *arguments))
