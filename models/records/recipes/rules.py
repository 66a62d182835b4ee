"""Which columns hold which signals in which files: rules with patterns of names, of which the most specific wins.

A rule for one file by its name goes before one for a pattern, a pattern with more letters before one with fewer, and
any pattern before a rule for all files; of two equal ones the later. Each signal is decided by itself.
"""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from models.records.columns import Columns
from models.records.tables.sizes import RecordError

ALL = "*"  # the pattern of every file


@dataclass(frozen=True)
class Rule:
    """The entries, signal -> "NAME [unit] * factor", of all files whose names fit a pattern such as "sweep*.mf4".

    An empty entry takes back what a less specific rule says: the signal has its standard name, or is not in the file.
    origin: where the rule stands, for messages. needed: whether it is a mistake if the pattern fits no file, as of an
    option that is given for these; a mapping file may serve many calls.
    Raises RecordError, a sentence, for an unknown signal or a bad entry.
    """

    entries: Mapping[str, str]
    origin: str
    pattern: str = ALL
    needed: bool = True

    def __post_init__(self) -> None:
        if not self.pattern or "/" in self.pattern:
            raise RecordError(
                f"{self.origin}: {self.pattern!r} must be the name of a file, or a pattern of names such as "
                '"sweep*.csv", without its folder'
            )
        known = Columns.__dataclass_fields__
        for signal in self.entries:
            if signal not in known:
                close = difflib.get_close_matches(signal, known, n=1, cutoff=0.6)
                hint = f"did you mean {close[0]}? " if close else ""
                raise RecordError(f"{self.origin}: {signal!r} is not a signal; {hint}known: {', '.join(known)}")
        try:
            _columns(self.entries)
        except ValueError as error:
            raise RecordError(f"{self.origin}: {error}") from error

    def fits(self, path: Path) -> bool:
        """Whether the rule is for this file."""
        return fnmatch.fnmatchcase(path.name, self.pattern)

    @property
    def specificity(self) -> tuple[bool, int]:
        """Greater for a rule that is for fewer files: whether it names one, and the letters that it prescribes."""
        wild = re.findall(r"\[[^\]]*\]|[*?]", self.pattern)
        return not wild, len(self.pattern) - sum(map(len, wild))


def columns_for(path: Path, rules: Sequence[Rule]) -> Columns:
    """The columns of a file by all rules that fit it, the most specific last."""
    entries: dict[str, str] = {}
    for rule in sorted((rule for rule in rules if rule.fits(path)), key=lambda rule: rule.specificity):
        entries |= rule.entries
    return _columns(entries)


def _columns(entries: Mapping[str, str]) -> Columns:
    return Columns(**{signal: entry for signal, entry in entries.items() if entry.strip()})


def rule_of(columns: Columns | None, origin: str) -> tuple[Rule, ...]:
    """What a mapping of all files says beyond the standard names, as a rule; none where it says nothing."""
    stated = {name: entry for name, entry in vars(columns or Columns()).items() if entry != getattr(Columns(), name)}
    return (Rule(stated, origin),) if stated else ()


def check_used(rules: Sequence[Rule], paths: Sequence[Path]) -> tuple[str, ...]:
    """What is said of rules that fit none of these files, a sentence each. Raises RecordError for one that has to fit
    one, and where a file is left that no rule is for: then the pattern is mistyped."""
    mapped, said = all(any(rule.fits(path) for rule in rules) for path in paths), list[str]()
    for rule in rules:
        if any(rule.fits(path) for path in paths):
            continue
        names = ", ".join(path.name for path in paths[:5]) + (", ..." if len(paths) > 5 else "")
        none = f"{rule.origin}: {rule.pattern!r} fits none of the records ({names or 'none is given'})"
        if rule.needed or not mapped:
            raise RecordError(f"{none}; correct the pattern, or leave the rule out")
        said.append(f"{none}; it is not used")
    return tuple(said)
