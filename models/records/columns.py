"""Which column of a file holds which signal of a record, in which unit, by which factor: a table, not code.

An entry is "NAME [unit] * factor": "position_m", "qm [mm]", "vir [V] * 35.15 N/V", "-1" as a factor turns a sign.
A name may have an index in brackets, "Axes[1].ActPos [mm]"; behind one at its end the unit must stand.
The factor may hold the unit of what is counted: "xist * 5 nm", "current * 31.5 N/A", "torque * 16.3 N/%", and of the
time "sample * 250 us", or "row * 250 us" for the count of the rows. What states no unit is in the file's, or else in
SI. A signal of several motors or encoders is the sum of their columns: "I_1 * 48 N/A + I_2 * 48 N/A", and a mean of
two "x_1 * 5 nm + x_2 * 5 nm", half of 10 nm each.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, fields, replace
from typing import Final

from models.quantity import QuantityError, is_rotary, parse

_NAME: Final = r"[^\[\]*](?:[^\[\]*]|\[[^\[\]]*\])*?"  # with indices in brackets; of brackets the last ones are a unit
_ENTRY: Final = re.compile(rf"\s*(?P<name>{_NAME})\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*(?:\*\s*(?P<factor>[^*]+))?\s*")
_NUMBER: Final = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)")
_COUNTS: Final = frozenset(("inc", "incs", "increment", "increments", "count", "counts", "ct", "cts", "lsb", "pulses"))
_NO_BRACKETS: Final = str.maketrans("[]", "  ")  # "24 [N/A]" is a factor, too
_PLUS: Final = re.compile(r"\s\+\s")
_ANGLES: Final = {"deg": 1.0, "rad": 57.29577951308232}


@dataclass(frozen=True)
class Source:
    """Where one signal comes from: the file's column `name`, times `factor` to SI; decibels: 20 log10 of it;
    absolute: a deviation in m/N, not relative to the magnitude; unit: of the column, "" where none is stated; rotary:
    whether it is one of a rotary axis, None where nothing tells."""

    name: str
    factor: float
    decibels: bool = False
    absolute: bool = field(default=False, repr=False)
    unit: str = field(default="", repr=False)
    rotary: bool | None = field(default=None, repr=False)


DERIVATIVES: Final = ("error", "position")


@dataclass(frozen=True)
class Columns:
    """One entry a signal: of a record over time, and of a measured frequency response. See the module's head.

    error: the following error, the reference less the position, of a log that has no reference. derivative: what the
    derivative of the PID that ran was taken of, the "error" or the "position" alone.

    >>> columns = pos.Columns(position="qm [mm]", command="vir [V] * 35.2 N/V")
    >>> columns
    Columns(command='vir [V] * 35.2 N/V', position='qm [mm]')
    >>> columns.source("position")
    Source(name='qm', factor=0.001, decibels=False)
    """

    time: str = "time_s"
    target: str = "target_m"
    reference: str = "reference_m"
    error: str = "error_m"
    feedforward: str = "feedforward_N"
    command: str = "command_N"
    position: str = "position_m"
    frequency: str = "frequency_Hz"
    magnitude: str = "magnitude_m_per_N"
    phase: str = "phase_deg"
    deviation: str = "relative_deviation"
    derivative: str = DERIVATIVES[0]

    def __repr__(self) -> str:
        given = ((one.name, getattr(self, one.name)) for one in fields(self))
        shown = [f"{name}={entry!r}" for name, entry in given if entry != getattr(Columns, name)]
        return f"Columns({', '.join(shown) or 'as the reference tables have them'})"

    def __post_init__(self) -> None:
        if self.derivative not in DERIVATIVES:
            raise ValueError(f"derivative: {self.derivative!r} is neither of {', '.join(DERIVATIVES)}")
        for signal in UNITS:
            terms = self.terms(signal)
            if len(terms) > 1 and signal not in SUMMED:
                raise ValueError(f"{signal}: must be one column; a sum can be {', '.join(SUMMED)}")
            for one in terms:
                one.source(signal)

    def terms(self, signal: str) -> tuple[Columns, ...]:
        """The columns with one term of the signal's sum each; these themselves where one column is the signal; [-]."""
        entry = getattr(self, signal)
        parts = _PLUS.split(entry) if isinstance(entry, str) else []
        return tuple(replace(self, **{signal: one}) for one in parts) if len(parts) > 1 else (self,)

    def source(self, signal: str, stated: str = "") -> Source:
        """The column of a signal and its factor to SI units [UNITS], of a sum the first one. Raises ValueError, a
        sentence, for a bad entry.

        stated: the unit that the file states for the column, which counts where the entry states none.
        """
        entry = getattr(self, signal)
        match = _ENTRY.fullmatch(_PLUS.split(entry)[0]) if isinstance(entry, str) else None
        if match is None:
            raise ValueError(
                f"{signal}: {entry!r} must be a column with its unit; "
                f'write it like "{signal} [mm]" or "x [V] * 35.2 N/V"'
            )
        factor = (match["factor"] or "1").translate(_NO_BRACKETS).strip()
        unit = match["unit"] or _unit_by(factor, signal, stated.strip())
        if unit.lower() in _COUNTS and _is_of(factor, signal):
            unit = ""  # "[inc] * 10 nm" is "* 10 nm" for each of them
        name = match["name"]
        if unit.lower() == "db":
            return Source(name, _factor("", factor, "1", signal), decibels=True, unit=unit)
        if signal == "phase":
            if unit and unit not in _ANGLES:
                raise ValueError(f"phase: [{unit}] must be an angle; write [deg] or [rad]")
            return Source(name, _ANGLES[unit or "deg"] * _factor("", factor, "1", signal), unit=unit)
        absolute = signal == "deviation" and "/" in unit
        wanted = UNITS["magnitude" if absolute else signal]
        quantity = _one(unit, factor, signal)
        return Source(
            name, _parsed(quantity, wanted, signal), absolute=absolute, unit=unit, rotary=is_rotary(quantity, wanted)
        )


SUMMED: Final = ("target", "reference", "error", "feedforward", "command", "position")
UNITS: Final = {
    "time": "s",
    "target": "m",
    "reference": "m",
    "error": "m",
    "feedforward": "N",
    "command": "N",
    "position": "m",
    "frequency": "Hz",
    "magnitude": "m/N",
    "phase": "1",
    "deviation": "1",
}


def _unit_by(factor: str, signal: str, stated: str) -> str:
    """The unit of a column whose mapping states none but in its factor; stated: what the file says, "" for nothing.

    "5 nm" for each of the counts in a column needs none; "31.5 N/A" is of a column in A, "16.3 N/%" of one in percent;
    and a number that is the unit's own, as in "x_um * 1e-6", converts the column already.
    """
    match = _NUMBER.fullmatch(factor)
    if match is None:
        return ""
    numerator, _, denominator = match[2].rpartition("/")
    if _is_of(factor, signal) and match[2] and not _is_part(denominator):
        return ""
    if match[2]:
        return stated or (denominator.strip("() ") if _is_of(f"1 {numerator}", signal) else "")
    own = stated and _is_of(f"1 {stated}", signal) and parse(f"1 {stated}", UNITS[signal])
    return "" if own and own != 1 and math.isclose(float(match[1]), own, rel_tol=1e-9) else stated


def _is_part(unit: str) -> bool:
    """Whether a unit is a number other than 1, such as % or ‰."""
    try:
        return bool(unit) and parse(f"1 {unit}", "1") != 1
    except QuantityError:
        return False


def _is_of(quantity: str, signal: str) -> bool:
    """Whether a quantity is one of the signal."""
    try:
        return math.isfinite(parse(quantity, UNITS[signal]))
    except QuantityError:
        return False


def _factor(unit: str, factor: str, wanted: str, signal: str) -> float:
    """The SI value of `factor` times one `unit`; no unit at all means that the column is in SI already."""
    return _parsed(_one(unit, factor, signal), wanted, signal)


def _one(unit: str, factor: str, signal: str) -> str:
    """`factor` times one `unit`, as text; without a unit if neither has one."""
    match = _NUMBER.fullmatch(factor)
    if match is None:
        raise ValueError(
            f'{signal}: the factor {factor!r} must be a number with a unit; write it like "35.2 N/V" or "-1"'
        )
    number, own = match.groups()
    units = " * ".join(part for part in (f"({own})" if own else "", f"({unit})" if unit else "") if part)
    return f"{number} {units}"


def _parsed(quantity: str, wanted: str, signal: str) -> float:
    """The number of `wanted` in a quantity; in one without a unit, the number itself. Raises ValueError."""
    number, _, unit = quantity.partition(" ")
    try:
        return parse(f"{number} {unit or wanted}", wanted)
    except QuantityError as error:
        raise ValueError(f"{signal}: {error}{_with_a_factor(unit.strip('()'), wanted)}") from error


def _with_a_factor(unit: str, wanted: str) -> str:
    """How to write the factor of a column in amperes or volts that is to be a force, for a message; else nothing."""
    drive = drive_unit(unit)
    return f'; give its factor, like "NAME [{unit}] * 35 {wanted}/{drive}"' if drive and wanted == "N" else ""


def drive_unit(unit: str) -> str:
    """A or V, whichever a unit is a multiple of; nothing for any other."""
    for drive in ("A", "V"):
        try:
            parse(f"1 {unit}", drive)
        except QuantityError:
            continue
        return drive
    return ""
