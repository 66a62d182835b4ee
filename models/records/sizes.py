"""How large a record may be, so that a file of any content is read in 2 GB of memory or refused in seconds."""

from __future__ import annotations

from dataclasses import dataclass
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
    variables and fields in a MAT file, of which each takes some effort, however small it is. depth: of structures
    within structures. remedy: what to do with more samples.
    """

    samples: int = 7_000_000
    numbers: int = 100_000_000
    text: int = 2_000_000_000
    line: int = 1_000_000
    columns: int = 1_000
    depth: int = 16
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
                f"holds more than {self.columns:,} columns, the most that is read; leave out those that are not needed"
            )


LIMITS: Final = Limits()
