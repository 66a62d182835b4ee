"""The sizes that effects may have in one machine: what its file states, and what the usual ranges are counted in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, Self

Range = tuple[float, ...]


@dataclass(frozen=True)
class Units:
    """The quantities of a machine in which the usual sizes of effects are counted; those of the reference table, for
    which the catalogue states the sizes, are the defaults.

    force [N]: the friction where every contact slips. thrust [N]: the rated one. mass [kg]: 1/k
    of the rigid body. contact [m]: by how much
    the contacts yield before they slip. travel [m]: the longest way in the records. reading [m]: deviation of the
    scale's reading. loop [s]: time of the control loop. sample [s]: the sample time.
    """

    force: float = 16.499895149
    thrust: float = 150.0
    mass: float = 44.736724377041114
    contact: float = 7.628887474119413e-06
    travel: float = 0.06
    reading: float = 4.1633319989322656e-08
    loop: float = 0.003616416772918726
    sample: float = 0.0005

    def over(self, reference: Units, powers: Powers) -> float:
        """A product of powers of these quantities over that of the reference's [1]."""
        factor = 1.0
        for name, power in powers:
            factor *= (getattr(self, name) / getattr(reference, name)) ** power
        return float(factor)


Powers = tuple[tuple[str, int], ...]
"""A product of powers of `Units`: their names and exponents."""

REFERENCE: Final = Units()
"""Of the table that the catalogue's ranges are stated for."""


@dataclass(frozen=True)
class Priors(Mapping[tuple[str, str], Range]):
    """A frozen mapping: (effect's name, parameter's name) -> its least and its greatest size [SI], whatever its sign.

    rows: its entries, in the order of the catalogue where a machine file states them. units: what the usual ranges of
    everything else are counted in. Raises ValueError for what is not a range of positive sizes.
    """

    rows: tuple[tuple[tuple[str, str], Range], ...] = ()
    units: Units = REFERENCE

    def __post_init__(self) -> None:
        """Checks that every entry is a range of positive sizes."""
        for (effect, name), ends in self.rows:
            if len(ends) != 2 or not 0 < ends[0] < ends[1]:
                raise ValueError(f"{effect}: {name}: must be a range; give its minimum and maximum, both above 0")

    @classmethod
    def of(cls, ranges: Mapping[tuple[str, str], Range], units: Units = REFERENCE) -> Self:
        """The priors with the entries of another mapping [SI], in its order."""
        return cls(tuple(ranges.items()), units)

    def __getitem__(self, key: tuple[str, str]) -> Range:
        """The range [SI] of an effect's parameter. Raises KeyError where the machine states none."""
        return dict(self.rows)[key]

    def __iter__(self) -> Iterator[tuple[str, str]]:
        """The (effect, parameter) of every entry."""
        return (key for key, _ in self.rows)

    def __len__(self) -> int:
        """The number of entries."""
        return len(self.rows)

    @property
    def stated(self) -> Self:
        """What the machine file states, without the units of a machine and its records."""
        return replace(self, units=REFERENCE)

    def by_effect(self) -> Mapping[str, Mapping[str, Range]]:
        """The entries grouped by the effect's name: parameter's name -> range [SI]."""
        grouped: dict[str, dict[str, Range]] = {}
        for (effect, name), ends in self.rows:
            grouped.setdefault(effect, {})[name] = ends
        return grouped


USUAL = Priors()
"""Of a machine that states none: every effect has its usual ranges."""
