"""Does it carry over: what is fitted to one record, judged on the others; and what belongs to one record alone.

Each row fits the same laws to one record, starting from the fit to all of them, and each column judges the file that
is written of it on one record. A value that is known so well from each record that its differences are not by chance
belongs to the records and not to the machine: a ripple's phase after homing, the offset of the day.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.handover.files import Content, judged_file, machine_of, starts_of
from diagnosis.handover.final_fit import Finished, finished
from diagnosis.how_far import Gap, errors_of
from diagnosis.model.fit import Fit, coordinates
from diagnosis.model.parallel import parallel_map
from diagnosis.model.parameters import Parameters
from diagnosis.model.residual import Candidate, smooth
from diagnosis.model.start_states import static_equilibrium_start
from diagnosis.model.unknown_force import still_fit
from diagnosis.records.motions import numbered, pieces
from diagnosis.records.units import loop_time
from diagnosis.which.table import covariance_of
from models.effects.base import parameters as parameters_of
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

ITERATIONS: Final = 4
DIFFERS: Final = 3.0  # standard deviations by which a value differs between records, no chance any more


@dataclass(frozen=True)
class PerRecord:
    """A value by record, with its standard deviations (both SI): of an effect ("cogging"), or "nominal"; differs:
    whether two records differ by more than chance. kept_out: whether the effect was left out of the file for it."""

    part: str
    name: str
    unit: str
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    differs: bool
    kept_out: bool = False

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {
            "part": self.part,
            "name": self.name,
            "unit": self.unit,
            "values": list(self.values),
            "std": list(self.deviations),
            "differs": self.differs,
            "kept_out": self.kept_out,
        }


@dataclass(frozen=True)
class Matrix:
    """What files of one kind leave: `gaps[row][column]`, fitted on one record, judged on another; of files that were
    fitted to none, all rows are equal."""

    file: str
    gaps: tuple[tuple[Gap, ...], ...]

    def elsewhere(self) -> Gap:
        """The mean square over the records that a file was not fitted on, as a gap."""
        others = [gap for i, row in enumerate(self.gaps) for j, gap in enumerate(row) if i != j]
        settling = [gap.settling for gap in others if gap.settling is not None]
        return Gap(
            float(np.sqrt(np.mean([gap.force**2 for gap in others]))),
            float(np.sqrt(np.mean([gap.position**2 for gap in others]))),
            float(np.mean(settling)) if settling else None,
        )

    def to_json(self) -> dict[str, Any]:
        """As results.json has it: rows fitted on, columns judged on."""
        return {
            "file": self.file,
            "force_N": [[gap.force for gap in row] for row in self.gaps],
            "position_m": [[gap.position for gap in row] for row in self.gaps],
            "settling_s": [[gap.settling for gap in row] for row in self.gaps],
            "elsewhere": self.elsewhere().to_json(),
        }


@dataclass(frozen=True)
class Transfer:
    """The matrices of the machine as delivered, re-fitted and, if there are effects, with them; values by record."""

    matrices: tuple[Matrix, ...]
    values: tuple[PerRecord, ...]

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {
            "matrices": [one.to_json() for one in self.matrices],
            "by_record": [one.to_json() for one in self.values],
        }


def transferred(fits: Sequence[Finished], baseline: Baseline) -> tuple[list[Finished], Transfer]:
    """The finished fits, of the re-fitted machine and, if there are effects, with them, and how they carry over. Added
    effects whose phase belongs to single records are left out of the last: phases that differ, where with them a fit to
    one record leaves more of the others than without. A deviation that is too small makes a difference, too, and such
    a law still carries over."""
    kept, apart = list(fits), [alone(one, baseline) for one in fits]
    values = per_record(apart[-1], baseline)
    names = (Content.REFITTED, Content.EFFECTS)
    matrices = [_matrix(*row, baseline) for row in zip(names, kept, apart, strict=False)]
    common = without_effects_of_records(kept[-1].candidate, values)
    if len(fits) > 1 and len(common.effects) < len(kept[-1].candidate.effects):
        fewer = finished(replace(kept[-1].fitted, candidate=common), baseline.records)
        without = _matrix(names[-1], fewer, alone(fewer, baseline), baseline)
        if without.elsewhere().force < matrices[-1].elsewhere().force:
            kept[-1], matrices[-1] = fewer, without
            left = {effect.name for effect in common.effects}
            values = tuple(replace(one, kept_out=one.part != "nominal" and one.part not in left) for one in values)
    return kept, Transfer((as_delivered(starts_of(kept[0].candidate), baseline), *matrices), values)


def _matrix(name: str, whole: Finished, apart: Sequence[Fit], baseline: Baseline) -> Matrix:
    """How the laws of a fit to all records carry over; apart: their fits to each record alone."""
    return matrix(name, apart, starts_of(whole.candidate), baseline)


def alone(finished: Finished, baseline: Baseline) -> tuple[Fit, ...]:
    """The finished fit's laws, fitted to each record alone."""

    def of(index: int) -> Fit:
        candidate = _of_record(finished.candidate, index)
        records, paths = [baseline.records[index]], [finished.fitted.paths[index]]
        return still_fit(candidate, records, paths, ITERATIONS)

    return tuple(parallel_map(of, range(len(baseline.records))))


def _of_record(candidate: Candidate, index: int) -> Candidate:
    """The candidate for one record of those that it was fitted to."""
    layout = candidate.layout
    starts = layout.of("initial_friction_state").reshape(layout.records, -1)
    kept = np.concatenate([np.flatnonzero(np.array(layout.names) != "initial_friction_state"), starts[index]])
    names = tuple(layout.names[i] for i in kept)
    smaller = Parameters(layout.machine, 1, names, layout.deviation[kept], layout.low[kept], layout.high[kept])
    return replace(candidate, layout=smaller, theta=candidate.theta[kept])


def matrix(name: str, fits: Sequence[Fit], starts: Sequence[Array], baseline: Baseline) -> Matrix:
    """Files of each of these fits on each record; starts: displacements (N,) [m] of the friction by record."""
    machines = [machine_of(baseline.machine, one.candidate) for one in fits]
    count = len(baseline.records)

    def row(number: int) -> tuple[Gap, ...]:
        machine, random = machines[number], fits[number].candidate.random_forces
        found = []
        for j in range(count):
            candidate = judged_file(machine, [starts[j]], random).candidate
            found.append(_gap(candidate, baseline.records[j], baseline.driving[j]))
        return tuple(found)

    return Matrix(name, tuple(parallel_map(row, range(count))))


def as_delivered(starts: Sequence[Array], baseline: Baseline) -> Matrix:
    """The machine file as it was given, on each record; starts: displacements (N,) [m] of the friction by record."""
    pairs = zip(starts, baseline.records, baseline.driving, strict=True)
    row = tuple(_gap(judged_file(baseline.machine, [start]).candidate, one, drives) for start, one, drives in pairs)
    return Matrix(Content.DELIVERED, (row,) * len(row))


def _gap(candidate: Candidate, record: Record, drives: Record) -> Gap:
    return errors_of(candidate, [record], smooth(candidate, [record]), [drives]).gap()


def on_record(machine: Machine, record: Record, drives: Record) -> Gap:
    """What a machine file leaves of a record that nothing was fitted to, its friction elements at first where they hold
    the first command."""
    layout = judged_file(machine, [np.zeros(len(machine.friction.limit))]).candidate.layout
    start = static_equilibrium_start(layout, [record])[layout.of("initial_friction_state")]
    return _gap(judged_file(machine, [start]).candidate, record, drives)


def per_record(fits: Sequence[Fit], baseline: Baseline) -> tuple[PerRecord, ...]:
    """The offset and the phases of the effects by record."""
    known = [list(_known(fit, record)) for fit, record in zip(fits, baseline.records, strict=True)]
    found = []
    for rows in zip(*known, strict=True):
        part, name, unit, turns = rows[0][:4]
        values, deviations = tuple(row[4] for row in rows), tuple(row[5] for row in rows)
        found.append(PerRecord(part, name, unit, values, deviations, differing(values, deviations, turns=turns)))
    return tuple(found)


def _known(fitted: Fit, record: Record) -> Iterator[tuple[str, str, str, bool, float, float]]:
    """(part, name, unit, whether it is an angle, value, standard deviation) of what may belong to a record."""
    covariance = covariance_of(fitted, numbered(pieces([record], loop_time(fitted.candidate.nominal)), [record]))
    candidate, layout = fitted.candidate, fitted.candidate.layout
    (at,) = layout.of("amplifier_offset")
    yield "nominal", "offset", "N", False, candidate.machine.drive.offset, float(np.sqrt(covariance[at, at]))
    begin = layout.count
    for effect in candidate.effects:
        here = coordinates(effect)
        for item in parameters_of(type(effect)):
            if item.role == "phase":  # its coordinates begin with cosine and sine
                size = float(np.hypot(here[0], here[1]))
                turn = np.array([-here[1], here[0]]) / max(size, 1e-300) ** 2
                spread = float(turn @ covariance[begin : begin + 2, begin : begin + 2] @ turn)
                yield effect.name, item.name, item.unit, True, float(getattr(effect, item.name)), float(np.sqrt(spread))
        begin += here.size


def differing(values: Sequence[float], deviations: Sequence[float], *, turns: bool) -> bool:
    """Whether two of the values are further apart than their standard deviations explain (SI); turns: they are angles
    [rad]."""
    pairs = combinations(zip(values, deviations, strict=True), 2)
    return any(_apart(a - b, turns=turns) > DIFFERS * float(np.hypot(s, t)) for (a, s), (b, t) in pairs)


def _apart(difference: float, *, turns: bool) -> float:
    return abs((difference + np.pi) % (2 * np.pi) - np.pi) if turns else abs(difference)


def without_effects_of_records(candidate: Candidate, found: Sequence[PerRecord]) -> Candidate:
    """The candidate without the added effects of which a phase differs between records, and others of their law; found:
    in the order of its effects."""
    gone = {one.part for one in found if one.part != "nominal" and one.differs}
    added = {id(effect) for effect in candidate.added_effects if effect.name in gone}
    return replace(candidate, effects=tuple(effect for effect in candidate.effects if id(effect) not in added))
