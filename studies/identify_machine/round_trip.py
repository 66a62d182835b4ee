"""Are simulated tables, identified from their own records, recovered within the stated uncertainties?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.identification import modes, motion, response
from models.identification.estimate import Estimate
from models.identification.force import by_elements
from models.identification.force.signals import Terms, slow_band
from models.identification.force.stated import along_the_path
from models.identification.into_machine import drag_of, spring_of
from models.identification.pipeline import identify
from models.machine import Machine, Parameter, Provenance, parameters
from models.records.files import Loaded
from models.variation import known
from studies.identify_machine import own_records

Array = NDArray[np.float64]

INTERVAL_STDS: Final = 1.96  # Half width of a 95 % interval, in standard deviations.


def judged(machine: Machine, tables: int, seed: int, tell: Callable[[float, str], None]) -> dict[str, Any]:
    """Errors in standard deviations of every parameter of `tables` simulated tables; tell(share, text): progress."""
    machine = own_records.noisy(machine)
    rows: dict[str, list[Array]] = {"frequency response": [], "hysteresis": [], "motions": []}
    missed = 0
    for i in range(tables):
        tell(i / tables, f"round trip of table {i + 1} of {tables}")
        own = seed + 1000 + i
        table = own_records.another(machine, own)
        spring = modes.Spring(spring_of(table), sought=spring_of(table) == 0)
        found = modes.fit(response.measured(own_records.excitation(table, own)), spring=spring)
        truth = true_modes(table)
        if found.estimate.values.size == truth.size:
            rows["frequency response"].append(_errors(found.estimate, truth))
        else:
            missed += 1
        terms = Terms(
            mass=found.plant.mass,
            known_delay=_delay(table),
            drag=drag_of(table),
            effects=along_the_path(table),
            likely_limit=max(machine.friction.limit),
        )
        slow = own_records.hysteresis(table, own)
        curve = by_elements.identify(slow, terms, pass_band=slow_band(slow))
        limit, stiffness = np.array(table.friction.limit), np.array(table.friction.stiffness)
        if len(curve.friction.limit) == limit.size:
            last = slice(-2 * limit.size - 1, None)
            wanted = np.concatenate([[table.drive.offset], stiffness, limit])
            rows["hysteresis"].append((curve.estimate.values[last] - wanted) / curve.estimate.deviations[last])
        else:
            missed += 1
        moved, _ = own_records.drawn_from(machine, own, held=True)
        record = Loaded("motions", "", own_records.motions(moved, own, machine), (), ())
        rows["motions"].append(errors_of_file(identify(machine, [record], kinds=["motion"]).machine, moved))
    return _summary(rows, tables, missed)


def true_modes(machine: Machine) -> Array:
    """The true values (p,) [SI] for `modes.fit`: gains that include K_t, modes by rising frequency."""
    plant = machine.plant
    numbers = [plant.rigid_gain, plant.dead_time]
    for mode in sorted((plant.modes[i] for i in plant.flexible), key=lambda mode: mode.frequency):
        numbers += [plant.thrust_constant * mode.gain, mode.frequency, mode.damping]
    return np.array(numbers)


def _delay(machine: Machine) -> float:
    """From a command to the middle of the time over which it acts [s]."""
    return machine.plant.dead_time + 0.5 * machine.sample_time


def errors_of_file(found: Machine, truth: Machine) -> Array:
    """Errors (p,), in standard deviations, of every value that a machine has with a stated one, but for those of its
    tolerances."""
    right = {one.name: np.atleast_1d(np.array(one.number, float)) for one in numbers_of(truth)}
    stated = [one for one in known(found) if one.origin == "value"]
    return np.concatenate([(np.array(one.numbers) - right[one.name]) / one.deviations for one in stated])


def numbers_of(machine: Machine) -> list[Parameter]:
    """The values of a machine that are numbers, SI, an offset that no file states among them."""
    stated = machine.with_value("drive.offset", machine.drive.offset, Provenance("assumed", "simulated"))
    return [one for one in parameters(stated) if not isinstance(one.number, str)]


def errors_of_motion(found: motion.MotionFit, truth: Array) -> Array:
    """Errors (p,) in standard deviations of a fit to motions of a table without damping whose `truth` (5,) [SI] ends
    with the offset: a damping that is found all the same is an error, too."""
    return _errors(found.estimate, np.insert(truth, -1, 0.0) if found.damped else truth)


def _errors(estimate: Estimate, truth: Array) -> Array:
    return np.asarray((estimate.values - truth) / estimate.deviations)


def _summary(rows: dict[str, list[Array]], tables: int, missed: int) -> dict[str, Any]:
    kinds = []
    for name, found in rows.items():
        errors = np.concatenate(found) if found else np.zeros(0)
        inside = float(np.mean(np.abs(errors) < INTERVAL_STDS)) if errors.size else 0.0
        kinds.append({"record": name, "intervals": int(errors.size), "coverage": inside, "errors": errors})
    every = np.concatenate([kind["errors"] for kind in kinds])
    return {
        "tables": tables,
        "wrong_number": missed,
        "kinds": kinds,
        "intervals": int(every.size),
        "coverage": float(np.mean(np.abs(every) < INTERVAL_STDS)),
    }
