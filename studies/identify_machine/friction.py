"""Friction into the machine: the elements of a slow record, all that acts in a fast one by inverse dynamics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.effects import catalogue
from models.effects.base import Effect
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.identification import force, inverse_dynamics
from models.identification.estimate import STRONG, newey_west
from models.identification.force_fit import SURE, ForceFit
from models.machine import Machine, Provenance
from models.records.files import Loaded
from models.records.record import Record
from studies.identify_machine.found import SHOWN, Found, identified, own_curve, record_of, with_offset
from studies.study import Check

Array = NDArray[np.float64]

PUBLISHED: Final = {"cutoff": 100.0, "factor": 10}  # of the inverse dynamics as EMPS's authors do it
LOST: Final = 1.05  # of the held-out error: friction by direction as a part of the force stands for one that is not
WAYS: Final = ("viscous friction forwards", "viscous friction backwards")


def from_hysteresis(found: Found, loaded: Loaded) -> Found:
    """The friction elements from a slow record; mass and dead time as known so far."""
    plant, ts = found.machine.plant, found.machine.sample_time
    dead_time = [row["std"] for row in found.results.get("estimates", []) if row["name"] == "dead time"]
    terms = force.Terms(
        mass=plant.mass,
        known_delay=plant.dead_time + 0.5 * ts,
        known_delay_std=max(dead_time, default=0.0),
        damped=bool(dead_time),
    )
    record, band = record_of(loaded), found.pass_band or 20.0
    fit = force.identify(record, terms, pass_band=band)
    dragged = force.identify(record, replace(terms, viscous=True), pass_band=band)
    if _drags(fit, dragged):
        fit = dragged
    slip, spread = fit.slip_force()
    said = (
        f"At full slip the friction is {slip:.4g} N with a standard deviation of {spread:.2g} N.",
        _on_damping(fit),
        _on_drag(dragged, taken=fit is dragged),
    )
    shown = {**_force(fit), "slip_N": slip, "slip_std_N": spread}
    machine = _with_friction(found.machine, fit, loaded)
    machine = with_offset(machine, loaded, fit.estimate.value("offset"), fit.estimate.deviation("offset"))
    if fit is dragged:
        drag = fit.estimate.value("viscous friction"), fit.estimate.deviation("viscous friction")
        machine = _with_drag(machine, loaded, drag, None)
    found = found.having("hysteresis", shown, fit.estimate, said)
    last = slice(-2 * len(fit.friction.limit), None)
    shape = fit.estimate.covariance[last, last]
    known = found.known | {"friction", "offset"}
    return replace(found, machine=machine, known=known, friction_covariance=shape)


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


def _with_drag(
    machine: Machine, loaded: Loaded, drag: tuple[float, float] | None, asymmetry: tuple[float, float] | None
) -> Machine:
    """With viscous friction c [N s/m] and friction by direction [1], each with its standard deviation, as effects."""
    found: list[tuple[Effect, str, float, str]] = []
    if drag is not None:
        found.append((ViscousFriction(drag[0]), "coefficient", drag[1], "N s/m"))
    if asymmetry is not None:
        turning = replace(DirectionalFriction.typical(), asymmetry=asymmetry[0])
        found.append((turning, "asymmetry", asymmetry[1], "1"))
    ours = tuple(f"effects.{kind.name}" for kind in (ViscousFriction, DirectionalFriction))
    sources = {name: source for name, source in machine.sources.items() if not name.startswith(ours)}
    for effect, part, std, unit in found:
        sources[f"effects.{effect.name}.{part}"] = identified(loaded, std, unit)
    others = [effect for effect in machine.effects if f"effects.{effect.name}" not in ours]
    effects = catalogue.in_order([*others, *(effect for effect, *_ in found)])
    return replace(machine, effects=effects, sources=sources)


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
    sources["friction.stiffness"] = identified(loaded, std[-2 * count : -count].tolist(), "N/m")
    sources["friction.limit"] = identified(loaded, std[-count:].tolist(), "m")
    if fit.damped:
        sources["friction.damping"] = identified(loaded, fit.damping_std().tolist(), "N s/m")
    else:
        sources["friction.damping"] = Provenance("assumed", f"record {loaded.name} does not show it")
    return own_curve(replace(machine, friction=fit.friction, sources=sources))


def from_dynamics(found: Found, loaded: Loaded) -> Found:
    """Inverse dynamics of a fast record: the published least squares, then this project's friction, both held out."""
    record = record_of(loaded)
    half = 0.5 * record.position.size * record.sample_time
    by_direction = force.Terms(viscous=True, by_direction=True)
    late = replace(by_direction, delay=True, damped=True)
    ladder = [
        ("elements and viscous friction by direction", by_direction),
        ("the same, a delay, and damping of the elements where it shows", late),
        ("the same and a bend of the viscous friction, which no machine file holds", replace(late, bent=True)),
    ]
    band = found.pass_band or 40.0
    fits = [(name, force.identify(record, terms, pass_band=band, fit_until=half)) for name, terms in ladder]
    window = fits[0][1].time[[0, -1]]
    rows = [*_published(record, half, window)]
    rows += [{"model": name, "fitted": fit.error(used=True), "held_out": fit.error(used=False)} for name, fit in fits]
    fit = fits[1][1]
    held = _holdable(fit)
    machine = _with_dynamics(found, fit, held, loaded)
    rows.append(held.row)
    slip, spread = fit.slip_force()
    shown = {**_force(fit), "ladder": rows, "published": _reproduced(record), "slip_N": slip, "slip_std_N": spread,
             "half_s": half, "offset_N": held.offset[0], "over_speed": _over_speed(fit)}  # fmt: skip
    said = (_on_offset(held), _on_damping(fit))
    found = found.having("dynamics", shown, fit.estimate, said)
    source = "second half of the record, not fitted"
    better, kept = (rows[3]["held_out"] / row["held_out"] for row in (rows[1], held.row))
    name = "held-out force error, over that of the published model by direction"
    checks = [Check(name, better, "1", 1.0, source)]
    name = "held-out force error of the machine file, over that of the fit that it is made of"
    checks.append(Check(name, 1 / kept, "1", LOST, source))
    known = found.known | {"plant", "friction", "offset"}
    return replace(found, machine=machine, known=known, checks=(*found.checks, *checks))


def _on_offset(held: _Holdable) -> str:
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


@dataclass(frozen=True)
class _Holdable:
    """A force as a machine file can hold it: viscous friction [N s/m] and asymmetry [1], None where not sure, and the
    offset [N], each with its standard deviation; the row of the ladder with its errors."""

    drag: tuple[float, float] | None
    asymmetry: tuple[float, float] | None
    offset: tuple[float, float]
    row: dict[str, Any]


def _holdable(fit: ForceFit) -> _Holdable:
    """What a machine file can hold of a fit by direction.

    F = sum K_i z_i + c v, with c the mean of both directions. What is left beyond it is even in the direction: a |F|,
    the friction by direction of a machine file, and an offset. What is not sure, c or a, is left out.
    """
    e, kept = fit.estimate, fit.used
    where = [e.names.index(name) for name in WAYS]
    ahead, back = e.values[where]
    drag = _sure(max(float(ahead + back) / 2, 0.0), 0.5 * float(np.sqrt(np.sum(e.covariance[np.ix_(where, where)]))))
    speed = np.gradient(fit.path, fit.time)
    dragged = drag[0] * speed if drag else np.zeros(speed.size)
    beyond = fit.measured - fit.modelled + e.value("offset") + np.where(speed > 0, ahead, back) * speed - dragged
    columns = np.column_stack([np.ones(speed.size), np.abs(fit.rolling + dragged)])
    values, stds = _weighed(columns[kept], beyond[kept])
    asymmetry = _sure(float(values[1]), float(stds[1]))
    if asymmetry is None:
        columns = columns[:, :1]
        values, stds = _weighed(columns[kept], beyond[kept])
    rest = beyond - columns @ values
    errors = [float(np.linalg.norm(rest[part]) / np.linalg.norm(fit.measured[part])) for part in (kept, ~kept)]
    parts = [
        "elements",
        *["viscous friction"] * (drag is not None),
        *["friction by direction"] * (asymmetry is not None),
    ]
    row = {"model": f"what the machine file holds: {', '.join(parts)}, offset", "fitted": errors[0]}
    return _Holdable(drag, asymmetry, (float(values[0]), float(stds[0])), {**row, "held_out": errors[1]})


def _over_speed(fit: ForceFit) -> dict[str, Any]:
    """All that is not inertia over speed, at the samples kept: as measured and as the fit has it [N]."""
    speed = np.gradient(fit.path, fit.time)
    ahead, back = (fit.estimate.value(name) for name in WAYS)
    friction = fit.rolling + np.where(speed > 0, ahead, back) * speed + fit.estimate.value("offset")
    every = max(fit.time.size // SHOWN, 1)
    measured = fit.measured - fit.modelled + friction
    return {"speed_m_per_s": speed[::every], "measured_N": measured[::every], "modelled_N": friction[::every]}


def _sure(value: float, std: float) -> tuple[float, float] | None:
    """A value and its standard deviation [the same unit] if it is surely not zero."""
    return (value, std) if abs(value) > SURE * std else None


def _weighed(columns: Array, wanted: Array) -> tuple[Array, Array]:
    """Weights of the columns (n, p) by least squares and their standard deviations (p,) [N, or 1 for a part of one]."""
    found = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    covariance = newey_west(columns, wanted - columns @ found, force.TOGETHER)
    return np.asarray(found, float), np.asarray(np.sqrt(np.diag(covariance)), float)


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


def _with_dynamics(found: Found, fit: ForceFit, held: _Holdable, loaded: Loaded) -> Machine:
    """The machine with what no other record gave; friction that grows with speed and the offset go together."""
    machine, e = found.machine, fit.estimate
    if "plant" not in found.known:
        rigid = machine.plant.rigid
        gain = 1 / (e.value("mass") * machine.plant.thrust_constant)
        modes_ = tuple(replace(m, gain=gain) if i == rigid else m for i, m in enumerate(machine.plant.modes))
        delay = max(e.value("delay") - 0.5 * machine.sample_time, 0.0)
        sources = dict(machine.sources)
        spread = gain * e.deviation("mass") / e.value("mass")
        sources[f"plant.modes.{rigid + 1}.gain"] = identified(loaded, spread, "1/kg")
        sources["plant.dead_time"] = identified(loaded, e.deviation("delay"), "s")
        machine = replace(machine, plant=replace(machine.plant, modes=modes_, dead_time=delay), sources=sources)
    if "friction" not in found.known:
        machine = _with_friction(machine, fit, loaded)
    if held.drag is not None or held.asymmetry is not None:
        machine = _with_drag(machine, loaded, held.drag, held.asymmetry)
    return with_offset(machine, loaded, *held.offset)
