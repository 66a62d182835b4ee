"""Which effect: the catalogue's effects one after another into the model, each with all that is nominal re-fitted.

Forwards: of the effects that gain more on held-out motions than any did where nothing was wrong, the most promising are
fitted with everything else and the best is kept; then all are looked at again, because one effect can hide another.
What the effects make of each other is looked at in the end (orders.py). A class of effects may have two members (two
time constants) before a second class is looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, amplitudes, at_bounds, fit
from diagnosis.model.parallel import parallel_map
from diagnosis.null import LEAST
from diagnosis.refit import started, weighed
from diagnosis.which.command_jitter import Lateness, lateness
from diagnosis.which.random_force import Shaking, shaking
from diagnosis.which.scan import Columns, Finding, freed, scan
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.records.record import Record

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

LINE: Final = 40.0  # -2 log likelihood that a random force has to gain
SHARE: Final = 0.04  # of what is above the floor that an effect has to gain
MOST: Final = 3  # classes of effects in one answer
TRIED: Final = 3  # findings that are fitted with everything else before one is chosen
WORTH: Final = 0.25  # of the best finding's gain that another needs in order to be tried
FORM: Final = 0.05  # of the first effect's gain that a further one needs: the first may have another form than its law
ANOTHER: Final = 0.3  # of what others gained, from which on an effect at its bounds is more than their form's error
REST: Final = 0.15  # of what the first leaves above every floor; a further effect needs no more than that
SECOND: Final = 60.0  # chi-square that a further effect has to gain
DULL: Final = 10.0  # chi-square below which an effect gains nothing
STEADY: Final = 0.5  # of a random force's mean power that is there half of the time
MUCH: Final = 200.0  # chi-square that an effect gains where the starts may have stood in for it


@dataclass(frozen=True)
class Step:
    """One stage of the search: the model as it was fitted, and what every effect would gain beside it."""

    fitted: Fit
    findings: tuple[Finding, ...]
    shaking: Shaking
    lateness: Lateness
    rivals: tuple[tuple[str, float], ...] = ()  # effects that were tried for this stage, and the cost with each


def search_effects(
    nominal: Fit,
    records: Sequence[Record],
    segment: NDArray[np.int64],
    thresholds: Mapping[str, float],
    floors: Array,
    left_out: Collection[str] = (),
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Step, ...]:
    """The stages of the search: the nominal re-fit first, then with one effect more each time.

    floors: chi-square (draws,) [1] that complete models leave. An effect that takes off a few per cent of what is above
    them names nothing.
    """
    first, known = _step(nominal, records, segment, left_out)
    steps, aside = [first], set[str]()
    while True:
        here = steps[-1]
        strong = _strong(steps, thresholds, floors, aside)
        shaken = here.shaking
        if _shakes(here, strong, thresholds, left_out):
            say(f"fitting a random force about {shaken.resonance.frequency:.3g} Hz")
            candidate = replace(here.fitted.candidate, shaken=(*here.fitted.candidate.shaken, shaken.resonance))
            fitted = fit(candidate, records, paths=here.fitted.paths, iterations=4, walk=here.fitted.walk)
            step, known = _step(fitted, records, segment, {*left_out, *_dull(steps)})
            steps.append(step)
            continue
        if not strong:
            return tuple(steps)
        say(f"fitting {', '.join(finding.effect.name for finding in strong)} with all that is nominal")
        fits = parallel_map(partial(_with, here.fitted, records=records), [finding.effect for finding in strong])
        tried = [(finding.effect.name, fitted) for finding, fitted in zip(strong, fits, strict=True)]
        aside |= {name for name, one in tried if _opposed(one, name)}  # or it would be named for the form of the first
        if here.fitted.candidate.found:
            large = ANOTHER * (nominal.cost - here.fitted.cost)
            aside |= {name for name, one in tried if _bent(one, name) and here.fitted.cost - one.cost < large}
        tried = [(name, fitted) for name, fitted in tried if name not in aside]
        if not tried:
            continue
        best = min((fitted for _, fitted in tried), key=lambda fitted: fitted.cost)
        if here.fitted.cost - best.cost > MUCH:
            best = started(best, records)
        if best.candidate.rough:  # some of the white force was this effect
            best = weighed(best, records)
        gained = here.fitted.cost - best.cost
        if gained < LEAST:
            aside |= {name for name, _ in tried}
            continue
        found = best.candidate.found
        if len({effect.name for effect in found}) > MOST or len(found) > MOST + 2:
            return tuple(steps)
        rivals = sorted(((name, fitted.cost) for name, fitted in tried), key=lambda rival: rival[1])
        step, known = _step(best, records, segment, {*left_out, *_dull(steps)}, known)
        steps.append(replace(step, rivals=tuple(rivals)))
        aside = set()


def _step(
    fitted: Fit,
    records: Sequence[Record],
    segment: NDArray[np.int64],
    left_out: Collection[str],
    known: Columns = MappingProxyType({}),
) -> tuple[Step, Columns]:
    """A stage, and the scan's columns for the next: an effect changes those of others to second order only."""
    own = freed(fitted, segment)
    findings, columns = scan(fitted, records, own, left_out, known)
    return Step(fitted, tuple(findings), shaking(fitted, records, own), lateness(fitted, records)), columns


def _dull(steps: Sequence[Step]) -> set[str]:
    """Names of effects that gained nothing at the first stage nor at the second: they are not looked at again."""
    if len(steps) < 2:
        return set()
    gains = {finding.effect.name for step in steps[:2] for finding in step.findings if finding.held_out > DULL}
    return {finding.effect.name for finding in steps[0].findings} - gains


def _shakes(here: Step, strong: Sequence[Finding], thresholds: Mapping[str, float], left_out: Collection[str]) -> bool:
    """Whether a random force is the next to go into the model."""
    if "floor_vibration" in left_out or len(here.fitted.candidate.shaken) >= MOST:
        return False
    if here.shaking.steady < STEADY:
        return False
    best = strong[0].held_out if strong else 0.0
    return here.shaking.gain > max(thresholds.get("floor_vibration", LINE), LINE, WORTH * best)


def _strong(
    steps: Sequence[Step], thresholds: Mapping[str, float], floors: Array, aside: Collection[str] = ()
) -> list[Finding]:
    """The findings to be tried next: above their thresholds, above the form error of what is in the model already, and
    not put `aside`."""
    here = steps[-1]
    inside = [effect.name for effect in here.fitted.candidate.found]
    gained = steps[0].fitted.cost - here.fitted.cost
    left = float(here.fitted.innovations @ here.fitted.innovations)
    allowed = []
    for finding in here.findings:
        name = finding.effect.name
        least = LEAST if name in inside or not inside else further(gained, left, floors)
        needed = max(thresholds.get(name, LEAST), least, SHARE * (left - float(np.mean(floors))))
        if finding.held_out > needed and inside.count(name) < 2 and name not in aside:
            allowed.append(finding)
    if not allowed:
        return []
    own = [finding for finding in allowed if finding.effect.name in inside]
    if own and own[0].held_out > 0.5 * allowed[0].held_out:
        return own[:1]
    return [finding for finding in allowed[:TRIED] if finding.held_out > WORTH * allowed[0].held_out]


def further(gained: float, left: float, floors: Array) -> float:
    """Chi-square that an effect has to gain beside others, which gained so much and left so much: more than the others'
    form may be wrong by, or a good part of what is surely above the floor (draws,); all [1]."""
    above = left - float(np.max(floors))
    return max(SECOND, min(FORM * gained, REST * above) if above > 0 else FORM * gained)


def _bent(fitted: Fit, name: str) -> bool:
    """Whether an effect of this kind had to leave its prior range beside others: it takes up what is wrong with their
    form."""
    return any(
        at_bounds(effect, fitted.candidate.layout.machine.priors)
        for effect in fitted.candidate.found
        if effect.name == name
    )


def _opposed(fitted: Fit, name: str) -> bool:
    """Whether members of this kind, the machine file's among them, take from each other as tried: they draw another
    form together."""
    sizes = [size for effect in fitted.candidate.effects if effect.name == name for size in amplitudes(effect)]
    return min(sizes, default=0.0) < 0 < max(sizes, default=0.0)


def _with(fitted: Fit, effect: Effect, records: Sequence[Record]) -> Fit:
    candidate = replace(fitted.candidate, effects=in_order((*fitted.candidate.effects, effect)))
    return fit(candidate, records, paths=fitted.paths, iterations=8, walk=fitted.walk)
