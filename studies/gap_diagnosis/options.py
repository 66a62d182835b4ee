"""What gap_diagnosis can be asked beyond what all studies are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from studies.options import Options, paths, texts


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions(Options):
    """The records, how they are read, and which effects are not to be used."""

    record: tuple[Path, ...] = paths(
        "RECORD",
        ".csv, .csv.gz, .mat or .parquet files of one machine, one or several. Without any, a simulated table with an "
        "effect that the model lacks is diagnosed, so that the answer can be judged",
    )
    disable: tuple[str, ...] = texts(
        "NAME", "an effect of the catalogue that is not to be used, such as cogging; may be repeated"
    )
    column: tuple[str, ...] = texts(
        "SIGNAL=ENTRY",
        'how the files call a signal, such as "position=qm [mm]" or "command=vir [V] * 35.2 N/V"; may be repeated '
        "(default: the machine file's [record], else time_s, command_N, position_m, ...)",
    )
