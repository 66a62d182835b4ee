"""How far the gap shrinks: what each stage of the search leaves, in newtons, micrometres and milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit
from diagnosis.model.kalman import smoothed
from diagnosis.model.motions import rms
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import STARTING, Candidate, Residual, SmoothedPath, evaluate, smooth, unweighted_predictor
from diagnosis.null import simulated
from diagnosis.which.random_force import with_sines
from diagnosis.which.stage import Stage
from models.effects.catalogue import in_order
from models.machine import Machine
from models.records.record import Record, motions
from models.records.settling import settling_time

Array = NDArray[np.float64]

SEEN_BY: Final = 0.05  # [N a sample] of the walk with which the unknown force is told in newtons


@dataclass(frozen=True)
class Gap:
    """What a model leaves: unknown force (its deviation) [N], position in the closed loop [m], settling [s]."""

    force: float
    position: float
    settling: float | None

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {"force_N": self.force, "position_m": self.position, "settling_s": self.settling}


@dataclass(frozen=True)
class HowFar:
    """The gaps by stage, in order, each with what was added; the floor and where it is from: "simulated" or "repeats";
    the closure and its 95 % interval [1]."""

    stages: tuple[tuple[str, Gap], ...]
    floor: Gap
    source: str
    closure: float
    interval: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """As interfaces fix it, and the stages between."""
        named = dict(self.stages)
        last = self.stages[-1][1]
        return {
            "gap_as_delivered": named["as delivered"].to_json(),
            "gap_refitted": named["re-fitted"].to_json(),
            "gap_after": last.to_json(),
            "floor": self.floor.to_json(),
            "floor_source": self.source,
            "closure": self.closure,
            "closure_interval": list(self.interval),
            "held_out": True,
            "stages": [{"added": name, **gap.to_json()} for name, gap in self.stages],
        }


def gap(candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath]) -> Gap:
    """What a candidate leaves of the records."""
    force, apart, settling = gaps_by_record(candidate, records, paths)
    differences = [time for times in settling for time in times]
    return Gap(rms(force), rms(apart), float(np.mean(differences)) if differences else None)


def gaps_by_record(
    candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath]
) -> tuple[tuple[Array, ...], tuple[Array, ...], tuple[list[float], ...]]:
    """By record: the unknown force (n,) [N], by how much the position in the closed loop is another (n,) [m], and the
    same of each motion's settling [s]; no number before the state has settled."""
    machine = candidate.machine
    model = unweighted_predictor(candidate, records[0].sample_time, SEEN_BY)

    def left(i: int, record: Record, residual: Residual) -> tuple[Array, Array, list[float]]:
        start = np.zeros(model.C.size)
        start[0] = record.position[0]
        states = smoothed(model, residual.force, record.position - residual.acts.reading, start)
        unknown = states[:, 2 * len(machine.plant.modes)]
        made = simulated(quiet(candidate), record, i, 0)
        apart = made.position - record.position
        unknown[:STARTING] = apart[:STARTING] = np.nan
        # a constant force is an offset of the amplifier, and costs nothing
        return unknown - np.nanmean(unknown), apart, _settling_differences(record, made, machine)

    found = parallel_map(left, range(len(records)), records, evaluate(candidate, records, paths))
    force, apart, settling = zip(*found, strict=True)
    return force, apart, settling


def gaps_of(stages: Sequence[Stage], records: Sequence[Record]) -> tuple[tuple[str, Gap], ...]:
    """What the machine as delivered, the re-fitted one and each stage with one effect more leave of the records."""
    nominal = stages[0].fitted
    delivered = _as_delivered(nominal)
    gaps = [("as delivered", gap(delivered, records, smooth(delivered, records)))]
    gaps.append(("re-fitted", gap(nominal.candidate, records, nominal.paths)))
    found = [(f"{stage.added}", gap(stage.fitted.candidate, records, stage.fitted.paths)) for stage in stages[1:]]
    return (*gaps, *found)


def _as_delivered(nominal: Fit) -> Candidate:
    """The machine file as it is; only the starts of the records, which no file can know, are the fit's."""
    layout = nominal.candidate.layout
    start = np.array(layout.names) == "initial_friction_state"
    theta = np.where(start, nominal.candidate.theta, 0.0)
    return replace(nominal.candidate, theta=theta, effects=in_order(layout.machine.effects))


def quiet(candidate: Candidate) -> Candidate:
    """The candidate with a scale that reads exactly."""
    machine = candidate.nominal
    still = replace(machine, scale=replace(machine.scale, noise=1e-15, resolution=0.0))
    return with_sines(replace(candidate, layout=replace(candidate.layout, machine=still)))


def _settling_differences(record: Record, made: Record, machine: Machine) -> list[float]:
    """How much the settling of each motion differs between record and simulation [s]."""
    wanted, found = machine.specification, []
    steps = np.count_nonzero(np.diff(record.target))
    if not 0 < steps < record.target.size / 20:
        return []
    for motion in motions(record.target, float(record.reference[0])):
        part = slice(motion.start, motion.stop)
        times = [
            settling_time(one.position[part] - motion.target, wanted.tolerance, record.sample_time)
            for one in (record, made)
        ]
        longest = (motion.stop - motion.start) * record.sample_time
        found.append(abs(min(times[0], longest) - min(times[1], longest)))
    return found
