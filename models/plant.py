"""The linear plant P_l(s) of eq. (1), once, as a CasADi expression, and what follows from it.

    P_l(s) = exp(-L s) P'(s),   P'(s) = K_t sum_i k_i / (s^2 + 2 zeta_i w_i s + w_i^2)

    P_e(s) = exp(-L s) P'(s) / (1 + K_e P'(s))                                                            (2)

The rigid body is the mode with w = 0; its gain is positive. A vibration mode's gain has either sign: negative where the
scale moves against the thrust in it, as on the far side of a compliance. States: (q_1, q_1', q_2, q_2', ...), with
x = sum q_i [m]; input: the thrust less the friction [N of thrust reference], because friction acts at the thrust's
input, as K_e does in eq. (2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from models.quantity import listed, show, value

if TYPE_CHECKING:
    import control

Array = NDArray[np.float64]

UNITS_REASON: Final = "the thrust reference would not be in a unit of force or current"


@dataclass(frozen=True)
class Mode:
    """One term k / (s^2 + 2 zeta w s + w^2) of eq. (1); the rigid body is the one with frequency 0.

    >>> pos.Mode(gain=1 / 45, frequency=0, damping=0)  # a rigid body of 45 kg
    Mode(gain=0.0222..., frequency=0, damping=0)
    """

    gain: float = value(
        "1/kg",
        "modal gain k_t (negative: against the thrust)",
        above=-1e16,
        below=1e16,
        because="no mass is that small",
    )
    frequency: float = value(
        "Hz",
        "natural frequency w / 2 pi (0: rigid body)",
        at_least=0,
        at_most=1e6,
        because="structures vibrate at 1 Hz to 10 kHz",
    )
    damping: float = value("1", "damping ratio zeta", at_least=0, below=1)


@dataclass(frozen=True)
class Plant:
    """P_l(s) of eq. (1).

    A mode of frequency 0 is a rigid body. `rigid`, `rigid_gain` and `mass` are of plants that have exactly one,
    wherever it stands among the modes, and raise ValueError for others.

    >>> plant = pos.Plant(1e-3, 1.0, modes=(pos.Mode(1 / 45, 0, 0), pos.Mode(0.002, 55, 0.02)))
    >>> plant
    Plant(45 kg and 55 Hz, dead time 1 ms)
    >>> round(plant.mass, 6), plant.flexible
    (45.0, (1,))
    """

    dead_time: float = value(
        "s", "equivalent dead time L", at_least=0, at_most=10, because="no loop is closed around more"
    )
    thrust_constant: float = value(
        "1", "thrust per thrust reference K_t", above=0, at_least=1e-9, at_most=1e9, because=UNITS_REASON
    )
    modes: tuple[Mode, ...] = ()

    def __repr__(self) -> str:
        bodies = [show(1 / (self.thrust_constant * one.gain), "kg") for one in self.modes if one.frequency == 0]
        modes = [f"{self.modes[i].frequency:.4g} Hz" for i in self.flexible]
        return f"Plant({listed([*bodies, *modes]) or 'nothing moves'}, dead time {show(self.dead_time, 's')})"

    @property
    def rigid(self) -> int:
        """The index of the rigid body in `modes`."""
        found = [i for i, mode in enumerate(self.modes) if mode.frequency == 0]
        if len(found) != 1:
            raise ValueError(f"the plant has {len(found)} rigid bodies; exactly one mode must have the frequency 0")
        return found[0]

    @property
    def flexible(self) -> tuple[int, ...]:
        """The indices in `modes` of the vibration modes, in their order."""
        return tuple(i for i, mode in enumerate(self.modes) if mode.frequency > 0)

    @property
    def lowest_mode(self) -> float:
        """The lowest frequency of a vibration mode [Hz]; inf without one."""
        return min((self.modes[i].frequency for i in self.flexible), default=math.inf)

    @property
    def rigid_gain(self) -> float:
        """Acceleration of the rigid body over the thrust reference, K_t k [1/kg]."""
        return self.thrust_constant * self.modes[self.rigid].gain

    @property
    def mass(self) -> float:
        """Thrust reference over the acceleration of the rigid body, 1 / (K_t k) [kg]: the moving mass if K_t is 1."""
        return 1 / self.rigid_gain


@cache
def equations(count: int) -> ca.Function:
    """CasADi function (state (2m,), thrust, gain (m,), omega (m,) [rad/s], zeta (m,), K_t) -> (state', x), m = count.

    Eq. (1) without its dead time; `thrust` is what acts at the input, friction already taken off.
    """
    state, thrust, constant = ca.SX.sym("state", 2 * count), ca.SX.sym("thrust"), ca.SX.sym("K_t")
    gain, omega, zeta = (ca.SX.sym(name, count) for name in ("gain", "omega", "zeta"))
    q, rate = state[0::2], state[1::2]
    acceleration = gain * constant * thrust - 2 * zeta * omega * rate - omega**2 * q
    derivative = ca.reshape(ca.horzcat(rate, acceleration).T, -1, 1)
    inputs = [state, thrust, gain, omega, zeta, constant]
    names = ["state", "thrust", "gain", "omega", "zeta", "K_t"]
    return ca.Function("plant", inputs, [derivative, ca.sum1(q)], names, ["derivative", "position"])


def state_space(plant: Plant, stiffness: float = 0.0) -> control.StateSpace:
    """P'(s) of eq. (1), or with `stiffness` = K_e [N/m] the delay-free part of P_e(s), eq. (2).

    Continuous control.StateSpace from thrust [N] to position [m], states as in the module's head.
    """
    a, b, c = matrices(plant)
    return _space(a - stiffness * b @ c, b, c, None)


def frequency_response(plant: Plant, omega: ArrayLike, stiffness: float = 0.0) -> NDArray[np.complex128]:
    """P_l(j omega) (n,) [m/N], or P_e(j omega) for K_e = stiffness [N/m], dead time included.

    omega [rad/s]: of any shape, which the response has, too.

    >>> response = pos.frequency_response(machine.plant, [1.0, 1000.0])
    >>> response.shape, bool(abs(response[0]) > abs(response[1]))
    ((2,), True)
    """
    w = np.asarray(omega, float)
    rational = _rational(plant, 1j * w.ravel(), stiffness).reshape(w.shape)
    return np.asarray(rational * np.exp(-1j * w * plant.dead_time))


def bode(plant: Plant, omega: ArrayLike, stiffness: float = 0.0) -> tuple[Array, Array]:
    """(magnitude [m/N], phase [rad]), each (n,), of P_l or P_e at omega (n,) [rad/s], dead time included.

    The phase is that of the delay-free part, taken between -350 and 10 degrees, less omega L. So it falls at an
    undamped resonance, where unwrapping from one frequency to the next could not tell +180 from -180 degrees. Beyond
    two modes of negative gain it starts again at 10 degrees.
    """
    w = np.asarray(omega, float)
    rational = _rational(plant, 1j * w, stiffness)
    angle = np.angle(rational)
    return np.abs(rational), np.where(angle > math.pi / 18, angle - 2 * math.pi, angle) - w * plant.dead_time


def antiresonances(plant: Plant) -> tuple[float, ...]:
    """The frequencies [Hz] at which the scale stands still and the rest of the structure swings, as it does while
    friction holds the scale: the zeros of P_l that oscillate, the lowest first."""
    zeros = np.asarray(state_space(plant).zeros())
    return tuple(sorted(float(abs(one)) / (2 * math.pi) for one in zeros if one.imag > abs(one.real)))


def _rational(plant: Plant, points: ArrayLike, stiffness: float) -> NDArray[np.complex128]:
    """P' or the delay-free part of P_e at complex points [rad/s] (n,) [m/N]."""
    a, b, c = matrices(plant)
    return _resolvent(a - stiffness * b @ c, b, c, points)


def _resolvent(a: Array, b: Array, c: Array, points: ArrayLike) -> NDArray[np.complex128]:
    """C (p I - A)^-1 B at complex points p (n,)."""
    p = np.asarray(points, complex)
    shifted = p[:, None, None] * np.eye(len(a)) - a
    state = np.linalg.solve(shifted, np.broadcast_to(b.astype(complex), (p.size, len(a), 1)))
    return np.asarray((c @ state)[:, 0, 0])


def delay_split(dead_time: float, sample_time: float) -> tuple[int, float]:
    """(d, rest [s]): dead_time = d sample_time + rest [s], 0 <= rest < sample_time; round-off counts as no rest."""
    whole = math.floor(dead_time / sample_time + 1e-9)
    rest = dead_time - whole * sample_time
    return whole, rest if rest > 1e-9 * sample_time else 0.0


def transition(a: Array, b: Array, duration: float) -> tuple[Array, Array]:
    """(Phi (n, n), Gamma (n, 1)): exact response over `duration` [s] of state' = A state + B u, A (n, n) and B (n, 1),
    to the state and to a held input; SI."""
    n = len(a)
    exponent = np.zeros((n + 1, n + 1))
    exponent[:n, :n], exponent[:n, n:] = a, b
    both = expm(exponent * duration)
    return both[:n, :n], both[:n, n:]


def sampled(
    plant: Plant,
    sample_time: float,
    stiffness: float = 0.0,
    *,
    damping: float = 0.0,
    lag: float = 0.0,
    whole_delay: bool = True,
    by_friction: tuple[Mode, ...] = (),
) -> control.StateSpace:
    """Exact model of the plant behind a zero-order hold, at the samples [s], for any dead time: StateSpace with dt.

    The thrust changes in the midst of a sample when L is not a multiple of sample_time; the inputs under way are states
    behind those of `state_space`: (..., u[k-1], u[k-2], ...). `whole_delay=False` leaves out the d whole samples of
    delay (L = d T_s + rest) and keeps the rest. damping, lag, by_friction: see `sampled_matrices`.
    """
    found = sampled_matrices(
        plant, sample_time, stiffness, damping=damping, lag=lag, whole_delay=whole_delay, by_friction=by_friction
    )
    return _space(*found, sample_time)


def sampled_matrices(
    plant: Plant,
    sample_time: float,
    stiffness: float = 0.0,
    *,
    damping: float = 0.0,
    lag: float = 0.0,
    whole_delay: bool = True,
    by_friction: tuple[Mode, ...] = (),
) -> tuple[Array, Array, Array]:
    """A (n, n), B (n, 1), C (1, n) of `sampled`, for who needs no control.StateSpace; arguments as there; SI.

    damping: of the spring K_e, by the speed at the scale [N s/m]. lag: of first order, with which the thrust follows
    its command behind the dead time [s]; the thrust is then the last state of the plant's own. by_friction: modes that
    the spring drives and the thrust does not, as it is on another part of the structure.
    """
    whole, rest = delay_split(plant.dead_time, sample_time)
    a_plant, b_plant, c_plant = against_spring(plant, stiffness, damping, by_friction)
    if lag > 0:
        a_plant, b_plant, c_plant = _behind_lag(a_plant, b_plant, c_plant, lag)
    n, memory = len(a_plant), (whole if whole_delay else 0) + (rest > 0)
    phi, _ = transition(a_plant, b_plant, sample_time)
    part = sample_time - rest  # in which the newer command acts
    behind, late = transition(a_plant, b_plant, part)
    _, early = transition(a_plant, b_plant, rest)
    inputs = np.zeros((n, memory + 1))  # what u[k], u[k-1], ... contribute to the next state
    inputs[:, memory - (rest > 0)] += late[:, 0]
    if rest > 0:
        inputs[:, memory] += (behind @ early)[:, 0]
    a = np.zeros((n + memory, n + memory))
    a[:n, :n], a[:n, n:] = phi, inputs[:, 1:]
    a[n + 1 :, n:-1] = np.eye(max(memory - 1, 0))
    b = np.zeros((n + memory, 1))
    b[:n, 0] = inputs[:, 0]
    if memory:
        b[n, 0] = 1.0
    return a, b, np.hstack([c_plant, np.zeros((1, memory))])


def _behind_lag(a: Array, b: Array, c: Array, lag: float) -> tuple[Array, Array, Array]:
    """A (n + 1, n + 1), B (n + 1, 1), C (1, n + 1) of a plant behind lag u_i' + u_i = u, its last state u_i; lag
    [s]."""
    n = len(a)
    both = np.block([[a, b], [np.zeros((1, n)), np.full((1, 1), -1 / lag)]])
    return both, np.vstack([np.zeros((n, 1)), [[1 / lag]]]), np.hstack([c, np.zeros((1, 1))])


def against_spring(
    plant: Plant, stiffness: float, damping: float = 0.0, by_friction: tuple[Mode, ...] = ()
) -> tuple[Array, Array, Array]:
    """A (n, n), B (n, 1), C (1, n) of a plant against a spring at its scale, which bears stiffness x + damping x' where
    the thrust acts, and drives modes of its own; stiffness [N/m], damping [N s/m]; C B = 0, as a force moves nothing at
    once."""
    driven = by_friction if stiffness or damping else ()  # else nothing drives them
    a, b, c = matrices(replace(plant, modes=(*plant.modes, *driven)))
    held = a - stiffness * b @ c
    thrust = b.copy()
    thrust[2 * len(plant.modes) :] = 0.0
    return (held - damping * b @ c @ a if damping else held), thrust, c


def _space(a: Array, b: Array, c: Array, sample_time: float | None) -> control.StateSpace:
    import control  # noqa: PLC0415  # imports matplotlib, and most commands neither design nor draw

    time = () if sample_time is None else (sample_time,)
    return control.StateSpace(a, b, c, np.zeros((1, 1)), *time, inputs=["u_M"], outputs=["x_T"])


def matrices(plant: Plant) -> tuple[Array, Array, Array]:
    """A (2m, 2m), B (2m, 1), C (1, 2m) of `state_space` at the plant's parameters; SI."""
    gain = [mode.gain for mode in plant.modes]
    omega = [2 * math.pi * mode.frequency for mode in plant.modes]
    zeta = [mode.damping for mode in plant.modes]
    a, b, c = _jacobians(len(plant.modes))(gain, omega, zeta, plant.thrust_constant)
    return np.array(a), np.array(b), np.array(c)


@cache
def _jacobians(count: int) -> ca.Function:
    """CasADi function (gain, omega, zeta, K_t) -> (A, B, C) of `equations`, which are linear in state and thrust."""
    state, thrust, constant = ca.SX.sym("state", 2 * count), ca.SX.sym("thrust"), ca.SX.sym("K_t")
    parameters = [ca.SX.sym(name, count) for name in ("gain", "omega", "zeta")] + [constant]
    derivative, position = equations(count)(state, thrust, *parameters)
    jacobians = [ca.jacobian(derivative, state), ca.jacobian(derivative, thrust), ca.jacobian(position, state)]
    return ca.Function("matrices", parameters, [ca.densify(jacobian) for jacobian in jacobians])
