"""--column, --mapping and --recipe of the studies that read records: which column of which file is which signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from models.machine import Machine
from models.records.columns import Columns
from models.records.recipes.mapping_file import read_rules, recipes
from models.records.recipes.rules import ALL, Rule, check_used, columns_for, rule_of
from models.records.tables.sizes import RecordError
from studies.options import BadInputError
from studies.record_options import RecordOptions


@dataclass(frozen=True)
class Mapped:
    """How the signals are called in each of the records; notes: which patterns of a mapping file fit none of them."""

    rules: tuple[Rule, ...]
    notes: tuple[str, ...] = ()

    def columns(self, path: Path) -> Columns:
        """The columns of one file. Raises BadInputError."""
        try:
            return columns_for(path, self.rules)
        except ValueError as error:
            raise BadInputError(f"{path}: {error}") from error


def mapped(machine: Machine, options: RecordOptions, paths: Sequence[Path]) -> Mapped:
    """The rules of the machine file, the recipe, the mapping file and --column, of which the most specific wins.

    Of two that are as specific, the later in this order. paths: the records. Raises BadInputError for a bad rule, and
    for a pattern of --column that fits none of the records, or one of --mapping where no rule is for one of them.
    """
    try:
        rules = [*rule_of(machine.record, "[record] of the machine file")]
        if options.recipe:
            rules += read_rules(recipes()[options.recipe])
        if options.mapping:
            rules += read_rules(options.mapping)
        rules += [_rule(entry) for entry in options.column]
        notes = check_used(rules, paths)
    except RecordError as error:
        raise BadInputError(str(error)) from error
    return Mapped(tuple(rules), notes)


def _rule(entry: str) -> Rule:
    """The rule of one --column: SIGNAL=ENTRY, or FILES:SIGNAL=ENTRY. Raises RecordError."""
    head, equals, text = entry.partition("=")
    pattern, colon, signal = head.rpartition(":")
    origin = f"--column {entry}"
    if not equals:
        raise RecordError(f'{origin}: must be SIGNAL=ENTRY or FILES:SIGNAL=ENTRY, such as "sweep*.csv:position=x [mm]"')
    return Rule({signal.strip(): text}, origin, pattern if colon else ALL, bool(colon))
