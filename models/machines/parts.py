"""The parts of a machine that its file declares: drive, scale, presliding, control, specification, tolerances.

Every field's unit, meaning and range, with the reason for where the range ends.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from models.controller import PID, Feedback
from models.feedback.forms import NO_FILTERS, Cascade, Filters, described, law_of, nearest_pid
from models.feedback.law import Law
from models.quantity import listed, show, value

MOST_COMPENSATED: Final = 100  # elements that a friction compensator may have
UNSTATED: Final = 0.3  # steps of a scale's resolution: the noise of a scale whose file states none; assumed
# Why the ranges of a machine file end where they do: far beyond any axis, and well before numbers lose their meaning.
FORCE: Final = "no drive has more than a meganewton, in millinewtons of thrust reference"
SCALE: Final = "no scale for positioning is coarser"
STIFF: Final = "no contact is stiffer than a solid metre of steel"
LONG: Final = "no axis is positioned over a longer distance at once"
TIME: Final = "motions take up to minutes"


@dataclass(frozen=True)
class Drive:
    """Motor and amplifier."""

    rated_thrust: float = value("N", "largest thrust reference the drive follows", above=0, at_most=1e9, because=FORCE)
    rated_speed: float = value("m/s", "rated speed", above=0, at_most=1e4, because="no axis is faster")
    rated_power: float = value(
        "W",
        "rated power, for the reader; 0: not stated",
        at_least=0,
        at_most=1e9,
        because="no axis takes more",
        default=0.0,
    )
    current_loop_bandwidth: float = value(
        "Hz",
        "bandwidth of the current control (contained in L), for the reader; 0: not stated",
        at_least=0,
        at_most=1e7,
        because="no amplifier is faster",
        default=0.0,
    )
    offset: float = value(
        "N",
        "constant force that the thrust has to hold: M a = u - f - offset",
        at_least=-1e9,
        at_most=1e9,
        because=FORCE,
        default=0.0,
    )
    travel: float = value(
        "m",
        "how far the axis may travel, which experiments keep to; 0: not stated",
        at_least=0,
        at_most=1e4,
        because=LONG,
        default=0.0,
    )

    @property
    def room(self) -> float:
        """How long the way of an experiment may be [m]: the travel less a twentieth at each end; inf if not stated."""
        return 0.9 * self.travel if self.travel > 0 else math.inf


@dataclass(frozen=True)
class Scale:
    """The position measurement."""

    resolution: float = value("m", "resolution", at_least=0, at_most=0.1, because=SCALE)
    noise: float = value("m", "noise before rounding, one standard deviation", at_least=0, at_most=0.1, because=SCALE)

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise before rounding [m]; assumed to be UNSTATED steps where none is stated."""
        return self.noise or UNSTATED * self.resolution

    @property
    def reading_deviation(self) -> float:
        """Standard deviation of a reading [m]: the stated noise, and the rounding's resolution / sqrt(12)."""
        return float(np.hypot(self.noise, self.resolution / math.sqrt(12)))

    def noisy(self) -> Scale:
        """The scale with its noise stated."""
        return dataclasses.replace(self, noise=self.deviation)


@dataclass(frozen=True)
class Presliding:
    """Published facts of the hysteresis curve, which the friction elements have to agree with (Fig. 3)."""

    coulomb_force: float = value(
        "N", "rolling friction T_fc when every element slips", above=0, at_most=1e9, because=FORCE
    )
    stiffness_1: float = value(
        "N/m", "comprehensive slope K_e1 of Region 1, after a reversal", above=0, at_most=1e13, because=STIFF
    )
    stiffness_2: float = value("N/m", "comprehensive slope K_e2 of Region 2", above=0, at_most=1e13, because=STIFF)
    boundary: float = value(
        "m", "distance after a reversal at which Region 2 begins", above=0, at_most=100, because=LONG
    )
    extent: float = value("m", "presliding region", above=0, at_most=100, because=LONG)


FROM_ELEMENTS: Final = Presliding(*[math.nan] * 5)  # stands where nothing is stated: they follow from the elements
FROM_CASCADE: Final = PID(*[math.nan] * 4)  # stands where none is stated: it follows from the cascade


@dataclass(frozen=True)
class Control:
    """What is fixed of the controller before a feedforward is designed.

    compensator_elements: "auto" stands for the fewest with which the design meets its specification
    with time to spare, or else those with which it does soonest.
    """

    sample_time: float = value(
        "s",
        "sample time T_s",
        above=0,
        at_least=1e-6,
        at_most=0.1,
        because="controllers of axes sample every 20 us to 5 ms",
    )
    reference_delay: int = value(
        "1", "samples by which the reference of the PID in place waits", at_least=0, below=1001
    )
    compensator_elements: int | Literal["auto"] = value(
        "1", "elements N of the friction compensator RFM", at_least=1, below=MOST_COMPENSATED + 1
    )
    anti_windup: float = value(
        "s",
        "time constant by which the integral follows what the rating cuts off (0: it winds up)",
        at_least=0,
        at_most=100,
        because="a slower one takes part in no motion",
        default=0.0,
    )
    pid: PID = dataclasses.field(kw_only=True, default=FROM_CASCADE)
    cascade: Cascade | None = None
    filters: Filters = NO_FILTERS

    def __post_init__(self) -> None:
        """The PID of a cascade, where designs ask for the size of gains, is the one with nearly the cascade's loop."""
        if self.cascade is not None:
            object.__setattr__(self, "pid", nearest_pid(self.cascade))

    @property
    def derived(self) -> frozenset[str]:
        """The fields that follow from others [-], and which no file states."""
        return frozenset(() if self.cascade is None else {"pid"})

    @property
    def law(self) -> Law | None:
        """The law of the feedback in place [SI], where it is anything but a plain PID."""
        if self.cascade is None and self.pid.plain and not self.filters.count and self.anti_windup == 0:
            return None
        return law_of(self.cascade or self.pid, self.filters, self.anti_windup, self.sample_time)

    @property
    def feedback(self) -> Feedback:
        """The feedback in place [SI]: its law, or the PID where it is a plain one."""
        return self.law or self.pid

    @property
    def in_words(self) -> str:
        """What runs, for a reader: "a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms and 2 filters" [SI]."""
        core, weights = "a PID", (self.pid.proportional_weight, self.pid.derivative_weight)
        if self.cascade is not None:
            core = described(self.cascade)
        elif not self.pid.plain:
            core += f" with set-point weights of {weights[0]:.4g} and {weights[1]:.4g}"
        filters = [f"{self.filters.count} filter{'s' * (self.filters.count > 1)}"] if self.filters.count else []
        limited = [f"an anti-windup of {show(self.anti_windup, 's')}"] if self.anti_windup > 0 else []
        return listed([core, *filters, *limited])

    @property
    def fed_forward(self) -> float:
        """The mass [kg] whose force the controller adds by itself: that of a cascade's acceleration feedforward."""
        return 0.0 if self.cascade is None else self.cascade.acceleration_feedforward

    def without_feedforward(self) -> Control:
        """The same without what a cascade adds of the reference's speed and acceleration; no unit [-]."""
        if self.cascade is None:
            return self
        bare = dataclasses.replace(self.cascade, velocity_feedforward=0.0, acceleration_feedforward=0.0)
        return dataclasses.replace(self, cascade=bare)

    def with_pid(self, pid: PID) -> Control:
        """The same with a plain PID [SI] as the only feedback: no cascade, filters or anti-windup."""
        return dataclasses.replace(self, pid=pid, cascade=None, filters=NO_FILTERS, anti_windup=0.0)


@dataclass(frozen=True)
class Specification:
    """The motions and what they must achieve (section II.D)."""

    stroke: float = value("m", "stroke of a motion", above=0, at_least=1e-10, at_most=100, because=LONG)
    tolerance: float = value("m", "settling accuracy (+-)", above=0, at_least=1e-12, at_most=1, because=LONG)
    settling_time: float = value("s", "settling time", above=0, at_most=1000, because=TIME)
    reference_settling_time: float = value("s", "time by which x_T* is settled", above=0, at_most=1000, because=TIME)
    interval: float = value("s", "time from one motion to the next", above=0, at_most=1000, because=TIME)
    motions: int = value("1", "motions in one direction before the reversal", at_least=2, below=101)


@dataclass(frozen=True)
class Published:
    """What an experiment on the machine showed, to compare with (sections III.B and V.B); nothing is designed on it."""

    reversal_settling_time: float = value(
        "s", "settling of the reversal without compensation", above=0, at_most=1000, because=TIME
    )
    dispersion_without: float = value(
        "m", "3 sigma after the settling time, without compensation", above=0, at_most=1, because=LONG
    )
    dispersion_with: float = value(
        "m", "3 sigma after the settling time, with compensation", above=0, at_most=1, because=LONG
    )


@dataclass(frozen=True)
class Covered:
    """How far the records went that the machine was identified or diagnosed from: beyond, it is extrapolated."""

    force: float = value("N", "largest thrust in the records behind the values", above=0, at_most=1e9, because=FORCE)
    speed: float = value(
        "m/s", "largest speed in the records behind the values", above=0, at_most=1e4, because="no axis is faster"
    )


@dataclass(frozen=True)
class Tolerance:
    """How well the values are known, as standard deviations. A diagnosis re-fits within 3 of them, what a changed drive
    or preload moves (modes, dead time, friction level) within 8, and the mass within 20.

    In position and command alone only ratios to the thrust constant show. Where the mass is known by itself (a small
    `mass`) and `thrust_constant` is stated, a re-fit moves it, and with it all forces that are stated in newtons.
    """

    mass: float = value(
        "1", "standard deviation of mass over thrust constant, of its value", above=0, below=1, default=0.015
    )
    thrust_constant: float = value(
        "1",
        "standard deviation of the thrust constant, of its value, where the mass itself is known (0: not told apart)",
        at_least=0,
        below=1,
        default=0.0,
    )
    mode_gain: float = value(
        "1", "standard deviation of a vibration mode's gain, of its value", above=0, below=1, default=0.055
    )
    frequency: float = value(
        "1", "standard deviation of a natural frequency, of its value", above=0, below=1, default=0.005
    )
    damping: float = value("1", "standard deviation of a damping ratio, of its value", above=0, below=1, default=0.12)
    dead_time: float = value(
        "s", "standard deviation of the dead time (not stated: 4 % of the sample time)", above=0, at_most=1, default=0.0
    )
    offset: float = value(
        "N",
        "standard deviation of the constant force (not stated: 1/750 of the rated thrust, at most 5 % of the friction)",
        above=0,
        at_most=1e9,
        default=0.0,  # stands where none is stated, as for the dead time
    )
    friction_level: float = value(
        "1", "standard deviation of all contact stiffnesses together, of their value", above=0, below=1, default=0.03
    )
    stiffness: float = value(
        "1", "standard deviation of each contact stiffness, of its value", above=0, below=1, default=0.03
    )
    limit: float = value(
        "1", "standard deviation of each contact's limit, of its value", above=0, below=1, default=0.03
    )


USUAL_TOLERANCE: Final = Tolerance()  # of a machine file that states none
# What it leaves to the machine, so that an axis of any size has its own. An amplifier's offset is so much of its range;
# but a drive far stronger than its friction (a galvo, 670 times) would leave an offset open that is as large as that.
USUAL_DELAY: Final = 0.04  # sample times: standard deviation of the dead time
USUAL_OFFSET: Final = 750  # rated thrust over standard deviation of the constant force
MOST_OFFSET: Final = 0.05  # of the friction, likewise


def usual_delay(sample_time: float) -> float:
    """The standard deviation [s] of a dead time of which a file states none; sample_time [s]."""
    return USUAL_DELAY * sample_time


def usual_offset(rated_thrust: float, friction: float) -> float:
    """The standard deviation [N] of a constant force of which a file states none; thrust and friction [N]."""
    return min(rated_thrust / USUAL_OFFSET, MOST_OFFSET * friction)
