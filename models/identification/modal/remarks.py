"""What to say of modes that were identified: what was left out, and where several responses disagree."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from models.identification import modes
from models.identification.estimate import Estimate
from models.identification.force.fit import SPRING
from models.identification.response import FrequencyResponse
from models.quantity import listed, show

TURNED: Final = 2e-4  # share of the samples in which an axis may move backwards; with more, modes come out wrong
MAX_PLAUSIBLE_CHI_SQUARE: Final = 3.0  # reduced chi-square beyond which no plant fits a response
SIGMAS: Final = 3.0  # beyond which two responses differ by more than their noise
OTHER_LEVEL: Final = 1.5  # ratio of two excitations from which on amplitude may be what makes responses differ
SAME_MODE_DISTANCE: Final = 0.1  # relative distance of two frequencies that may be those of one mode
CAUSES: Final = (
    ("rigid body gain", "another payload or thrust constant, or friction that was not constant"),
    ("dead time", "commands or positions logged a sample apart, or another current loop"),
    (modes.LAG, "another setting of the current loop"),
    (modes.DRAG, "another speed or temperature"),
    (SPRING, "friction that grows along the way, as that turns with the direction and a spring does not"),
    ("", "another place of the table, or joints that depend on the amplitude"),
)


@dataclass(frozen=True)
class ResponseStep:
    """What a frequency response gave: the response, measured or from an excitation, and the modes fitted to it.

    together: the modes fitted to this response and to those before it; None for the first one. level [N]: rms of the
    force that excited it, None for a file that does not say.
    """

    measured: FrequencyResponse
    fit: modes.Fit
    together: modes.Fit | None = None
    level: float | None = None

    @property
    def estimate(self) -> Estimate:
        """The plant's parameters [SI]."""
        return self.fit.estimate


def bent(measured: FrequencyResponse) -> bool:
    """Whether an axis that was to roll moved backwards for long enough to bend its response."""
    return measured.turned > TURNED


def refuted(step: ResponseStep) -> bool:
    """Whether no rigid body with modes fits a response within the scatter of its lines."""
    return step.fit.chi_square > MAX_PLAUSIBLE_CHI_SQUARE and bool(np.all(np.isfinite(step.measured.variance)))


def on_turning(measured: FrequencyResponse) -> Iterator[str]:
    """That the axis moved backwards where it was to roll, and what to do."""
    if bent(measured):
        yield (
            f"In {100 * measured.turned:.2g} % of the samples the axis moved backwards: friction was not constant, and "
            "the response is bent where the axis was shaken most, by more than the deviations say. Roll faster, or "
            "excite with less force there, as by the references that --write-references makes of the identified file."
        )


def on_refuted(step: ResponseStep) -> Iterator[str]:
    """That no plant fits a response, and what to do."""
    if refuted(step):
        yield (
            f"No rigid body with modes fits the response (reduced chi-square {step.fit.chi_square:.3g}, at most "
            f"{MAX_PLAUSIBLE_CHI_SQUARE:g}): the excitation may have turned a part of the axis, such as one side of a "
            "gantry, or changed its modes. Excite with less force, or roll faster."
        )


def on_response(fit: modes.Fit, measured: FrequencyResponse) -> Iterator[str]:
    """What a response shows beside modes, what was not a mode, and what was clipped."""
    yield from on_turning(measured)
    if measured.settled > 0:
        lowest = measured.frequency[fit.used][0]
        foreign = [f"{f:.4g} Hz" for f in measured.frequency[~fit.used] if f > lowest]
        if foreign:
            yield (
                f"Another signal stands on the excitation's line at {listed(foreign)}, as a ripple does that the axis "
                "passes as often in each period: it is left out. Roll a little slower or faster to tell the two apart."
            )
    if not np.all(np.isfinite(measured.variance)):
        yield "The response has no stated deviations: all lines count alike, relative to their size."
    if fit.lag > 0:
        std = fit.estimate.deviation(modes.LAG)
        yield (
            f"The current loop lags by {show(fit.lag, 's')} with a standard deviation of {show(std, 's', 2)}, beside "
            "the dead time; in a machine file this is the effect current_loop_lag."
        )
    if fit.drag > 0:
        std = fit.estimate.deviation(modes.DRAG)
        yield f"Viscous friction is {fit.drag:.3g} N s/m with a standard deviation of {std:.2g} N s/m."
    yield from _on_spring(fit)
    late = fit.plant.dead_time + fit.lag + measured.held / 2
    if measured.hold is not None:
        yield (
            f"The log has a sample every {show(measured.sample_time, 's')}; a command is taken to be held for the "
            f"{show(measured.hold, 's')} of the controller."
        )
    if measured.sample_time > 0:
        yield f"From a command to the middle of its action it takes {1e3 * late:.4g} ms, half its hold included."
    if fit.early < 0:
        yield (
            f"The fitted dead time was negative ({show(fit.early, 's')}) and was set to 0: the position is logged "
            "before its command, or the sample time is another."
        )
    richer = fit.orders[-1] if fit.orders else None
    if richer is not None and any(richer.faults):
        found = [
            f"{row[1]:.4g} Hz ({fault})" for row, fault in zip(richer.triples, richer.faults, strict=True) if fault
        ]
        yield f"Looked at up to {len(richer.faults)} modes; of those, {listed(found)} were not modes."


def _on_spring(fit: modes.Fit) -> Iterator[str]:
    """What a response says of a spring to ground."""
    if SPRING in fit.estimate.names:
        std = fit.estimate.deviation(SPRING)
        yield (
            f"A spring to ground of {fit.spring:.4g} N/m with a standard deviation of {std:.2g} N/m pulls at the axis: "
            "the force rises in proportion to the way that it rolls; in a machine file this is the effect cable_spring."
        )
    elif fit.spring > 0:
        yield f"The spring to ground of {fit.spring:.4g} N/m, which the machine file states, is in the model."


def on_disagreement(names: Sequence[str], steps: Sequence[ResponseStep]) -> Iterator[str]:
    """Which parameter differs between which two responses, by how many deviations, and what may cause it."""
    for (one, first), (other, second) in combinations(zip(names, steps, strict=True), 2):
        counts = [len(step.fit.plant.modes) - 1 for step in (first, second)]
        if counts[0] != counts[1]:
            yield f"{one} alone shows {counts[0]} vibration modes, {other} alone {counts[1]}."
        why = ""
        if first.level and second.level and not 1 / OTHER_LEVEL < first.level / second.level < OTHER_LEVEL:
            levels = f"{show(first.level, 'N', 3)} and {show(second.level, 'N', 3)}"
            why = f"excited with {levels} rms: the response depends on the amplitude"
        for name, values, far in surely_apart(first.fit.estimate, second.fit.estimate):
            cause = why or next(cause for begin, cause in CAUSES if name.startswith(begin))
            unit = first.fit.estimate.units[first.fit.estimate.names.index(name)]
            yield (
                f"{one} and {other} disagree in the {name}, {show(values[0], unit)} and {show(values[1], unit)}, by "
                f"{far:.1f} standard deviations ({cause}); the machine file has the value of the fit to all together, "
                "with a deviation as wide."
            )


def on_one_alone(names: Sequence[str], steps: Sequence[ResponseStep], joint: Estimate) -> Iterator[str]:
    """What one response alone shows, where the fit to all together surely has another value."""
    for record, step in zip(names, steps, strict=True):
        others = [one.estimate for one in steps if one is not step]
        for name, (together, alone), _ in surely_apart(joint, step.estimate):
            if any(_twin(joint, other, name) for other in others):
                continue  # which is told as a disagreement
            unit = joint.units[joint.names.index(name)]
            yield (
                f"{record} alone shows a {name} of {show(alone, unit)}, and the fit to all together one of "
                f"{show(together, unit)}; the machine file has the latter, with a deviation as wide."
            )


def on_left_out(steps: Sequence[tuple[str, ResponseStep]]) -> Iterator[str]:
    """That the plant is not from these, by name: the axis moved backwards, or no plant fits them."""
    back = [name for name, step in steps if bent(step.measured)]
    if back:
        yield f"The plant is that of the other responses: {listed(back)} went backwards, and is left out of it."
    refuted_ones = [name for name, _ in steps if name not in back]
    if refuted_ones:
        yield (
            f"The plant is that of the other responses: no rigid body with modes fits {listed(refuted_ones)}, which is "
            "left out of it."
        )


def surely_apart(one: Estimate, other: Estimate) -> Iterator[tuple[str, tuple[float, float], float]]:
    """Parameters of both that differ surely: name, both values [SI], and how many deviations [1]. Modes go by their
    frequencies; dead time and lag are compared only where both responses tell them apart."""
    for name in one.names:
        twin = _twin(one, other, name)
        if twin is None or (
            name in {"dead time", modes.LAG} and (modes.LAG in one.names) != (modes.LAG in other.names)
        ):
            continue
        values = one.value(name), other.value(twin)
        far = abs(values[0] - values[1]) / max(math.hypot(one.deviation(name), other.deviation(twin)), 1e-300)
        if far > SIGMAS:
            yield name, values, far


def _twin(one: Estimate, other: Estimate, name: str) -> str | None:
    """The other estimate's name of the same parameter, of modes the one of the nearest frequency, or None."""
    if not name.startswith("mode "):
        return name if name in other.names else None
    _, number, part = name.split()
    natural = one.value(f"mode {number} frequency")
    near = {each: abs(other.value(each) / natural - 1) for each in other.names if each.endswith("frequency")}
    best = min(near, key=lambda each: near[each], default="")
    return f"{best.removesuffix('frequency')}{part}" if best and near[best] < SAME_MODE_DISTANCE else None
