"""What proposes an effect: each detector looks at one stage of the search in its own way.

A detector is a function of a `View`. It returns proposals, those of the catalogue scan with what each gains, the
others only where the gain is more than chance. Only here, in random_force.py and in command_jitter.py is it known which
effect a detector is about.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.model.fit import Fit, cost_with
from diagnosis.model.parallel import parallel_map
from diagnosis.records.motions import periods, repeated, scatter
from diagnosis.records.units import noise
from diagnosis.which.detectors.command_jitter import Lateness, lateness
from diagnosis.which.detectors.random_force import (
    SAME_FREQUENCY_RATIOS,
    RandomForce,
    is_about,
    reductions,
    strongest_random_force,
)
from diagnosis.which.detectors.scan import Columns, NuisanceProjection, partial_out, scan
from diagnosis.which.kinds import with_free_forms
from diagnosis.which.stage import Carrier, Proposal, RandomPart
from models.effects.base import parameters
from models.effects.motor import TimingJitter
from models.effects.protocol import ControllerMismatch
from models.effects.structure import FloorVibration
from models.plant import antiresonances

# Times the largest usual size: where a law is tried that is not linear on the way there.
NONLINEAR_SIZE_FACTORS: Final = (0.5, 1.5, 5.0)
# Of the commands that are late in a simulation: enough for a few records to tell the mean, and not so many that those
# that are not scatter as well.
SIMULATED_PARTS: Final = (0.02, 0.1)


@dataclass(frozen=True)
class View:
    """What a detector sees: a stage's fit, the baseline, what the fit's own parameters leave unexplained, effects that
    must not be used, effects that gained nothing so far (`negligible`: the scan skips them), and the scan's columns
    that are known from the stage before."""

    fitted: Fit
    baseline: Baseline
    own: NuisanceProjection
    disabled: Collection[str] = ()
    negligible: Collection[str] = ()
    known: Columns = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True)
class Detected:
    """Proposals, and the scan's columns that hold for the next stage, too."""

    proposals: tuple[Proposal, ...] = ()
    columns: Columns = field(default_factory=lambda: MappingProxyType({}))


Detector = Callable[[View], Detected]


def view(
    fitted: Fit, baseline: Baseline, disabled: Collection[str], negligible: Collection[str], known: Columns
) -> View:
    """A fit as the detectors see it."""
    return View(fitted, baseline, partial_out(fitted, baseline.segment), disabled, negligible, known)


def catalogue_scan(seen: View) -> Detected:
    """Every effect of the catalogue at the point of its grid that gains the most on held-out motions, best first."""
    skipped = {*seen.disabled, *seen.negligible}
    findings, columns = scan(seen.fitted, seen.baseline.records, seen.own, skipped, seen.known)
    thresholds, least = seen.baseline.thresholds, seen.baseline.criteria.min_gain
    proposals = [
        Proposal(
            finding.effect.name,
            finding.held_out,
            thresholds.get(finding.effect.name, least),
            effect=finding.effect,
            in_sample_gain=finding.gain,
            forbidden=finding.forbidden,
        )
        for finding in findings
    ]
    proposals = [replace(one, gain=0.0, in_sample_gain=0.0) if _keeps_time(one, seen) else one for one in proposals]
    return Detected(tuple(_from_afar(seen, one) for one in proposals), columns)


def _from_afar(seen: View, proposal: Proposal) -> Proposal:
    """The proposal of a law that has nothing but its amplitude and moves the reading, at the best of some large sizes,
    where it gains less to first order: the path moves with it, and contacts slip on the way."""
    effect = proposal.effect
    assert effect is not None
    if any(one.name == effect.name for one in seen.fitted.candidate.added_effects):
        return proposal
    items = parameters(type(effect), seen.fitted.candidate.nominal.priors)
    if type(effect).shown_in() != "reading" or [item.role for item in items] != ["amplitude"]:
        return proposal
    (item,) = items
    signs = (1.0, -1.0) if item.low < 0 else (1.0,)
    sizes = [sign * far * item.high for sign in signs for far in NONLINEAR_SIZE_FACTORS]
    tried = [replace(effect, **{item.name: size}) for size in sizes]
    costs = list(parallel_map(lambda one: cost_with(seen.fitted, one, seen.baseline.records), tried))
    best = int(np.argmin(costs))
    gain = seen.fitted.cost - costs[best]
    return replace(proposal, effect=tried[best], in_sample_gain=gain) if gain > proposal.in_sample_gain else proposal


def random_force(seen: View, about: float | None = None) -> Detected:
    """A force about a frequency that is not locked to the motion, such as a floor's vibration; about: near this one
    only [Hz], wherever it lies."""
    name, criteria = FloorVibration.name, seen.baseline.criteria
    if name in seen.disabled or _is_filled(seen) or len(seen.fitted.candidate.random_forces) >= criteria.max_effects:
        return Detected()
    found = strongest_random_force(seen.fitted, seen.baseline.records, seen.own, about)
    if found is None or _rings(seen.fitted, found.resonance.frequency):
        return Detected()
    threshold = max(seen.baseline.thresholds.get(name, 0.0), criteria.random_force_min_gain)
    low, high = found.even
    # What another form leaves looks like a line in noise, but not as much at rest as in motion.
    if seen.fitted.candidate.added_effects and low < criteria.random_force_evenness:
        threshold = max(threshold, criteria.random_force_beside * (seen.baseline.nominal.cost - seen.fitted.cost))
    loses = low + high <= 0  # at rest what it gains in motion, or the other way round
    if high < _least_evenness(seen, found) or loses or found.steady < criteria.random_force_steadiness:
        return Detected()
    if found.gain - gain_in_time(seen, found) <= threshold:
        return Detected()
    if is_locked(seen.fitted, seen.baseline, found.resonance.frequency) or _rings_unnamed(seen, found):
        return Detected()
    even = low >= criteria.random_force_evenness
    return Detected((Proposal(name, found.gain, threshold, random_force=found.resonance, even=even),))


def _least_evenness(seen: View, found: RandomForce) -> float:
    """How even a force has to be to be a floor's [1]: more where the structure itself rings on after motions."""
    criteria, structure = seen.baseline.criteria, antiresonances(seen.baseline.delivered.plant)
    ringing = any(is_about(found.resonance.frequency, one) for one in structure)
    return criteria.random_force_evenness_ringing if ringing else criteria.random_force_evenness


def _rings(fitted: Fit, frequency: float) -> bool:
    """Whether a mode that was added rings about this frequency [Hz]: it rings to forces that nobody knows, too."""
    return any(is_about(mode.frequency, frequency) for one in fitted.candidate.added_effects for mode in one.modes())


def _rings_unnamed(seen: View, found: RandomForce) -> bool:
    """Whether a mode about the force's frequency that must not be used would take a good part of what it gains: what
    rings with the commands is no floor, whether or not it may have its name."""
    kinds, least = seen.baseline.machine.kinds, seen.baseline.criteria.random_force_of_a_mode * found.gain
    modes = [name for name in seen.disabled if name in kinds and kinds[name].typical().modes()]
    if not modes:
        return False
    findings, _ = scan(seen.fitted, seen.baseline.records, seen.own, kinds.keys() - set(modes))
    about = found.resonance.frequency
    return any(
        one.held_out > least and any(is_about(mode.frequency, about) for mode in one.effect.modes()) for one in findings
    )


def _keeps_time(proposal: Proposal, seen: View) -> bool:
    """Whether a law repeats in time as the motions of all records do, so that nothing tells it from one of them."""
    effect = proposal.effect
    assert effect is not None
    items = [item for item in parameters(type(effect)) if item.role == "period" and item.periodic_in == "time"]
    numbers = [(getattr(effect, item.name), item.is_frequency) for item in items]
    return bool(items) and all(bool(in_time(number if per else 1 / number, seen).all()) for number, per in numbers)


def in_time(frequency: float, seen: View) -> NDArray[np.bool_]:
    """By record, whether a frequency [Hz] is within a line of it of a multiple of the rate at which motions repeat."""
    pieces, records = seen.baseline.pieces, seen.baseline.records
    groups = repeated(pieces, records, noise(seen.fitted.candidate.nominal))
    times = periods(groups, pieces, records, seen.baseline.criteria.min_equal_motions)
    duration = np.array([record.position.size * record.sample_time for record in records])
    cycles = frequency * np.array(times)
    with np.errstate(invalid="ignore"):  # infinite times of records that repeat nothing
        return np.asarray(np.abs(cycles - np.round(cycles)) < times / duration)


def gain_in_time(seen: View, found: RandomForce) -> float:
    """What a random force gains of -2 log likelihood [1] in the records with whose motions it keeps time: within a
    record's line of a multiple of the rate at which equal motions repeat, nothing tells it from a law of the motion."""
    timed = in_time(found.resonance.frequency, seen)
    if not timed.any():
        return 0.0
    gains = reductions(seen.fitted, seen.baseline.records, found.resonance)
    return sum(float(np.sum(gained)) for gained, one in zip(gains, timed, strict=True) if one)


def is_locked(fitted: Fit, baseline: Baseline, frequency: float) -> bool:
    """Whether what is left about a frequency [Hz] repeats with equal motions and is not there at rest: then it is a law
    of the motion, whatever its line in the spectrum."""
    records, criteria = baseline.records, baseline.criteria
    groups = repeated(baseline.pieces, records, noise(fitted.candidate.nominal))
    if sum(map(len, groups)) < criteria.min_equal_motions:
        return False
    near = scipy.signal.butter(
        2, np.array(SAME_FREQUENCY_RATIOS) * frequency, "bandpass", fs=1 / records[0].sample_time, output="sos"
    )
    band = [scipy.signal.sosfiltfilt(near, one.innovations) for one in fitted.residuals]
    power, apart = (np.concatenate(list(one)) ** 2 for one in (band, scatter(groups, baseline.pieces, band)))
    alike = ~np.isnan(apart)
    moving = float(np.mean(power[alike]))
    resting = np.isin(baseline.segment, [i for i, piece in enumerate(baseline.pieces) if piece.kind.rests])
    at_rest = float(np.mean(power[resting])) if resting.any() else 0.0
    return bool(max(float(np.mean(apart[alike])), at_rest) < criteria.random_force_apart * moving)


def _is_filled(seen: View) -> bool:
    """Whether a log has only one of several samples of the controller: what interpolation makes of the commands between
    them is in what is left, and no noise of the drive."""
    return any(record.every > 1 for record in seen.baseline.records)


def command_jitter(seen: View) -> Detected:
    """Commands that act late now and then: what differs among equal motions grows with the commands' steps."""
    name, thresholds = TimingJitter.name, seen.baseline.thresholds
    threshold = max(seen.baseline.criteria.late_commands_min_gain, thresholds.get(name, 0.0))
    if name in seen.disabled or _is_filled(seen):
        return Detected()
    found = lateness(seen.fitted, seen.baseline.records)
    if found.gain > threshold and seen.fitted.candidate.added_effects:
        found = lateness(_with_free_forms_out(seen), seen.baseline.records)  # a drift in another form differs, too
    least = seen.baseline.criteria.late_commands_min_size * seen.baseline.records[0].sample_time
    if found.gain <= threshold or (found.size < least and not _accounts_for_the_rest(found, seen)):
        return Detected()
    part = (found.size / seen.baseline.records[0].sample_time) ** 2
    simulated = TimingJitter(float(np.clip(part, *SIMULATED_PARTS)))
    random_part = RandomPart(simulated, part / simulated.part)
    return Detected((Proposal(name, found.gain, threshold, Carrier.FLOOR, random_part=random_part),))


def _accounts_for_the_rest(found: Lateness, seen: View) -> bool:
    """Whether so much lateness adds most of what is left above the noise floor, or all that is surely above it: else a
    little of it may be the form error of another law. A rough drive's floor does not tell."""
    criteria, floors, left = seen.baseline.criteria, seen.baseline.floors, seen.own.e
    above = float(left @ left - np.mean(floors))
    most = found.energy >= criteria.late_commands_min_share * above
    all_of_it = above - found.energy < criteria.shown_by * float(np.std(floors))
    return not seen.fitted.candidate.rough and (most or all_of_it)


def _with_free_forms_out(seen: View) -> Fit:
    """The fit with innovations from which the free forms of its effects are partialled out."""
    e = with_free_forms(seen.own, seen.fitted, seen.baseline.records).e
    ends = np.cumsum([one.innovations.size for one in seen.fitted.residuals])[:-1]
    pairs = zip(seen.fitted.residuals, np.split(e, ends), strict=True)
    return replace(seen.fitted, residuals=tuple(replace(one, innovations=left) for one, left in pairs))


def controller_replay(seen: View) -> Detected:
    """A stated controller that, replayed on the logged error, does not give the logged commands."""
    name, criteria = ControllerMismatch.name, seen.baseline.criteria
    if name in seen.disabled or all(one.replays for one in seen.baseline.replays):
        return Detected()
    return Detected((Proposal(name, float("inf"), criteria.late_commands_min_gain, Carrier.LOG),))


DETECTORS: Final[Mapping[str, Detector]] = MappingProxyType(
    {
        "catalogue scan": catalogue_scan,
        "random force": random_force,
        "late commands": command_jitter,
        "controller replay": controller_replay,
    }
)


def detect(seen: View) -> Detected:
    """What all detectors propose."""
    found = [detector(seen) for detector in DETECTORS.values()]
    columns = {effect: column for one in found for effect, column in one.columns.items()}
    return Detected(tuple(proposal for one in found for proposal in one.proposals), columns)
