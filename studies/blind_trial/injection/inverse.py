"""The record that an axis would have logged with a force d (n,) [N] against it, its motion being the measured one.

The plant sees u' - d = u, so x stays. The feedback is linear: u' = u + d asks for r' = r + C_r(z)^-1 d, with C_r from
the reference to the command. Where C_r has no stable inverse, d goes through the logged feedforward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.feedback.forms import NO_FILTERS, law_of
from models.feedback.law import REFERENCE, Law
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

STABLE: Final = 1 - 1e-6  # largest pole of an inverse that is used
REFERENCE_ROUTE: Final = "reference"
FEEDFORWARD_ROUTE: Final = "feedforward"


class NoInverseError(ValueError):
    """The reference's way to the command can't be inverted by a stable filter; the message is part of a sentence."""


@dataclass(frozen=True)
class Channel:
    """C_r(z) as s[k+1] = A s + b r, u = c s + d r, with the states that the reference moves; hold (m,) [1/N]: those
    states per newton that the integral holds. Positions in [m], forces in [N]."""

    a: Array
    b: Array
    c: Array
    d: float
    hold: Array
    has_integral: bool

    @property
    def rest_gain(self) -> float:
        """u / r [N/m] at rest, of a law without an integral."""
        return float(self.d + self.c @ np.linalg.solve(np.eye(self.b.size) - self.a, self.b))


def channel(machine: Machine, derivative: str = "error") -> Channel:
    """The way from the reference to the command [N/m]; derivative: what the PID that ran took it of, "error" or
    "position". Raises NoInverseError."""
    control = machine.control
    if control.law is None:
        pid = replace(control.pid, derivative_weight=0.0) if derivative == "position" else control.pid
        law = law_of(pid, NO_FILTERS, 0.0, control.sample_time)
    else:
        law = control.law
    found = _moved(law)
    if found.d == 0:
        raise NoInverseError("the reference reaches the command a sample late")
    poles = np.linalg.eigvals(found.a - np.outer(found.b, found.c) / found.d) if found.b.size else np.zeros(0)
    if np.max(np.abs(poles), initial=0.0) > STABLE:
        raise NoInverseError("what inverts it is unstable")
    if not found.has_integral and found.rest_gain <= 0:
        raise NoInverseError("a reference at rest makes no command")
    return found


def _moved(law: Law) -> Channel:
    a, b, c, hold = np.array(law.a), np.array(law.b)[:, REFERENCE], np.array(law.c), np.array(law.hold)
    moved, before = b != 0, np.zeros(b.size, bool)
    while np.any(moved != before):
        before, moved = moved, moved | np.any(a[:, moved] != 0, axis=1)
    return Channel(a[np.ix_(moved, moved)], b[moved], c[moved], float(law.d[REFERENCE]), hold[moved], law.has_integral)


def inject(record: Record, force: Array, way: Channel | None, reference_delay: int) -> Record:
    """The record with a force (n,) [N] against the axis. way: None puts it into the feedforward. reference_delay
    [samples]. The target is the new reference: what the old one was is not in the answer."""
    if not np.any(force):
        return record
    command = record.command + force
    if way is None:
        return replace(record, command=command, feedforward=record.feedforward + force)
    moved, left = _inverted(way, force, reference_delay)
    later = np.concatenate([moved[reference_delay:], np.full(reference_delay, moved[-1])])
    reference = record.reference + later
    return replace(
        record, command=command, reference=reference, target=reference, feedforward=record.feedforward + left
    )


def _inverted(way: Channel, force: Array, waits: int) -> tuple[Array, Array]:
    """The change (n,) [m] of the reference as the feedback has it, from a rest under the first force, and what of the
    force (n,) [N] the reference can't give while the feedback waits for its first sample."""
    first = 0.0 if way.has_integral else float(force[0]) / way.rest_gain
    state = way.hold * float(force[0])
    if not way.has_integral and way.b.size:
        state = np.asarray(np.linalg.solve(np.eye(way.b.size) - way.a, way.b) * first, float)
    moved, left = np.empty(force.size), np.zeros(force.size)
    for k, wanted in enumerate(force.tolist()):
        held = float(way.c @ state)
        moved[k] = (wanted - held) / way.d
        if waits and k <= waits:
            moved[k] = first
            left[k] = wanted - held - way.d * first
        state = way.a @ state + way.b * moved[k]
    return moved, left
