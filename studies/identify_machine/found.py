"""What is found so far, and how it is written down: values with the record's hash and their standard deviation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.identification.estimate import Estimate, not_identifiable
from models.machine import Machine, Provenance, Tolerance
from models.records.files import Loaded
from models.records.record import Record
from studies.study import Check

Array = NDArray[np.float64]

SHOWN: Final = 3000  # samples that results.json keeps of a signal, for the figures


@dataclass(frozen=True)
class Found:
    """The machine so far, which parts are identified, and what goes into the results."""

    machine: Machine
    pass_band: float | None = None
    known: frozenset[str] = frozenset()
    results: Mapping[str, Any] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    said: tuple[str, ...] = ()
    friction_covariance: Array | None = None  # (2 N, 2 N) of stiffnesses [N/m] and limits [m], from a slow record

    def having(self, name: str, content: Mapping[str, Any], estimate: Estimate, said: Iterable[str] = ()) -> Found:
        """With the results of one record and its estimate's rows."""
        rows = [
            {"record": name, "name": n, "unit": u, "number": float(v), "std": float(s)}
            for n, u, v, s in zip(estimate.names, estimate.units, estimate.values, estimate.deviations, strict=True)
        ]
        matrix = {"names": list(estimate.names), "matrix": estimate.correlation}
        estimates = [*self.results.get("estimates", []), *rows]
        content = {**content, "correlation": matrix}
        return replace(
            self,
            results={**self.results, name: content, "estimates": estimates},
            said=(*self.said, *said, *not_identifiable(estimate, ("offset",))),
        )


def identified(loaded: Loaded, std: float | Iterable[float], unit: str) -> Provenance:
    """Provenance of a value found in a record, its standard deviation in `unit`."""
    spread = f"{std:.3g}" if isinstance(std, float) else "[" + ", ".join(f"{one:.3g}" for one in std) + "]"
    text = f"record {loaded.name} sha256 {loaded.sha256}, std {spread} {unit}"
    return Provenance("identified", text.removesuffix(" 1"))


def with_offset(machine: Machine, loaded: Loaded, offset: float, std: float) -> Machine:
    """The machine with a constant force [N] beside friction that a record shows, and its standard deviation [N], which
    is its tolerance where it is more than the usual one."""
    usual, found = Tolerance().offset, identified(loaded, std, "N")
    sources = {name: source for name, source in machine.sources.items() if name != "tolerance.offset"}
    sources |= {"drive.offset": found} | ({"tolerance.offset": found} if std > usual else {})
    drive, tolerance = replace(machine.drive, offset=offset), replace(machine.tolerance, offset=max(std, usual))
    return replace(machine, drive=drive, tolerance=tolerance, sources=sources)


def record_of(loaded: Loaded) -> Record:
    """The record over time that a file holds. Raises ValueError for a frequency response."""
    if not isinstance(loaded.content, Record):
        raise ValueError("is a frequency response, not a record over time; name its kind response")
    return loaded.content


def own_curve(machine: Machine) -> Machine:
    """Facts of the hysteresis curve that a nominal machine states no longer hold: they follow from the elements."""
    sources = dict(machine.sources)
    sources["presliding.coulomb_force"] = Provenance("derived", "from the friction elements")
    return replace(machine, sources=sources)
