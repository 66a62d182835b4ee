"""Rolling friction with presliding hysteresis: N stop elements in parallel, eqs. (3)-(8) of the paper.

Symbols: x displacement [m]; z_i element displacement (the paper's x_i) [m]; X_i its limit (X_mi) [m]; K_i stiffness
[N/m]; D_i damping [N s/m]; F_i = K_i X_i (F_mi) [N]; f = sum f_i.

The stop operator is the family's nonsmooth law: an element moves with x until |z_i| = X_i and slips from there on.
Without damping the force depends on the path of x only, not on its speed (rate independence).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from models.compiled import compiled
from models.quantity import show, value

Array = NDArray[np.float64]

MAX_ELEMENTS: Final = 200  # Elements: a hysteresis curve shows about ten, and the simulation's time grows with them.
REACHING: Final = 30  # strokes that lead to a random state
PERIOD: Final = 2000  # points of a period of the sine that a describing function is of
STIFF: Final = "no contact is stiffer than a solid metre of steel"
RANGE: Final = "contacts give way after nanometres to millimetres"


@dataclass(frozen=True)
class Friction:
    """Parameters of N elements (tuples of length N), each slipping at K_i X_i; eqs. (3)-(8).

    >>> pos.Friction(stiffness=(2e6, 1e6), limit=(1e-6, 1e-5), damping=(0.0, 0.0))
    Friction(2 elements, T_fc = 12 N, stiffness at a reversal 3000 N/mm)
    """

    stiffness: tuple[float, ...] = value(
        "N/m", "element stiffness K_i", at_least=0, at_most=1e13, because=STIFF, most=MAX_ELEMENTS
    )
    limit: tuple[float, ...] = value(
        "m", "largest element displacement X_mi", above=0, at_least=1e-13, at_most=100, because=RANGE, most=MAX_ELEMENTS
    )
    damping: tuple[float, ...] = value(
        "N s/m", "element damping D_i", at_least=0, at_most=1e10, because=STIFF, most=MAX_ELEMENTS
    )

    def __repr__(self) -> str:
        return (
            f"Friction({len(self.limit)} elements, T_fc = {show(self.coulomb_force, 'N')}, "
            f"stiffness at a reversal {show(sum(self.stiffness), 'N/m')})"
        )

    def __post_init__(self) -> None:
        counts = {len(self.stiffness), len(self.limit), len(self.damping)}
        if len(counts) != 1 or 0 in counts:
            raise ValueError("a friction needs as many stiffnesses as limits and dampings, and at least one of each")

    @property
    def coulomb_force(self) -> float:
        """T_fc = sum K_i X_mi [N]: the force when every element slips."""
        return sum(k * x for k, x in zip(self.stiffness, self.limit, strict=True))


def elements(stiffness: ArrayLike, limit: ArrayLike, damping: ArrayLike = 0.0) -> Friction:
    """A Friction from arrays of shape (N,) [N/m], [m], [N s/m]; a scalar damping goes for every element.

    >>> pos.friction_elements([2e6, 1e6], [1e-6, 1e-5]).coulomb_force  # [N]
    12.0
    """
    k, x = np.asarray(stiffness, float), np.asarray(limit, float)
    d = np.broadcast_to(np.asarray(damping, float), k.shape)
    return Friction(tuple(k.tolist()), tuple(x.tolist()), tuple(d.tolist()))


def half_way(friction: Friction) -> float:
    """The way [m] behind a reversal from full slip after which half of the friction has turned round."""
    ends = np.concatenate([[0.0], np.sort(2 * np.array(friction.limit))])
    return float(np.interp(friction.coulomb_force, branch(friction, ends), ends))


def branch(friction: Friction, distance: ArrayLike) -> Array:
    """Force climbed [N] at `distance` [m] behind a reversal from full slip: sum K_i min(s, 2 X_i).

    This is Masing's rule: the virgin curve sum K_i min(s, X_i), doubled in both directions.

    >>> float(branch(elements([2e6], [1e-6]), 5e-6))  # [N]: from -2 N to 2 N
    4.0
    """
    s = np.asarray(distance, float)[..., None]
    climbed: Array = np.minimum(s, 2 * np.asarray(friction.limit)) @ np.asarray(friction.stiffness)
    return climbed


def deflections(limit: ArrayLike, path: ArrayLike, state: ArrayLike | None = None) -> Array:
    """Displacements z (n, N) [m] of elements with limits (N,) [m] at each point of the displacement `path` (n,) [m].

    Exact for any path that is monotone between its points; `state` is z at the path's first point (default: zero, the
    virgin state).
    """
    x, points = np.asarray(limit, float), np.asarray(path, float)
    z = np.empty((points.size, x.size))
    z[0] = 0.0 if state is None else np.clip(np.asarray(state, float), -x, x)
    _deflect(points, x, z)
    return z


def follow(friction: Friction, path: ArrayLike, state: ArrayLike | None = None) -> tuple[Array, Array]:
    """Force (n,) [N] at each point of the displacement `path` (n,) [m], and the elements' state (N,) [m] at its end.

    As `deflections`; quasi-static: the damping D_i, which needs a speed, does not act.
    """
    z = deflections(friction.limit, path, state)
    return z @ np.asarray(friction.stiffness), z[-1].copy()


def describing_stiffness(friction: Friction, amplitude: float) -> complex:
    """The describing function K(a) [N/m]: the force's fundamental over that of x = a sin(omega t), for a [m].

    It does not depend on the frequency, as the elements are rate independent; quasi-static, as in `follow`.

    >>> round(describing_stiffness(Friction((1e6,), (1e-6,), (0.0,)), 1e-7).real)  # [N/m]: no element slips
    1000000
    """
    angle = 2 * np.pi * np.arange(3 * PERIOD) / PERIOD
    force, _ = follow(friction, amplitude * np.sin(angle))
    last = slice(2 * PERIOD, None)
    return complex(2j * np.mean(force[last] * np.exp(-1j * angle[last]))) / amplitude


def random_pasts(friction: Friction, count: int, seed: int) -> Array:
    """Paths (count, REACHING + 1) [m] of random motions from rest at 0: each of REACHING strokes either way.

    The strokes are even in the logarithm, from the shortest limit to four times the longest, so that any element may
    stand anywhere in the end, but only as a path can bring it there.
    """
    rng, limit = np.random.default_rng(seed), np.array(friction.limit)
    sizes = np.exp(rng.uniform(np.log(np.min(limit)), np.log(4 * np.max(limit)), (count, REACHING)))
    paths = np.cumsum(sizes * rng.choice([-1.0, 1.0], sizes.shape), axis=1)
    return np.hstack([np.zeros((count, 1)), paths])


def reached_states(friction: Friction, count: int, seed: int) -> Array:
    """States z (count, N) [m] of the elements that `random_pasts` leave."""
    return np.array([deflections(friction.limit, path)[-1] for path in random_pasts(friction, count, seed)])


def fit_elements(limit: ArrayLike, distance: ArrayLike, force: ArrayLike, coulomb_force: float) -> Friction:
    """Elements with given limits (N,) [m] whose `branch` follows force (n,) [N] over distance (n,) [m].

    Non-negative least squares on the stiffnesses, so convex; T_fc = coulomb_force is then met exactly by a common
    factor.
    """
    x, s = np.asarray(limit, float), np.asarray(distance, float)
    stiffness, _ = scipy.optimize.nnls(np.minimum(s[:, None], 2 * x), np.asarray(force, float))
    if not np.any(stiffness > 0):
        raise ValueError("no element follows this curve: its force does not rise with the distance")
    return elements(stiffness * (coulomb_force / float(stiffness @ x)), x)


@compiled
def _deflect(path: Array, limit: Array, z: Array) -> None:
    for k in range(1, path.size):
        step = path[k] - path[k - 1]
        for i in range(limit.size):
            z[k, i] = min(max(z[k - 1, i] + step, -limit[i]), limit[i])
