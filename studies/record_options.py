"""Options of the studies that read records, the same in each: how the files call their signals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from models.records.recipes.mapping_file import describe, recipes
from studies.options import Options, flag, known_text, path, texts

RECIPES = "; ".join(f"{name}: {describe(name)}" for name in recipes())


@dataclass(frozen=True, kw_only=True)
class RecordOptions(Options):
    """How records are read."""

    trust_records: bool = flag(
        "use records whose columns, units or jumps look wrong for this machine; the report says what looks wrong"
    )
    column: tuple[str, ...] = texts(
        "[FILES:]SIGNAL=ENTRY",
        "what the files call a signal (time; command: the whole thrust asked for; position: the reading; reference: "
        "what the feedback follows; error: the following error, of a log without a reference; target: where a motion "
        "ends; feedforward: what is added to the feedback), such as "
        '"position=qm [mm]" or "command=vir [V] * 35.2 N/V"; counts, currents '
        'and sample counters by their factors, as "position=xist * 5 nm", "command=current * 31.5 N/A", '
        '"time=sample * 250 us", and "time=row * 250 us" for the count of the rows; without a unit, that of the header '
        "counts, else SI; for some of them, "
        '"sweep*.csv:position=x [mm]"; an empty ENTRY takes back what a recipe or mapping says; may be repeated '
        "(default: the machine file's [record], else time_s, command_N, position_m, ...)",
        reviewable=True,
    )
    mapping: Path | None = path(
        "FILE",
        'TOML with such entries for each record, in tables [[record]] with files = "sweep*.csv" (a pattern or a list). '
        "For each signal the entry with the most specific pattern counts; where several are as specific, that of "
        "--column, then of FILE, of --recipe, of the machine file",
        reviewable=True,
    )
    recipe: str | None = known_text(
        f"how usual logs call their signals. {RECIPES}. Each is a file models/records/recipes/NAME.toml, of which a "
        "changed copy can be given as --mapping",
        tuple(recipes()),
        "a file of your own is given by --mapping",
    )
