"""What each kind of record puts into the machine: its values, with the record's hash and their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import norm

from models.friction import elements
from models.identification import modes, motion, response
from models.identification.estimate import Estimate
from models.identification.force_fit import DAMPING, SURE
from models.machine import Machine, Provenance
from models.records.files import Loaded
from models.records.record import Record
from studies.identify_machine.found import SHOWN, Found, identified, own_curve, record_of, with_offset
from studies.identify_machine.friction import from_dynamics, from_hysteresis
from studies.study import Check

LINES: Final = 1200  # of a frequency response that results.json keeps, for the figure
SIGMAS: Final = 3.0  # beyond which two records differ by more than their noise
BY_CHANCE: Final = 1e-3  # how often the check of two records against each other fails although the model is right


def from_response(found: Found, loaded: Loaded) -> Found:
    """P_l from a measured frequency response, or from an excitation."""
    content = loaded.content
    measured = response.measured(content) if isinstance(content, Record) else content
    fit = modes.fit(measured)
    model = modes.model(fit.plant, measured.frequency, measured.sample_time)
    known = bool(np.all(np.isfinite(measured.variance)))
    phase = np.rad2deg(np.unwrap(np.angle(model)))
    phase -= 360 * np.round((phase[0] + 180) / 360)  # a rigid body begins at -180 degrees
    lines = {
        "frequency_Hz": measured.frequency,
        "measured_m_per_N": np.abs(measured.response),
        "measured_deg": phase + np.rad2deg(np.angle(measured.response / model)),
        "modelled_m_per_N": np.abs(model),
        "modelled_deg": phase,
        "residual": np.abs(model - measured.response) / np.abs(measured.response),
        "deviation": np.sqrt(measured.variance) / np.abs(measured.response),
        "coherence": measured.coherence,
        "used": fit.used,
    }
    size = measured.frequency.size  # thousands after one long sweep: as many are shown over a decade as over another
    some = np.unique(np.geomspace(1, size, LINES).astype(int)) - 1 if size > LINES else np.arange(size)
    shown = {
        **{name: values[some] for name, values in lines.items()},
        "lowest_Hz": float(measured.frequency[fit.used][0]),
        "rolling": measured.rolling,
        "criterion": fit.criterion,
        "chi_square": fit.chi_square if known else None,
        "modes": len(fit.plant.modes) - 1,
    }
    said = () if known else ("The response has no stated deviations: all lines count alike, relative to their size.",)
    name = "reduced chi-square of the frequency response"
    checks = (Check(name, fit.chi_square, "1", 3.0, "1 if the model is right"),) if known else ()
    machine = _with_plant(found.machine, fit, loaded)
    found = found.having("response", shown, fit.estimate, said)
    return replace(found, machine=machine, known=found.known | {"plant"}, checks=(*found.checks, *checks))


def _with_plant(machine: Machine, fit: modes.Fit, loaded: Loaded) -> Machine:
    sources = {name: source for name, source in machine.sources.items() if not name.startswith("plant.modes")}
    estimate = fit.estimate
    sources["plant.dead_time"] = identified(loaded, estimate.deviation("dead time"), "s")
    sources["plant.thrust_constant"] = Provenance("derived", "the gains are identified with it as 1")
    for i in range(len(fit.plant.modes)):
        name, where = ("rigid body" if i == 0 else f"mode {i}"), f"plant.modes.{i + 1}"
        sources[f"{where}.gain"] = identified(loaded, estimate.deviation(f"{name} gain"), "1/kg")
        for part, unit in (("frequency", "Hz"), ("damping", "1")):
            rigid = Provenance("derived", "the rigid body")
            sources[f"{where}.{part}"] = (
                rigid if i == 0 else identified(loaded, estimate.deviation(f"{name} {part}"), unit)
            )
    return replace(machine, plant=fit.plant, sources=sources)


def from_motion(found: Found, loaded: Loaded) -> Found:
    """Prediction-error fit with the controller replayed; what no other record gave goes into the machine."""
    fit = motion.identify(record_of(loaded), found.machine, friction_covariance=found.friction_covariance)
    every = max(fit.command.size // SHOWN, 1)
    shown = {
        "time_s": np.arange(fit.command.size)[::every] * found.machine.sample_time,
        "command_N": fit.command[::every],
        "residual_N": (fit.command - fit.modelled)[::every],
        "residual_std_N": float(np.std((fit.command - fit.modelled)[motion.START :])),
        "prediction_error_std_N": float(np.std(fit.prediction_error)),
    }
    checks, said = _agreement(found, fit.estimate)
    said = (*said, *_on_motion(fit))
    machine = _with_motion(found, fit, loaded)
    found = found.having("motion", shown, fit.estimate, said)
    return replace(found, machine=machine, checks=(*found.checks, *checks))


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
    count, force = fit.carried
    if count:
        yield (
            f"{count} of the elements {'is' if count == 1 else 'are'} longer than half the motion record's first way: "
            f"a force from before, {force:.2g} N at most, may stay in {'it' if count == 1 else 'them'} throughout and "
            "then counts as part of the offset."
        )


def _agreement(found: Found, estimate: Estimate) -> tuple[tuple[Check, ...], tuple[str, ...]]:
    """How far the motion record departs from what the others said; a sentence where noise does not explain it."""
    rows = {row["name"]: row for row in found.results.get("estimates", [])}
    twice = []  # name, difference as a share, its standard deviation
    if "plant" in found.known and "rigid body gain" in rows:
        gain, delay, ts = rows["rigid body gain"], rows["dead time"], found.machine.sample_time
        spread = math.hypot(estimate.deviation("mass"), gain["std"] / gain["number"])
        twice.append(("mass", estimate.value("mass") - 1, spread))
        spread = math.hypot(estimate.deviation("dead time"), delay["std"]) / ts
        twice.append(("dead time", (estimate.value("dead time") - delay["number"]) / ts, spread))
    if "hysteresis" in found.results:
        slip = found.results["hysteresis"]
        spread = math.hypot(estimate.deviation("friction level"), slip["slip_std_N"] / slip["slip_N"])
        twice.append(("friction level", estimate.value("friction level") - 1, spread))
    said = tuple(
        f"The motion record shows a {name} that differs by {100 * share:+.2g} % from the other record, "
        f"{abs(share / spread):.1f} standard deviations: noise does not explain it, the model's form may."
        for name, share, spread in twice
        if abs(share) > SIGMAS * spread
    )
    if not twice:
        return (), said
    name = f"largest difference between {len(twice)} values found by two records, in standard deviations"
    limit = float(norm.isf(BY_CHANCE / 2 / len(twice)))
    source = f"exceeded by chance once in {1 / BY_CHANCE:.0f} times (Bonferroni)"
    return (Check(name, max(abs(share) / spread for _, share, spread in twice), "1", limit, source),), said


def _with_motion(found: Found, fit: motion.MotionFit, loaded: Loaded) -> Machine:
    machine, sources, e = found.machine, dict(found.machine.sources), fit.estimate
    level, length = e.deviation("friction level"), e.deviation("presliding length")
    slow = found.results.get("hysteresis", {}).get("damping") or {}
    if "plant" not in found.known:
        machine = replace(machine, plant=fit.machine.plant)
        sources["plant.dead_time"] = identified(loaded, e.deviation("dead time"), "s")
        for i, mode in enumerate(fit.machine.plant.modes):
            spread = abs(mode.gain) * e.deviation("mass") / e.value("mass")
            sources[f"plant.modes.{i + 1}.gain"] = identified(loaded, spread, "1/kg")
    if "offset" not in found.known:
        machine = with_offset(replace(machine, sources=sources), loaded, e.value("offset"), e.deviation("offset"))
        sources = dict(machine.sources)
    if "friction" not in found.known:
        friction = fit.machine.friction
        machine = replace(machine, friction=replace(friction, damping=machine.friction.damping))
        spreads = [k * math.hypot(level, length) for k in friction.stiffness]
        sources["friction.stiffness"] = identified(loaded, spreads, "N/m")
        sources["friction.limit"] = identified(loaded, [x * length for x in friction.limit], "m")
        sources = {name: source for name, source in sources.items() if not name.startswith("presliding")}
        machine = own_curve(replace(machine, sources=sources))
        sources = dict(machine.sources)
    if fit.lag[1] > slow.get("std_s", math.inf):  # the slow record knows the damping better
        return replace(machine, sources=sources)
    machine = replace(machine, friction=elements(machine.friction.stiffness, machine.friction.limit))
    sources["friction.damping"] = Provenance("assumed", f"record {loaded.name} does not show it")
    if fit.damped:  # the time that motions show, and the stiffnesses that the machine now has
        time, std = e.value(DAMPING), e.deviation(DAMPING)
        damping = [time * k for k in machine.friction.stiffness]
        machine = replace(machine, friction=replace(machine.friction, damping=tuple(damping)))
        relative = math.hypot(std / time, level, length)
        sources["friction.damping"] = identified(loaded, [d * relative for d in damping], "N s/m")
    return replace(machine, sources=sources)


STEPS: Final[Mapping[str, Callable[[Found, Loaded], Found]]] = {
    "response": from_response,
    "excitation": from_response,
    "hysteresis": from_hysteresis,
    "motion": from_motion,
    "dynamics": from_dynamics,
}
