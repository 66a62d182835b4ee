"""A command ends at once, with one line and nothing half-written, when it is interrupted, whatever it is doing.

Python's own handling of SIGINT does not do for a study: compiled code may hold it up for minutes, and some solvers
swallow it. So a command's work is done by a child process, which the kernel ends without asking any handler. Its parent
only waits: it passes on how the child ended or, on a signal, ends the child with all processes that it began, removes
what the child says would be left, and says so.

Imports little, so that hardly any time passes before an interruption is handled.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

INTERRUPTED: Final = 130  # The exit status after SIGINT; after another signal, too, it is 128 and the signal's number.
RETRY_S: Final = 0.05  # s until a child that is putting its files in place is told again
PATIENCE: Final = 20.0  # s for that; then the child is killed
CLEARING: Final = 0.4  # s for processes that clear shared memory up when the child has ended
SCRATCH: Final = b"-"
EMPTY: Final = b"="
GROUP: Final = b"+"
GONE: Final = b"~"

_parent: list[int] = []  # In a supervised child, where it tells its parent what to remove and to end.
_heeded: set[signal.Signals] = set()  # In a supervised child, what ends it.


def supervise() -> None:
    """Goes on in a child process, in which it returns; this one exits as the child does, or when it is interrupted.

    To be called before a command imports anything else. Nothing happens for --help, nor where there is no fork.
    """
    if not hasattr(os, "fork") or not {"-h", "--help"}.isdisjoint(sys.argv[1:]):
        return
    heeded: set[signal.Signals] = {
        number
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP)
        if number == signal.SIGTERM or signal.getsignal(number) != signal.SIG_IGN  # as nohup and a shell's & ask
    }
    alive, told = os.pipe(), os.pipe()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*heeded, signal.SIGCHLD})
    child = os.fork()
    if child == 0:
        os.setsid()  # a group of its own, with all that it begins
        os.close(alive[1])
        os.close(told[0])
        _parent.append(told[1])
        _heeded.update(heeded - {signal.SIGTSTP})
        heed_interruptions()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        end_with(alive[0])
        _keep_trackers_quiet()
        return
    os.close(alive[0])
    os.close(told[1])
    signal.signal(signal.SIGCHLD, lambda *_: None)  # some systems drop a signal that nobody handles, blocked or not
    sys.exit(_wait(child, heeded, told[0]))


def supervised() -> bool:
    """Whether this is the child process of a command, whose only other thread waits for the end of its parent."""
    return bool(_parent)


def heed_interruptions() -> None:
    """From now on, a supervised child can be interrupted."""
    _set(signal.SIG_DFL)


def finish_first() -> None:
    """From now on, a supervised child can't be interrupted: it is putting its results in place, and ends then."""
    _set(signal.SIG_IGN)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """A short block that a supervised child finishes before it heeds an interruption."""
    finish_first()
    try:
        yield
    finally:
        heed_interruptions()


def remove_if_interrupted(scratch: Path, made: Sequence[Path] = ()) -> None:
    """Has the parent of a supervised child remove `scratch` with all in it, and the folders `made` if they are empty,
    when the child is interrupted. To be called before they are there; `made` from the innermost one on.
    """
    for mark, path in [(SCRATCH, scratch), *((EMPTY, one) for one in made)]:
        _tell(mark + os.fsencode(path.absolute()))


@contextmanager
def ended_if_interrupted(group: int) -> Iterator[None]:
    """A block in which another group of processes works for a supervised child and is ended together with it."""
    _tell(GROUP + b"%d" % group)
    try:
        yield
    finally:
        _tell(GONE + b"%d" % group)


def end_with(alive: int) -> None:
    """Ends this process and its group when nobody holds the other end of the pipe `alive` any more, so that they end
    with who began them, even if that was killed.
    """
    import threading

    def watch() -> None:
        os.read(alive, 1)
        while True:
            os.killpg(0, signal.SIGTERM)
            time.sleep(RETRY_S)

    threading.Thread(target=watch, daemon=True).start()


def _tell(line: bytes) -> None:
    if _parent:
        os.write(_parent[0], line + b"\0")


def _set(action: signal.Handlers) -> None:
    for number in _heeded:
        signal.signal(number, action)


def _keep_trackers_quiet() -> None:
    """Processes that clear up shared memory after an interruption do so without a warning."""
    given = os.environ.get("PYTHONWARNINGS", "")
    os.environ["PYTHONWARNINGS"] = ",".join([*filter(None, [given]), "ignore:resource_tracker:UserWarning"])


def _wait(child: int, heeded: set[signal.Signals], told: int) -> int:
    """The exit status: the child's or, after an interruption, the one that stands for the signal."""
    while True:
        number = signal.sigwait({*heeded, signal.SIGCHLD})
        if number == signal.SIGTSTP:
            _pause(child)
        elif number != signal.SIGCHLD:
            return _interrupted(child, _end(child), signal.Signals(number), told)
        else:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return _interrupted(child, status, None, told)


def _pause(child: int) -> None:
    """Stops the child and this process, as Ctrl-Z asks, and has both go on."""
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGSTOP)
        os.kill(os.getpid(), signal.SIGSTOP)
        os.killpg(child, signal.SIGCONT)


def _end(child: int) -> int:
    """Ends the child, once it can be interrupted; its wait status."""
    until = time.monotonic() + PATIENCE
    while True:
        _signal_group(child, signal.SIGTERM if time.monotonic() < until else signal.SIGKILL)
        pause = time.monotonic() + RETRY_S
        while time.monotonic() < pause:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return status
            time.sleep(0.002)


def _signal_group(child: int, number: signal.Signals) -> bool:
    """Whether there was still a process in the child's group to be told."""
    try:
        os.killpg(child, number)
    except (ProcessLookupError, PermissionError):  # it has no group yet, or nothing but what has ended is in it
        return False
    return True


def _interrupted(child: int, status: int, number: signal.Signals | None, told: int) -> int:
    """Clears up after a child that was ended by a signal, and says so; the exit status. `number`: what came here."""
    if os.WIFEXITED(status):
        return os.WEXITSTATUS(status)  # it had put its results in place already
    _end_rest(child)
    _clear(_read(told))
    by = signal.Signals(os.WTERMSIG(status))
    if number is None and by not in {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}:
        why = ", as it is when memory runs out" if by == signal.SIGKILL else ""
        _say(f"error: ended by {by.name}{why}; nothing was written")
        return 128 + by
    _say("interrupted")
    return 128 + (number or by)


def _end_rest(child: int) -> None:
    """Ends what is left of the child's group; what clears up shared memory ignores SIGTERM, and gets a moment."""
    until = time.monotonic() + CLEARING
    while _signal_group(child, signal.SIGTERM) and time.monotonic() < until:
        time.sleep(0.01)
    _signal_group(child, signal.SIGKILL)


def _read(told: int) -> list[bytes]:
    """The lines that the child told."""
    os.set_blocking(told, False)
    text = b""
    with suppress(BlockingIOError):
        while part := os.read(told, 1 << 16):
            text += part
    return text.split(b"\0")[:-1]


def _clear(lines: Sequence[bytes]) -> None:
    """Ends the groups and removes the files that the child said would be left."""
    import shutil
    from pathlib import Path

    for line in lines:
        if line[:1] == GROUP and GONE + line[1:] not in lines:
            with suppress(ProcessLookupError):
                os.killpg(int(line[1:]), signal.SIGKILL)
    for line in lines:
        path = Path(os.fsdecode(line[1:]))
        if line[:1] == SCRATCH:
            shutil.rmtree(path, ignore_errors=True)
        elif line[:1] == EMPTY:
            with suppress(OSError):
                path.rmdir()


def _say(text: str) -> None:
    with suppress(OSError):  # a terminal that was closed
        print(text, file=sys.stderr, flush=True)
