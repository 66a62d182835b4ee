"""The folder that a study writes into: what in it may be replaced, and that it is replaced in one piece.

Only files of an earlier run of the same study make way: those that its manifest lists, as long as they are as that run
wrote them. Whatever else stands where the study writes is somebody's work, and is replaced only by `--overwrite`.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from studies.interrupt import finish_first, remove_if_interrupted, uninterrupted
from studies.manifest import FORMAT, sha256
from studies.options import BadInputError

EVERY: Final = (
    "manifest.json",
    "results.json",
    "machine.toml",
    "given_controller.json",
    "report.html",
    "report.pdf",
    "figures/*.svg",
)
"""What every study may write."""
FULL: Final = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
# With fewer bytes of free space than this, what a program that was started reports as its own failure is a full disk.
FULL_DISK_BYTES: Final = 1 << 16
HASH: Final = re.compile(r"[0-9a-f]{64}")
MAX_MANIFEST_BYTES: Final = 1 << 24  # bytes of a manifest


@dataclass(frozen=True)
class Place:
    """A folder that a study writes into.

    study: its name; writes: patterns of all names, relative to the folder, that it may write; keeps: those that it
    writes while it works and goes on from when it is run again; overwrite: whether other people's files make way.
    """

    folder: Path
    study: str
    writes: tuple[str, ...] = EVERY
    keeps: tuple[str, ...] = ()
    overwrite: bool = False


def require_writable(output: Path) -> None:
    """Raises BadInputError, before any work, for a folder that can't be written."""
    existing = next(place for place in (output, *output.absolute().parents) if place.exists())
    if not existing.is_dir():
        raise BadInputError(f"--output {output}: {existing} is a file; give a folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise BadInputError(f"--output {output}: {existing} can't be written to; give another folder")


def require_free(place: Place) -> None:
    """Raises BadInputError, before any work, where the study would have to replace what is not its own."""
    require_writable(place.folder)
    _refuse(place, (name for pattern in place.writes for name in _matching(place.folder, pattern)))


@contextmanager
def atomic_folder(place: Place) -> Iterator[Path]:
    """A folder whose files are put into the place when the block ends, and which vanishes when it fails.

    Files of an earlier run, and only those, make way; if anything fails, they are put back. Raises BadInputError where
    the disk is full or somebody else's file is in the way.
    """
    output = place.folder
    made = [one for one in (output, *output.absolute().parents) if not one.exists()]
    folder = output / f".writing-{os.urandom(8).hex()}"
    remove_if_interrupted(folder, made)
    try:
        output.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700)
    except OSError as error:
        raise BadInputError(
            f"--output {output}: can't be written to ({error.strerror}); give another folder"
        ) from error
    try:
        yield folder
        names = [file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()]
        _refuse(place, names)
        old = earlier(place)
        finish_first()
        _put(folder, output, old, names)
    except BadInputError:
        raise
    except Exception as error:
        if is_full(error) or shutil.disk_usage(output).free < FULL_DISK_BYTES:
            raise BadInputError(
                f"--output {output}: the disk is full, nothing was written; make room, or give another folder"
            ) from error
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):  # they hold something, as they should
            for one in made:
                one.rmdir()


def write_at_once(file: Path, text: str) -> None:
    """Puts the text in place in one step: whenever this is killed, the file holds what it held or the text."""
    with uninterrupted():
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{file.stem}-", dir=file.parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            Path(name).chmod(0o666 & ~_umask())
            Path(name).replace(file)
        finally:
            Path(name).unlink(missing_ok=True)


def _umask() -> int:
    """The permissions that files of this process are not given; there is no way to read it but to set it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def is_full(error: BaseException | None) -> bool:
    """Whether an error, or what led to it, is that nothing more can be written."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL:
            return True
        error = error.__cause__ or error.__context__
    return False


def earlier(place: Place) -> frozenset[str]:
    """The files in the place that an earlier run of the study wrote and nobody has changed since, its manifest too."""
    if not _regular(place.folder, "manifest.json"):
        return frozenset()
    listed = _listed(place.folder / "manifest.json", place.study)
    same = {
        name
        for name, expected in listed.items()
        if any(PurePosixPath(name).match(pattern) for pattern in place.writes)
        and _regular(place.folder, name)
        and sha256(place.folder / name) == expected
    }
    return frozenset({*same, "manifest.json"} if same else ())


def _listed(file: Path, study: str) -> dict[str, str]:
    """The outputs with their hashes in a manifest that the study wrote; nothing in any other."""
    try:
        if file.stat().st_size > MAX_MANIFEST_BYTES:
            return {}
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(content, dict) or content.get("study") != study or not _of_a_run(content):
        return {}
    return {
        name: expected
        for name, expected in content["outputs"].items()
        if isinstance(expected, str) and HASH.fullmatch(expected) and is_inside(name)
    }


def _of_a_run(content: dict[str, Any]) -> bool:
    """Whether it has the form of a run's manifest; those of earlier versions lack the mark of the format."""
    parts = (content.get(key) for key in ("outputs", "inputs", "options", "versions"))
    return content.get("format", FORMAT) == FORMAT and all(isinstance(part, dict) for part in parts)


def is_inside(name: str) -> bool:
    """Whether this is the plain relative name, with forward slashes, of a file in a folder or below it."""
    parts = name.split("/")
    return name.isprintable() and "\\" not in name and all(part not in {"", ".", ".."} for part in parts)


def _regular(folder: Path, name: str) -> bool:
    """Whether this is a file, reached from the folder without any link."""
    *above, last = name.split("/")
    here = folder
    try:
        for part in above:
            here /= part
            if not stat.S_ISDIR(here.lstat().st_mode):
                return False
        return stat.S_ISREG((here / last).lstat().st_mode)
    except OSError:
        return False


def _matching(folder: Path, pattern: str) -> Iterator[str]:
    """What exists in the folder under a name that the pattern matches; a parent that is not a folder stands for it."""
    above, _, last = pattern.rpartition("/")
    here = folder / above
    if above and os.path.lexists(here) and (here.is_symlink() or not here.is_dir()):
        yield above
    elif "*" in last:
        yield from (one.relative_to(folder).as_posix() for one in sorted(here.glob(last)))
    elif os.path.lexists(here / last):
        yield pattern


def _refuse(place: Place, names: Iterable[str]) -> None:
    """Raises BadInputError where one of these names is taken by what the study must not replace."""
    own = earlier(place)
    taken = []
    for name in dict.fromkeys(names):
        above = next(_matching(place.folder, name), None)
        if above is None or name in own or (name in place.keeps and _regular(place.folder, name)):
            continue
        whole = place.folder / above
        if not (place.overwrite and above == name and (whole.is_file() or whole.is_symlink())):
            taken.append(above)
    if taken:
        more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
        end = "" if place.overwrite else ", or --overwrite to replace it"
        raise BadInputError(
            f"--output {place.folder}: {taken[0]}{more} in it was not written by {place.study}, or was edited since; "
            f"give another folder{end}"
        )


def _put(folder: Path, output: Path, old: Iterable[str], new: Iterable[str]) -> None:
    """Moves the new files into place of the old ones: all of them or, where anything fails, none.

    The manifest goes first and comes last, so that files of two runs are never taken for those of one.
    """
    new = sorted(new, key=lambda name: (name == "manifest.json", name))
    aside = Path(tempfile.mkdtemp(prefix=".earlier-", dir=output))
    done: list[tuple[Path, Path]] = []

    def move(before: Path, after: Path) -> None:
        after.parent.mkdir(parents=True, exist_ok=True)
        before.rename(after)
        done.append((before, after))

    try:
        for name in sorted({*old, *new}, key=lambda name: (name != "manifest.json", name)):
            if os.path.lexists(output / name):
                move(output / name, aside / name)
        for name in new:
            move(folder / name, output / name)
    except BaseException:
        for before, after in reversed(done):
            after.rename(before)
        raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)
