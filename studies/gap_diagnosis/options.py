"""Options of gap_diagnosis besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from models.records.tables.formats import LISTED
from studies.options import files, path, paths, quantity, text, texts, whole, wholes
from studies.record_options import RecordOptions

# Of all records together, by default: as many as MAX_MEMORY_BYTES hold of several records, and as the two tables take
# that --write-references writes for a diagnosis. 150,000 took 2.2 GB, and 105,000 of two records 2.3: what the null
# keeps of the effects takes 1.5 kB a sample, and what two threads compute of them at a time the rest.
MOST_SAMPLES: Final = 200_000


def samples_at_most() -> Any:
    """A field: how many samples all records of a diagnosis may have together."""
    return whole(
        "N",
        "of all records together; more are refused, as each takes about 14 kB of memory, and 21 kB of several records "
        f"(default: {MOST_SAMPLES:,}, which take up to 4.2 GB)",
        1,
        default=MOST_SAMPLES,
    )


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions(RecordOptions):
    """The records, how they are read, and which effects are excluded."""

    record: tuple[Path, ...] = paths(
        "RECORD",
        f"{LISTED} files of one machine, one or several. Without any, a simulated table with an "
        "effect that the model lacks is diagnosed, so that the answer can be verified",
        reviewable=True,
    )
    hold_out: tuple[Path, ...] = files(
        "RECORD",
        "a record kept out of every fit, on which it is checked at the end whether the gap shrinks; may be repeated",
        reviewable=True,
    )
    disable: tuple[str, ...] = texts(
        "NAME", "an effect of the catalogue to exclude, such as cogging; may be repeated", reviewable=True
    )
    continue_: Path | None = path(
        "FOLDER",
        "go on from the run that wrote this folder: its machine, records and options, and the new RECORD, such as the "
        "one that its next_experiment.csv asked for. Results go into the same folder unless --output says otherwise. "
        "A name that came up after the first look is said to be unconfirmed until a new record bears it out",
    )
    looked: tuple[int, ...] = wholes(
        "N",
        "that the first N of these records were diagnosed before, and chose what was run next; may be repeated. "
        "--continue gives it: each of these looks is taken again, so that the records since can confirm its names",
        1,
    )
    machine_process: str | None = text(
        "CMD",
        "ask a machine for records until the diagnosis is sure, beginning with the RECORD that there are or, without "
        "any, with the specified motions. CMD is started as CMD --folder FOLDER, writes limits.json (distance_m, "
        "speed_m_per_s, feedforward_N, machine_time_s, records) into FOLDER and, without --machine, nominal.json, and "
        "then runs one table of references for each path on its input; studies/machine_process.py says how to put an "
        "axis behind it. What is asked stays within these limits, and within 6 records",
    )
    seconds: float | None = quantity(
        "s",
        "TIME",
        "of the machine's time that --machine-process takes at most (default: 60 s, or what its limits leave)",
        above=0,
        reviewable=False,
    )
    looks: Path | None = path(
        "FILE",
        "looks.json of a --machine-process run whose records these are: its course is told, and a name that no later "
        "record confirmed is not given",
        reviewable=True,
    )
    draft_effect: Path | None = path(
        "FILE",
        "where a law is learned, as no effect explains the records: write it as a draft of an effect, a file for "
        "models/effects, such as my_law.py",
    )
    most_samples: int = samples_at_most()
