"""What no single value of a machine shows: whether the values of one axis agree.

Each check raises MachineError, a sentence with what is wrong, where, and what to do.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from models.effects import catalogue
from models.effects.base import Effect
from models.friction import Friction
from models.machines.parts import FROM_CASCADE, Control, Drive, Presliding, Specification
from models.machines.provenance import MachineError
from models.plant import Plant
from models.quantity import ROTARY, show

MODES: Final = 20  # Vibration modes and the rigid body; the time of the optimal controls grows with their cube.
EFFECTS: Final = 50  # Each is asked for its force ten times a sample or more.
SLOWEST: Final = 0.1  # Hz. What vibrates more slowly does not come back within any motion.
MAX_SETTLING_SAMPLES: Final = 1024  # Up to which a deadbeat is designed: its programs grow with their square.
PERIOD: Final = 400_000  # Samples in a period of the motions: the up to 24 periods that a design is tried on take 1 GB.
MODE_SHARES: Final = (1e-7, 1e4)  # of the size of a mode's gain in the rigid body's: others are neither seen nor its
# kg of thrust reference: 1 g in kilonewtons to 1000 t in newtons; in newtons 1 mg, and no stage is lighter. What turns
# is counted in kg m^2 and may have far fewer: mirrors of scanners have 1e-9 to 1e-7, those of silicon 1e-12.
MASSES: Final = {"linear": (1e-6, 1e9), "rotary": (1e-12, 1e9)}


def check_feedback(control: Control, stated: Collection[str]) -> None:
    """That one feedback is among the values `stated`, and that the controller can sample its filters."""
    ts = control.sample_time
    if control.pid is FROM_CASCADE:
        raise MachineError("control.pid: missing; add it, or control.cascade")
    if control.cascade is not None and any(name.startswith("control.pid.") for name in stated):
        raise MachineError("control.pid: control.cascade is stated as well, and only one of them runs; leave one out")
    for name, frequency in control.filters.frequencies.items():
        if frequency >= 0.5 / ts:
            raise MachineError(
                f"control.filters.{name}.frequency: {show(frequency, 'Hz')} is not below the Nyquist frequency "
                f"{show(0.5 / ts, 'Hz')} of control.sample_time; leave the filter out"
            )
    if 0 < control.anti_windup < ts:
        raise MachineError(
            f"control.anti_windup: {show(control.anti_windup, 's')} is below control.sample_time, {show(ts, 's')}, so "
            "that the integral would move by more than the rating cuts off; give the sample time or more, or 0 s"
        )
    integral = control.pid.ki if control.cascade is None else control.cascade.integral_time
    if control.anti_windup > 0 and integral == 0:
        raise MachineError("control.anti_windup: there is no integral that could wind up; leave it out")


def check_times(wanted: Specification, dead_time: float, ts: float) -> None:
    """That the specification's times follow each other, and make a sequence that can be simulated; times in [s]."""
    if not wanted.reference_settling_time <= wanted.settling_time < wanted.interval:
        raise MachineError(
            "specification: reference_settling_time, settling_time and interval have to follow each other; "
            f"they are {wanted.reference_settling_time:g} s, {wanted.settling_time:g} s and {wanted.interval:g} s"
        )
    for name, time, most in (
        ("specification.interval", wanted.interval, 100_000),
        ("specification.reference_settling_time", wanted.reference_settling_time, MAX_SETTLING_SAMPLES),
        ("plant.dead_time", dead_time, 1000),
    ):
        if time > most * ts:
            raise MachineError(
                f"{name}: {time:g} s are more than {most} samples of control.sample_time, {ts:g} s; "
                "shorten it or lengthen the sample time"
            )
    samples = 2 * wanted.motions * wanted.interval / ts
    if samples > PERIOD:
        raise MachineError(
            f"specification: {wanted.motions} motions to and fro every {show(wanted.interval, 's')} are {samples:.0f} "
            f"samples, more than {PERIOD}, which would take over 1 GB; give fewer motions or less time"
        )


def check_modes(plant: Plant, effects: Sequence[Effect], sample_time: float, axis: str) -> None:
    """That modes, effects' too, are of one axis of this kind, a key of MASSES: one rigid body, and what a controller
    sees every `sample_time` [s]."""
    nyquist = 0.5 / sample_time
    modes = {f"plant.modes.{i + 1}": mode for i, mode in enumerate(plant.modes)}
    for name, effect in catalogue.named(effects).items():
        modes |= {f"effects.{name}": mode for mode in effect.modes()}
    for where, mode in modes.items():
        if mode.frequency >= nyquist:
            raise MachineError(
                f"{where}.frequency: {mode.frequency:g} Hz is not below the Nyquist frequency "
                f"{nyquist:g} Hz of control.sample_time; shorten the sample time or leave the mode out"
            )
        if 0 < mode.frequency < SLOWEST:
            raise MachineError(
                f"{where}.frequency: {mode.frequency:g} Hz is slower than {SLOWEST} Hz, so that no motion sees it "
                "vibrate; leave the mode out, or give 0 Hz for the rigid body"
            )
    rigid = sum(mode.frequency == 0 for mode in plant.modes)
    if rigid != 1:
        held = "; a suspension that holds the axis is stiffness in [effects.cable_spring]" if rigid == 0 else ""
        raise MachineError(f'plant.modes: {rigid} rigid-body modes; exactly one needs frequency = "0 Hz"{held}')
    check_rigid_gain(plant)
    if len(plant.modes) > MODES:
        raise MachineError(
            f"plant.modes: {len(plant.modes)} are more than {MODES}, which would take designs hours; keep "
            "those that show in the frequency response up to a few times the loop's bandwidth"
        )
    least, most = MASSES[axis]
    if not least <= plant.mass <= most:
        what, unit = ("an inertia", ROTARY["kg"]) if axis == "rotary" else ("a mass", "kg")
        raise MachineError(
            f"plant: {what} of {plant.mass:.3g} {unit}, 1 / (thrust_constant x gain of the rigid body), is not from "
            f"{least:g} to {most:g} {unit}; give gains in 1/({unit}) and K_t per unit of thrust reference"
        )
    for where, mode in modes.items():
        share = mode.gain * plant.mass * plant.thrust_constant
        if not MODE_SHARES[0] <= abs(share) <= MODE_SHARES[1]:
            raise MachineError(
                f"{where}.gain: {mode.gain:.4g} 1/kg is {share:.3g} times the rigid body's; a mode of one axis has "
                f"{MODE_SHARES[0]:g} to {MODE_SHARES[1]:g} times, of either sign: correct it or leave the mode out"
            )
    if len(effects) > EFFECTS:
        raise MachineError(f"effects: {len(effects)} are more than {EFFECTS}; keep those that matter most")


def check_rigid_gain(plant: Plant) -> None:
    """That a rigid body moves with the thrust."""
    for i, mode in enumerate(plant.modes):
        if mode.frequency == 0 and not mode.gain > 0:
            raise MachineError(
                f"plant.modes.{i + 1}.gain: {mode.gain:g} 1/kg must be above 0, as it is 1/M of the rigid body; only "
                "vibration modes may have a negative gain"
            )


def check_drive(drive: Drive, specification: Specification) -> None:
    """That the drive can hold its offset, and that the motions keep to its travel."""
    if specification.motions * specification.stroke > drive.travel > 0:
        raise MachineError(
            f"drive.travel: {show(drive.travel, 'm')} are less than the specification's {specification.motions} "
            f"motions of {show(specification.stroke, 'm')} one way"
        )
    if abs(drive.offset) >= drive.rated_thrust:
        raise MachineError(
            f"drive.offset: the drive can't hold {drive.offset:g} N within drive.rated_thrust, "
            f"{drive.rated_thrust:g} N; give the force in newtons of thrust reference"
        )


def check_friction(friction: Friction, presliding: Presliding) -> None:
    """That there is friction, and that its elements agree with the stated facts of the hysteresis curve."""
    slip, stated = friction.coulomb_force, presliding.coulomb_force
    if not slip > 0:
        raise MachineError(
            "friction: no element has a force; for an axis without friction give one far below all other forces, "
            "such as 1 N/mm over 1 um"
        )
    if abs(slip / stated - 1) > 1e-3:
        raise MachineError(
            f"friction: the elements slip at {slip:.5g} N together, presliding.coulomb_force says {stated:.5g} N; "
            "scale stiffness or limit so that sum(stiffness x limit) agrees"
        )
