"""What motor and amplifier may do to a command on its way to a thrust."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from models.effects.base import Effect, H, Numbers, Place, X, hook
from models.effects.parameter import MAX_SCALED_FACTOR, counted, parameter, period, phase, switch

RIPPLE: Final = "Tan, Huang and Lee 2002, Compensation for friction and force ripple in permanent-magnet linear motors"
FULL_THRUST: Final = 100.0  # N, at which the saturation's loss is stated
OF_THE_NOISE: Final = {
    "force": 1,
    "contact": -1,
    "reading": 1,
}  # the force that the scale's noise makes of the contacts


@hook
def _cogging(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    amplitude, pitch, angle = p[0], p[1], p[2]
    return value + amplitude * math.sin(2.0 * math.pi * now[X] / pitch + angle)


@dataclass(frozen=True)
class Cogging(Effect):
    """Magnets and iron pull the table towards places, whatever the current."""

    name: ClassVar = "cogging"
    family: ClassVar = "motor"
    coordinate: ClassVar = "position"
    parity: ClassVar = "even"
    equation: ClassVar = r"d=A\sin(2\pi x/p+\varphi)"
    source: ClassVar = f"{RIPPLE}; sizes assumed"
    hooks: ClassVar = {Place.FORCE: _cogging}
    amplitude: float = parameter("N", "amplitude A", 0.5, 5.0, "amplitude", at_least=0)
    pitch: float = period("m", "pitch p", 2e-2, 6e-2, "position", points=10, above=0)
    phase: float = phase()


@hook
def _ripple(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    part, pitch, angle = p[0], p[1], p[2]
    return value * (1.0 + part * math.sin(2.0 * math.pi * now[X] / pitch + angle))


@dataclass(frozen=True)
class ThrustRipple(Effect):
    """The thrust constant varies along the magnets."""

    name: ClassVar = "thrust_ripple"
    family: ClassVar = "motor"
    coordinate: ClassVar = "position"
    parity: ClassVar = "of the command"
    equation: ClassVar = r"K_t\left(1+a\sin(2\pi x/p+\varphi)\right)u"
    source: ClassVar = f"{RIPPLE}; sizes assumed"
    hooks: ClassVar = {Place.THRUST: _ripple}
    part: float = parameter("1", "variation a", 0.01, 0.06, "amplitude", at_least=0, below=1)
    pitch: float = period("m", "pitch p", 2e-2, 6e-2, "position", points=10, above=0)
    phase: float = phase()


@hook
def _falling_off(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value * (1.0 - p[0] * now[X] * now[X])


@dataclass(frozen=True)
class ThrustFallOff(Effect):
    """The thrust constant of a voice coil falls, as the coil leaves the middle of the magnet's field."""

    name: ClassVar = "thrust_fall_off"
    family: ClassVar = "motor"
    coordinate: ClassVar = "position"
    parity: ClassVar = "of the command"
    equation: ClassVar = r"K_t\left(1-a\,x^2\right)u"
    source: ClassVar = "Klippel 2006, Tutorial: loudspeaker nonlinearities (force factor over the way); sizes assumed"
    hooks: ClassVar = {Place.THRUST: _falling_off}
    common_on: ClassVar = ()  # of a motor that repeats along the way this is the thrust ripple
    beside: ClassVar = ("cable_spring",)
    fall: float = counted(
        parameter(
            "1/m^2", "part a that is lost, over the square of the way from 0", 5.0, 150.0, "amplitude", signed=True
        ),
        {"travel": -2},
    )


@hook
def _asymmetric(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value + p[0] * abs(value)


@dataclass(frozen=True)
class GainAsymmetry(Effect):
    """The amplifier's gain differs by the sign of the command."""

    name: ClassVar = "gain_asymmetry"
    family: ClassVar = "motor"
    coordinate: ClassVar = "command"
    parity: ClassVar = "even"
    equation: ClassVar = r"K_t(1+a\,\mathrm{sign}\,u)\,u"
    source: ClassVar = "assumed: two halves of an amplifier with unequal gains"
    hooks: ClassVar = {Place.THRUST: _asymmetric}
    asymmetry: float = parameter("1", "asymmetry a", 0.005, 0.04, "amplitude", signed=True, above=-1, below=1)


@hook
def _saturating(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    lost = p[0] * (value / FULL_THRUST) ** 2
    if 3.0 * lost > 1.0:  # beyond the most
        most = FULL_THRUST * 2.0 / 3.0 / math.sqrt(3.0 * p[0])
        return most if value > 0.0 else -most
    return value * (1.0 - lost)


@dataclass(frozen=True)
class ThrustSaturation(Effect):
    """The thrust constant falls at large currents; the thrust stays at the most that it comes to."""

    name: ClassVar = "thrust_saturation"
    family: ClassVar = "motor"
    coordinate: ClassVar = "command"
    parity: ClassVar = "odd"
    equation: ClassVar = (
        r"K_t\left(1-a\,(u/100\,\mathrm{N})^2\right)u,\ |u|\le100\,\mathrm{N}/\sqrt{3a},\ \text{constant beyond}"
    )
    source: ClassVar = "assumed: the first term of iron that saturates alike both ways"
    hooks: ClassVar = {Place.THRUST: _saturating}
    loss: float = counted(
        parameter(
            "1", "part a that is lost at 100 N", 0.01, 0.1, "amplitude", at_least=0, at_most=0.1 * MAX_SCALED_FACTOR
        ),
        {"thrust": -2},
    )

    def at_rating(self, rated_thrust: float) -> float:
        """The loss at the rating [N], where it counts."""
        lost = self.loss * (rated_thrust / FULL_THRUST) ** 2
        return lost if 3 * lost <= 1 else 1 - 2 / 3 / math.sqrt(3 * lost)


@hook
def _lagging(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    time, current, called = p[0], memory[0], memory[1] > 0.0
    if time == 0.0:
        return value
    behind = current - value if called else 0.0
    keep = math.exp(-now[H] / time)
    memory[0], memory[1] = value + behind * keep, 1.0
    return value + behind * (1.0 - keep) * time / now[H]


@dataclass(frozen=True)
class CurrentLoopLag(Effect):
    """The current follows the command with a lag; exact for a command that is held over a substep."""

    name: ClassVar = "current_loop_lag"
    family: ClassVar = "motor"
    coordinate: ClassVar = "change of the command"
    parity: ClassVar = "odd"
    remembers: ClassVar = True
    delayed_by: ClassVar = "time"
    equation: ClassVar = r"\tau\dot u_i+u_i=u"
    source: ClassVar = "assumed: a current control of first order; 0.2 ms is a bandwidth of 800 Hz"
    hooks: ClassVar = {Place.THRUST: _lagging}
    time: float = counted(
        parameter("s", "time constant tau", 1e-4, 5e-4, "width", at_least=0), {"sample": 1}, {"loop": 1}
    )

    def memory(self, elements: int) -> int:
        """The current at the end of the last substep, in newtons, and whether there was one."""
        return 2

    def lag(self) -> float:
        """The time constant [s]."""
        return self.time


@hook
def _late(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    part, sample, before = p[0], memory[1], memory[0] if memory[1] > 0.0 else value
    memory[0], memory[1] = value, sample + 1.0
    number = int(sample) & 0x7FFFFFFF  # a hash of the sample's number: mixed bits, the same in every run
    for _ in range(3):
        number = ((number ^ (number >> 15)) * 0x2C1B3C6D + 0x297A2D39) & 0x7FFFFFFF
    return before if number < part * 0x80000000 else value


@dataclass(frozen=True)
class TimingJitter(Effect):
    """A command now and then comes a sample late: the one before stays. Which samples: the same in every run."""

    name: ClassVar = "timing_jitter"
    family: ClassVar = "motor"
    coordinate: ClassVar = "change of the command"
    parity: ClassVar = "random"
    equation: ClassVar = r"u[k-1]\ \text{instead of}\ u[k]\ \text{in a part}\ q\ \text{of the samples}"
    source: ClassVar = (
        "Wittenmark, Nilsson and Törngren 1995, Timing problems in real-time control systems; sizes assumed"
    )
    hooks: ClassVar = {Place.COMMAND: _late}
    shows_in: ClassVar = "log"  # as a scatter of motions that the log says are equal, not as a force of its own
    part: float = parameter("1", "part q of the samples", 0.005, 0.1, "amplitude", at_least=0, below=1)

    def memory(self, elements: int) -> int:
        """The last command and the number of samples so far."""
        return 2


@hook
def _dead(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    width = p[0]
    return value - max(-width, min(value, width))


@dataclass(frozen=True)
class AmplifierDeadband(Effect):
    """Commands near zero do nothing."""

    name: ClassVar = "amplifier_deadband"
    family: ClassVar = "motor"
    coordinate: ClassVar = "command"
    parity: ClassVar = "odd"
    equation: ClassVar = r"\mathrm{sign}(u)\max(|u|-w,0)"
    source: ClassVar = (
        "Tao and Kokotović 1996, Adaptive control of systems with actuator and sensor nonlinearities; sizes assumed"
    )
    hooks: ClassVar = {Place.COMMAND: _dead}
    width: float = counted(
        parameter("N", "command w up to which nothing happens", 0.05, 0.5, "width", points_per_decade=6, at_least=0),
        {"force": 1},
        OF_THE_NOISE,  # beside a coarse scale only a wide one is seen
    )


@hook
def _stepped(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    step, law = p[0], p[1]
    if step == 0.0:
        return value
    if law > 1.5:
        return math.floor(abs(value) / step) * (step if value > 0.0 else -step)
    if law > 0.5:
        return (math.floor(value / step) + 0.5) * step
    return math.floor(value / step + 0.5) * step


@dataclass(frozen=True)
class DacQuantisation(Effect):
    """The command is put out in steps: one of them at zero, a jump there, or cut off towards zero.

    The last is what a conversion to integers in firmware does.
    """

    name: ClassVar = "dac_quantisation"
    family: ClassVar = "motor"
    coordinate: ClassVar = "command"
    parity: ClassVar = "odd"
    equation: ClassVar = (
        r"q\lfloor u/q+\tfrac12\rfloor\ (r=0),\ "
        r"q\left(\lfloor u/q\rfloor+\tfrac12\right)\ (r=1),\ \mathrm{sign}(u)\,q\lfloor |u|/q\rfloor\ (r=2)"
    )
    source: ClassVar = "Widrow and Kollár 2008, Quantization noise (mid-tread, mid-rise, truncation); sizes assumed"
    hooks: ClassVar = {Place.COMMAND: _stepped}
    step: float = period("N", "step q", 1e-2, 1e-1, "command", role="width", linear_within=1e-5, at_least=0)
    rise: int = switch("r: it jumps at zero", "it is cut off towards zero")
