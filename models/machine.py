"""Machine: all that is nominally known of one positioning axis, read from a file; every value with its source.

How a value is written in a file stands in models/machines/reading.py.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from models.controller import PID, Controller
from models.effects import catalogue
from models.effects.base import Effect
from models.effects.priors import USUAL, Priors
from models.friction import Friction, branch
from models.machines.consistency import (
    check_drive,
    check_feedback,
    check_friction,
    check_modes,
    check_rigid_gain,
    check_times,
)
from models.machines.ideal_form import in_parallel_form
from models.machines.missing import complete
from models.machines.parts import (
    FROM_ELEMENTS,
    UNSTATED,
    USUAL_TOLERANCE,
    Control,
    Covered,
    Drive,
    Presliding,
    Published,
    Scale,
    Specification,
    Tolerance,
    usual_delay,
    usual_offset,
)
from models.machines.plain import Parameter, left_out, plain_of, range_rows, rows_of
from models.machines.provenance import SOURCES, MachineError, MissingError, Provenance
from models.machines.reading import read, read_table
from models.plant import Plant
from models.quantity import AXES, QuantityError, check, cut, declaration, rotary, show, turned_but_quoted
from models.records.columns import Columns

__all__ = [
    "DEFAULT",
    "FROM_ELEMENTS",
    "SOURCES",
    "UNSTATED",
    "Control",
    "Drive",
    "Machine",
    "MachineError",
    "Parameter",
    "Presliding",
    "Provenance",
    "Published",
    "Scale",
    "Specification",
    "Tolerance",
    "from_table",
    "left_out",
    "load",
    "parameters",
    "presliding_of",
    "range_rows",
    "read_table",
    "to_json",
    "with_derived_presliding",
    "with_pid",
]

NAME: Final = 200  # characters
DEFAULT: Final = Path(__file__).parent / "machines" / "linear_motor_table.toml"


@dataclass(frozen=True)
class Machine:
    """One positioning axis. `sources` maps the dotted name of every value ("plant.dead_time") to its Provenance.

    effects: what acts beside the nominal model, in the order of the catalogue; a file's tables [effects.NAME]. priors:
    the sizes that a diagnosis gives to effects in place of their usual ones; a file's tables [priors.NAME]. axis: one
    of AXES; of a "rotary" one every number is in rad where it is in m here, in N m where in N, in kg m^2 where in kg.

    >>> machine
    Machine('Linear-motor table with rolling ball guides': 3 modes, 44.74 kg, 10 friction elements, T_s = 500 µs)
    >>> machine.specification.stroke, machine.sample_time  # [m], [s]
    (2e-05, 0.0005)
    """

    name: str
    drive: Drive
    scale: Scale
    plant: Plant
    friction: Friction
    control: Control
    specification: Specification
    presliding: Presliding = FROM_ELEMENTS
    published: Published | None = None
    covered: Covered | None = None
    tolerance: Tolerance = USUAL_TOLERANCE
    record: Columns | None = None
    priors: Priors = USUAL
    effects: tuple[Effect, ...] = ()
    axis: str = AXES[0]
    sources: Mapping[str, Provenance] = dataclasses.field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        """Facts of the hysteresis curve that are not stated are those of the elements, whatever was stated before."""
        if self.presliding is FROM_ELEMENTS:
            object.__setattr__(self, "presliding", presliding_of(self.friction, self.specification.stroke))
            others = {path: one for path, one in self.sources.items() if not path.startswith("presliding.")}
            object.__setattr__(self, "sources", others)

    def __repr__(self) -> str:
        effects = f", {', '.join(effect.name for effect in self.effects)}" if self.effects else ""
        return (
            f"Machine({self.name!r}: {len(self.plant.modes)} modes, {show(self.plant.mass, self.unit('kg'))}, "
            f"{len(self.friction.limit)} friction elements, T_s = {show(self.sample_time, 's')}{effects})"
        )

    @property
    def sample_time(self) -> float:
        """T_s [s]."""
        return self.control.sample_time

    @property
    def tolerances(self) -> Tolerance:
        """How well the values are known [SI], with what is usual on such a machine where the file states nothing."""
        stated = self.tolerance
        offset = stated.offset or usual_offset(self.drive.rated_thrust, self.friction.coulomb_force)
        return dataclasses.replace(stated, offset=offset, dead_time=stated.dead_time or usual_delay(self.sample_time))

    def unit(self, unit: str) -> str:
        """What this axis has in place of a linear one's unit: "rad" for "m" if it is rotary; no unit [-]."""
        return rotary(unit) if self.axis == "rotary" else unit

    def wording(self, text: str) -> str:
        """A message that is written for every axis, in this one's units, what it quotes left as it is; no unit [-]."""
        return turned_but_quoted(text) if self.axis == "rotary" else text

    def feedback_only(self, reference_delay: int | None = None) -> Controller:
        """The feedback in place without a feedforward of its own: u_M is u_fb and what is given to the simulator.

        N_ff = 1 and D_ff = 0, so x_T* = r. reference_delay [samples]: that of the feedback in place if None.
        """
        control = self.control
        delay = control.reference_delay if reference_delay is None else reference_delay
        return Controller(self.sample_time, control.pid, delay, (1.0,), (0.0,), law=control.law)

    def with_value(self, name: str, number: float | tuple[float, ...], provenance: Provenance) -> Machine:
        """The machine with another value (SI) and its source, so that neither goes without the other.

        name: as in a machine file's tables, such as "plant.modes.1.gain" (modes count from 1). Raises MachineError for
        a name that the machine has not, and for a number out of the declared range.
        """
        *parents, last = name.split(".")
        try:
            part = _part_at(self, parents)
            field = next(field for field in dataclasses.fields(part) if field.name == last)
        except (AttributeError, StopIteration, TypeError) as error:
            raise MachineError(f"{name}: the machine has no such value; name one of its parameters") from error
        declared = declaration(field, part)
        if declared is None:
            raise MachineError(f"{name}: must be a single value; give a part of the machine to with_part")
        try:
            for one in number if isinstance(number, tuple) else (number,):
                check(one, declared)
        except QuantityError as error:
            raise MachineError(f"{name}: {error}") from error
        changed: Machine = _with_part_at(self, parents, dataclasses.replace(part, **{last: number}))
        if name.startswith("plant.modes."):
            check_rigid_gain(changed.plant)
        return dataclasses.replace(changed, sources={**self.sources, name: provenance})

    def sources_of(self, name: str) -> Mapping[str, Provenance]:
        """The sources of a part's values by their names within it: of "plant" that of "modes.1.gain"; no unit [-]."""
        begins = f"{name}."
        return {path.removeprefix(begins): one for path, one in self.sources.items() if path.startswith(begins)}

    def with_part(self, name: str, part: Any, provenances: Mapping[str, Provenance]) -> Machine:
        """The machine with another part, such as "plant", "friction" or "control.pid", and the sources of its values.

        provenances: by name within the part, such as "modes.1.gain". The sources of the part that was there go; a value
        without a new one counts as set in a program. SI.
        """
        kept = {path: source for path, source in self.sources.items() if not path.startswith(f"{name}.")}
        given = {f"{name}.{path}": source for path, source in provenances.items()}
        changed: Machine = _with_part_at(self, name.split("."), part)
        return dataclasses.replace(changed, sources={**kept, **given})

    @property
    def kinds(self) -> Mapping[str, type[Effect]]:
        """The effects by name that may be in this machine; their ranges: `parameters(kind, machine.priors)` [SI]."""
        has = {effect.name for effect in self.effects}
        return catalogue.looked_for(self.priors, self.axis, has, self.plant)


def load(path: str | Path = DEFAULT) -> Machine:
    """The machine in a TOML file. Raises MachineError, a sentence, for what is missing, unknown or impossible.

    >>> machine = pos.load_machine()  # the paper's table; pos.load_machine("my_axis.toml") is another one
    >>> machine.sample_time  # [s]
    0.0005
    """
    return from_table(read_table(Path(path)), Path(path))


def from_table(content: Mapping[str, Any], path: Path) -> Machine:
    """The machine that a machine file's content describes; `path` stands in the messages of its MachineErrors."""
    table, sources = dict(content), dict[str, Provenance]()
    try:
        name = table.pop("name", path.stem)
        if not isinstance(name, str):
            raise MachineError(f"name: {cut(name)} must be text; write it in quotes")
        if len(name) > NAME:
            raise MachineError(f"name: {cut(name)} is longer than {NAME} characters; shorten it")
        if table.get("axis", AXES[0]) not in AXES:
            raise MachineError(f'axis: {cut(table["axis"])} must be "linear" or "rotary"; correct it')
        machine = _read({"name": name, **table}, sources)
        _check_units(machine.axis, sources)
        machine = dataclasses.replace(machine, sources=sources)
        if "presliding" not in table:
            machine = with_derived_presliding(machine)
        _check(machine)
    except ValueError as error:
        said = turned_but_quoted(str(error)) if table.get("axis") == "rotary" else str(error)
        raise MachineError(f"{path}: {said}") from error
    return machine


def _read(table: Mapping[str, Any], sources: dict[str, Provenance]) -> Machine:
    """The machine in a file's tables, its values' sources put into `sources`. Raises MachineError."""
    try:
        content = in_parallel_form(table)
        return read(Machine, content, "", sources)
    except MissingError as error:
        raise complete(error, Machine, table) from error


def _check_units(axis: str, sources: Mapping[str, Provenance]) -> None:
    """Raises MachineError for a value in the units of an axis of the other kind."""
    for name, source in sources.items():
        if source.rotary is not None and source.rotary != (axis == "rotary"):
            if source.rotary:
                raise MachineError(f'{name}: is in units of a rotary axis; write axis = "rotary" above all tables')
            raise MachineError(
                f'{name}: is in units of a linear axis, but axis = "rotary"; '
                "write it with rad for m, N m for N and kg m^2 for kg"
            )


def parameters(machine: Machine) -> tuple[Parameter, ...]:
    """Every value of the machine with its meaning, unit and source, in the order of the declarations."""
    rows = rows_of(machine, "", machine.sources)
    return tuple(dataclasses.replace(row, unit=machine.unit(row.unit)) for row in rows)


def to_json(machine: Machine) -> dict[str, Any]:
    """The machine as it stands in results.json: SI numbers, units in the names, no sources."""
    plain = plain_of(machine)
    assert isinstance(plain, dict)
    return {"name": machine.name, "sample_time_s": machine.sample_time, **plain}


def with_pid(machine: Machine, pid: PID, origin: str) -> Machine:
    """The machine with another PID, whose gains then name `origin` as what they are derived from; SI units.

    It is then the whole feedback: a cascade, filters and an anti-windup go.
    """
    said = {field.name: Provenance("derived", origin) for field in dataclasses.fields(PID)}
    if machine.control.law is not None:
        gone = ("control.cascade.", "control.filters.", "control.anti_windup")
        sources = {path: source for path, source in machine.sources.items() if not path.startswith(gone)}
        machine = dataclasses.replace(machine, control=machine.control.with_pid(pid), sources=sources)
    return machine.with_part("control.pid", pid, said)


def _part_at(part: Any, path: Sequence[str]) -> Any:
    """What stands at a path of names within a part of a machine."""
    while path:
        first, path = _first(part, path)
        part = part[first] if isinstance(first, int) else getattr(part, first)
    return part


def _with_part_at(part: Any, path: Sequence[str], new: Any) -> Any:
    """The part with something else at a path of names within it."""
    if not path:
        return new
    first, rest = _first(part, path)
    if isinstance(first, int):
        return (*part[:first], _with_part_at(part[first], rest, new), *part[first + 1 :])
    return dataclasses.replace(part, **{first: _with_part_at(getattr(part, first), rest, new)})


def _first(part: Any, path: Sequence[str]) -> tuple[int | str, Sequence[str]]:
    """The first step of a path, a field's name or the index in a tuple, and the steps after it.

    Modes are counted from 1; effects stand in it by their names, as `catalogue.named` has them.
    """
    if not isinstance(part, tuple):
        return path[0], path[1:]
    known = {str(i + 1): one for i, one in enumerate(part)}
    if part and hasattr(part[0], "name"):
        known = dict(catalogue.named(part))
    name = next(name for name in known if [*path[: name.count(".") + 1]] == name.split("."))
    index = next(i for i, one in enumerate(part) if one is known[name])
    return index, path[name.count(".") + 1 :]


def with_derived_presliding(machine: Machine) -> Machine:
    """The machine with the facts of its hysteresis curve [N], [N/m], [m] taken from its elements."""
    derived = Provenance("derived", "from the friction elements")
    sources = {field.name: derived for field in dataclasses.fields(Presliding)}
    sources["boundary"] = Provenance("derived", "one stroke of the specification")
    curve = presliding_of(machine.friction, machine.specification.stroke)
    return machine.with_part("presliding", curve, sources)


def presliding_of(friction: Friction, stroke: float) -> Presliding:
    """The facts of the elements' hysteresis curve [N], [N/m], [m]; Region 1 is one stroke [m] long."""
    end = max(2 * max(friction.limit), 2 * stroke)
    climbed = branch(friction, [stroke, end])
    return Presliding(
        coulomb_force=friction.coulomb_force,
        stiffness_1=float(climbed[0]) / stroke,
        stiffness_2=float(climbed[1] - climbed[0]) / (end - stroke),
        boundary=stroke,
        extent=max(friction.limit),
    )


def _check(machine: Machine) -> None:
    """What no single value shows. Raises MachineError."""
    check_feedback(machine.control, machine.sources)
    check_times(machine.specification, machine.plant.dead_time, machine.sample_time)
    check_modes(machine.plant, machine.effects, machine.sample_time, machine.axis)
    check_drive(machine.drive, machine.specification)
    check_friction(machine.friction, machine.presliding)
