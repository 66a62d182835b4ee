"""What the friction's contacts may do beyond the nominal elements: forget, heal, drag, differ by direction or place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from models.effects.base import LIMIT, MOVED, STIFFNESS, Effect, H, Numbers, Place, T, V, X, Z, hook
from models.effects.parameter import parameter, period, phase, switch

FORGOTTEN: Final = 5e-3  # s in which a table at rest loses its direction, where it does
STILL_TIME: Final = 0.03  # s for a rest's distance: well slower a contact heals, well faster it loses what it gained
SURVEY: Final = "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, A survey of models for machines with friction"


@hook
def _relaxing(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    part, time, reloads = p[0], p[1], p[2] > 0.5
    keep = math.exp(-0.5 * now[H] / time)
    leaking, count = 0.0, memory.size // 2
    for i in range(count):
        moved = now[MOVED] if reloads else contact[Z, i] - memory[count + i]
        z = (memory[i] * keep + moved) * keep
        memory[i] = max(-contact[LIMIT, i], min(z, contact[LIMIT, i])) if reloads else z
        memory[count + i] = contact[Z, i]
        leaking += contact[STIFFNESS, i] * memory[i]
    return (1.0 - part) * value + part * leaking


@dataclass(frozen=True)
class FrictionRelaxation(Effect):
    """A part of each contact's force decays with time: slip loads it again, or only what a contact takes up."""

    name: ClassVar = "friction_relaxation"
    family: ClassVar = "friction"
    coordinate: ClassVar = "rest"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    equation: ClassVar = (
        r"F=\sum_i K_i\left[(1-b)z_i+b\,\zeta_i\right],\quad "
        r"\dot\zeta_i=\dot z_i-\zeta_i/\tau\ (r=0)\ \text{or}\ "
        r"\dot\zeta_i=\dot x-\zeta_i/\tau,\ |\zeta_i|\le X_i\ (r=1)"
    )
    source: ClassVar = (
        "Flügge 1975, Viscoelasticity (a Maxwell element beside a spring), here with the slip of each contact; "
        "sizes assumed"
    )
    hooks: ClassVar = {Place.FRICTION: _relaxing}
    part: float = parameter("1", "part b of the force that decays", 0.05, 0.3, "amplitude", at_least=0, below=1)
    time: float = parameter("s", "time constant tau", 0.05, 1.0, "shape", above=0)
    reload: int = switch("r: slip loads it again")

    def memory(self, elements: int) -> int:
        """A leaking displacement and the last displacement of each element."""
        return 2 * elements


@hook
def _healing(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    rise, time, distance = p[0], p[1], p[2]
    rest = 1.0 / (1.0 + (now[V] * STILL_TIME / distance) ** 2)
    gain, loss = rest * now[H] / time, (1.0 - rest) * abs(now[MOVED]) / distance
    final = gain / (gain + loss)
    memory[0] = final + (memory[0] - final) * math.exp(-(gain + loss))
    return value * (1.0 + rise * memory[0])


@dataclass(frozen=True)
class DwellBreakaway(Effect):
    """Contacts that rested hold more, until they have moved a little."""

    name: ClassVar = "dwell_breakaway"
    family: ClassVar = "friction"
    coordinate: ClassVar = "rest"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    equation: ClassVar = (
        r"X_i(1+a\theta),\quad \dot\theta=w\,\frac{1-\theta}{\tau}-(1-w)\frac{|\dot x|}{\lambda}\theta,\quad "
        r"w=\frac{1}{1+(\dot x/v_0)^2},\ v_0=\lambda/30\,\mathrm{ms}"
    )
    source: ClassVar = (
        f"Ruina 1983, Slip instability and state variable friction laws (a state that heals in time and is lost over a "
        f"distance); {SURVEY}; v_0 and sizes assumed"
    )
    hooks: ClassVar = {Place.LIMIT: _healing}
    rise: float = parameter("1", "rise a of the limits after a long rest", 0.02, 0.3, "amplitude", at_least=0)
    time: float = parameter("s", "time constant tau of the rise", 0.1, 10.0, "shape", above=0)
    distance: float = parameter(
        "m", "distance lambda over which it is lost", 1e-6, 1e-5, "shape", points_per_decade=2, above=0
    )

    def memory(self, elements: int) -> int:
        """The state theta."""
        return 1


@hook
def _viscous(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value + p[0] * now[V]


@dataclass(frozen=True)
class ViscousFriction(Effect):
    """A drag in proportion to speed."""

    name: ClassVar = "viscous_friction"
    family: ClassVar = "friction"
    coordinate: ClassVar = "speed"
    parity: ClassVar = "odd"
    equation: ClassVar = r"F+c\,\dot x"
    source: ClassVar = f"{SURVEY}; sizes assumed"
    hooks: ClassVar = {Place.FRICTION: _viscous}
    coefficient: float = parameter("N s/m", "drag c", 10.0, 100.0, "amplitude", at_least=0)

    def viscous_drag(self) -> float:
        """The coefficient [N s/m]."""
        return self.coefficient


@hook
def _stribeck(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    rise, speed = p[0], p[1]
    return value * (1.0 + rise * math.exp(-((now[V] / speed) ** 2)))


@dataclass(frozen=True)
class Stribeck(Effect):
    """Contacts hold more at low speed."""

    name: ClassVar = "stribeck"
    family: ClassVar = "friction"
    coordinate: ClassVar = "speed"
    parity: ClassVar = "odd"
    equation: ClassVar = r"X_i\left(1+a\,e^{-(\dot x/v_s)^2}\right)"
    source: ClassVar = f"Bo and Pavelescu 1982, The friction-speed relation; {SURVEY}; sizes assumed"
    hooks: ClassVar = {Place.LIMIT: _stribeck}
    rise: float = parameter("1", "rise a of the limits at rest", 0.05, 0.3, "amplitude", at_least=0)
    speed: float = parameter("m/s", "speed v_s over which it is lost", 5e-4, 5e-3, "shape", above=0)


@hook
def _strengthening(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    rise, speed = p[0], p[1]
    return value * (1.0 + 0.5 * rise * math.log1p((now[V] / speed) ** 2))


@dataclass(frozen=True)
class VelocityStrengthening(Effect):
    """Friction grows with the logarithm of speed, as in lubricated screws and slides."""

    name: ClassVar = "velocity_strengthening"
    family: ClassVar = "friction"
    coordinate: ClassVar = "speed"
    parity: ClassVar = "odd"
    equation: ClassVar = r"X_i\left(1+\tfrac{a}{2}\ln(1+(\dot x/v_0)^2)\right)"
    source: ClassVar = (
        "Eyring 1936, Viscosity, plasticity, and diffusion as examples of absolute reaction rates (the stress of a "
        "film); Dieterich 1979, Modeling of rock friction (the logarithm); smooth at rest, and sizes: assumed"
    )
    hooks: ClassVar = {Place.LIMIT: _strengthening}
    common_on: ClassVar = ()  # rolling guides have none: a machine file that states its sizes asks for it
    rise: float = parameter("1", "rise a of the limits with each e-fold of speed", 0.02, 0.5, "amplitude", at_least=0)
    speed: float = parameter("m/s", "speed v_0 above which it is a logarithm", 1e-4, 1e-2, "shape", above=0)


@hook
def _directional(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    asymmetry, distance, forgets, drag = p[0], p[1], p[2] > 0.5, p[3]
    keep = math.exp(-0.5 * now[H] / FORGOTTEN) if forgets else 1.0
    memory[0] = max(-1.0, min((memory[0] * keep + now[MOVED] / distance) * keep, 1.0))
    return value * (1.0 + asymmetry * memory[0]) + drag * memory[0] * now[V]


@dataclass(frozen=True)
class DirectionalFriction(Effect):
    """Friction is larger one way than the other; a table at rest keeps its direction, or loses it.

    Beside a drag c, d = 0 makes the whole friction differ, d = -a c that of the contacts alone, and a = 0 the drag
    alone. s is the sign of the speed but for a turn, over lambda [m], and where a rest loses it for speeds below
    lambda / tau_0 [m/s]. For strokes that let every contact slip: where contacts stick under a load, the law can give
    energy back, and their force changes at rest with r = 1.
    """

    name: ClassVar = "directional_friction"
    family: ClassVar = "friction"
    coordinate: ClassVar = "direction"
    parity: ClassVar = "even"
    equation: ClassVar = (
        r"F(1+a\,s)+d\,s\,\dot x,\quad |s|\le 1,\quad \dot s=\dot x/\lambda\ (r=0)\ \text{or}\ "
        r"\dot s=\dot x/\lambda-s/\tau_0\ (r=1),\ \tau_0=5\,\mathrm{ms}"
    )
    source: ClassVar = (
        "Janot, Gautier and Brunot 2019, Data set and reference models of EMPS (friction that differs by direction); "
        "over a distance, so that nothing jumps where the table turns, and what a rest does: assumed, as sizes; tau_0 "
        "such that the direction goes by speeds below 0.1 to 1 mm/s, as that of the blind trial's sealer"
    )
    hooks: ClassVar = {Place.FRICTION: _directional}
    asymmetry: float = parameter("1", "asymmetry a", 0.02, 0.1, "amplitude", signed=True, above=-1, below=1)
    distance: float = parameter(
        "m", "half the distance lambda over which it turns", 5e-7, 5e-6, "shape", points_per_decade=2, above=0
    )
    forgets: int = switch("r: a rest loses the direction")
    drag: float = parameter(
        "N s/m", "further difference d of the drag", 0.5, 20.0, "amplitude", signed=True, default=0.0
    )

    def memory(self, elements: int) -> int:
        """The direction s."""
        return 1

    def larger_forwards(self) -> tuple[float, float]:
        """The asymmetry [1] and the further difference of the drag [N s/m]."""
        return self.asymmetry, self.drag


@hook
def _placed(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    part, length, angle = p[0], p[1], p[2]
    return value * (1.0 + part * math.sin(2.0 * math.pi * now[X] / length + angle))


@dataclass(frozen=True)
class PositionDependentFriction(Effect):
    """Friction varies along the guide."""

    name: ClassVar = "position_dependent_friction"
    family: ClassVar = "friction"
    coordinate: ClassVar = "position"
    parity: ClassVar = "odd"
    equation: ClassVar = r"F\left(1+a\sin(2\pi x/L+\varphi)\right)"
    source: ClassVar = "Armstrong-Hélouvry 1991, Control of machines with friction (measured on a robot); sizes assumed"
    hooks: ClassVar = {Place.FRICTION: _placed}
    part: float = parameter("1", "variation a", 0.03, 0.2, "amplitude", at_least=0, below=1)
    length: float = period("m", "length L of a period", 3e-3, 6e-2, "position", points=18, above=0)
    phase: float = phase()


@hook
def _lagging(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    time, lag, last, called = p[0], memory[0], memory[1], memory[2] > 0.0
    if time == 0.0:
        return value
    if called:  # the force as a straight line from the last call's to this one
        keep = math.exp(-now[H] / time)
        lag = lag * keep + (value - last) * time / now[H] * (1.0 - keep)
    memory[0], memory[1], memory[2] = lag, value, 1.0
    return value - lag


@dataclass(frozen=True)
class FrictionalLag(Effect):
    """Friction follows what the contacts say with a lag."""

    name: ClassVar = "frictional_lag"
    family: ClassVar = "friction"
    coordinate: ClassVar = "change of friction"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    equation: ClassVar = r"\tau\dot F+F=\sum_i K_i z_i"
    source: ClassVar = (
        "Hess and Soom 1990, Friction at a lubricated line contact operating at oscillating sliding velocities "
        "(a lag); of first order, and sizes: assumed"
    )
    hooks: ClassVar = {Place.FRICTION: _lagging}
    time: float = parameter("s", "time constant tau", 2e-4, 3e-3, "width", at_least=0)

    def memory(self, elements: int) -> int:
        """By how much the friction lags, the force at the last call, and whether there was one."""
        return 3


@hook
def _drifting(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value * (1.0 + p[0] * now[T])


@dataclass(frozen=True)
class FrictionDrift(Effect):
    """Friction grows or falls with time, as where the lubricant warms."""

    name: ClassVar = "friction_drift"
    family: ClassVar = "friction"
    coordinate: ClassVar = "time"
    parity: ClassVar = "odd"
    equation: ClassVar = r"F(1+k t)"
    source: ClassVar = "assumed: the first term of any slow change; 4 to 40 % in 40 s"
    hooks: ClassVar = {Place.FRICTION: _drifting}
    depends_on_time: ClassVar = True
    rate: float = parameter("1/s", "relative rate k", 1e-3, 1e-2, "amplitude", signed=True)


@hook
def _playing(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    width = p[0]
    memory[0] = max(-0.5 * width, min(memory[0] - now[MOVED], 0.5 * width))
    return value + memory[0]


@dataclass(frozen=True)
class Play(Effect):
    """A dead zone between the table and the friction's contacts: behind a reversal, the force stays for a while.

    For strokes well above w: the operator gives energy back on those that are not, which no clearance does.
    """

    name: ClassVar = "play"
    family: ClassVar = "friction"
    coordinate: ClassVar = "way since a reversal"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    equation: ClassVar = r"x_c=x+o,\quad \dot o=-\dot x\ \text{while}\ |o|\le w/2\quad(\text{play operator})"
    source: ClassVar = "Krasnosel'skii and Pokrovskii 1989, Systems with hysteresis; sizes assumed"
    hooks: ClassVar = {Place.PATH: _playing}
    width: float = parameter("m", "width w of the dead zone", 2e-7, 3e-6, "width", at_least=0)

    def memory(self, elements: int) -> int:
        """By how much the contacts are off the table."""
        return 1


@hook
def _swinging(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    gained = (now[V] - memory[0]) * memory[1]
    memory[0] = now[V]
    memory[1] = 1.0
    return value + p[0] * gained / now[H]


@dataclass(frozen=True)
class NoncollocatedFriction(Effect):
    """The friction acts on another part of the structure than the one where the scale reads, with a spring between.

    Exact where one inertia J is between them, on a spring k: the scale's on the side of the friction, such as a mirror
    or a load with the encoder on it and the bearing at the motor, c = J/k = 1/w^2, w its frequency [rad/s] while the
    friction's side is held. A negative c is the first term of the reverse: the scale at the motor, friction beyond.
    The acceleration is that of the substep before, so that simulation is of first order in its length.
    """

    name: ClassVar = "noncollocated_friction"
    family: ClassVar = "friction"
    coordinate: ClassVar = "acceleration"
    parity: ClassVar = "odd"
    equation: ClassVar = r"x_c=x+c\,\ddot x"
    source: ClassVar = "Newton's second law of the inertia between; sizes assumed: held, it swings at 160 Hz to 1.6 kHz"
    hooks: ClassVar = {Place.PATH: _swinging}
    differentiates: ClassVar = True
    advance: float = parameter(
        "s^2", "advance c of the contacts per acceleration", 1e-8, 1e-6, "amplitude", signed=True
    )

    def memory(self, elements: int) -> int:
        """The speed at the last call, and whether there was one."""
        return 2
