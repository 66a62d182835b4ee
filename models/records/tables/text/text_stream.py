"""Text files, plain or compressed by gzip, in any usual encoding, in chunks of whole lines and bounded memory."""

from __future__ import annotations

import codecs
import gzip
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, cast

from models.records.tables.sizes import CHUNK, Limits, RecordError

_MARKS: Final = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
ENCODING_NAMES: Final = {
    "latin-1": "ASCII",
    "utf-8-sig": "UTF-8 with a byte order mark",
    "utf-16": "UTF-16",
    "utf-16-le": "UTF-16, little-endian",
    "utf-16-be": "UTF-16, big-endian",
    "cp1252": "Windows-1252",
    "utf-8": "UTF-8",
}


@dataclass(frozen=True)
class TextFile:
    """A text file, the encoding that its first chunk shows, and its number of lines."""

    path: Path
    encoding: str
    lines: int

    def head(self) -> list[str]:
        """The whole lines of the first chunk."""
        return next(iter(self.blocks()), "").rstrip("\n").split("\n")

    def blocks(self) -> Iterator[str]:
        """Text of whole lines that end in "\\n"; an unfinished last line is given without an end."""
        begun = ""
        for text in _decoded(self.path, self.encoding):
            head, end, rest = text.rpartition("\n")
            if end:
                yield begun + head + end
                begun = rest
            else:
                begun += rest
        if begun:
            yield begun


def text_file(path: Path, limits: Limits) -> TextFile:
    """The file, whose lines are counted. Raises RecordError as soon as they are too many or too long."""
    with _opened(path) as file:
        encoding = _encoding(file.read(CHUNK))
    size = lines = begun = 0
    for text in _decoded(path, encoding):
        ends = text.find("\n")
        if begun + (ends if ends >= 0 else len(text)) > limits.line:
            raise RecordError(
                f"line {lines + 1} has more than {limits.line:,} characters; give text with one line a sample"
            )
        size, lines = size + len(text), lines + text.count("\n")
        begun = len(text) - text.rfind("\n") - 1 if ends >= 0 else begun + len(text)
        limits.check_samples(lines - 1, "samples, a line each")
        limits.check_text(size)
    return TextFile(path, encoding, lines + (begun > 0))


def _opened(path: Path) -> IO[bytes]:
    return cast("IO[bytes]", gzip.open(path, "rb")) if path.suffix.lower() == ".gz" else path.open("rb")


def _decoded(path: Path, encoding: str) -> Iterator[str]:
    """The text in chunks, with "\\n" at the end of each line. Raises RecordError for bytes that do not decode."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)(), translate=True)
    with _opened(path) as file:
        try:
            while block := file.read(CHUNK):
                yield decoder.decode(block)
            yield decoder.decode(b"", final=True)
        except UnicodeDecodeError as error:
            raise RecordError(
                f"is {ENCODING_NAMES[encoding]} at its beginning, and is not later on; save it as UTF-8"
            ) from error


def _encoding(head: bytes) -> str:
    """The encoding that a mark states, or in which the first chunk is text; bytes below 128 alone are read as Latin-1,
    in which any later byte is a character."""
    for mark, encoding in _MARKS:
        if head.startswith(mark):
            return encoding
    if len(head) > 3:  # in UTF-16, every second byte of digits and letters is zero
        even, odd = head[0::2].count(0) / len(head[0::2]), head[1::2].count(0) / len(head[1::2])
        if max(even, odd) > 0.8 and min(even, odd) < 0.2:
            return "utf-16-be" if even > odd else "utf-16-le"
    if head.isascii():
        return "latin-1"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252" if not set(head) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"
    return "utf-8"
