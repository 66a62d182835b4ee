"""How far the gap shrinks: the files that the stages of the search make, which of them is handed over, the closure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.closure import NoiseFloor
from diagnosis.handover.files import Content, starts_of
from diagnosis.handover.final_fit import finished
from diagnosis.handover.gate import (
    DRAWS,
    File,
    Handover,
    Harm,
    Sums,
    as_delivered,
    beside_doubted,
    chosen,
    file_of,
    is_believed,
    offset_alone,
    with_fit,
)
from diagnosis.handover.known_modes import with_known_modes
from diagnosis.handover.transfer import Transfer, transferred
from diagnosis.how_far import Gap, errors_of
from diagnosis.learned.learn import Learned
from diagnosis.model.at_bounds import AtBound
from diagnosis.model.residual import Candidate
from diagnosis.records.motions import rms
from diagnosis.verdict import Outcome
from diagnosis.where.energy import bootstrap_interval, closure_interval
from diagnosis.which.detectors.random_force import NAME
from diagnosis.which.stage import Stage

Array = NDArray[np.float64]

ADOPTED: Final = (Outcome.ATTRIBUTED, Outcome.AMBIGUOUS)  # outcomes whose effects may go into the machine
STAGE_ITERATIONS: Final = 4  # iterations of the fits of stages between the first and the last
FORMULA: Final = "(refitted^2 - after^2 + random^2) / (refitted^2 - floor^2)"
MEASURE_UNITS: Final = {"force": "N", "position": "m", "settling": "s"}


@dataclass(frozen=True)
class Terms:
    """What the closure is computed from: the unknown force [N] or the position's error [m] (rms) of the machine as
    delivered, re-fitted, and with the effects, all on motions left out of their fits; of the floor; and what effects at
    random add to the floor. Where the floor is the scatter between equal motions, all are of those motions."""

    delivered: float
    refitted: float
    after: float
    floor: float
    random: float = 0.0
    measure: str = "force"

    @property
    def shows(self) -> bool:
        """Whether the re-fitted machine leaves more than the floor, so that there is a gap that may be closed."""
        return self.refitted > self.floor

    def closure(self, start: float | None = None) -> float:
        """The closure [1] from the re-fitted machine, or from another error to start at [N] or [m]; 0 where that is
        within the floor, so that nothing is there to be closed."""
        before = self.refitted if start is None else start
        if before <= self.floor:
            return 0.0
        return float(closure_share(before**2, self.after**2, self.floor**2, self.random**2))

    def to_json(self) -> dict[str, Any]:
        """With the formula, in which the terms have these names."""
        return {
            "delivered": self.delivered,
            "refitted": self.refitted,
            "after": self.after,
            "floor": self.floor,
            "random": self.random,
            "measure": self.measure,
            "unit": MEASURE_UNITS[self.measure],
            "formula": FORMULA,
        }


def closure_share(before: Array | float, after: Array | float, floor: float, random: float = 0.0) -> Array:
    """The closure [1] of mean squares [N^2] or [m^2]: of a gap above the floor, the share that is gone."""
    gap = np.maximum(np.asarray(before) - floor, 1e-30)
    return np.asarray(np.clip((np.asarray(before) - after + random) / gap, -1.0, 1.0))


@dataclass(frozen=True)
class HowFar:
    """The gaps by stage, in order, each with what was added; the floor and where it is from: "simulated" or "repeats";
    the closure, its 95 % interval [1] and the terms that it is computed from; that interval of the search's effects,
    where a measured law is handed over in their place; the file that is handed over, among those that were judged; the
    drive's force (rms) [N]; values at bounds of the last file; transfer: between the records, where there are
    several."""

    stages: tuple[tuple[str, Gap], ...]
    floor: Gap
    source: str
    terms: Terms
    interval: tuple[float, float]
    effects_interval: tuple[float, float]
    handover: Handover
    drive: float
    widened: tuple[AtBound, ...] = ()
    at_bound: tuple[AtBound, ...] = ()
    transfer: Transfer | None = None

    @property
    def leaves_more(self) -> bool:
        """Whether the file with effects leaves more than the re-fitted one, both in force and in position."""
        with_effects, refitted = (self.handover.named(one) for one in (Content.EFFECTS, Content.REFITTED))
        if with_effects is None or refitted is None:
            return False
        pairs = ((file.gap.force, file.gap.position) for file in (with_effects, refitted))
        return all(after > before for after, before in zip(*pairs, strict=True))

    @property
    def closure(self) -> float:
        """The closure [1], on motions left out of the fits."""
        return self.terms.closure()

    @property
    def left_out(self) -> tuple[str, ...]:
        """The effects that the last file lacks, as their phases belong to single records."""
        values = self.transfer.values if self.transfer else ()
        return tuple(dict.fromkeys(one.part for one in values if one.kept_out))

    def to_json(self) -> dict[str, Any]:
        """As interfaces fix it, the stages between, and all that the closure and the choice of a file hang on."""
        named, adopted = dict(self.stages), self.handover.adopted
        return {
            "gap_as_delivered": named[Content.DELIVERED].to_json(),
            "gap_refitted": named[Content.REFITTED].to_json(),
            "gap_after": self.stages[-1][1].to_json(),
            "gap_improved": adopted.gap.to_json(),
            "floor": self.floor.to_json(),
            "floor_source": self.source,
            "closure": self.closure,
            "closure_interval": list(self.interval),
            "closure_of": {"delivered": self.terms.closure(self.terms.delivered), "refitted": self.closure},
            "closure_terms": self.terms.to_json(),
            "held_out": True,
            "drive_rms_N": self.drive,
            "stages": [{"added": name, **gap.to_json()} for name, gap in self.stages],
            "adopted_file": adopted.name,
            "without": list(self.handover.without),
            "modes_kept": adopted.finished.modes_kept if adopted.finished else 0.0,
            "frequency_alone_Hz": adopted.finished.frequency_alone if adopted.finished else None,
            "files": [_file(file) for file in self.handover.files],
            "harms": [_harm(harm) for harm in self.handover.harms],
            "widened": [_bound(one) for one in self.widened],
            "at_bounds": [_bound(one) for one in self.at_bound],
            "transfer": self.transfer.to_json() if self.transfer else None,
        }


def _file(file: File) -> dict[str, Any]:
    return {"file": file.name, "on_records": file.gap.to_json(), "held_out": file.held_out.gap().to_json()}


def _harm(harm: Harm) -> dict[str, Any]:
    return {
        "file": harm.file,
        "measure": harm.measure,
        "unit": MEASURE_UNITS[harm.measure],
        "than": harm.than,
        "before": harm.before,
        "after": harm.after,
    }


def _bound(one: AtBound) -> dict[str, Any]:
    return {"part": one.part, "name": one.name, "value": one.value, "unit": one.unit}


def how_far(
    stages: Sequence[Stage], outcome: Outcome, floor: NoiseFloor, baseline: Baseline, law: Learned | None = None
) -> HowFar:
    """The files of the machine as delivered, re-fitted and with the effects of the stages; which is handed over. law: a
    learned one, in the stages under a name, or, where nothing has a name, to be handed over in place of effects if
    motions that were not used agree and it does no harm [SI]."""
    records = baseline.records
    ends = (stages[0], stages[-1]) if len(stages) > 1 else (stages[0],)
    fits = [with_known_modes(finished(one.fitted, records), baseline) for one in ends]
    transfer = None
    if len(records) > 1:
        fits, transfer = transferred(fits, baseline)
    delivered = as_delivered(baseline, starts_of(fits[0].candidate))
    names = (Content.REFITTED, Content.EFFECTS)
    files = [with_fit(name, one, baseline, law) for name, one in zip(names, fits, strict=False)]
    if outcome is Outcome.NOTHING:
        handover = Handover(delivered, (delivered, *files))
    else:
        handover = _gated(delivered, files, _learned(law, outcome, baseline), baseline, outcome)
    named: list[tuple[str, Gap]] = [(Content.DELIVERED, delivered.gap), (Content.REFITTED, files[0].gap)]
    motions = np.bincount(baseline.segment[floor.known], minlength=len(baseline.pieces)) > 0
    first, then, last = (_of(file.held_out, motions) for file in (delivered, files[0], files[-1]))
    rough = stages[-1].fitted.candidate.rough
    of_effects = closure_terms((first, then, last), floor.gap(), floor.random_force(), rough=rough)
    terms, interval = of_effects
    if handover.adopted.name == Content.MEASURED:
        named.append((Content.MEASURED, handover.adopted.gap))
        sums_with_law = first, then, _of(handover.adopted.held_out, motions)
        terms, interval = closure_terms(sums_with_law, floor.gap(), rough=rough)
    elif len(files) > 1:
        named += [*_between(stages, baseline), (f"{stages[-1].added}", files[-1].gap)]
    drive = rms([record.command * baseline.machine.plant.thrust_constant for record in records])
    behind = handover.adopted.finished or fits[-1]  # bounds of a law that is in no file tell nothing
    at = behind.widened, behind.at_bound
    return HowFar(
        tuple(named), floor.gap(), floor.source, terms, interval, of_effects[1], handover, drive, *at, transfer
    )


def _learned(law: Learned | None, outcome: Outcome, baseline: Baseline) -> list[File]:
    """The file with a learned law that has no name, where there is one that motions which were not used confirm."""
    if outcome is not Outcome.NONE or law is None or law.fitted is None or law.reason:
        return []
    return [with_fit(Content.MEASURED, finished(law.fitted, baseline.records), baseline, law)]


def _gated(
    delivered: File, files: Sequence[File], learned: Sequence[File], baseline: Baseline, outcome: Outcome
) -> Handover:
    """The file among those that may be handed over; files: re-fitted and, if there are effects, with them, which the
    outcome lets into it or not. Where the file with all of them does harm, it may still have some."""
    adopted = outcome in ADOPTED
    refitted, with_effects = files[:1], files[1:]
    judged = (*files, *learned) if adopted else (*refitted, *learned)
    doubted = [one for one in judged if not is_believed(one, baseline)]
    may = [delivered, *(one for one in judged if one not in doubted)]
    handover = chosen(may, lambda: offset_alone(baseline, delivered), incomplete=outcome is Outcome.NONE)
    if refitted[0] in doubted and handover.adopted is delivered:
        for simpler in beside_doubted(baseline, delivered):
            handover = replace(handover, adopted=simpler, files=(delivered, simpler, *handover.files[1:]))
    if adopted and with_effects and handover.adopted.name not in {Content.EFFECTS, Content.MEASURED}:
        handover = _with_some(handover, with_effects[0], baseline)
    rest = () if adopted else with_effects
    return replace(handover, files=(*handover.files, *doubted, *rest))


def _with_some(handover: Handover, with_effects: File, baseline: Baseline) -> Handover:
    """The handover where the file may have all of the effects but one: one law may do harm, and the others be right.
    Of those that pass, the one that leaves the least force; the same handover where none does."""
    passed = list[tuple[File, str]]()
    simpler = handover.files[: [one.name for one in handover.files].index(handover.adopted.name) + 1]
    for name, fewer in all_but_one(with_effects.fitted.candidate):
        made = finished(replace(with_effects.fitted, candidate=fewer), baseline.records)
        file = with_fit(Content.SOME, made, baseline)
        if is_believed(file, baseline) and chosen([*simpler, file]).adopted is file:
            passed.append((file, name))
    if not passed:
        return handover
    best, name = min(passed, key=lambda one: float(one[0].held_out.mean("force")))
    before = [one for one in handover.files if one is not with_effects]
    after = [one for one in handover.files if one is with_effects]
    return Handover(best, (*before, best, *after), handover.harms, (name,))


def all_but_one(candidate: Candidate) -> Iterator[tuple[str, Candidate]]:
    """The name of one of the laws that a candidate adds, and the candidate without it, each in turn, where it adds
    several; the random forces count as one law."""
    names = dict.fromkeys(effect.name for effect in candidate.added_effects)
    if len(names) + bool(candidate.random_forces) < 2:
        return
    added = {id(effect): effect.name for effect in candidate.added_effects}
    for name in names:
        yield name, replace(candidate, effects=tuple(one for one in candidate.effects if added.get(id(one)) != name))
    if candidate.random_forces:
        yield NAME, replace(candidate, random_forces=())


def _between(stages: Sequence[Stage], baseline: Baseline) -> list[tuple[str, Gap]]:
    """What the files of the stages between the re-fit and the last one leave."""
    found = []
    for stage in stages[1:-1]:
        one = finished(stage.fitted, baseline.records, STAGE_ITERATIONS)
        file = file_of(one.candidate, baseline.machine)
        left = errors_of(file.candidate, baseline.records, one.fitted.paths, baseline.driving)
        found.append((f"{stage.added}", left.gap()))
    return found


def closure_terms(
    files: tuple[Sums, Sums, Sums], floor: Gap, random: float = 0.0, *, rough: bool = False
) -> tuple[Terms, tuple[float, float]]:
    """The closure's terms by what files as delivered, re-fitted and last leave of motions, and its 95 % interval [1] by
    a bootstrap over these: of the unknown force, or of the position where the force that the re-fit leaves is not
    surely above its floor and the position is, as those of a mode or of an error of the reading may be. random: what
    effects at random add to the force of the floor [N]. rough: of a drive that is rougher than its model, whose names
    have to be seen in the force: any gap there counts."""
    force, surely = _terms_in("force", files, floor.force, random)
    if surely or random > 0 or (rough and force[0].shows):
        return force
    position, surely = _terms_in("position", files, floor.position)
    return position if surely or (not force[0].shows and position[0].shows) else force


def _terms_in(
    measure: str, files: tuple[Sums, ...], least: float, random: float = 0.0
) -> tuple[tuple[Terms, tuple[float, float]], bool]:
    """The terms in a measure, force [N] or position [m], with the closure's interval [1], and whether the re-fit leaves
    more than the floor in 97.5 % of the draws."""
    _, refitted, after = files
    first, then, last = (float(np.sqrt(one.mean(measure))) for one in files)
    terms = Terms(first, then, last, least, random, measure)
    draws = np.random.default_rng(0).integers(0, refitted.count.size, (DRAWS, refitted.count.size))
    before = refitted.mean(measure, draws)
    motions = refitted.count.size
    closed = closure_share(before, after.mean(measure, draws), least**2, random**2)
    low, high = closure_interval(terms.closure(), closed, motions)
    interval = min(low, terms.closure()), max(high, terms.closure())
    return (terms, interval), motions > 1 and bootstrap_interval(before, motions)[0] > least**2


def _of(one: Sums, motions: NDArray[np.bool_]) -> Sums:
    """The sums of those motions alone."""
    return Sums(*(part[motions] for part in (one.force, one.position, one.count, one.settling, one.settled)))
