"""Where a machine's values come from, and the error of a machine that can't be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

SOURCES: Final = ("paper", "datasheet", "given", "derived", "identified", "assumed")


Shares = tuple[tuple[float, ...], ...]
"""What deviations have in common, for each number of a value: by how many of its standard deviations it moves with the
first, second, ... of independent errors, which are the same for all values of a file [1]. What the squares leave of 1
is an error of its own."""


class MachineError(ValueError):
    """A machine file that can't be used; the message is one sentence: what, where, what to do.

    >>> pos.load_machine("nowhere.toml")
    Traceback (most recent call last):
    models.machines.provenance.MachineError: nowhere.toml: can't be read (No such file or directory); ...
    """


class MissingError(MachineError):
    """A machine file that lacks a value."""


@dataclass(frozen=True)
class Provenance:
    """Where a value comes from: `kind` is one of SOURCES, `detail` says which section, rule, method or assumption.

    record, sha256: the file that it was identified from, and that file's hash; empty for any other. std: its standard
    deviation in the value's own unit, one for each number of a list; None where it is not known. rotary: whether the
    value was given in units of a rotary axis; None where these are the same as others'. shares: see `Shares`; empty
    where nothing tells what the deviation has in common with others. at_limit: whether a fit left the value at the end
    of its range, where it stands in for what the model lacks.
    """

    kind: str
    detail: str
    note: str = ""
    record: str = ""
    sha256: str = ""
    std: float | tuple[float, ...] | None = None
    rotary: bool | None = field(default=None, repr=False, compare=False)
    shares: Shares = ()
    at_limit: bool = False

    @property
    def plain(self) -> dict[str, object]:
        """The fields but `rotary`, by their names, as results.json has them; at_limit only where it is true."""
        left_out = {"rotary"} if self.at_limit else {"rotary", "at_limit"}
        return {name: content for name, content in vars(self).items() if name not in left_out}
