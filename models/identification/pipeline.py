"""Which machine is this? From records to a machine with uncertainties, whatever the records show.

Each record is recognised (recognise.py), identified by the method for its kind, and put into the machine
(into_machine.py): frequency responses and excitations first, which give the plant; then slow records, which give the
friction; then motions, which judge both and give what is missing; then fast records by inverse dynamics. A value that
an earlier record gave stays, but for the offset, and for the damping of the friction's elements, which the record that
knows it best gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification import force, modes, motion, response
from models.identification.estimate import LOOSE, STRONG, Estimate, combined, not_identifiable
from models.identification.force_fit import SURE, ForceFit
from models.identification.into_machine import (
    Found,
    Holdable,
    drag_of,
    holdable,
    lag_of,
    with_damping_of_motion,
    with_drag,
    with_friction,
    with_inertia,
    with_offset,
    with_response,
    with_scaled_friction,
    with_scaled_plant,
)
from models.identification.modal.remarks import ResponseStep, on_disagreement, on_response
from models.identification.recognise import read, recognised
from models.identification.response import FrequencyResponse
from models.machine import Machine
from models.quantity import show
from models.records.files import Loaded
from models.records.kinds import KINDS
from models.records.record import Record
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]

CAUSES: Final = {
    "mass": "another payload or thrust constant, or friction that is not the model's",
    "delay": "commands or positions logged a sample apart, or another current loop",
    "offset": "gravity by another tilt, a cable, or what friction still remembers",
}
SIGMAS: Final = 3.0  # beyond which two records differ by more than their noise
SLOW_BAND: Final = 20.0  # Hz, of the low-pass for friction in a slow record
FAST_BAND: Final = 40.0  # Hz, the same in a fast record
BY_DIRECTION: Final = force.Terms(viscous=True, by_direction=True)
DYNAMICS: Final = replace(BY_DIRECTION, delay=True, damped=True)  # what is identified of a fast record


@dataclass(frozen=True)
class Settings:
    """How records are identified. pass_band [Hz]: of the low-pass for friction, None: the usual one. modes: how many
    vibration modes, None: as many as a response shows. rolled: responses in files were measured while the axis
    rolled."""

    pass_band: float | None = None
    modes: int | None = None
    rolled: bool = False


@dataclass(frozen=True)
class ForceStep:
    """What a record gave by its force: a slow one its friction, a fast one its dynamics, of which `held` is what a
    machine file can hold."""

    fit: ForceFit
    held: Holdable | None = None

    @property
    def estimate(self) -> Estimate:
        """The parameters of the force [SI]."""
        return self.fit.estimate


@dataclass(frozen=True)
class Difference:
    """By how much a motion record departs from what the records before it said: relative, or the dead time's in sample
    times [1], with its standard deviation."""

    name: str
    size: float
    std: float


@dataclass(frozen=True)
class MotionStep:
    """What a motion record gave, and how far it agrees with the records before it."""

    fit: motion.MotionFit
    differences: tuple[Difference, ...]

    @property
    def estimate(self) -> Estimate:
        """Mass, friction and presliding length relative to the machine as the records before had it [1], and more."""
        return self.fit.estimate


@dataclass(frozen=True)
class Step:
    """One record: what it is (one of KINDS), the file, what it gave, and remarks on it in whole sentences."""

    kind: str
    loaded: Loaded
    gave: ResponseStep | ForceStep | MotionStep
    remarks: tuple[str, ...] = ()

    @property
    def result(self) -> str:
        """The kind of its result: an excitation gives a response."""
        return "response" if self.kind == "excitation" else self.kind


@dataclass(frozen=True, repr=False)
class Identified:
    """The machine that the records show, each identified value with its record and standard deviation, and how.

    steps: what each record gave, in the order in which they were identified.

    >>> pos.identify(machine, [folder / "moves.csv"])
    Identified('Linear-motor table with rolling ball guides, identified', moves.csv: motion)
    """

    machine: Machine
    steps: tuple[Step, ...] = ()

    def __repr__(self) -> str:
        """The machine's name and what each record was taken for; no unit [-]."""
        records = (f"{step.loaded.name}: {step.kind}" for step in self.steps)
        return f"Identified({', '.join([repr(self.machine.name), *records])})"

    @property
    def estimates(self) -> Mapping[str, Estimate]:
        """What each record gave [SI], by the record's name."""
        return {step.loaded.name: step.gave.estimate for step in self.steps}

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know of the values, in whole sentences: what the records can't show or tell apart, or disagree in."""
        return tuple(remark for step in self.steps for remark in step.remarks)

    def earlier(self, name: str) -> list[tuple[float, float]]:
        """Value and standard deviation of a parameter [SI] in every record so far that has it."""
        having = (step.gave.estimate for step in self.steps if name in step.gave.estimate.names)
        return [(estimate.value(name), estimate.deviation(name)) for estimate in having]

    def last(self, result: str) -> ResponseStep | ForceStep | MotionStep | None:
        """What the last record with this kind of result gave."""
        return next((step.gave for step in reversed(self.steps) if step.result == result), None)

    @property
    def slow(self) -> ForceFit | None:
        """The friction of the last slow record."""
        gave = self.last("hysteresis")
        return gave.fit if isinstance(gave, ForceStep) else None

    def misfit(self, gave: ResponseStep) -> float:
        """Reduced chi-square [1] of this machine, as its file has it, on a response that it was identified from."""
        return modes.misfit(
            gave.measured, gave.fit.used, self.machine.plant, lag_of(self.machine), drag_of(self.machine)
        )

    def has(self, *results: str) -> bool:
        """Whether a record had a result of one of these kinds."""
        return any(step.result in results for step in self.steps)


def identify(
    machine: Machine,
    records: Sequence[str | Path | Loaded],
    *,
    kinds: Sequence[str] = (),
    pass_band: float | None = None,
    modes: int | None = None,
    rolled: bool = False,
    tell: Callable[[float, str], None] | None = None,
) -> Identified:
    """Which machine the records show, with standard deviations; what they don't show stays as in `machine`.

    records: files (CSV, CSV.gz, MAT or Parquet, their columns as machine.record maps them), or what
    `recognise.read` made of them. kinds: one of "response", "excitation", "hysteresis", "motion", "dynamics" or "auto"
    for each; recognised by default. pass_band [Hz]: of the low-pass for friction, by default 20 Hz for slow records and
    40 Hz for fast ones. modes: how many vibration modes a frequency response has, by default the fewest that pass.
    rolled: frequency responses in files were measured while the axis rolled. tell: hears the share that is done [1] and
    a sentence, before each record.
    Raises RecordError, a sentence that begins with the file's name, for a record that can't be used or is of another
    kind.

    >>> found = pos.identify(machine, [folder / "moves.csv"], kinds=["motion"])
    >>> found.machine.sources["plant.dead_time"].record
    'moves.csv'
    """
    loaded = [one if isinstance(one, Loaded) else read(machine, Path(one)) for one in records]
    if kinds and (len(kinds) != len(loaded) or not set(kinds) <= {"auto", *KINDS}):
        raise ValueError(f"kinds: must be one of auto, {', '.join(KINDS)} for each of the {len(loaded)} records")
    known = [
        recognised(machine, one) if kind == "auto" else kind
        for one, kind in zip(loaded, kinds or ["auto"] * len(loaded), strict=True)
    ]
    # What an experiment on another machine showed is left out.
    found = Identified(replace(machine, name=f"{machine.name}, identified", published=None))
    settings = Settings(pass_band, modes, rolled)
    for i, (kind, one) in enumerate(sorted(zip(known, loaded, strict=True), key=lambda item: KINDS.index(item[0]))):
        if tell is not None:
            tell(i / len(loaded), f"identifying from {one.name} ({kind})")
        try:
            found = _METHODS[kind](found, kind, one, settings)
        except ValueError as error:
            raise RecordError(f"{one.name}: {error}") from error
    return found


def record_of(loaded: Loaded) -> Record:
    """The record over time that a file holds [SI]. Raises ValueError for a frequency response."""
    if not isinstance(loaded.content, Record):
        raise ValueError("is a frequency response, not a record over time; name its kind response")
    return loaded.content


def _with(
    found: Identified,
    machine: Machine,
    kind: str,
    loaded: Loaded,
    gave: ResponseStep | ForceStep | MotionStep,
    remarks: Sequence[str],
) -> Identified:
    remarks = (*remarks, *not_identifiable(gave.estimate, ("offset",)))
    return Identified(machine, (*found.steps, Step(kind, loaded, gave, remarks)))


def _from_response(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:
    """P_l from a measured frequency response, or from an excitation; from all of them together if there are several."""
    content = loaded.content
    if isinstance(content, Record):
        measured, level = response.measured(content), float(np.std(content.feedforward))
    else:
        measured, level = replace(content, rolling=content.rolling or settings.rolled), None
    fit = modes.fit(measured, count=settings.modes)
    _check_excited(fit, measured)
    step = ResponseStep(measured, fit, level=level)
    earlier = [one for one in found.steps if isinstance(one.gave, ResponseStep)]
    remarks, source, best = [*on_response(fit, measured)], Found(loaded, "response"), fit
    if earlier:
        steps = [*(one.gave for one in earlier if isinstance(one.gave, ResponseStep)), step]
        best = modes.fit_together(
            [one.measured for one in steps], [one.fit.used for one in steps], count=settings.modes
        )
        step = replace(step, together=best)
        remarks += on_disagreement([one.loaded.name for one in earlier] + [loaded.name], steps)
        together = _together([*earlier, Step(kind, loaded, step)])
        source = Found(together, "response")
    return _with(found, with_response(found.machine, best, source), kind, loaded, step, remarks)


def _check_excited(fit: modes.Fit, measured: FrequencyResponse) -> None:
    """Raises ValueError where the response leaves mass [kg] or dead time [s] open: the phase of its highest line by a
    radian."""
    gain, gain_std, late_std = (
        *(fit.estimate.values[0], fit.estimate.deviations[0]),
        fit.estimate.deviation("dead time"),
    )
    top = float(np.max(measured.frequency[fit.used]))
    if gain_std < LOOSE * gain and 2 * np.pi * top * late_std < 1:
        return
    raise ValueError(
        f"does not excite the axis: from {measured.frequency[0]:.3g} to {top:.3g} Hz it leaves the mass open by "
        f"{100 * gain_std / gain:.2g} % and the dead time by {1e3 * late_std:.2g} ms; excite with more force, over two "
        "octaves or more, or name another kind"
    )


def _from_hysteresis(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:
    """The friction elements from a slow record; mass and dead time as known so far."""
    plant, ts = found.machine.plant, found.machine.sample_time
    dead_time = [std for _, std in found.earlier("dead time")]
    terms = force.Terms(
        mass=plant.mass,
        known_delay=plant.dead_time + lag_of(found.machine) + 0.5 * ts,
        known_delay_std=max(dead_time, default=0.0),
        damped=bool(dead_time),
    )
    record, band = record_of(loaded), settings.pass_band or SLOW_BAND
    fit = force.identify(record, terms, pass_band=band)
    dragged = force.identify(record, replace(terms, viscous=True), pass_band=band)
    if _drags(fit, dragged):
        fit = dragged
    slip, spread = fit.slip_force()
    steps = [*_steps(found, "hysteresis"), Step(kind, loaded, ForceStep(fit))]
    fits = [step.gave.fit for step in steps if isinstance(step.gave, ForceStep)]
    best = min(range(len(fits)), key=lambda i: _vagueness(fits[i]))
    remarks = (
        f"At full slip the friction is {slip:.4g} N with a standard deviation of {spread:.2g} N.",
        _on_damping(fit),
        _on_drag(dragged, taken=fit is dragged),
        *_on_agreement(steps, ("offset",)),
        *_on_slip(steps),
        *_on_memory(fit),
    )
    source, e = Found(loaded, "hysteresis"), fit.estimate
    offset = _joint_estimate([one.estimate for one in fits], ("offset",))
    machine = with_friction(found.machine, fits[best], Found(steps[best].loaded, "hysteresis"))
    together = Found(_together(steps), "hysteresis")
    machine = with_offset(machine, offset.value("offset"), offset.deviation("offset"), together)
    if fit is dragged:
        machine = with_drag(machine, (e.value("viscous friction"), e.deviation("viscous friction")), None, source)
    return _with(found, machine, kind, loaded, ForceStep(fit), remarks)


def _drags(plain: ForceFit, dragged: ForceFit) -> bool:
    """Whether a slow record shows viscous friction: BIC falls by ten, and it is surely above none."""
    fallen = plain.criterion[len(plain.friction.limit)] - dragged.criterion[len(dragged.friction.limit)]
    name = "viscous friction"
    return fallen > STRONG and dragged.estimate.value(name) > SURE * dragged.estimate.deviation(name)


def _on_drag(dragged: ForceFit, *, taken: bool) -> str:
    """What a slow record says of viscous friction."""
    value, std = (f("viscous friction") for f in (dragged.estimate.value, dragged.estimate.deviation))
    if taken:
        return f"Viscous friction is {value:.3g} N s/m with a standard deviation of {std:.2g} N s/m."
    return (
        f"The record does not show viscous friction: by {SURE:g} standard deviations it is at most "
        f"{max(value, 0.0) + SURE * std:.2g} N s/m; a fast record shows it."
    )


def _on_damping(fit: ForceFit) -> str:
    """What the record says of the elements' damping D_i."""
    if fit.lag is None:
        return (
            "Damping of the elements was not sought: in a slow record it looks like dead time, which no record gave; "
            "add a frequency response."
        )
    time, std = (1e3 * number for number in fit.lag)
    if fit.damped:
        return f"The elements are damped: D = {time:.3g} ms times K, with a standard deviation of {std:.2g} ms."
    speed = float(np.max(np.abs(np.gradient(fit.path, fit.time))))
    most = 1e3 * fit.longest_lag
    if fit.longest_lag * speed > max(fit.friction.limit):
        return "The record does not show damping of the elements, nor bound it: it passes their range too quickly."
    return (
        f"The record does not show damping of the elements: it is too slow, {1e3 * speed:.2g} mm/s at most, to tell "
        f"{time:.2g} ms times K from none; by {SURE:g} standard deviations D is at most {most:.2g} ms times K, which "
        f"leads the deflection by {most * speed * 1e3:.2g} µm there."
    )


def _from_motion(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:  # noqa: ARG001
    """Prediction-error fit with the controller replayed; what no other record gave goes into the machine."""
    fit = motion.identify(record_of(loaded), found.machine, friction_covariance=_shape(found))
    differences = tuple(_differences(found, fit.estimate))
    remarks = [
        f"The motion record shows a {one.name} that differs by {100 * one.size:+.2g} % from the other record, "
        f"{abs(one.size / one.std):.1f} standard deviations: noise does not explain it, the model's form may."
        for one in differences
        if abs(one.size) > SIGMAS * one.std
    ]
    machine, source, e = found.machine, Found(loaded, "motion"), fit.estimate
    if not found.has("response", "dynamics"):
        machine = with_scaled_plant(machine, fit, source)
    if not found.has("hysteresis", "dynamics"):
        machine = with_offset(machine, e.value("offset"), e.deviation("offset"), source)
        machine = with_scaled_friction(machine, fit, source)
    known = found.slow.lag if found.slow else None
    if known is None or fit.lag[1] <= known[1]:  # else the slow record knows the damping better
        machine = with_damping_of_motion(machine, fit, source)
    return _with(found, machine, kind, loaded, MotionStep(fit, differences), [*remarks, *_on_motion(fit)])


def _shape(found: Identified) -> Array | None:
    """Covariance (2 N, 2 N) of stiffnesses [N/m] and limits [m], as the last slow record knows them."""
    if found.slow is None:
        return None
    last = slice(-2 * len(found.slow.friction.limit), None)
    return found.slow.estimate.covariance[last, last]


def _differences(found: Identified, estimate: Estimate) -> Iterator[Difference]:
    """How far the motion record departs from what the others said."""
    gains, delays = found.earlier("rigid body gain"), found.earlier("dead time")
    if gains:
        (gain, gain_std), (delay, delay_std), ts = gains[-1], delays[-1], found.machine.sample_time
        spread = math.hypot(estimate.deviation("mass"), gain_std / gain)
        yield Difference("mass", estimate.value("mass") - 1, spread)
        spread = math.hypot(estimate.deviation("dead time"), delay_std) / ts
        yield Difference("dead time", (estimate.value("dead time") - delay) / ts, spread)
    if found.slow:
        slip, slip_std = found.slow.slip_force()
        spread = math.hypot(estimate.deviation("friction level"), slip_std / slip)
        yield Difference("friction level", estimate.value("friction level") - 1, spread)


def _on_motion(fit: motion.MotionFit) -> Iterator[str]:
    """What the motion record says of damping, and of what friction remembered when it began."""
    time, std = (1e3 * number for number in fit.lag)
    if fit.damped:
        yield f"Motions show damped elements: D = {time:.3g} ms times K, with a standard deviation of {std:.2g} ms."
    else:
        yield (
            f"Motions show no damping of the elements: by {SURE:g} standard deviations D is at most "
            f"{max(time, 0.0) + SURE * std:.2g} ms times K."
        )
    count, size = fit.carried
    if count:
        yield (
            f"{count} of the elements {'is' if count == 1 else 'are'} longer than half the motion record's first way: "
            f"a force from before, {size:.2g} N at most, may stay in {'it' if count == 1 else 'them'} throughout and "
            "then counts as part of the offset."
        )


def _from_dynamics(found: Identified, kind: str, loaded: Loaded, settings: Settings) -> Identified:
    """Inverse dynamics of a fast record, fitted to its first half; what no other record gave goes into the machine.

    Of several fast records mass, delay, drag, asymmetry and offset are the means by their deviations, and the elements
    those of the record that knows the slip force best. Friction that grows with speed and the offset go together: where
    records show different forms of it, both are that record's.
    """
    record = record_of(loaded)
    fit = force.identify(record, DYNAMICS, pass_band=settings.pass_band or FAST_BAND, fit_until=half_of(record))
    if not fit.estimate.deviation("mass") < LOOSE * abs(fit.estimate.value("mass")):
        raise ValueError(
            f"does not excite the axis: its mass, {fit.estimate.value('mass'):.3g} kg, has a standard deviation of "
            f"{fit.estimate.deviation('mass'):.2g} kg; record faster strokes, or name its kind hysteresis"
        )
    steps = [*_steps(found, "dynamics"), Step(kind, loaded, ForceStep(fit, holdable(fit)))]
    fits = [step.gave.fit for step in steps if isinstance(step.gave, ForceStep)]
    source, best = Found(_together(steps), "dynamics"), min(range(len(fits)), key=lambda i: _vagueness(fits[i]))
    machine, remarks = found.machine, [*_on_agreement(steps, ("mass", "delay")), *_on_slip(steps)]
    if found.has("response"):
        remarks += _on_plant(found, fit)
    else:
        inertia = _joint_estimate([one.estimate for one in fits], ("mass", "delay"))
        machine = with_inertia(machine, inertia, source)
        remarks += _on_delay(inertia, machine.sample_time)
    if not found.has("hysteresis"):
        machine = with_friction(machine, fits[best], Found(steps[best].loaded, "dynamics"))
    helds = [step.gave.held for step in steps if isinstance(step.gave, ForceStep) and step.gave.held is not None]
    held, joint = _joint_force(helds, best)
    if not joint:
        source = Found(steps[best].loaded, "dynamics")
    if held.drag is not None or held.asymmetry is not None:
        machine = with_drag(machine, held.drag, held.asymmetry, source)
    machine = with_offset(machine, *held.offset, source)
    step = ForceStep(fit, holdable(fit))
    return _with(found, machine, kind, loaded, step, (_on_offset(helds[-1]), _on_damping(fit), *remarks))


def _steps(found: Identified, kind: str) -> list[Step]:
    """The steps of one kind so far."""
    return [step for step in found.steps if step.kind == kind]


def _together(steps: Sequence[Step]) -> Loaded:
    """The last of the files, with the names and hashes of all."""
    names, hashes = zip(*((step.loaded.name, step.loaded.sha256) for step in steps), strict=True)
    return replace(steps[-1].loaded, name=", ".join(names), sha256=", ".join(hashes))


def _vagueness(fit: ForceFit) -> float:
    """The relative standard deviation of the slip force [1]."""
    slip, std = fit.slip_force()
    return std / slip


def _joint_estimate(estimates: Sequence[Estimate], names: Sequence[str]) -> Estimate:
    """Some parameters of all the estimates together."""
    joint = [combined([(one.value(name), one.deviation(name)) for one in estimates]) for name in names]
    units = tuple(estimates[0].units[estimates[0].names.index(name)] for name in names)
    values, stds = (np.array([one[i] for one in joint]) for i in range(2))
    return Estimate(tuple(names), units, values, np.diag(stds**2))


def _joint_force(helds: Sequence[Holdable], best: int) -> tuple[Holdable, bool]:
    """What a machine file holds of all records together, and whether it is of all: of the best one where their forms
    differ."""
    forms = {(held.drag is None, held.asymmetry is None) for held in helds}
    if len(forms) > 1:
        return helds[best], False
    drag, asymmetry, offset = (
        None if None in parts else combined([part for part in parts if part is not None])[:2]
        for parts in zip(*((held.drag, held.asymmetry, held.offset) for held in helds), strict=True)
    )
    assert offset is not None
    return replace(helds[best], drag=drag, asymmetry=asymmetry, offset=offset), True


def _on_agreement(steps: Sequence[Step], names: Sequence[str]) -> Iterator[str]:
    """In which parameters the last record disagrees with those before it."""
    new = steps[-1].gave.estimate
    for step, name in product(steps[:-1], names):
        old = step.gave.estimate
        pair = [(one.value(name), one.deviation(name)) for one in (old, new)]
        apart = combined(pair)[2]
        if apart > SIGMAS:
            unit, cause = old.units[old.names.index(name)], CAUSES.get(name, "the axis or its surroundings changed")
            said = [f"{show(value, unit)} ± {show(std, unit, 2)}" for value, std in pair]
            yield (
                f"{step.loaded.name} and {steps[-1].loaded.name} disagree in the {name}, {said[0]} and {said[1]}, by "
                f"{apart:.1f} standard deviations ({cause}); the machine file has their mean, with a deviation as wide."
            )


def _on_memory(fit: ForceFit) -> Iterator[str]:
    """What elements may carry from before a slow record."""
    if fit.short:
        span = float(np.ptp(fit.path))
        yield (
            f"The path, {show(span, 'm')} from end to end, is too short for the longest element: the friction may go "
            "on rising beyond it; record slow loops twice as wide."
        )
    if fit.remembered > 0:
        yield (
            f"Friction may carry up to {fit.remembered:.2g} N from before the record, on the mean over its samples, as "
            "part of the offset; the offset's standard deviation covers it."
        )


def _on_slip(steps: Sequence[Step]) -> Iterator[str]:
    """Where the last record's slip force disagrees with those before it."""
    forces = [step.gave.fit.slip_force() for step in steps if isinstance(step.gave, ForceStep)]
    for step, slip in zip(steps[:-1], forces[:-1], strict=True):
        apart = combined([slip, forces[-1]])[2]
        if apart > SIGMAS:
            yield (
                f"{step.loaded.name} and {steps[-1].loaded.name} disagree in the slip force, {slip[0]:.4g} N and "
                f"{forces[-1][0]:.4g} N, by {apart:.1f} standard deviations (temperature, lubrication, preload or "
                "another place of the guide); the machine file has the elements of the record that knows it best."
            )


def _on_plant(found: Identified, fit: ForceFit) -> Iterator[str]:
    """Where a fast record disagrees with the frequency response, whose values the machine file has."""
    (gain, gain_std), (dead, dead_std) = (found.earlier(name)[-1] for name in ("rigid body gain", "dead time"))
    late = dead + lag_of(found.machine) + 0.5 * found.machine.sample_time
    for name, unit, known in (("mass", "kg", (1 / gain, gain_std / gain**2)), ("delay", "s", (late, dead_std))):
        here = fit.estimate.value(name), fit.estimate.deviation(name)
        apart = combined([known, here])[2]
        if apart > SIGMAS:
            yield (
                f"This record's {name}, {show(here[0], unit)}, differs from the frequency response's, "
                f"{show(known[0], unit)}, by {apart:.1f} standard deviations ({CAUSES[name]}); the machine file has "
                "the latter."
            )


def _on_delay(inertia: Estimate, sample_time: float) -> Iterator[str]:
    """The delay with the hold, and that a dead time below none was clipped."""
    delay, std = inertia.value("delay"), inertia.deviation("delay")
    yield (
        f"From a command to the middle of its action it takes {1e3 * delay:.3g} ms with a standard deviation of "
        f"{1e3 * std:.2g} ms, half a sample of hold included."
    )
    if delay < 0.5 * sample_time:
        yield (
            f"The dead time came out {show(0.5 * sample_time - delay, 's')} below none and was set to 0: the position "
            "is logged before its command, or friction bends the force where it is fast."
        )


def half_of(record: Record) -> float:
    """The time [s] up to which a fast record is fitted; the rest of it judges."""
    return 0.5 * record.position.size * record.sample_time


def _on_offset(held: Holdable) -> str:
    """What a fast record says of a constant force."""
    value, std = held.offset
    if held.asymmetry is None:
        return f"A constant force of {value:.3g} N is held beside friction, with a standard deviation of {std:.2g} N."
    share, way = 100 * abs(held.asymmetry[0]), "larger" if held.asymmetry[0] > 0 else "smaller"
    return (
        f"The machine file has friction by direction as a share of the force, {share:.2g} % {way} forwards than the "
        f"mean, and beside it an offset of {value:.3g} N with a standard deviation of {std:.2g} N; the offset above is "
        "what goes with viscous friction of its own for each direction."
    )


_METHODS: Final[Mapping[str, Callable[[Identified, str, Loaded, Settings], Identified]]] = {
    "response": _from_response,
    "excitation": _from_response,
    "hysteresis": _from_hysteresis,
    "motion": _from_motion,
    "dynamics": _from_dynamics,
}
