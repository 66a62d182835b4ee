"""A stranger's folder, copied: plain files only, bounded in number and size, no link followed.

Everything that is reviewed is the copy, so that nothing can be exchanged between a check and its use.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection
from pathlib import Path
from typing import Final

from studies.folder import is_inside
from studies.options import BadInputError

FILES: Final = 2000
DEPTH: Final = 4  # folders within folders
FILE_SIZE: Final = 64 << 20  # bytes; the largest file that a study writes has a few of them
WHOLE_SIZE: Final = 512 << 20  # bytes
CHUNK_BYTES: Final = 1 << 20  # bytes
KINDS: Final = (
    (stat.S_ISLNK, "a link"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def visible(text: object, longest: int = 100) -> str:
    """A stranger's text on one line of a terminal: control characters escaped, the rest cut."""
    plain = "".join(one if one.isprintable() else ascii(one)[1:-1] for one in str(text)[: 2 * longest])
    return plain if len(plain) <= longest else plain[: longest - 3] + "..."


def copied(folder: Path, place: Path, without: Collection[str] = ()) -> frozenset[str]:
    """Copies the files of a folder, by names relative to it, to `place`, and returns the names.

    without: names of folders at the top that are left out; they are among the names with a slash at the end. Raises
    BadInputError for what a study would not have written: links, pipes, devices and sockets, and more or larger files
    than any study writes.
    """
    try:
        top = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise BadInputError(f"{folder}: can't be read ({error.strerror}); give a folder that a study wrote") from error
    place.mkdir(parents=True, exist_ok=True)
    copy = _Copy(folder, place, frozenset(without))
    try:
        copy.walk(top, "", 0)
    except OSError as error:
        name = visible(error.filename or "a file in it")
        raise BadInputError(f"{folder}: {name} can't be read ({error.strerror}); make it readable") from error
    finally:
        os.close(top)
    return frozenset(copy.names)


class _Copy:
    """A walk through a folder by descriptors: no name is looked up twice."""

    def __init__(self, folder: Path, place: Path, without: frozenset[str]) -> None:
        self._folder, self._place, self._without = folder, place, without
        self._left = WHOLE_SIZE
        self.names: list[str] = []

    def walk(self, descriptor: int, above: str, depth: int) -> None:
        """Copies what lies in the folder of this descriptor, which has the name `above`."""
        if depth > DEPTH:
            raise self._refused(above, "lies too deep")
        with os.scandir(descriptor) as entries:
            for entry in entries:
                name = f"{above}/{entry.name}" if above else entry.name
                mode = entry.stat(follow_symlinks=False).st_mode
                for is_kind, said in KINDS:
                    if is_kind(mode):
                        raise self._refused(name, f"is {said}")
                if not is_inside(name):
                    raise self._refused(name, "has a name that no study gives")
                if stat.S_ISDIR(mode):
                    if name in self._without:
                        self.names.append(f"{name}/")
                    else:
                        self._enter(descriptor, entry.name, name, depth)
                else:
                    self._take(descriptor, entry.name, name)

    def _enter(self, descriptor: int, last: str, name: str, depth: int) -> None:
        inner = os.open(last, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=descriptor)
        try:
            self.walk(inner, name, depth + 1)
        finally:
            os.close(inner)

    def _take(self, descriptor: int, last: str, name: str) -> None:
        """Copies one file; O_NONBLOCK, as what was a file a moment ago may be a pipe now."""
        inner = os.open(last, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=descriptor)
        with os.fdopen(inner, "rb") as source:
            if not stat.S_ISREG(os.fstat(inner).st_mode):
                raise self._refused(name, "is not a plain file")
            if len(self.names) >= FILES:
                raise BadInputError(f"{self._folder}: holds more than {FILES} files; no study writes so many")
            target, size = self._place / name, 0
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("wb") as copy:
                while part := source.read(CHUNK_BYTES):
                    size += len(part)
                    if size > min(FILE_SIZE, self._left):
                        raise self._refused(
                            name, f"is too large (a file may have {FILE_SIZE >> 20} MB, all {WHOLE_SIZE >> 20} MB)"
                        )
                    copy.write(part)
            self._left -= size
            self.names.append(name)

    def _refused(self, name: str, what: str) -> BadInputError:
        return BadInputError(
            f"{self._folder}: {visible(name)} {what}, which no study writes; give a folder as a study wrote it"
        )
