"""Options of full_circle besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.gap_diagnosis.options import samples_at_most
from studies.options import path, texts, whole
from studies.record_options import RecordOptions


@dataclass(frozen=True, kw_only=True)
class CircleOptions(RecordOptions):
    """A folder of records of one's own axis, or how many withheld machines."""

    records: Path | None = path(
        "FOLDER",
        "records of the axis of --machine: frequency responses, slow loops and excitations are identified from, all "
        "others are diagnosed. What is to be run next is written into --output; put its record into FOLDER and run "
        "the same command again: what has not changed is not computed again",
    )
    disable: tuple[str, ...] = texts("NAME", "an effect of the catalogue to exclude, such as cogging; may be repeated")
    cases: int | None = whole(
        "N",
        "without --records: number of withheld machines, one case on each (default: 4; 1 with --quick). A run that was "
        "interrupted goes on where it stopped",
        1,
    )
    most_samples: int = samples_at_most()
