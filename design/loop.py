"""The exact sampled loop of plant and PID: its sensitivities, their peaks between grid points, stability and margins.

`DIAGRAM` defines L, S, T, PS and CS, here and wherever else they are named. r: x_T* delayed for the PID; noise of the
scale enters as -r does. P(z) is the plant behind its zero-order hold, exact at the samples for any dead time; C(z) is
the PID of `models.controller.PID` as it is sampled, or what any law of `models.feedback` makes of the position. |S| is
the distance's inverse from L to -1: 1 / Ms is the nearest approach.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import matrix_balance, solve_discrete_lyapunov

from models.controller import Feedback
from models.feedback.law import Law
from models.plant import Mode, Plant, sampled_matrices
from models.quantity import show

if TYPE_CHECKING:
    import control

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Sensitivity = Literal["S", "T", "PS", "CS"]

DIAGRAM: Final = """\
                           d  (friction, as thrust)
                           |
 r --->o--- e -->[ C(z) ]->o-->[ P(z) ]--+--> x     L  = P C
      -^                u                |          S  = 1/(1 + L)   r -> e
       +---------------------------------+          T  = L/(1 + L)   r -> x
                                                    PS = P/(1 + L)   d -> x
                                                    CS = C/(1 + L)   r -> u"""
SENSITIVITIES: Final[tuple[Sensitivity, ...]] = ("S", "T", "PS", "CS")
WIDTHS: Final = np.linspace(-4, 4, 17)  # A grid looks at each resonance so many of its half-widths off its centre.
UNDAMPED: Final = 1e-9  # A pole with a smaller damping ratio counts as undamped.
INTEGRATOR: Final = 1e-6  # An eigenvalue slower than this share of Nyquist's frequency counts as an integrator.
ZOOM: Final = 9  # A refinement looks at so many points, and narrows the interval to 2 / (ZOOM - 1) of it.
REFINEMENTS: Final = 8  # They end at 4^-8 = 1.5e-5 of the interval; a maximum is flat, so its value is good to 1e-9.


@dataclass(frozen=True)
class Peak:
    """The largest magnitude of a frequency response [its unit] and where [rad/s]."""

    value: float
    omega: float


@dataclass(frozen=True)
class Assessment:
    """What one loop achieves; all of it holds at and between grid frequencies.

    spectral_radius: largest |eigenvalue| of the closed loop, below 1 if it is stable. ms, mt [1], mps [m/N],
    mcs [N/m]: peaks of |S|, |T|, |PS|, |CS|. crossover: last frequency with |L| = 1 [rad/s]; bandwidth: first with
    |S| = 1 / sqrt(2) [rad/s]. gain_margin [1]: the least factor, up or down, that destabilises, as a number above 1;
    phase_margin [rad]; disk_margin [1]: 2 / max |S - T|, the balanced one.
    """

    spectral_radius: float
    ms: Peak
    mt: Peak
    mps: Peak
    mcs: Peak
    crossover: float
    bandwidth: float
    gain_margin: float
    phase_margin: float
    disk_margin: float

    def __repr__(self) -> str:
        return (
            f"Assessment({'stable' if self.stable else 'UNSTABLE'}, |S| <= {self.ms.value:.3g}, "
            f"|T| <= {self.mt.value:.3g}, "
            f"crossover {show(self.crossover / (2 * math.pi), 'Hz')}, disk margin {self.disk_margin:.3g})"
        )

    @property
    def stable(self) -> bool:
        """Whether every eigenvalue of the closed loop lies within the unit circle."""
        return self.spectral_radius < 1


def controller_model(feedback: Feedback, sample_time: float) -> control.StateSpace:
    """C(z) from e [m] to u_fb [N], as `controller_matrices` has it; sample_time [s]."""
    import control  # noqa: PLC0415  # imports matplotlib, and who only asks whether a loop is stable does not draw

    return control.StateSpace(*controller_matrices(feedback, sample_time), sample_time, inputs=["e"], outputs=["u"])


def controller_matrices(feedback: Feedback, sample_time: float) -> tuple[Array, Array, Array, Array]:
    """A (n, n), B (n, 1), C (1, n), D (1, 1) of C(z), from -x [m] to u_fb [N]; SI.

    States of a PID: I[k-1], unless k_i = 0, and what d[k] owes to the past.
    """
    if isinstance(feedback, Law):
        return feedback.feedback_matrices()
    pid, keep = feedback, feedback.pole(sample_time)
    slope = (1 - keep) / sample_time
    a = np.diag([1.0, keep])
    b = np.array([[pid.ki * sample_time], [(keep - 1) * slope]])
    d = pid.kp + pid.ki * sample_time + pid.kd * slope
    c = np.array([[1.0, pid.kd]])
    if pid.ki == 0:  # an integral that never moves is not part of the loop, nor is its eigenvalue of 1
        a, b, c = a[1:, 1:], b[1:], c[:, 1:]
    return a, b, c, np.array([[d]])


def dominant_pole(
    plant: Plant,
    feedback: Feedback,
    sample_time: float,
    stiffness: float = 0.0,
    damping: float = 0.0,
    lag: float = 0.0,
    by_friction: tuple[Mode, ...] = (),
) -> complex:
    """The closed loop's eigenvalue z [1] of the largest magnitude, one of a pair; inf where the loop is not finite.

    sample_time [s]; stiffness [N/m], damping [N s/m]: of a spring in place of the friction, which drives modes of its
    own, lag [s] of the thrust, see `sampled_matrices`.
    """
    a, b, c = sampled_matrices(plant, sample_time, stiffness, damping=damping, lag=lag, by_friction=by_friction)
    a_pid, b_pid, c_pid, d_pid = controller_matrices(feedback, sample_time)
    loop = np.block([[a - b @ d_pid @ c, b @ c_pid], [-b_pid @ c, a_pid]])
    if not np.all(np.isfinite(loop)):
        return complex(math.inf)
    poles = np.linalg.eigvals(loop)
    return complex(poles[np.argmax(np.abs(poles))])


def closed_loop(plant: control.StateSpace, feedback: Feedback) -> control.StateSpace:
    """The loop of the diagram from (r [m], d [N]) to (e [m], x [m], u [N]), for a plant without direct feedthrough."""
    import control  # noqa: PLC0415  # as in controller_model

    c = controller_model(feedback, plant.dt)
    n, order = plant.nstates, plant.nstates + c.nstates
    a = np.zeros((order, order))
    a[:n, :n], a[:n, n:] = plant.A - plant.B @ c.D @ plant.C, plant.B @ c.C
    a[n:, :n], a[n:, n:] = -c.B @ plant.C, c.A
    b = np.zeros((order, 2))
    b[:n], b[n:, :1] = np.hstack([plant.B @ c.D, plant.B]), c.B
    outputs = np.zeros((3, order))
    outputs[0, :n], outputs[1, :n] = -plant.C[0], plant.C[0]
    outputs[2, :n], outputs[2, n:] = -(c.D @ plant.C)[0], c.C[0]
    through = np.array([[1.0, 0.0], [0.0, 0.0], [c.D[0, 0], 0.0]])
    return control.StateSpace(a, b, outputs, through, plant.dt, inputs=["r", "d"], outputs=["e", "x", "u"])


def sensitivity(plant: control.StateSpace, feedback: Feedback, name: Sensitivity) -> control.StateSpace:
    """One of S, T [1], PS [m/N], CS [N/m] of the diagram as a system of its own."""
    import control  # noqa: PLC0415  # as in controller_model

    whole = closed_loop(plant, feedback)
    row, column = {"S": (0, 0), "T": (1, 0), "PS": (1, 1), "CS": (2, 0)}[name]
    b, c, d = whole.B[:, [column]], whole.C[[row]], whole.D[[row]][:, [column]]
    return control.StateSpace(whole.A, b, c, d, whole.dt)


def frequency_response(system: control.StateSpace, omega: ArrayLike) -> Complex:
    """System (one input, one output) at z = exp(j omega T_s), (n,) [its unit], for omega (n,) [rad/s]."""
    z = np.exp(1j * np.atleast_1d(np.asarray(omega, float)) * system.dt)
    pencil = z[:, None, None] * np.eye(system.nstates) - system.A
    inner = np.linalg.solve(pencil, np.broadcast_to(system.B, (z.size, *system.B.shape)))
    response: Complex = (system.C @ inner)[:, 0, 0] + system.D[0, 0]
    return response


def controller_response(feedback: Feedback, sample_time: float, omega: ArrayLike) -> Complex:
    """C(exp(j omega T_s)) (n,) [N/m], of a PID in closed form, for omega (n,) [rad/s]."""
    if isinstance(feedback, Law):
        return frequency_response(controller_model(feedback, sample_time), omega)
    pid, back = feedback, np.exp(-1j * np.asarray(omega, float) * sample_time)
    keep = pid.pole(sample_time)
    derivative = (1 - keep) / sample_time * (1 - back) / (1 - keep * back)
    return np.asarray(pid.kp + pid.ki * sample_time / (1 - back) + pid.kd * derivative, complex)


def sensitivities(plant: Complex, controller: Complex) -> dict[Sensitivity, Complex]:
    """S, T [1], PS [m/N], CS [N/m] (n,) from P [m/N] and C [N/m] (n,) at the same frequencies."""
    s = 1 / (1 + plant * controller)
    return {"S": s, "T": plant * controller * s, "PS": plant * s, "CS": controller * s}


def spectral_radius(plant: control.StateSpace, feedback: Feedback) -> float:
    """Largest magnitude [1] of the closed loop's eigenvalues."""
    return float(np.max(np.abs(np.linalg.eigvals(closed_loop(plant, feedback).A))))


def grid(plant: control.StateSpace, feedback: Feedback | None = None, count: int = 200, lowest: float = 1e-3) -> Array:
    """Frequencies (n,) [rad/s] up to Nyquist's, dense where a resonance is: of the plant, and of a feedback's loop.

    `count` of them are spread evenly in their logarithm from `lowest` [1, of Nyquist's] on, or from a tenth of the
    slowest eigenvalue if that is lower. A sensitivity can rise and fall sharply only near an eigenvalue of the closed
    loop, so none of its peaks is missed.
    """
    nyquist = math.pi / plant.dt
    matrices = [plant.A] if feedback is None else [plant.A, closed_loop(plant, feedback).A]
    z = np.concatenate([np.linalg.eigvals(matrix) for matrix in matrices])
    poles = np.log(z[np.abs(z) > 1e-3].astype(complex)) / plant.dt
    moving = np.abs(poles)[np.abs(poles) > INTEGRATOR * nyquist]
    spread = np.geomspace(min(lowest * nyquist, 0.1 * np.min(moving, initial=nyquist)), nyquist, count)
    damped = np.abs(poles.real) > UNDAMPED * np.abs(poles)
    poles = poles[(poles.imag > 0) & damped]  # on a pole of the plant without damping there is no response
    near = (poles.imag[:, None] + np.abs(poles.real[:, None]) * WIDTHS).ravel()
    inside = near[(near > spread[0]) & (near < nyquist)]
    return np.unique(np.concatenate([spread, inside]))


def peaks(magnitudes: Callable[[Array], Array], omega: Array) -> list[Peak]:
    """The largest of each of m `magnitudes` (m, n) over omega (n,) [rad/s], refined between the grid's points to 1e-6
    and better; all are asked for together.

    Every maximum of the grid within 30 % of the highest is refined, since the highest one need not be the peak's.
    """
    values = magnitudes(omega)
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=-np.inf)
    high_enough = values > 0.7 * np.max(values, axis=1, keepdims=True)
    which, maxima = np.nonzero((values >= padded[:, :-2]) & (values >= padded[:, 2:]) & high_enough)
    low, high = omega[np.maximum(maxima - 1, 0)], omega[np.minimum(maxima + 1, omega.size - 1)]
    rows = np.arange(maxima.size)
    for _ in range(REFINEMENTS):
        points = np.linspace(low, high, ZOOM, axis=1)
        found = magnitudes(points.ravel()).reshape(-1, *points.shape)[which, rows]
        best = np.argmax(found, axis=1)
        low, high = points[rows, np.maximum(best - 1, 0)], points[rows, np.minimum(best + 1, ZOOM - 1)]
    tops, places = found[rows, best], points[rows, best]
    of_each = [np.flatnonzero(which == i) for i in range(len(values))]
    highest = [some[np.argmax(tops[some])] for some in of_each]
    return [Peak(float(tops[row]), float(places[row])) for row in highest]


def assess(plant: control.StateSpace, feedback: Feedback, *, count: int = 200) -> Assessment:
    """Stability, peaks and margins of one loop; `count` of the grid's frequencies [rad/s] are evenly spread.

    >>> from models.plant import sampled
    >>> pos.assess_loop(sampled(machine.plant, machine.sample_time), machine.control.pid)
    Assessment(stable, |S| <= ..., |T| <= ..., crossover ... Hz, disk margin ...)
    """

    def response(omega: Array) -> dict[Sensitivity, Complex]:
        return sensitivities(frequency_response(plant, omega), controller_response(feedback, plant.dt, omega))

    def magnitudes(omega: Array) -> Array:
        found = response(omega)
        return np.abs([*(found[name] for name in SENSITIVITIES), found["S"] - found["T"]])

    omega = grid(plant, feedback, count)
    found = response(omega)
    *of_these, difference = peaks(magnitudes, omega)
    largest = dict(zip(SENSITIVITIES, of_these, strict=True))
    holds = feedback.has_integral if isinstance(feedback, Law) else feedback.ki > 0
    if holds and largest["T"].value < 1:  # T = 1 at rest, which no grid in a logarithm reaches
        largest["T"] = Peak(1.0, 0.0)
    loop, weak = found["T"] / found["S"], np.abs(found["S"]) - math.sqrt(0.5)
    at_one = _crossings(omega, np.log(np.abs(loop)))
    rising = _crossings(omega, weak)
    there = frequency_response(plant, at_one) * controller_response(feedback, plant.dt, at_one)
    phases = np.abs(np.angle(-there))
    real = _crossings(omega, np.where(loop.real < 0, loop.imag, np.nan))
    gains = np.abs(frequency_response(plant, real) * controller_response(feedback, plant.dt, real))
    return Assessment(
        spectral_radius(plant, feedback),
        largest["S"],
        largest["T"],
        largest["PS"],
        largest["CS"],
        crossover=float(at_one[-1]) if at_one.size else 0.0,
        bandwidth=float(rising[0]) if rising.size else 0.0,
        gain_margin=float(np.min(np.maximum(gains, 1 / gains), initial=math.inf)),
        phase_margin=float(np.min(phases, initial=math.inf)),
        disk_margin=2 / difference.value,
    )


def disturbance_response(plant: control.StateSpace, feedback: Feedback, count: int) -> Array:
    """x (count,) [m per newton] at samples 1 .. count after a unit step of d, by the closed loop's matrices."""
    model = sensitivity(plant, feedback, "PS")
    state, found = np.zeros(model.nstates), []
    for _ in range(count):
        state = model.A @ state + model.B[:, 0]
        found.append(float(model.C[0] @ state))
    return np.array(found)


def intersample(fast: control.StateSpace, feedback: Feedback, sample_time: float, count: int) -> Array:
    """x (count parts,) [m per newton] at `parts` points a sample from 0 on, after a unit step of d at the command.

    fast: the plant, sampled `parts` times as fast as the controller, so that it is exact at every point; its command
    changes with sample_time [s].
    """
    parts = round(sample_time / fast.dt)
    law = controller_model(feedback, sample_time)
    state, memory, command = np.zeros(fast.nstates), np.zeros(law.nstates), 0.0
    path = np.empty(count * parts)
    for k in range(path.size):
        path[k] = float(fast.C[0] @ state)
        if k % parts == 0:
            command = float(law.C[0] @ memory - law.D[0, 0] * path[k])
            memory = law.A @ memory - law.B[:, 0] * path[k]
        state = fast.A @ state + fast.B[:, 0] * (command + 1.0)
    return path


def rms(system: control.StateSpace) -> float:
    """Standard deviation of the output per that of a white input [its unit], of a stable system: its H2 norm."""
    a, units = matrix_balance(system.A, permute=False, separate=True)  # states in units of like size, for the solver
    b, c = system.B / units[0][:, None], system.C * units[0]
    spread = solve_discrete_lyapunov(a, b @ b.T)
    return math.sqrt(float((c @ spread @ c.T + system.D @ system.D.T)[0, 0]))


def stays_below(system: control.StateSpace, bound: float) -> bool:
    """Whether |G| < bound [its unit] at every frequency, decided without a grid, for a stable system.

    After the bilinear map s = (z - 1) / (z + 1), which keeps the magnitudes, |G(jw)| reaches the bound if and only if
    the Hamiltonian matrix has an eigenvalue on the imaginary axis (Boyd, Balakrishnan and Kabamba, 1989).
    """
    a, b, c, d = (np.asarray(matrix, float) for matrix in (system.A, system.B, system.C, system.D))
    shifted = np.linalg.inv(a + np.eye(len(a)))
    a, b, c, d = (
        shifted @ (a - np.eye(len(a))),
        math.sqrt(2) * shifted @ b,
        math.sqrt(2) * c @ shifted,
        d - c @ shifted @ b,
    )
    room = bound**2 - d[0, 0] ** 2
    if room <= 0:  # at Nyquist's frequency
        return False
    inner = a + b @ c * d[0, 0] / room
    hamiltonian = np.block([[inner, b @ b.T / room], [-c.T @ c * bound**2 / room, -inner.T]])
    balanced, _ = matrix_balance(hamiltonian)
    eigenvalues = np.linalg.eigvals(balanced)
    return bool(np.min(np.abs(eigenvalues.real) / np.abs(eigenvalues)) > 1e-7)


def _crossings(omega: Array, values: Array) -> Array:
    """Where `values` (n,) change their sign over omega (n,) [rad/s], on straight lines; nan has no sign."""
    index = np.flatnonzero(values[:-1] * values[1:] < 0)
    share = values[index] / (values[index] - values[index + 1])
    return np.asarray(omega[index] + share * (omega[index + 1] - omega[index]), float)
