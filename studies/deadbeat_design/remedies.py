"""What would do where motions miss the specification: a few changes, each judged as the design itself is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from design.controller import assemble
from design.deadbeat import Deadbeat, DesignError
from design.effect_compensation import with_effects
from design.family import usual_errors
from design.pid.problem import TuningError
from design.pid.tuning import tune_pid
from design.redesign.designs import with_all_elements
from design.validation import Validation, repeats_within, validate
from models.controller import PID, Controller
from models.machine import Machine, with_pid
from models.quantity import keeps_to, show
from studies.as_known import on_allowed_machines
from studies.deadbeat_design.effects import Written
from studies.deadbeat_design.options import DeadbeatOptions

PEAK: Final = 2.0  # bound on |S| of the feedback that is tried: what pid_tradeoff tunes for unless asked otherwise
SOONER: Final = 0.75  # of the settling time of x_T*: when that of the one that is tried rests,
MIN_SETTLING_RATIO: Final = 1.1  # but no sooner than this many times the shortest that the thrust allows
# Share of the allowed machines on which a change that would do has to bring all motions in time.
MIN_REMEDIED_SHARE: Final = 0.5

Synthesise = Callable[[Machine, float], Deadbeat]
"""The feedforward for a machine that rests after a time [s]; raises DesignError."""


@dataclass(frozen=True)
class _Change:
    """A design with something changed, on a machine with that change; how: what makes a user's design so."""

    name: str
    how: str
    machine: Machine
    controller: Controller


def needed(machine: Machine, judged: Validation, as_known: Mapping[str, Any]) -> bool:
    """Whether a motion is late on the machine as its file has it, or on one that the file allows."""
    late = not keeps_to(max(one.settling_time for one in judged.achieved), machine.specification.settling_time)
    return late or as_known["in_time"] < as_known["machines"]


def remedies(
    machine: Machine,
    written: Written,
    wanted: Mapping[str, Any],
    shortest: float,
    options: DeadbeatOptions,
    synthesise: Synthesise,
) -> dict[str, Any]:
    """The changes with what they achieve, for results.json; shortest [s]: settling time that the thrust allows.

    Each is judged on the machines that the design itself was judged on, so that they are compared pairwise.
    """
    changes, refused = _changes(machine, written, wanted, shortest, synthesise)
    rows = []
    for one in changes:
        found = validate(one.machine, one.controller, stroke=wanted["stroke_m"], seed=options.seed)
        allowed = on_allowed_machines(one.machine, one.controller, written.validation, options, wanted["stroke_m"])
        rows.append(
            {
                "name": one.name,
                "how": one.how,
                "settling_s": max(motion.settling_time for motion in found.achieved),
                "dispersion_m": found.worst_dispersion,
                "peak_thrust_N": found.peak_thrust,
                "repeats": found.repeat_error <= repeats_within(one.machine),
                **{key: allowed[key] for key in ("in_time", "machines", "median_s", "quantile_s")},
            }
        )
    return {"rows": rows, "refused": refused, "enough": MIN_REMEDIED_SHARE, "best": _best(machine, rows)}


def told(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The change that would do as a line of the summary; none where nothing is missed."""
    if "remedies" not in results:
        return []
    found, name = results["remedies"], "what would bring all motions in time"
    if found["best"] is None:
        return [(name, "none of the changes that were tried; see the report")]
    row = found["rows"][found["best"]]
    settles = f"{show(row['settling_s'], 's')}, on {row['in_time']} of {row['machines']} machines that the file allows"
    return [(name, f"{row['name']}: {settles}")]


def _best(machine: Machine, rows: list[dict[str, Any]]) -> int | None:
    """The place of the change that brings all motions in time on the most machines, among those that do so on the
    machine as its file has it, within its thrust and repeatably, and on enough of those that it allows; the fewest
    changes come first."""
    wanted, rated = machine.specification, machine.drive.rated_thrust
    shares = [
        row["in_time"] / row["machines"]
        if keeps_to(row["settling_s"], wanted.settling_time) and row["peak_thrust_N"] <= rated and row["repeats"]
        else 0.0
        for row in rows
    ]
    return max(range(len(rows)), key=shares.__getitem__) if max(shares, default=0.0) >= MIN_REMEDIED_SHARE else None


def _changes(
    machine: Machine, written: Written, wanted: Mapping[str, Any], shortest: float, synthesise: Synthesise
) -> tuple[list[_Change], list[str]]:
    """What can be tried, and what cannot be, with the reason."""
    found, refused, pid = [], [], None
    try:
        pid = _tuned_pid(machine)
    except TuningError as error:
        refused.append(f"another PID: {error.reason}")
    tuned = f"a PID tuned for Ms ≤ {PEAK:g}", f"pid_tradeoff --ms {PEAK:g} writes such a controller.json"
    if pid is not None:
        found.append(_with_feedback(_Change(*tuned, machine, written.controller), pid))
    gains = f"the gains that pid_tradeoff --ms {PEAK:g} reports, in [control.pid] of the machine file"
    sooner = max(SOONER * wanted["settling_time_s"], MIN_SETTLING_RATIO * shortest)
    count = round(sooner / machine.sample_time)
    if count < round(wanted["settling_time_s"] / machine.sample_time):
        time = count * machine.sample_time
        name, how = f"x_T* at rest after {show(time, 's')}", f'--settling-time "{show(time, "s", 12)}"'
        try:
            earlier = synthesise(replace(machine, plant=written.plant), time)
        except DesignError as error:
            refused.append(f"{name}: {error}")
        else:
            one = _Change(name, how, machine, _assembled(machine, earlier, written))
            found.append(one)
            if pid is not None:
                both = replace(one, name=f"{tuned[0]}, and {name}", how=f"{gains}, and {how}")
                found.append(_with_feedback(both, pid))
    whole = with_all_elements(machine)
    most, now = whole.control.compensator_elements, machine.control.compensator_elements
    if most != now:
        name = f"a friction compensator of {most} elements"
        how = f"control.compensator_elements = {most} in the machine file"
        found.append(_Change(name, how, whole, _assembled(whole, written.deadbeat, written)))
    return found, refused


def _tuned_pid(machine: Machine) -> PID:
    """The PID of most integral gain within PEAK, on the family of plants that pid_tradeoff covers by itself."""
    mode, mass = usual_errors(machine)
    return tune_pid(machine, ms=PEAK, mode_error=mode, mass_error=mass).pid


def _assembled(machine: Machine, deadbeat: Deadbeat, written: Written) -> Controller:
    return with_effects(assemble(machine, deadbeat, written.plant), machine)


def _with_feedback(change: _Change, pid: PID) -> _Change:
    tuned = with_pid(change.machine, pid, "this study")
    return replace(change, machine=tuned, controller=change.controller.with_feedback(pid))
