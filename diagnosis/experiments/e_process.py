"""How sure a name is after several looks at growing records: e-values on each new record, which chose nothing.

Who looks again after every record, and stops at a name, has that many chances of a false one. So what a look names is
tested on the record that comes next, before that record is used to choose anything; as is what came nearest to a name
where a look gave none, so that a small effect is confirmed by the record that makes it visible. H0: nothing but the
nominal parameters, as priors state them. H1: those effects, of the sizes that the look before found, each to within
SPREAD. Both predict the new record from the earlier ones. Given the past, LR = p1(new) / p0(new) has the mean 1 under
H0, so it is an e-value (V. Vovk, R. Wang, Annals of Statistics 49, 2021). What is multiplied up is

    e = (1 + LR^TEMPER) / 2.

It has a mean of 1 at most, too: by Jensen's inequality for the power; and as a mean with the constant 1, so that no
wrong choice loses more than half of what is there. The power allows for a variance of what is left that is 1 / TEMPER
times as large as stated (for a Gaussian shift by d, LR^t has a mean of exp(t (t c - 1) d^2 / 2), c times the variance),
as the thresholds of one look do. The product over the looks is a supermartingale under H0. By Ville's inequality it
ever reaches 1 / a with a probability of a at most, however many looks there are and whenever one stops.

In the linearised model of a look both marginal likelihoods are Gaussian, and p(new) = p(all) / p(earlier):

    log p(r) = -(r'r - b'M^-1 b) / 2 - log det(M) / 2,   M = I + A'A,  b = A'r,

r: the whitened innovations, A: how they depend on the parameters, in units of their priors. The first record chooses
the first names, so that it counts as 1. Not covered: laws that differ from the nominal machine and from the catalogue
alike; the verdict's own rules stand against these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from diagnosis.baseline import Baseline
from diagnosis.experiments.look import Look
from diagnosis.model.fit import Fit, weights
from diagnosis.model.kalman import STARTING
from diagnosis.model.residual import Residual, columns, evaluate
from diagnosis.which.detectors.command_jitter import lateness
from models.effects.base import Effect, Place
from models.effects.catalogue import in_order

Array = NDArray[np.float64]

TEMPER: Final = 0.5  # power of the likelihood ratio: 1 over the safety that thresholds of one look have
SPREAD: Final = 0.5  # deviation of an effect's size in a new record from the one found before, relative
CERTAIN: Final = 50.0  # log of the likelihood ratio of what cannot be where nothing is wrong, as a replay that fails
LATE_COMMAND_STDS: Final = 4.0  # deviations of late commands that clean tables reach, where the noise makes 1


@dataclass(frozen=True)
class EProcess:
    """Logarithms [1] of the products so far: of all that was named against nothing, and of each name against the model
    without it."""

    any: float = 0.0
    names: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def of(self, name: str) -> float:
        """The logarithm [1] of a name's product; 0 where it was never tested."""
        return self.names.get(name, 0.0)

    def is_confirmed(self, name: str, chance: float) -> bool:
        """Whether a name may be told, if false ones are to come up with this probability [1] at most."""
        return min(self.any, self.of(name)) >= -math.log(chance)

    def after(self, whole: float, each: Mapping[str, float]) -> EProcess:
        """With the logarithms of the likelihood ratios [1] of one more record."""
        names = dict(self.names)
        for name, ratio in each.items():
            names[name] = names.get(name, 0.0) + log_e_value(ratio)
        return EProcess(self.any + log_e_value(whole), names)

    def decades(self) -> dict[str, Any]:
        """The decimal logarithms of the e-values [1], of anything and of each name, as a course holds them."""
        decade = math.log(10)
        each = {name: log / decade for name, log in self.names.items()}
        return {"log10_e_value": self.any / decade, "log10_e_values": each}


def log_e_value(ratio: float) -> float:
    """Logarithm of (1 + LR^TEMPER) / 2 [1], of that of LR."""
    return float(np.logaddexp(0.0, TEMPER * ratio) - np.log(2.0))


def tested(before: Look, now: Baseline, process: EProcess) -> EProcess:
    """The e-process with the records of `now` that came after the look `before`, by what that tried; as it is where
    that was nothing. Logarithms [1]; of interpolated samples, which tell nothing new, less by their number to one that
    was logged."""
    named = [name for name in before.tried if name in now.machine.kinds]
    fresh = len(now.records) - len(before.baseline.records)
    if not named or fresh < 1:
        return process
    logged = {name: _in_the_log(name, before, now, fresh) for name in named if _is_logged(name, before)}
    random = _of_random_forces(before, now, fresh)
    forces = {name: [one for one in before.effects if one.name == name] for name in named}
    forces = {name: effects for name, effects in forces.items() if effects}
    ratios = _ratios(now, forces, fresh) if forces else {}
    each = {**logged, **{name: random for name in named if name not in logged and name not in forces}, **ratios}
    parts = [*logged.values(), *([random] if before.fitted.candidate.random_forces else [])]
    parts += [ratios[""]] if ratios else []
    if not parts:
        return process
    whole = float(np.logaddexp.reduce(parts) - np.log(len(parts)))  # a mean of e-values is one, their product is not
    return process.after(whole, {name: each[name] for name in named})


def _ratios(now: Baseline, forces: Mapping[str, list[Effect]], fresh: int) -> dict[str, float]:
    """Logarithms of LR [1] on so many last records: "" of all effects against none, and of each against all others."""
    fitted, records = now.nominal, now.records
    trials = [in_order((*fitted.candidate.effects, *effects)) for effects in forces.values()]
    moved = columns(fitted.candidate, trials, records, fitted.paths, fitted.residuals, fitted.walk)
    moved = moved * weights(records)[:, None]
    earlier = sum(record.position.size for record in records[:-fresh])
    base, slopes = at_the_priors(fitted)

    def predicted(kept: NDArray[np.bool_]) -> float:
        shifts = moved[:, kept]
        return predictive(base + shifts.sum(axis=1), np.hstack([slopes, SPREAD * shifts]), earlier)

    every = np.ones(len(trials), bool)
    whole = predicted(every)
    ratios = {"": whole - predicted(~every)}
    for i, name in enumerate(forces):
        ratios[name] = whole - predicted(np.arange(len(trials)) != i)
    return {name: ratio / _interpolation(now) for name, ratio in ratios.items()}


def _interpolation(now: Baseline) -> int:
    """How many samples the records have to one that was logged; the others tell nothing new."""
    return max(record.every for record in now.records)


def at_the_priors(fitted: Fit) -> tuple[Array, Array]:
    """What is left [1] with every nominal parameter at its prior's mean (n,), and how it depends on them, in deviations
    of their priors (n, P), as the fit's linearisation has it."""
    deviation = fitted.candidate.layout.deviation
    slopes = fitted.slopes * deviation
    return fitted.innovations - slopes @ (fitted.candidate.theta / deviation), slopes


def predictive(left: Array, slopes: Array, earlier: int) -> float:
    """log p [1] of the samples from `earlier` on, given those before: left (n,) [1] at the priors' means, slopes (n, P)
    [1] in deviations of the priors."""
    return evidence_of(left, slopes) - evidence_of(left[:earlier], slopes[:earlier])


def evidence_of(left: Array, slopes: Array) -> float:
    """log p [1] of what is left (n,), but for a constant a sample, with the parameters integrated out."""
    inner = np.eye(slopes.shape[1]) + slopes.T @ slopes
    onto = slopes.T @ left
    factor = cho_factor(inner)
    return float(-0.5 * (left @ left - onto @ cho_solve(factor, onto)) - np.sum(np.log(np.diag(factor[0]))))


def _is_logged(name: str, before: Look) -> bool:
    return before.baseline.machine.kinds[name].shown_in() == "log"


def _in_the_log(name: str, before: Look, now: Baseline, fresh: int) -> float:
    """Logarithm of LR [1] of what no force law shows: a replay that fails again, commands that are late again."""
    if Place.CONTROL in now.machine.kinds[name].hooks:
        checked = [one.replays for one in now.replays[-fresh:] if one.checked]
        return 0.0 if not checked else -CERTAIN if all(checked) else CERTAIN
    last = replace(now.nominal, residuals=now.nominal.residuals[-fresh:], paths=now.nominal.paths[-fresh:])
    seen, known = lateness(last, now.records[-fresh:]), lateness(before.baseline.nominal, before.baseline.records)
    if not np.isfinite(seen.scatter) or seen.scatter <= 0:
        return 0.0
    expected, found = known.size**2 / seen.scatter / LATE_COMMAND_STDS, np.sqrt(seen.gain) / LATE_COMMAND_STDS
    return float(expected * (found - 0.5 * expected)) / _interpolation(now)


def _of_random_forces(before: Look, now: Baseline, fresh: int) -> float:
    """Logarithm of LR [1] of the random forces in the model: what the filter with them leaves of the last records."""
    forces = before.fitted.candidate.random_forces
    if not forces:
        return 0.0
    fitted = now.nominal
    other = replace(fitted.candidate, random_forces=forces)
    after = evaluate(other, now.records, fitted.paths, fitted.walk)
    pairs = zip(fitted.residuals[-fresh:], after[-fresh:], strict=True)
    return 0.5 * sum(_cost(without) - _cost(within) for without, within in pairs) / _interpolation(now)


def _cost(left: Residual) -> float:
    """-2 log likelihood [1] of a record, but for a constant."""
    counted = left.innovations[STARTING:]
    return float(counted @ counted + 2 * counted.size * np.log(left.deviation))
