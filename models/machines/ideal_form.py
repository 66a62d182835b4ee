"""A PID stated in ideal form, kp (1 + 1 / (Ti s) + Td s), as the parallel one that a machine has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from models.controller import GAIN
from models.machines.provenance import MachineError, Provenance
from models.machines.reading import read
from models.quantity import show, value

# The keys of the ideal form, and what they stand for.
GAINS_OF_TIMES: Final = {"integral_time": "ki", "derivative_time": "kd"}


@dataclass(frozen=True)
class _Ideal:
    """What the gains of the parallel form follow from; a time of 0 stands for a part that is not there."""

    kp: float = value("N/m", "proportional gain", at_least=0, at_most=1e15, because=GAIN)
    integral_time: float = value(
        "s", "integral time Ti", above=0, at_most=1e4, because="it takes part in no motion; leave it out", default=0.0
    )
    derivative_time: float = value(
        "s", "derivative time Td", above=0, at_most=100, because="no axis is that slow", default=0.0
    )


def in_parallel_form(content: Mapping[str, Any]) -> dict[str, Any]:
    """A machine file's content whose [control.pid] has ki and kd [SI] in place of the times of the ideal form.

    Raises MachineError for times that can't be, and for a part that is stated in both forms.
    """
    control = content.get("control")
    table = control.get("pid") if isinstance(control, dict) else None
    if not isinstance(table, dict) or not isinstance(control, dict) or GAINS_OF_TIMES.keys().isdisjoint(table):
        return dict(content)
    for time, gain in GAINS_OF_TIMES.items():
        if gain in table:
            other = next(iter(GAINS_OF_TIMES.keys() & table.keys()))
            raise MachineError(
                f"control.pid.{gain}: must not stand beside {other}; state the PID by kp, ki and kd, or by kp, "
                "integral_time and derivative_time"
            )
        if isinstance(table.get(time), dict) and "std" in table[time]:
            raise MachineError(f"control.pid.{time}.std: is not used here; state the PID by kp, ki and kd instead")
    sources = dict[str, Provenance]()
    ideal = read(_Ideal, {key: table[key] for key in ("kp", *GAINS_OF_TIMES) if key in table}, "control.pid", sources)
    ti, td = ideal.integral_time, ideal.derivative_time
    gains = {
        "ki": _gain(ideal.kp / ti if ti else 0.0, "N/(m s)", "integral_time", ti, sources),
        "kd": _gain(ideal.kp * td, "N s/m", "derivative_time", td, sources),
    }
    rest = {key: entry for key, entry in table.items() if key not in GAINS_OF_TIMES}
    without = {} if td else {"derivative_filter": {"value": "0 s", "source": "derived: no derivative"}}
    return {**content, "control": {**control, "pid": {**without, **rest, **gains}}}


def _gain(number: float, unit: str, name: str, time: float, sources: Mapping[str, Provenance]) -> dict[str, str]:
    """The entry of a gain that follows from kp and a time [s]."""
    stated = sources.get(f"control.pid.{name}")
    if stated is None:
        return {"value": f"{number!r} {unit}", "source": f"derived: no {name}"}
    article = "an" if name.startswith("i") else "a"
    said = f"derived: kp and {article} {name} of {show(time, 's')} ({stated.kind}: {stated.detail})"
    return {"value": f"{number!r} {unit}", "source": said} | ({"note": stated.note} if stated.note else {})
