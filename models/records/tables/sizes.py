"""How large a record may be, so that a file of any content is read in 2 GB of memory or refused in seconds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CHUNK: Final = 1 << 20  # bytes that are read or expanded at a time
WAY_OUT: Final = "cut it into shorter records, or low-pass and decimate it"


class RecordError(ValueError):
    """A record that can't be used; the message is one sentence: what, where, what to do."""


@dataclass(frozen=True)
class Limits:
    """What a file may hold; counts, and bytes after decompression [1].

    samples: 10 minutes at 10 kHz and a sixth more, which with all checks take less than 2 GB. numbers: of all columns
    together, 0.8 GB as they are held. text: of a CSV, that many samples of 14 columns of 20 characters. line: of a CSV,
    a thousand columns with long names (a line that ends within a chunk may be longer). columns: of a table, and of
    variables and fields in a MAT file, of which each takes some effort, however small it is. memory: by which the
    process may grow while a MAT or Parquet file is read: all numbers as they are held, and once more in the file's own
    type. remedy: what to do with more samples.
    """

    samples: int = 7_000_000
    numbers: int = 100_000_000
    text: int = 2_000_000_000
    line: int = 1_000_000
    columns: int = 1_000
    memory: int = 1_600_000_000
    remedy: str = WAY_OUT

    def check_samples(self, count: int, what: str = "samples") -> None:
        """Raises RecordError for a file with more samples."""
        if count > self.samples:
            raise RecordError(f"holds more than {self.samples:,} {what}, the most that is read; {self.remedy}")

    def check_numbers(self, count: int) -> None:
        """Raises RecordError for a file with more numbers."""
        if count > self.numbers:
            raise RecordError(
                f"holds more than {self.numbers:,} numbers in all its columns, the most that is read; leave out "
                f"columns that are not needed, {WAY_OUT}"
            )

    def check_text(self, count: int) -> None:
        """Raises RecordError for a file of more text."""
        if count > self.text:
            raise RecordError(
                f"holds more than {self.text / 1e9:g} GB of text, the most that is read; write fewer columns or "
                f"digits, {WAY_OUT}"
            )

    def check_columns(self, count: int) -> None:
        """Raises RecordError for a file with more columns."""
        if count > self.columns:
            raise RecordError(
                f"holds more than {self.columns:,} columns or fields, the most that is read; leave some out"
            )


LIMITS: Final = Limits()


@contextmanager
def bounded_memory(limits: Limits) -> Iterator[None]:
    """Within, this process can't grow by more than `limits.memory`. Raises RecordError where that was not enough.

    The bound is on the address space of the whole process, so a record is read before other threads start their work.
    It holds on Linux, which says how large the process is; elsewhere only the counts that a file states are checked.
    """
    held = Path("/proc/self/statm")
    if not held.exists():
        yield
        return
    import resource  # noqa: PLC0415 (Windows has no such module)

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = int(held.read_text().split()[0]) * resource.getpagesize() + limits.memory
    resource.setrlimit(resource.RLIMIT_AS, (most if soft == resource.RLIM_INFINITY else min(most, soft), hard))
    try:
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    except (MemoryError, OSError) as error:
        if isinstance(error, MemoryError) or "alloc" in str(error):  # h5py has no error of its own for this
            raise RecordError(
                f"expands to more than {limits.memory / 1e9:g} GB in memory, the most that is read; leave out columns "
                f"that are not needed, {WAY_OUT}"
            ) from error
        raise
