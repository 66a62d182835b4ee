"""The content of results.json for an identification: the data of each record's figures and tables, and the checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.identification import inverse_dynamics, modes, motion
from models.identification.force import by_elements
from models.identification.force.fit import ForceFit
from models.identification.into_machine import VISCOUS_DIRECTIONS, Holdable
from models.identification.joint.fast_records import BY_DIRECTION, DYNAMICS, half_of
from models.identification.joint.response_records import on_what_is_between
from models.identification.joint.steps import Difference, Identified, MotionStep, Step, record_of
from models.identification.modal.order import SAME_MODE_DISTANCE, Order
from models.identification.modal.remarks import ResponseStep, bent, on_refuted, on_turning
from models.records.record import Record
from studies.study import Check

Array = NDArray[np.float64]

MAX_KEPT_SAMPLES: Final = 3000  # samples of a signal that are kept, for the figures
MAX_KEPT_LINES: Final = 1200  # of a frequency response that are kept, for the figure
BY_CHANCE: Final = 1e-3  # The check of two records against each other fails so often although the model is right.
# The machine file may have so many times the fit's held-out error, as its directional friction, in proportion to the
# force, is an approximation.
LOST: Final = 1.05
CUTOFF: Final = 100.0  # Hz, of the inverse dynamics, as EMPS's authors chose it; they decimate by 10
CUTOFF_BY_RATE: Final = 0.1  # of the sampling rate: theirs, which a slower record's cut-off keeps to


def results_of(found: Identified) -> dict[str, Any]:
    """The results of each record, under its kind, and the rows of all estimates."""
    results: dict[str, Any] = {}
    estimates, ladders = [], list[dict[str, Any]]()
    named = Counter(step.result for step in found.steps)
    for step in found.steps:
        estimate = step.gave.estimate
        record = step.result if named[step.result] == 1 else f"{step.result}, {step.loaded.name}"
        shown = _shown(step, found.machine.sample_time)
        correlation = {"names": list(estimate.names), "matrix": estimate.correlation}
        results[step.result] = {**shown, "correlation": correlation}
        if "ladder" in shown:
            ladders.append({"record": step.loaded.name, "ladder": shown["ladder"]})
            results[step.result]["ladders"] = ladders
        estimates += [
            {"record": record, "name": name, "unit": unit, "number": float(value), "std": float(std)}
            for name, unit, value, std in zip(
                estimate.names, estimate.units, estimate.values, estimate.deviations, strict=True
            )
        ]
    return {**results, "estimates": estimates}


def warnings_of(found: Identified) -> list[tuple[str, str]]:
    """What is wrong with records, each with the record's name: those that were left out, and why; logs that lack much
    of the command; and responses that are bent as the axis turned back, or that no plant fits."""
    left_out = [(one.name, f"left out: {one.why}") for one in found.left_out]
    lacking = [
        (step.loaded.name, said)
        for step in found.steps
        if isinstance(step.gave, ResponseStep) and isinstance(step.loaded.content, Record)
        for said in on_what_is_between(found.machine, step.loaded.content)
    ]
    responses = [(step.loaded.name, step.gave) for step in found.steps if isinstance(step.gave, ResponseStep)]
    wrong = [(name, said) for name, gave in responses for said in on_turning(gave.measured)]
    return left_out + lacking + (wrong or [(name, said) for name, gave in responses for said in on_refuted(gave)])


def checks_of(found: Identified, results: Mapping[str, Any]) -> Iterator[Check]:
    """The checks that the records themselves allow."""
    for kind, called in (("motion", "motion"), ("hysteresis", "slow")):
        if names := [one.name for one in found.left_out if one.kind == kind]:
            yield Check(f"{called} records that were left out", float(len(names)), "1", 0.0, ", ".join(names))
    for step in found.steps:
        if isinstance(step.gave, ResponseStep) and np.all(np.isfinite(step.gave.measured.variance)):
            name = "reduced chi-square of the frequency response"
            name += f": {step.loaded.name}" * (sum(isinstance(one.gave, ResponseStep) for one in found.steps) > 1)
            yield Check(name, found.misfit(step.gave), "1", 3.0, "1 if the model is right")
        if isinstance(step.gave, MotionStep) and step.gave.differences:
            yield _agreement(step.gave.differences)
    ladders = results["dynamics"]["ladders"] if "dynamics" in results else []
    for one in ladders:
        yield from _held_out(one["ladder"], f": {one['record']}" * (len(ladders) > 1))


def _held_out(ladder: Sequence[Mapping[str, Any]], of: str) -> Iterator[Check]:
    """The checks of a fast record's ladder of models by its second half; `of` ends their names."""
    better, kept = (ladder[3]["held_out"] / row["held_out"] for row in (ladder[1], ladder[-1]))
    source = "second half of the record, not fitted"
    yield Check(f"held-out force error, over that of the published model by direction{of}", better, "1", 1.0, source)
    name = f"held-out force error of the machine file, over that of the fit that it is made of{of}"
    yield Check(name, 1 / kept, "1", LOST, source)


def _agreement(differences: Sequence[Difference]) -> Check:
    name = f"largest difference between {len(differences)} values found by two records, in standard deviations"
    largest = max(abs(one.size) / one.std for one in differences)
    limit = float(scipy.stats.norm.isf(BY_CHANCE / 2 / len(differences)))
    return Check(name, largest, "1", limit, f"exceeded by chance once in {1 / BY_CHANCE:.0f} times (Bonferroni)")


def _shown(step: Step, sample_time: float) -> dict[str, Any]:
    gave = step.gave
    if isinstance(gave, ResponseStep):
        return _response(gave)
    if isinstance(gave, MotionStep):
        return _motion(gave.fit, sample_time)
    slip, spread = gave.fit.slip_force()
    shown = {**_force(gave.fit), "slip_N": slip, "slip_std_N": spread}
    if gave.held is None:
        return shown
    record = record_of(step.loaded)
    return shown | _dynamics(record, gave.fit, gave.held)


def _response(gave: ResponseStep) -> dict[str, Any]:
    measured, fit = gave.measured, gave.fit
    if gave.together is not None:
        fit = replace(gave.together, used_lines=fit.used_lines)
    model = modes.model(fit.plant, measured.frequency, measured.held, lag=fit.lag, drag=fit.drag, spring=fit.spring)
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
    some = (
        np.unique(np.geomspace(1, size, MAX_KEPT_LINES).astype(int)) - 1 if size > MAX_KEPT_LINES else np.arange(size)
    )
    return {
        **{name: values[some] for name, values in lines.items()},
        "lowest_Hz": float(measured.frequency[fit.used][0]),
        "rolling": measured.rolling,
        "turned": measured.turned,
        "bent": bent(measured),
        "criterion": fit.criterion,
        "chi_square": fit.chi_square if np.all(np.isfinite(measured.variance)) else None,
        "modes": len(fit.plant.modes) - 1,
        "lag_s": fit.lag,
        "drag_Ns_per_m": fit.drag,
        "spring_N_per_m": fit.spring,
        "worth": dict(fit.worth),
        "orders": [_order(fit, order) for order in fit.orders],
    }


def _order(fit: modes.Fit, order: Order) -> dict[str, Any]:
    """One row of the stabilisation diagram; kept: whether a mode of about that frequency is in the machine file."""
    kept = np.array([mode.frequency for mode in fit.plant.modes[1:]])
    return {
        "modes": len(order.faults),
        "chi_square": order.chi_square,
        "criterion": order.criterion,
        "frequency_Hz": order.triples[:, 1],
        "damping": order.triples[:, 2],
        "faults": list(order.faults),
        "kept": [bool(np.any(np.abs(kept / f - 1) < SAME_MODE_DISTANCE)) for f in order.triples[:, 1]],
    }


def _motion(fit: motion.MotionFit, sample_time: float) -> dict[str, Any]:
    every, residual = max(fit.command.size // MAX_KEPT_SAMPLES, 1), fit.command - fit.modelled
    return {
        "time_s": np.arange(fit.command.size)[::every] * sample_time,
        "command_N": fit.command[::every],
        "residual_N": residual[::every],
        "residual_std_N": float(np.std(residual[motion.START :])),
        "prediction_error_std_N": float(np.std(fit.prediction_error)),
    }


def _force(fit: ForceFit) -> dict[str, Any]:
    every = max(fit.time.size // MAX_KEPT_SAMPLES, 1)
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


def _dynamics(record: Record, fit: ForceFit, held: Holdable) -> dict[str, Any]:
    """Further results of a fast record: the comparison from the published models to the machine file's."""
    half = half_of(record)
    longest = max(fit.friction.limit)
    bending = replace(DYNAMICS, bent=True, likely_delay=fit.estimate.value("delay"))
    simple, bent = (
        by_elements.identify(
            record,
            replace(terms, effects=fit.effects, likely_limit=longest),
            pass_band=fit.pass_band,
            fit_until=half,
        )
        for terms in (BY_DIRECTION, bending)
    )
    fits = (
        ("elements and viscous friction by direction", simple),
        ("the same, a delay, and damping of the elements where it shows", fit),
        ("the same and a bend of the viscous friction, which no machine file holds", bent),
    )
    parts = (
        "elements",
        *["viscous friction"] * (held.drag is not None),
        *["friction by direction"] * (held.asymmetry is not None),
    )
    ladder = [
        *_published(record, half, simple.time[[0, -1]]),
        *({"model": name, "fitted": one.error(used=True), "held_out": one.error(used=False)} for name, one in fits),
        {
            "model": f"what the machine file holds: {', '.join(parts)}, offset",
            "fitted": held.fitted,
            "held_out": held.held_out,
        },
    ]
    return {
        "ladder": ladder,
        "published": _reproduced(record),
        "cutoff_Hz": _cutoff(record),
        "half_s": half,
        "offset_N": held.offset[0],
        "over_speed": _over_speed(fit),
    }


def _over_speed(fit: ForceFit) -> dict[str, Any]:
    """All force but inertia [N] over speed, at the samples kept: measured and fitted."""
    speed = np.gradient(fit.path, fit.time)
    ahead, back = (fit.estimate.value(name) for name in VISCOUS_DIRECTIONS)
    friction = fit.rolling + np.where(speed > 0, ahead, back) * speed + fit.estimate.value("offset")
    every = max(fit.time.size // MAX_KEPT_SAMPLES, 1)
    measured = fit.measured - fit.modelled + friction
    return {"speed_m_per_s": speed[::every], "measured_N": measured[::every], "modelled_N": friction[::every]}


def _cutoff(record: Record) -> float:
    """[Hz] of the published least squares."""
    return min(CUTOFF, CUTOFF_BY_RATE / record.sample_time)


def _published(record: Record, half: float, window: Array) -> Iterator[dict[str, Any]]:
    """The authors' two models, fitted to the first half and evaluated on the same held-out part as the others."""
    for name, by_direction in (
        ("published: viscous and Coulomb friction", False),
        ("published: the same by direction", True),
    ):
        found = inverse_dynamics.regress(record, cutoff=_cutoff(record), by_direction=by_direction, fit_until=half)
        inside = (found.time >= window[0]) & (found.time <= window[1])
        parts = [part & inside for part in (found.used, ~found.used)]
        left = found.measured - found.modelled
        errors = [float(np.linalg.norm(left[part]) / np.linalg.norm(found.measured[part])) for part in parts]
        yield {"model": name, "fitted": errors[0], "held_out": errors[1]}


def _reproduced(record: Record) -> list[dict[str, Any]]:
    """The published least squares over the whole record."""
    both = []
    for by_direction in (False, True):
        found = inverse_dynamics.regress(record, cutoff=_cutoff(record), by_direction=by_direction)
        rows = zip(found.estimate.names, found.estimate.units, found.estimate.values, strict=True)
        values = [{"name": name, "unit": unit, "number": float(number)} for name, unit, number in rows]
        both.append({"by_direction": by_direction, "error": found.error(), "values": values})
    return both
