"""What the structure and the surroundings may add: a mode, the floor, a cable."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Self

from models.effects.base import LIMIT, STIFFNESS, Effect, H, Numbers, Place, T, V, X, Z, hook
from models.effects.parameter import counted, parameter, period, phase
from models.plant import Mode, Plant

# What the hook of friction on the load remembers: whether it has begun; displacement and speed of the load as it would
# follow the motor without friction, and of the spring as the friction stretches it; where the load was at the last
# call, the pull of the motor over the load's mass then, and the friction; the displacements of the load's own elements.
BEGUN, FREE, FREE_SPEED, STRETCH, STRETCH_SPEED, WAS, PULLED, RUBBED, OWN = range(9)
MOST_RATIO: Final = (
    10.0  # between the masses of load and motor, where friction on the load differs from that on the motor
)
TYPICAL_SHARE: Final = math.sqrt(0.1)  # of the friction on the load


@dataclass(frozen=True)
class AdditionalMode(Effect):
    """One more vibration mode beside the plant's; with a negative gain it moves against the thrust."""

    name: ClassVar = "additional_mode"
    family: ClassVar = "structure"
    coordinate: ClassVar = "acceleration"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    equation: ClassVar = r"P'(s)+K_t\frac{k}{s^2+2\zeta\omega s+\omega^2}"
    source: ClassVar = "Ewins 2000, Modal testing; sizes assumed: 1 to 10 % of 1/M for M of 15 to 50 kg"
    gain: float = parameter("1/kg", "modal gain k", 2e-4, 7e-3, "amplitude", signed=True)
    frequency: float = parameter("Hz", "natural frequency", 100.0, 400.0, "shape", points=8, above=0)
    damping: float = parameter("1", "damping ratio", 5e-3, 5e-2, "shape", points=2, at_least=0, below=1)

    def modes(self) -> tuple[Mode, ...]:
        """The mode, unless its gain is 0."""
        return (Mode(self.gain, self.frequency, self.damping),) if self.gain != 0 else ()


@dataclass(frozen=True)
class FrictionDrivenMode(AdditionalMode):
    """A vibration mode that the friction drives and the thrust does not, as the two act on different parts of the
    structure, with a spring between.

    Exact for a motor m_1 and a load m_2 on a spring, friction and scale on the load, whose plant the machine file has:
    of the frequency and the damping of its mode, and with a gain of 1/m_2. With a negative one, the friction, whose
    contacts go with what the scale reads, would put energy into the mode.
    """

    name: ClassVar = "friction_driven_mode"
    coordinate: ClassVar = "friction"
    equation: ClassVar = r"x=K_t\left[P'(s)\,(u-F)-\frac{k}{s^2+2\zeta\omega s+\omega^2}\,F\right]"
    source: ClassVar = "Ewins 2000, Modal testing (receptances of two points); sizes assumed: a fifth of 1/M to 9/M"
    friction_drives: ClassVar = True
    gain: float = parameter("1/kg", "modal gain k", 5e-3, 0.2, "amplitude", at_least=0)


@hook
def _on_the_load(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    share, spring, mass, h = p[0], p[1], p[2], now[H]
    square = spring / mass
    drag = 2.0 * p[3] * math.sqrt(square)  # over the mass
    pulled = square * now[X] + drag * now[V]
    if memory[BEGUN] == 0.0:  # in equilibrium, its contacts as those of the motor
        memory[BEGUN], memory[FREE], memory[FREE_SPEED] = 1.0, now[X], now[V]
        rubbed = 0.0
        for i in range(memory.size - OWN):
            memory[OWN + i] = contact[Z, i]
            rubbed += contact[STIFFNESS, i] * contact[Z, i]
        memory[STRETCH] = share * rubbed / spring
        memory[WAS] = memory[FREE] - memory[STRETCH]
    else:  # by the trapezoidal rule, which is stable however stiff the spring and the contacts that stick are
        half = 0.5 * h * drag + 0.25 * h * h * square
        before, rate = memory[FREE_SPEED], 0.5 * (pulled + memory[PULLED])
        memory[FREE_SPEED] = (before * (1.0 - half) + h * (rate - square * memory[FREE])) / (1.0 + half)
        ahead = 0.5 * h * (before + memory[FREE_SPEED])
        memory[FREE] += ahead
        before, sticking = memory[STRETCH_SPEED], 0.0
        for i in range(memory.size - OWN):
            onwards = memory[OWN + i] if ahead > h * before else -memory[OWN + i]
            sticking += contact[STIFFNESS, i] if onwards < contact[LIMIT, i] else 0.0
        half += 0.25 * h * h * share * sticking / mass
        rate = share * (memory[RUBBED] + 0.5 * sticking * ahead) / mass
        memory[STRETCH_SPEED] = (before * (1.0 - half) + h * (rate - square * memory[STRETCH])) / (1.0 + half)
        memory[STRETCH] += 0.5 * h * (before + memory[STRETCH_SPEED])
        at = memory[FREE] - memory[STRETCH]
        moved, rubbed = at - memory[WAS], 0.0
        memory[WAS] = at
        for i in range(memory.size - OWN):
            limit = contact[LIMIT, i]
            memory[OWN + i] = max(-limit, min(memory[OWN + i] + moved, limit))
            rubbed += contact[STIFFNESS, i] * memory[OWN + i]
    memory[PULLED], memory[RUBBED] = pulled, rubbed
    on_motor = 0.0
    for i in range(memory.size - OWN):
        on_motor += contact[STIFFNESS, i] * contact[Z, i]
    return value - share * on_motor + spring * memory[STRETCH] + mass * drag * memory[STRETCH_SPEED]


@dataclass(frozen=True)
class LoadSideFriction(Effect):
    """A share of the rolling friction acts on the load, while the thrust and the scale are at the motor, with a spring
    between: a belt, a screw or a gear with the encoder on the motor.

    Exact for a motor m_1 and a load m on a spring k, whose plant the machine file has: a rigid body of m_1 + m and a
    mode of a positive gain. The load's contacts go with the load, which stays behind by the way that its friction
    stretches the spring, and have the motor's limits; their damping, and all other forces, stay on the motor.
    """

    name: ClassVar = "load_side_friction"
    family: ClassVar = "structure"
    coordinate: ClassVar = "friction"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    equation: ClassVar = (
        r"F=(1-s)\,f(x)+\frac{c\,p+k}{m\,p^2+c\,p+k}\,s\,f(x_2),\quad "
        r"x_2=\frac{(c\,p+k)\,x-s\,f(x_2)}{m\,p^2+c\,p+k},\quad c=2\zeta\sqrt{k\,m}"
    )
    source: ClassVar = "Newton's second law of the load; sizes assumed: held by the motor, it swings at 1 Hz to 1 kHz"
    hooks: ClassVar = {Place.FRICTION: _on_the_load}
    rubs_elsewhere: ClassVar = True
    share: float = parameter(
        "1", "share s of the friction that acts on the load", 0.1, 1.0, "amplitude", at_least=0, at_most=1
    )
    stiffness: float = counted(
        parameter("N/m", "stiffness k of the spring between", 1e3, 1e9, "shape", above=0),
        {"mass": 1, "loop": -2},
        {"mass": 1, "sample": -2},
    )
    mass: float = parameter("kg", "mass m of the load", 2.0, 45.0, "shape", above=0)
    damping: float = parameter(
        "1", "damping ratio of the load while the motor is held", 1e-4, 0.5, "shape", at_least=0, below=1
    )

    def memory(self, elements: int) -> int:
        """The load's motion, the spring's stretch and the load's own elements, see BEGUN."""
        return OWN + elements

    @classmethod
    def placed(cls, plant: Plant) -> tuple[Self, ...]:
        """The load behind the spring of each vibration mode that a motor would have with its scale on it, its typical
        share of the friction on the load; none where the plant has no such mode."""
        found = []
        for mode in plant.modes:
            ratio = mode.gain / plant.modes[plant.rigid].gain  # the load's mass over the motor's
            if mode.frequency > 0 and 1 / MOST_RATIO <= ratio <= MOST_RATIO:
                mass = plant.mass * ratio / (1 + ratio)
                held = 2 * math.pi * mode.frequency / math.sqrt(1 + ratio)
                found.append(cls(TYPICAL_SHARE, mass * held**2, mass, mode.damping / math.sqrt(1 + ratio)))
        return tuple(found)


@hook
def _shaking(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    amplitude, frequency, angle = p[0], p[1], p[2]
    return value + amplitude * math.sin(2.0 * math.pi * frequency * now[T] + angle)


@dataclass(frozen=True)
class FloorVibration(Effect):
    """The floor shakes the table, whatever it does."""

    name: ClassVar = "floor_vibration"
    family: ClassVar = "structure"
    coordinate: ClassVar = "time"
    parity: ClassVar = "even"
    equation: ClassVar = r"d=A\sin(2\pi f t+\varphi)"
    source: ClassVar = (
        "Gordon 1991, Generic criteria for vibration-sensitive equipment; sizes assumed: 0.02 N is an acceleration of "
        "0.4 mm/s2 of 45 kg"
    )
    hooks: ClassVar = {Place.FORCE: _shaking}
    depends_on_time: ClassVar = True
    amplitude: float = parameter("N", "amplitude A", 0.02, 1.0, "amplitude", at_least=0)
    frequency: float = period("Hz", "frequency f", 2.0, 30.0, "time", above=0)
    phase: float = phase()


@hook
def _falling(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value - p[0] * math.sin(now[X] + p[1])


@dataclass(frozen=True)
class Gravity(Effect):
    """The weight of what turns about a horizontal axis, its centre of mass beside it. Positions are angles [rad]."""

    name: ClassVar = "gravity"
    family: ClassVar = "structure"
    coordinate: ClassVar = "position"
    parity: ClassVar = "even"
    equation: ClassVar = r"d=-A\sin(x/\mathrm{rad}+\varphi)"
    source: ClassVar = "assumed: statics, A = m g r of a centre of mass at a distance r from the axis"
    hooks: ClassVar = {Place.FORCE: _falling}
    common_on: ClassVar = ("rotary",)  # a table on a level base has none, but what turns may be out of balance
    amplitude: float = parameter(
        "N", "torque A while the centre of mass is level with the axis", 0.1, 10.0, "amplitude", at_least=0
    )
    phase: float = phase()


@hook
def _pulling(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value - p[0] * now[X]


@dataclass(frozen=True)
class CableSpring(Effect):
    """Cables and hoses pull the table back. From where on, k x_0, is an offset of the thrust, no part of the effect."""

    name: ClassVar = "cable_spring"
    family: ClassVar = "structure"
    coordinate: ClassVar = "position"
    parity: ClassVar = "even"
    equation: ClassVar = r"d=-k\,x"
    source: ClassVar = "assumed: a linear spring; sizes assumed"
    hooks: ClassVar = {Place.FORCE: _pulling}
    stiffness: float = counted(
        parameter("N/m", "stiffness k", 50.0, 500.0, "amplitude", at_least=0), {"force": 1, "travel": -1}
    )

    def spring_to_ground(self) -> float:
        """All of it [N/m]."""
        return self.stiffness


@hook
def _hardening(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value - p[0] * now[X] * now[X] * now[X]


@dataclass(frozen=True)
class HardeningSpring(Effect):
    """A spring that holds the axis is stiffer away from where the position reads 0, or softer (of a negative size)."""

    name: ClassVar = "hardening_spring"
    family: ClassVar = "structure"
    coordinate: ClassVar = "position"
    parity: ClassVar = "even"
    equation: ClassVar = r"d=-k_3\,x^3"
    source: ClassVar = "Howell 2001, Compliant mechanisms (flexures that stretch as they bend); sizes assumed"
    hooks: ClassVar = {Place.FORCE: _hardening}
    common_on: ClassVar = ()  # without a spring there is none that could harden
    beside: ClassVar = ("cable_spring",)
    hardening: float = counted(
        parameter("N/m^3", "stiffness k_3 over the square of the way", 2e4, 3e5, "amplitude", signed=True),
        {"thrust": 1, "travel": -3},
    )
