"""Every linear feedback as one sampled law from reference and position to thrust, and the kernels that run it.

    v[k] = C s[k] + D (r[k], x[k]) + u_ff[k]
    u[k] = v[k], or v[k] within the rating where there is an anti-windup (M is not 0)
    s[k+1] = A s[k] + B (r[k], x[k]) + M (u[k] - v[k])

r is the reference as the feedback has it, after its delay; n states s. M takes back from the integral what the rating
cuts off (back-calculation, Astrom and Hagglund, Advanced PID Control, 2006, section 3.5).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.compiled import compiled, inlined

Array = NDArray[np.float64]
Row = tuple[float, ...]

REFERENCE, POSITION = range(2)  # columns of B and D


@dataclass(frozen=True)
class Law:
    """The law at the module's head; positions in [m], forces in [N], states in units of their own.

    a (n, n), b (n, 2), c (n,), d (2,): A, B, C and D. hold (n,) [1/N]: the states at rest at r = x = 0 per newton that
    the integral holds; all 0 for a law without an integral. The integral's state is the first. reset (n,) [1/N]: M.
    """

    sample_time: float
    a: tuple[Row, ...]
    b: tuple[Row, ...]
    c: Row
    d: Row
    hold: Row
    reset: Row

    @property
    def has_integral(self) -> bool:
        """Whether the law holds a constant force at rest."""
        return any(self.hold)

    @property
    def keeps_to_the_rating(self) -> bool:
        """Whether there is an anti-windup, so that no command is beyond the rating."""
        return any(self.reset)

    def of_error(self) -> Law:
        """The law whose reference enters as the position does, so that it puts out nothing where x = r.

        It has the loop of this one, and the form that a feedforward is designed for.
        """
        b = tuple((-row[POSITION], row[POSITION]) for row in self.b)
        return replace(self, b=b, d=(-self.d[POSITION], self.d[POSITION]))

    def feedback_matrices(self) -> tuple[Array, Array, Array, Array]:
        """A (n, n), B (n, 1), C (1, n), D (1, 1) from -x [m] to u [N]: C(z) of the loop."""
        a, b = np.array(self.a), np.array(self.b)[:, POSITION]
        moved, before = b != 0, np.zeros(b.size, bool)
        while np.any(moved != before):  # what the position never moves is the reference's alone, and not in the loop
            before, moved = moved, moved | np.any(a[:, moved] != 0, axis=1)
        return a[np.ix_(moved, moved)], -b[moved, None], np.array([self.c])[:, moved], np.array([[-self.d[POSITION]]])


class LawArrays(NamedTuple):
    """A law as the kernels read it, with its state, which they change; without states there is no law."""

    a: Array
    b: Array
    c: Array
    d: Array
    hold: Array
    reset: Array
    state: Array
    next: Array
    has_integral: bool
    keeps_to_the_rating: bool


def arrays(law: Law | None) -> LawArrays:
    """The law for the kernels at rest, holding nothing; SI. None: no states."""
    if law is None:
        empty = np.empty(0)
        return LawArrays(np.empty((0, 0)), np.empty((0, 2)), empty, empty, empty, empty, empty, empty, False, False)
    n = len(law.c)
    a, b, c, d, hold, reset = (np.array(part, float) for part in (law.a, law.b, law.c, law.d, law.hold, law.reset))
    return LawArrays(a, b, c, d, hold, reset, np.zeros(n), np.zeros(n), law.has_integral, law.keeps_to_the_rating)


@inlined
def output(law: LawArrays, reference: float, position: float) -> float:
    """C s + D (r, x) [N] at a reference and a position [m]."""
    thrust: float = law.d[0] * reference + law.d[1] * position
    for i in range(law.c.size):
        thrust += law.c[i] * law.state[i]
    return thrust


@inlined
def advance(law: LawArrays, reference: float, position: float, excess: float) -> None:
    """Moves the states on by one sample; reference and position [m], excess: u - v [N]."""
    n = law.c.size
    for i in range(n):
        moved = law.b[i, 0] * reference + law.b[i, 1] * position + law.reset[i] * excess
        for j in range(n):
            moved += law.a[i, j] * law.state[j]
        law.next[i] = moved
    law.state[:] = law.next


@compiled
def _follow(law: LawArrays, reference: Array, position: Array, feedforward: Array, limit: float) -> Array:
    command = np.empty(position.size)
    for k in range(position.size):
        wanted = output(law, reference[k], position[k]) + feedforward[k]
        command[k] = max(-limit, min(wanted, limit)) if law.keeps_to_the_rating else wanted
        advance(law, reference[k], position[k], command[k] - wanted)
    return command


def follow(
    law: Law,
    reference: ArrayLike,
    position: ArrayLike,
    feedforward: ArrayLike,
    *,
    limit: float = math.inf,
    start: float = 0.0,
) -> Array:
    """u (n,) [N] that the law makes of r, x (n,) [m] and u_ff (n,) [N], after a rest at the first of each.

    limit [N]: the rating that an anti-windup keeps to. start [N]: what the integral holds at first.
    """
    ready = arrays(law)
    r, x, known = (np.ascontiguousarray(signal, float) for signal in (reference, position, feedforward))
    origin = float(x[0])
    ready.state[:] = _at_rest(law, float(r[0]) - origin) + ready.hold * start
    return np.asarray(_follow(ready, r - origin, x - origin, known, limit), float)


def _at_rest(law: Law, reference: float) -> Array:
    """The states (n,) after a rest at r = `reference` [m], x = 0, but for the integral, whose states stay 0."""
    a, b = np.array(law.a), np.array(law.b)
    states, free = np.zeros(len(a)), slice(int(law.has_integral), None)
    states[free] = np.linalg.solve((np.eye(len(a)) - a)[free, free], b[free, REFERENCE] * reference)
    return states


def law_to_json(law: Law) -> dict[str, Any]:
    """The law's coefficients for a controller.json; SI."""
    names = ("a", "b", "c", "d", "hold", "reset")
    plain = {name: getattr(law, name) for name in names}
    return {name: [list(one) if isinstance(one, tuple) else one for one in rows] for name, rows in plain.items()}


def law_from_json(content: Mapping[str, Any], sample_time: float) -> Law:
    """The law in a controller.json that runs every sample_time [s]. Raises ValueError for coefficients that make none.

    The KeyError of a missing entry names it.
    """
    parts = {name: np.array(content[name], float) for name in ("a", "b", "c", "d", "hold", "reset")}
    n = parts["c"].size
    shapes = {"a": (n, n), "b": (n, 2), "c": (n,), "d": (2,), "hold": (n,), "reset": (n,)}
    if not 0 < n <= 100 or any(parts[name].shape != shape for name, shape in shapes.items()):
        raise ValueError("law: a, b, c, d, hold and reset must be of (n, n), (n, 2), n, 2, n and n numbers")
    if not all(np.all(np.isfinite(part)) for part in parts.values()):
        raise ValueError("law: a coefficient is not finite")
    a, b = (tuple(tuple(row) for row in parts[name].tolist()) for name in ("a", "b"))
    c, d, hold, reset = (tuple(parts[name].tolist()) for name in ("c", "d", "hold", "reset"))
    return Law(sample_time, a, b, c, d, hold, reset)
