"""What the structure and the surroundings may add: a mode, the floor, a cable."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from models.effects.base import Effect, Numbers, Place, T, X, hook
from models.effects.parameter import counted, parameter, period, phase
from models.plant import Mode


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
