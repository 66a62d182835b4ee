"""Options of identify_machine besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from models.identification import MOST_MODES
from models.records.kinds import KINDS
from models.records.tables.formats import LISTED
from models.records.tables.sizes import LIMITS
from studies.options import flag, path, paths, quantity, text, whole
from studies.record_options import RecordOptions


@dataclass(frozen=True, kw_only=True)
class IdentificationOptions(RecordOptions):
    """The records and how they are read."""

    record: tuple[Path, ...] = paths(
        "RECORD",
        f"{LISTED}, each with {LIMITS.samples:,} samples at most (decimate or cut others). "
        "The kind of each is recognised. Without any, records of simulated tables are identified, to verify the stated "
        "uncertainties (round trip)",
        reviewable=True,
    )
    kinds: str | None = text(
        "KIND,...",
        f"the kinds of the records, in their order, instead of recognising them: auto, {', '.join(KINDS)}",
        reviewable=True,
    )
    pass_band: float | None = quantity(
        "Hz",
        "FREQUENCY",
        'of the low-pass for friction, such as "40 Hz" (default: 80 times the frequency of its loops, or 5.8 times '
        "that of a fast motion)",
        above=0,
    )
    modes: int | None = whole(
        "N",
        "vibration modes of a frequency response, whatever it shows (default: the fewest that pass)",
        0,
        MOST_MODES,
    )
    rolling: bool = flag(
        "frequency responses given as files were measured while the axis rolled in one direction, so that friction "
        "bends none of their lines",
    )
    write_references: Path | None = path(
        "FOLDER",
        "write what to run on this machine, as references (CSV): slow loops, a sweep at two levels, strokes and a "
        "suite for a diagnosis; nothing is identified",
    )
    tables: int = whole(
        "N", "simulated tables of the round trip, at least 1 (default: 50; 3 with --quick)", 1, default=50
    )
