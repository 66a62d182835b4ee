"""Options of gap_diagnosis besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import Options, paths, texts


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions(Options):
    """The records, how they are read, and which effects are excluded."""

    record: tuple[Path, ...] = paths(
        "RECORD",
        ".csv, .csv.gz, .mat or .parquet files of one machine, one or several. Without any, a simulated table with an "
        "effect that the model lacks is diagnosed, so that the answer can be verified",
        reviewable=True,
    )
    disable: tuple[str, ...] = texts(
        "NAME", "an effect of the catalogue to exclude, such as cogging; may be repeated", reviewable=True
    )
    column: tuple[str, ...] = texts(
        "SIGNAL=ENTRY",
        'what the files call a signal, such as "position=qm [mm]" or "command=vir [V] * 35.2 N/V"; may be repeated '
        "(default: the machine file's [record], else time_s, command_N, position_m, ...)",
        reviewable=True,
    )
