"""What each kind of record puts into the machine: its values, with the record's hash and their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from models.identification import force, inverse_dynamics, modes, motion, response
from models.identification.estimate import Estimate, not_identifiable
from models.identification.force_fit import SURE, ForceFit
from models.machine import Machine, Provenance
from models.plant import Plant
from models.record import Record
from models.record_file import Loaded
from studies.command import Check

SIGMAS: Final = 3.0  # beyond which two records differ by more than their noise
SHOWN: Final = 3000  # samples that results.json keeps of a signal, for the figures
PUBLISHED: Final = {"cutoff": 100.0, "factor": 10}  # of the inverse dynamics as EMPS's authors do it


@dataclass(frozen=True)
class Found:
    """The machine so far, which parts are identified, and what goes into the results."""

    machine: Machine
    pass_band: float | None = None
    known: frozenset[str] = frozenset()
    results: Mapping[str, Any] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    said: tuple[str, ...] = ()

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


def from_response(found: Found, loaded: Loaded) -> Found:
    """P_l from a measured frequency response, or from an excitation."""
    content = loaded.content
    measured = response.measured(content) if isinstance(content, Record) else content
    fit = modes.fit(measured)
    model = modes.model(fit.plant, measured.frequency, measured.sample_time)
    known = bool(np.all(np.isfinite(measured.variance)))
    phase = np.rad2deg(np.unwrap(np.angle(model)))
    phase -= 360 * np.round((phase[0] + 180) / 360)  # a rigid body begins at -180 degrees
    shown = {
        "frequency_Hz": measured.frequency,
        "measured_m_per_N": np.abs(measured.response),
        "measured_deg": phase + np.rad2deg(np.angle(measured.response / model)),
        "modelled_m_per_N": np.abs(model),
        "modelled_deg": phase,
        "residual": np.abs(model - measured.response) / np.abs(measured.response),
        "deviation": np.sqrt(measured.variance) / np.abs(measured.response),
        "coherence": measured.coherence,
        "used": fit.used,
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
    sources["plant.dead_time"] = _identified(loaded, estimate.deviation("dead time"), "s")
    sources["plant.thrust_constant"] = Provenance("derived", "the gains are identified with it as 1")
    for i in range(len(fit.plant.modes)):
        name, where = ("rigid body" if i == 0 else f"mode {i}"), f"plant.modes.{i + 1}"
        sources[f"{where}.gain"] = _identified(loaded, estimate.deviation(f"{name} gain"), "1/kg")
        for part, unit in (("frequency", "Hz"), ("damping", "1")):
            rigid = Provenance("derived", "the rigid body")
            sources[f"{where}.{part}"] = (
                rigid if i == 0 else _identified(loaded, estimate.deviation(f"{name} {part}"), unit)
            )
    return replace(machine, plant=fit.plant, sources=sources)


def _identified(loaded: Loaded, std: float | Iterable[float], unit: str) -> Provenance:
    spread = f"{std:.3g}" if isinstance(std, float) else "[" + ", ".join(f"{one:.3g}" for one in std) + "]"
    text = f"record {loaded.name} sha256 {loaded.sha256}, std {spread} {unit}"
    return Provenance("identified", text.removesuffix(" 1"))


def from_hysteresis(found: Found, loaded: Loaded) -> Found:
    """The friction elements from a slow record; mass and dead time as known so far."""
    plant, ts = found.machine.plant, found.machine.sample_time
    dead_time = [row["std"] for row in found.results.get("estimates", []) if row["name"] == "dead time"]
    terms = force.Terms(
        mass=_mass(plant),
        known_delay=plant.dead_time + 0.5 * ts,
        known_delay_std=max(dead_time, default=0.0),
        damped=bool(dead_time),
    )
    fit = force.identify(_record(loaded), terms, pass_band=found.pass_band or 20.0)
    slip, spread = fit.slip_force()
    said = (
        f"At full slip the friction is {slip:.4g} N with a standard deviation of {spread:.2g} N.",
        _on_damping(fit),
    )
    shown = {**_force(fit), "slip_N": slip, "slip_std_N": spread}
    machine = _with_friction(found.machine, fit, loaded)
    found = found.having("hysteresis", shown, fit.estimate, said)
    return replace(found, machine=machine, known=found.known | {"friction"})


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


def _force(fit: ForceFit) -> dict[str, Any]:
    every = max(fit.time.size // SHOWN, 1)
    top = 2 * max(fit.friction.limit)
    distance = np.geomspace(min(fit.friction.limit) / 3, 1.5 * top, 60)
    climbed, std = fit.curve(distance)
    return {
        "time_s": fit.time[::every],
        "path_m": fit.path[::every],
        "measured_N": fit.measured[::every],
        "modelled_N": fit.modelled[::every],
        "rolling_N": fit.rolling[::every],
        "error": fit.error(used=True),
        "criterion": fit.criterion,
        "elements": len(fit.friction.limit),
        "damping": fit.lag and {"time_s": fit.lag[0], "std_s": fit.lag[1], "shown": fit.damped},
        "curve": {"distance_m": distance, "climbed_N": climbed, "std_N": std},
    }


def _with_friction(machine: Machine, fit: ForceFit, loaded: Loaded) -> Machine:
    count, std = len(fit.friction.limit), fit.estimate.deviations
    sources = {name: source for name, source in machine.sources.items() if not name.startswith("presliding")}
    sources["friction.stiffness"] = _identified(loaded, std[-2 * count : -count].tolist(), "N/m")
    sources["friction.limit"] = _identified(loaded, std[-count:].tolist(), "m")
    if fit.damped:
        sources["friction.damping"] = _identified(loaded, fit.damping_std().tolist(), "N s/m")
    else:
        sources["friction.damping"] = Provenance("assumed", f"record {loaded.name} does not show it")
    return _own_curve(replace(machine, friction=fit.friction, sources=sources))


def _own_curve(machine: Machine) -> Machine:
    """Facts of the hysteresis curve that a nominal machine states no longer hold: they follow from the elements."""
    sources = dict(machine.sources)
    sources["presliding.coulomb_force"] = Provenance("derived", "from the friction elements")
    return replace(machine, sources=sources)


def from_motion(found: Found, loaded: Loaded) -> Found:
    """Prediction-error fit with the controller replayed; what no other record gave goes into the machine."""
    fit = motion.identify(_record(loaded), found.machine)
    every = max(fit.command.size // SHOWN, 1)
    shown = {
        "time_s": np.arange(fit.command.size)[::every] * found.machine.sample_time,
        "command_N": fit.command[::every],
        "residual_N": (fit.command - fit.modelled)[::every],
        "residual_std_N": float(np.std((fit.command - fit.modelled)[motion.START :])),
        "prediction_error_std_N": float(np.std(fit.prediction_error)),
    }
    checks, said = _agreement(found, fit.estimate)
    machine = _with_motion(found, fit, loaded)
    found = found.having("motion", shown, fit.estimate, said)
    return replace(found, machine=machine, checks=(*found.checks, *checks))


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
    name = "largest difference between values found by two records"
    source = "mass, friction level; dead time as a share of the sample time"
    return (Check(name, max(abs(share) for _, share, _ in twice), "1", 0.02, source),), said


def _with_motion(found: Found, fit: motion.MotionFit, loaded: Loaded) -> Machine:
    machine, sources, e = found.machine, dict(found.machine.sources), fit.estimate
    if "plant" not in found.known:
        machine = replace(machine, plant=fit.machine.plant)
        sources["plant.dead_time"] = _identified(loaded, e.deviation("dead time"), "s")
        for i, mode in enumerate(fit.machine.plant.modes):
            spread = abs(mode.gain) * e.deviation("mass") / e.value("mass")
            sources[f"plant.modes.{i + 1}.gain"] = _identified(loaded, spread, "1/kg")
    if "friction" not in found.known:
        friction = fit.machine.friction
        machine = replace(machine, friction=friction)
        level, length = e.deviation("friction level"), e.deviation("presliding length")
        sources["friction.stiffness"] = _identified(
            loaded, [k * math.hypot(level, length) for k in friction.stiffness], "N/m"
        )
        sources["friction.limit"] = _identified(loaded, [x * length for x in friction.limit], "m")
        sources = {name: source for name, source in sources.items() if not name.startswith("presliding")}
        return _own_curve(replace(machine, sources=sources))
    return replace(machine, sources=sources)


def from_dynamics(found: Found, loaded: Loaded) -> Found:
    """Inverse dynamics of a fast record: the published least squares, then this project's friction, both held out."""
    record = _record(loaded)
    half = 0.5 * record.position.size * record.sample_time
    ladder = [
        ("elements and viscous friction by direction", force.Terms(viscous=True, by_direction=True)),
        ("the same and a delay", force.Terms(viscous=True, by_direction=True, delay=True)),
        ("the same and a bend of the viscous friction",
         force.Terms(viscous=True, by_direction=True, bent=True, delay=True)),
        ("the same and damping of the elements, where it shows",
         force.Terms(viscous=True, by_direction=True, bent=True, delay=True, damped=True)),
    ]  # fmt: skip
    band = found.pass_band or 40.0
    fits = [(name, force.identify(record, terms, pass_band=band, fit_until=half)) for name, terms in ladder]
    window = fits[0][1].time[[0, -1]]
    rows = [*_published(record, half, window)]
    rows += [{"model": name, "fitted": fit.error(used=True), "held_out": fit.error(used=False)} for name, fit in fits]
    best = fits[-1][1]
    slip, spread = best.slip_force()
    shown = {**_force(best), "ladder": rows, "published": _reproduced(record), "slip_N": slip, "slip_std_N": spread,
             "half_s": half}  # fmt: skip
    said = (
        "Viscous friction and offset are no part of a machine file's rolling friction: they are reported, and the "
        "simulation of the other studies goes without them.",
        _on_damping(best),
    )
    machine = _with_dynamics(found, best, loaded)
    found = found.having("dynamics", shown, best.estimate, said)
    name = "held-out force error, over that of the published model by direction"
    check = Check(name, rows[-1]["held_out"] / rows[1]["held_out"], "1", 1.0, "second half of the record, not fitted")
    known = found.known | {"plant", "friction"}
    return replace(found, machine=machine, known=known, checks=(*found.checks, check))


def _published(record: Record, half: float, window: Any) -> Iterable[dict[str, Any]]:
    """The authors' two models, fitted to the first half and judged on the same stretch as the others."""
    for name, by_direction in (
        ("published: viscous and Coulomb friction", False),
        ("published: the same by direction", True),
    ):
        found = inverse_dynamics.regress(record, by_direction=by_direction, fit_until=half, **PUBLISHED)  # type: ignore[arg-type]
        inside = (found.time >= window[0]) & (found.time <= window[1])
        parts = [part & inside for part in (found.used, ~found.used)]
        left = found.measured - found.modelled
        errors = [float(np.linalg.norm(left[part]) / np.linalg.norm(found.measured[part])) for part in parts]
        yield {"model": name, "fitted": errors[0], "held_out": errors[1]}


def _reproduced(record: Record) -> list[dict[str, Any]]:
    """The published least squares over the whole record."""
    both = []
    for by_direction in (False, True):
        found = inverse_dynamics.regress(record, by_direction=by_direction, **PUBLISHED)  # type: ignore[arg-type]
        rows = zip(found.estimate.names, found.estimate.units, found.estimate.values, strict=True)
        values = [{"name": name, "unit": unit, "number": float(number)} for name, unit, number in rows]
        both.append({"by_direction": by_direction, "error": found.error(), "values": values})
    return both


def _with_dynamics(found: Found, fit: ForceFit, loaded: Loaded) -> Machine:
    machine, e = found.machine, fit.estimate
    if "plant" not in found.known:
        rigid = next(i for i, mode in enumerate(machine.plant.modes) if mode.frequency == 0)
        gain = 1 / (e.value("mass") * machine.plant.thrust_constant)
        modes_ = tuple(replace(m, gain=gain) if i == rigid else m for i, m in enumerate(machine.plant.modes))
        delay = max(e.value("delay") - 0.5 * machine.sample_time, 0.0)
        sources = dict(machine.sources)
        sources[f"plant.modes.{rigid + 1}.gain"] = _identified(
            loaded, gain * e.deviation("mass") / e.value("mass"), "1/kg"
        )
        sources["plant.dead_time"] = _identified(loaded, e.deviation("delay"), "s")
        machine = replace(machine, plant=replace(machine.plant, modes=modes_, dead_time=delay), sources=sources)
    return machine if "friction" in found.known else _with_friction(machine, fit, loaded)


def _record(loaded: Loaded) -> Record:
    if not isinstance(loaded.content, Record):
        raise ValueError("is a frequency response, not a record over time; name its kind response")
    return loaded.content


def _mass(plant: Plant) -> float:
    rigid = next(mode for mode in plant.modes if mode.frequency == 0)
    return 1 / (rigid.gain * plant.thrust_constant)


STEPS: Final[Mapping[str, Callable[[Found, Loaded], Found]]] = {
    "response": from_response,
    "excitation": from_response,
    "hysteresis": from_hysteresis,
    "motion": from_motion,
    "dynamics": from_dynamics,
}
