"""What one machine states of the sizes that effects may have in it, in place of their usual ranges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Self

Range = tuple[float, ...]


@dataclass(frozen=True)
class Priors(Mapping[tuple[str, str], Range]):
    """A frozen mapping: (effect's name, parameter's name) -> its least and its greatest size [SI], whatever its sign.

    rows: its entries, in the order of the catalogue where a machine file states them. Raises ValueError for what is not
    a range of positive sizes.
    """

    rows: tuple[tuple[tuple[str, str], Range], ...] = ()

    def __post_init__(self) -> None:
        """Checks that every entry is a range of positive sizes."""
        for (effect, name), ends in self.rows:
            if len(ends) != 2 or not 0 < ends[0] < ends[1]:
                raise ValueError(f"{effect}: {name}: must be a range; give its minimum and maximum, both above 0")

    @classmethod
    def of(cls, ranges: Mapping[tuple[str, str], Range]) -> Self:
        """The priors with the entries of another mapping [SI], in its order."""
        return cls(tuple(ranges.items()))

    def __getitem__(self, key: tuple[str, str]) -> Range:
        """The range [SI] of an effect's parameter. Raises KeyError where the machine states none."""
        return dict(self.rows)[key]

    def __iter__(self) -> Iterator[tuple[str, str]]:
        """The (effect, parameter) of every entry."""
        return (key for key, _ in self.rows)

    def __len__(self) -> int:
        """The number of entries."""
        return len(self.rows)

    def by_effect(self) -> Mapping[str, Mapping[str, Range]]:
        """The entries grouped by the effect's name: parameter's name -> range [SI]."""
        grouped: dict[str, dict[str, Range]] = {}
        for (effect, name), ends in self.rows:
            grouped.setdefault(effect, {})[name] = ends
        return grouped


USUAL = Priors()
"""Of a machine that states none: every effect has its usual ranges."""
