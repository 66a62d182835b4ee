"""Machine: all that is nominally known of one positioning axis, read from a file; every value with its source.

A machine file is TOML. A value is text with a unit, `"16.5 N"`, or a table `{ value = "16.5 N", source = "paper: II.A",
note = "..." }`; a source begins with one of SOURCES. A value without one counts as assumed. A value that was identified
may also hold its standard deviation, and the record that it is from with the SHA-256 of the record's file:
`{ value = "16.5 N", std = "0.2 N", source = "identified: slow sweep", record = "slow.csv", sha256 = "..." }`.
"""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, TypeVar, get_args, get_origin, get_type_hints

from models.controller import PID, Controller
from models.effects import catalogue
from models.effects.base import Effect
from models.effects.priors import USUAL, Priors
from models.friction import Friction, branch
from models.plant import Plant
from models.quantity import Declaration, QuantityError, check, declaration, json_name, parse, show, value
from models.records.columns import Columns

SOURCES: Final = ("paper", "datasheet", "derived", "identified", "assumed")
ENTRY: Final = ("value", "std", "source", "record", "sha256", "note")  # keys of a value that is written as a table
UNSTATED: Final = 0.3  # steps of a scale's resolution: the noise of a scale whose file states none; assumed
DEFAULT: Final = Path(__file__).parent / "machines" / "linear_motor_table.toml"

Part = TypeVar("Part")


class MachineError(ValueError):
    """A machine file that can't be used; the message is one sentence: what, where, what to do.

    >>> pos.load_machine("nowhere.toml")
    Traceback (most recent call last):
    models.machine.MachineError: nowhere.toml: can't be read (No such file or directory); ...
    """


@dataclass(frozen=True)
class Drive:
    """Motor and amplifier."""

    rated_thrust: float = value("N", "largest thrust reference the drive follows", above=0)
    rated_power: float = value("W", "rated power", above=0)
    rated_speed: float = value("m/s", "rated speed", above=0)
    current_loop_bandwidth: float = value("Hz", "bandwidth of the current control (contained in L)", above=0)
    offset: float = value("N", "constant force that the thrust has to hold: M a = u - f - offset", default=0.0)


@dataclass(frozen=True)
class Scale:
    """The position measurement."""

    resolution: float = value("m", "resolution", at_least=0)
    noise: float = value("m", "noise before rounding, one standard deviation", at_least=0)

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise before rounding [m]; assumed to be UNSTATED steps where none is stated."""
        return self.noise or UNSTATED * self.resolution

    def noisy(self) -> Scale:
        """The scale with its noise stated."""
        return dataclasses.replace(self, noise=self.deviation)


@dataclass(frozen=True)
class Presliding:
    """Published facts of the hysteresis curve, which the friction elements have to agree with (Fig. 3)."""

    coulomb_force: float = value("N", "rolling friction T_fc when every element slips", above=0)
    stiffness_1: float = value("N/m", "comprehensive slope K_e1 of Region 1, behind a reversal", above=0)
    stiffness_2: float = value("N/m", "comprehensive slope K_e2 of Region 2", above=0)
    boundary: float = value("m", "distance behind a reversal at which Region 2 begins", above=0)
    extent: float = value("m", "presliding region", above=0)


@dataclass(frozen=True)
class Control:
    """What is fixed of the controller before a feedforward is designed."""

    sample_time: float = value("s", "sample time T_s", above=0)
    reference_delay: int = value(
        "1", "samples by which the reference of the PID in place waits", at_least=0, below=1001
    )
    compensator_elements: int = value("1", "elements N of the friction compensator RFM", at_least=1, below=101)
    pid: PID = dataclasses.field(kw_only=True)


@dataclass(frozen=True)
class Specification:
    """The motions and what they must achieve (section II.D)."""

    stroke: float = value("m", "stroke of a motion", above=0)
    tolerance: float = value("m", "settling accuracy (+-)", above=0)
    settling_time: float = value("s", "settling time", above=0)
    reference_settling_time: float = value("s", "time by which x_T* is settled", above=0)
    interval: float = value("s", "time from one motion to the next", above=0)
    motions: int = value("1", "motions in one direction before the reversal", at_least=2, below=101)


@dataclass(frozen=True)
class Published:
    """What an experiment on the machine showed, to compare with (sections III.B and V.B); nothing is designed on it."""

    reversal_settling_time: float = value("s", "settling of the reversal without compensation", above=0)
    dispersion_without: float = value("m", "3 sigma after the settling time, without compensation", above=0)
    dispersion_with: float = value("m", "3 sigma after the settling time, with compensation", above=0)


@dataclass(frozen=True)
class Tolerance:
    """How well the values are known, as standard deviations. A diagnosis re-fits within 3 of them, what a changed drive
    or preload moves (modes, dead time, friction level) within 8, and the mass within 20."""

    mass: float = value(
        "1", "standard deviation of mass over thrust constant, of its value", above=0, below=1, default=0.015
    )
    mode_gain: float = value(
        "1", "standard deviation of a vibration mode's gain, of its value", above=0, below=1, default=0.055
    )
    frequency: float = value(
        "1", "standard deviation of a natural frequency, of its value", above=0, below=1, default=0.005
    )
    damping: float = value("1", "standard deviation of a damping ratio, of its value", above=0, below=1, default=0.12)
    dead_time: float = value("s", "standard deviation of the dead time", above=0, default=2e-5)
    offset: float = value("N", "standard deviation of the constant force", above=0, default=0.2)
    friction_level: float = value(
        "1", "standard deviation of all contact stiffnesses together, of their value", above=0, below=1, default=0.03
    )
    stiffness: float = value(
        "1", "standard deviation of each contact stiffness, of its value", above=0, below=1, default=0.03
    )
    limit: float = value(
        "1", "standard deviation of each contact's limit, of its value", above=0, below=1, default=0.03
    )


@dataclass(frozen=True)
class Provenance:
    """Where a value comes from: `kind` is one of SOURCES, `detail` says which section, rule, method or assumption.

    record, sha256: the file that it was identified from, and that file's hash; empty for any other. std: its standard
    deviation in the value's own unit, one for each number of a list; None where it is not known.
    """

    kind: str
    detail: str
    note: str = ""
    record: str = ""
    sha256: str = ""
    std: float | tuple[float, ...] | None = None


@dataclass(frozen=True)
class Machine:
    """One positioning axis. `sources` maps the dotted name of every value ("plant.dead_time") to its Provenance.

    effects: what acts beside the nominal model, in the order of the catalogue; a file's tables [effects.NAME]. priors:
    the sizes that a diagnosis gives to effects in place of their usual ones; a file's tables [priors.NAME].

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
    presliding: Presliding = None  # type: ignore[assignment]  # derived by `load` where a file leaves it out
    published: Published | None = None
    tolerance: Tolerance = Tolerance()
    record: Columns | None = None
    priors: Priors = USUAL
    effects: tuple[Effect, ...] = ()
    sources: Mapping[str, Provenance] = dataclasses.field(default_factory=dict, compare=False)

    def __repr__(self) -> str:
        effects = f", {', '.join(effect.name for effect in self.effects)}" if self.effects else ""
        return (
            f"Machine({self.name!r}: {len(self.plant.modes)} modes, {show(self.plant.mass, 'kg')}, "
            f"{len(self.friction.limit)} friction elements, T_s = {show(self.sample_time, 's')}{effects})"
        )

    @property
    def sample_time(self) -> float:
        """T_s [s]."""
        return self.control.sample_time

    def feedback_only(self, reference_delay: int | None = None) -> Controller:
        """The PID in place without a feedforward of its own: u_M is u_fb and what is given to the simulator.

        N_ff = 1 and D_ff = 0, so x_T* = r. reference_delay [samples]: that of the PID in place if None.
        """
        control = self.control
        delay = control.reference_delay if reference_delay is None else reference_delay
        return Controller(self.sample_time, control.pid, delay, (1.0,), (0.0,))

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
        declared = declaration(field)
        if declared is None:
            raise MachineError(f"{name}: must be a single value; give a part of the machine to with_part")
        try:
            for one in number if isinstance(number, tuple) else (number,):
                check(one, declared)
        except QuantityError as error:
            raise MachineError(f"{name}: {error}") from error
        changed: Machine = _with_part_at(self, parents, dataclasses.replace(part, **{last: number}))
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
        return catalogue.looked_for(self.priors)


@dataclass(frozen=True)
class Parameter:
    """One value of a machine for a table of parameters; `number` is an SI float, or a tuple of them."""

    name: str
    meaning: str
    unit: str
    number: float | tuple[float, ...]
    provenance: Provenance


def load(path: str | Path = DEFAULT) -> Machine:
    """The machine in a TOML file. Raises MachineError, a sentence, for what is missing, unknown or impossible.

    >>> machine = pos.load_machine()  # the paper's table; pos.load_machine("my_axis.toml") is another one
    >>> machine.sample_time  # [s]
    0.0005
    """
    return from_table(read_table(Path(path)), Path(path))


def read_table(path: Path) -> dict[str, Any]:
    """The content of a TOML file. Raises MachineError for a file that can't be read or is none."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MachineError(f"{path}: can't be read ({error.strerror}); give an existing machine file") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise MachineError(f"{path}: is not valid TOML ({error}); correct that line") from error


def from_table(content: Mapping[str, Any], path: Path) -> Machine:
    """The machine that a machine file's content describes; `path` stands in the messages of its MachineErrors."""
    table, sources = dict(content), dict[str, Provenance]()
    try:
        name = table.pop("name", path.stem)
        if not isinstance(name, str):
            raise MachineError(f"name: {name!r} must be text; write it in quotes")
        machine = _read(Machine, {"name": name, **table}, "", sources)
        machine = dataclasses.replace(machine, sources=sources)
        if machine.presliding is None:
            machine = with_derived_presliding(machine)
        _check(machine)
    except ValueError as error:
        raise MachineError(f"{path}: {error}") from error
    return machine


def parameters(machine: Machine) -> tuple[Parameter, ...]:
    """Every value of the machine with its meaning, unit and source, in the order of the declarations."""
    return tuple(_parameters(machine, "", machine.sources))


def range_rows(priors: Priors) -> Iterator[tuple[str, tuple[float, ...], Declaration]]:
    """Every range that is stated, as "EFFECT.PARAMETER", least and most [SI], and how it is declared."""
    for (effect, name), ends in priors.items():
        yield f"{effect}.{name}", ends, catalogue.range_declarations(catalogue.every()[effect])[name]


def left_out(part: Any, field: dataclasses.Field[Any], where: str, sources: Mapping[str, Provenance]) -> bool:
    """Whether nothing states this field of a machine's part: it has no source, and stands at its default."""
    path = _join(where, field.name)
    stated = any(name == path or name.startswith(f"{path}.") for name in sources)
    return not stated and getattr(part, field.name) == field.default


def to_json(machine: Machine) -> dict[str, Any]:
    """The machine as it stands in results.json: SI numbers, units in the names, no sources."""
    plain = _plain(machine)
    assert isinstance(plain, dict)
    return {"name": machine.name, "sample_time_s": machine.sample_time, **plain}


def with_pid(machine: Machine, pid: PID, origin: str) -> Machine:
    """The machine with another PID, whose gains then name `origin` as what they are derived from; SI units."""
    said = {field.name: Provenance("derived", origin) for field in dataclasses.fields(PID)}
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


def _read(kind: type[Part], table: object, where: str, sources: dict[str, Provenance]) -> Part:
    """An instance of the dataclass `kind` from a TOML table; fields with a `value` declaration are quantities."""
    if not isinstance(table, dict):
        raise MachineError(f"{where}: must be a table; write [{where}] with its values below")
    fields = {field.name: field for field in dataclasses.fields(kind) if field.name != "sources"}  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            raise MachineError(f"{_join(where, key)}: unknown; {_nearest(key, list(fields))}")
    hints, arguments = get_type_hints(kind), {}
    for name, field in fields.items():
        path = _join(where, name)
        if name not in table and field.default is not dataclasses.MISSING:
            continue
        if name not in table:
            raise MachineError(f"{path}: missing; add it{_unit_hint(declaration(field))}")
        arguments[name] = _entry(hints[name], declaration(field), table[name], path, sources)
    try:
        return kind(**arguments)
    except ValueError as error:
        raise MachineError(f"{where}: {error}") from error


def _entry(
    hint: Any, declared: Declaration | None, entry: object, where: str, sources: dict[str, Provenance]
) -> object:
    if declared is not None:
        return _quantity(hint, declared, entry, where, sources)
    if hint is str:
        return entry
    if isinstance(hint, UnionType):  # an optional part, and here it is
        hint = next(kind for kind in get_args(hint) if kind is not NoneType)
    if hint == tuple[Effect, ...]:
        tables = _tables(catalogue.every(), entry, where)
        return catalogue.in_order(_read(kind, item, path, sources) for kind, path, item in tables)
    if hint is Priors:
        return _priors(entry, where, sources)
    if get_origin(hint) is tuple:
        if not isinstance(entry, list) or not entry:
            raise MachineError(f"{where}: needs one table or more; write [[{where}]] with its values below")
        return tuple(_read(get_args(hint)[0], item, f"{where}.{i + 1}", sources) for i, item in enumerate(entry))
    return _read(hint, entry, where, sources)


def _tables(known: Mapping[str, type[Effect]], table: object, where: str) -> Iterator[tuple[type[Effect], str, object]]:
    """What stands in [effects.NAME], say, or in [[effects.NAME]] where several are of one name: the effect's class, the
    path of the entry, the entry."""
    if not isinstance(table, dict):
        raise MachineError(f"{where}: must be a table; write [{where}.NAME] with what is stated of the effect below")
    for name, entry in table.items():
        path = _join(where, name)
        if name not in known:
            raise MachineError(f"{path}: unknown; {_nearest(name, list(known))}")
        same = entry if isinstance(entry, list) else [entry]
        for i, item in enumerate(same):
            yield known[name], path if len(same) == 1 else f"{path}.{i + 1}", item


def _priors(table: object, where: str, sources: dict[str, Provenance]) -> Priors:
    """The ranges in [priors.NAME], in the catalogue's order, each effect's once."""
    known, stated = catalogue.every(), dict[str, dict[str, tuple[float, ...]]]()
    for kind, path, entry in _tables(known, table, where):
        ranges = _ranges(kind, entry, path, sources)
        if kind.name in stated:
            once = f"{where}.{kind.name}"
            raise MachineError(f"{once}: stands there twice; state an effect's sizes once, in [{once}]")
        stated[kind.name] = ranges
    return Priors.of({(name, item): ends for name in known for item, ends in stated.get(name, {}).items()})


def _ranges(
    kind: type[Effect], table: object, where: str, sources: dict[str, Provenance]
) -> dict[str, tuple[float, ...]]:
    """The ranges that a table states of one effect's sizes, in the order of its parameters."""
    if not isinstance(table, dict):
        raise MachineError(f"{where}: must be a table; write [{where}] with its values below")
    declared = catalogue.range_declarations(kind)
    for key in table:
        if key not in declared:
            raise MachineError(f"{_join(where, key)}: unknown; {_nearest(key, list(declared))}")
    if not table:
        raise MachineError(f"{where}: has no range; give the least and the most of {next(iter(declared))}, say")
    ranges = {}
    for name in (name for name in declared if name in table):
        ends = _quantity(tuple[float, ...], declared[name], table[name], _join(where, name), sources)
        assert isinstance(ends, tuple)
        try:
            Priors.of({(kind.name, name): ends})
        except ValueError as error:
            raise MachineError(f"{where.rpartition('.')[0]}.{error}") from error
        ranges[name] = ends
    return ranges


def _quantity(hint: Any, declared: Declaration, entry: object, where: str, sources: dict[str, Provenance]) -> object:
    """The float, the tuple of floats or the int at `where`, its source put into `sources`."""
    text, source = _provenance(entry, where)
    if isinstance(entry, dict) and "std" in entry:
        source = dataclasses.replace(source, std=_deviation(entry["std"], declared, text, where))
    sources[where] = source
    try:
        if hint is int:
            if not isinstance(text, int) or isinstance(text, bool):
                raise QuantityError(f"{text!r} must be a whole number; write one without a unit, such as 2")
            check(text, declared)
            return text
        if hint is float:
            return _number(text, declared)
        if not isinstance(text, list) or not text:
            raise QuantityError(f"{text!r} must be a list; write one value for each element, in brackets")
        return tuple(_number(item, declared) for item in text)
    except QuantityError as error:
        raise MachineError(f"{where}: {error}") from error


def _deviation(text: object, declared: Declaration, number: object, where: str) -> float | tuple[float, ...]:
    """The standard deviation of a value in its own unit: one number, or one for each number of a list."""
    spread = Declaration(declared.unit, "standard deviation", above=None, at_least=0, below=None)
    try:
        if not isinstance(text, list):
            return _number(text, spread)
        if not isinstance(number, list) or len(text) != len(number):
            raise QuantityError("must be one text, or a list with one for each number of the value")
        return tuple(_number(item, spread) for item in text)
    except QuantityError as error:
        raise MachineError(f"{where}.std: {error}") from error


def _number(text: object, declared: Declaration) -> float:
    if declared.unit == "1" and isinstance(text, int | float) and not isinstance(text, bool):
        text = str(text)  # a plain TOML number has no unit, and none is wanted
    number = parse(text, declared.unit)
    check(number, declared)
    return number


def _provenance(entry: object, where: str) -> tuple[object, Provenance]:
    if not isinstance(entry, dict):
        return entry, Provenance("assumed", "no source given")
    for key in entry:
        if key not in ENTRY:
            raise MachineError(f"{where}.{key}: unknown; {_nearest(key, [*ENTRY])}")
    if "value" not in entry:
        raise MachineError(f'{where}: has no value; write {{ value = "...", source = "..." }}')
    kind, _, detail = str(entry.get("source", "assumed: no source given")).partition(":")
    if kind.strip() not in SOURCES:
        raise MachineError(f"{where}: source {kind.strip()!r} is unknown; begin it with one of {', '.join(SOURCES)}")
    note, record, sha256 = (str(entry.get(name, "")).strip() for name in ("note", "record", "sha256"))
    return entry["value"], Provenance(kind.strip(), detail.strip(), note, record, sha256)


def with_derived_presliding(machine: Machine) -> Machine:
    """The machine with the facts of its hysteresis curve [N], [N/m], [m] taken from its elements, whatever was stated.

    Region 1 is one stroke long.
    """
    friction, boundary = machine.friction, machine.specification.stroke
    end = max(2 * max(friction.limit), 2 * boundary)
    climbed = branch(friction, [boundary, end])
    presliding = Presliding(
        coulomb_force=friction.coulomb_force,
        stiffness_1=float(climbed[0]) / boundary,
        stiffness_2=float(climbed[1] - climbed[0]) / (end - boundary),
        boundary=boundary,
        extent=max(friction.limit),
    )
    derived = Provenance("derived", "from the friction elements")
    return machine.with_part(
        "presliding", presliding, {field.name: derived for field in dataclasses.fields(Presliding)}
    )


def _check_times(machine: Machine) -> None:
    """That the specification's times follow each other, and make a sequence that can be simulated."""
    wanted, ts = machine.specification, machine.sample_time
    if not wanted.reference_settling_time <= wanted.settling_time < wanted.interval:
        raise MachineError(
            "specification: reference_settling_time, settling_time and interval have to follow each other; "
            f"they are {wanted.reference_settling_time:g} s, {wanted.settling_time:g} s and {wanted.interval:g} s"
        )
    for name, time, most in (
        ("specification.interval", wanted.interval, 100_000),
        ("specification.reference_settling_time", wanted.reference_settling_time, 1000),
        ("plant.dead_time", machine.plant.dead_time, 1000),
    ):
        if time > most * ts:
            raise MachineError(
                f"{name}: {time:g} s are more than {most} samples of control.sample_time, {ts:g} s; "
                "shorten it or lengthen the sample time"
            )


def _check(machine: Machine) -> None:
    """What no single value shows."""
    _check_times(machine)
    nyquist = 0.5 / machine.sample_time
    modes = {f"plant.modes.{i + 1}": mode for i, mode in enumerate(machine.plant.modes)}
    for name, effect in catalogue.named(machine.effects).items():
        modes |= {f"effects.{name}": mode for mode in effect.modes()}
    for where, mode in modes.items():
        if mode.frequency >= nyquist:
            raise MachineError(
                f"{where}.frequency: {mode.frequency:g} Hz is not below the Nyquist frequency "
                f"{nyquist:g} Hz of control.sample_time; shorten the sample time or leave the mode out"
            )
    rigid = sum(mode.frequency == 0 for mode in machine.plant.modes)
    if rigid != 1:
        raise MachineError(f'plant.modes: {rigid} rigid-body modes; exactly one needs frequency = "0 Hz"')
    drive = machine.drive
    if abs(drive.offset) >= drive.rated_thrust:
        raise MachineError(
            f"drive.offset: the drive can't hold {drive.offset:g} N within drive.rated_thrust, "
            f"{drive.rated_thrust:g} N; give the force in newtons of thrust reference"
        )
    slip, stated = machine.friction.coulomb_force, machine.presliding.coulomb_force
    if abs(slip / stated - 1) > 1e-3:
        raise MachineError(
            f"friction: the elements slip at {slip:.5g} N together, presliding.coulomb_force says {stated:.5g} N; "
            "scale stiffness or limit so that sum(stiffness x limit) agrees"
        )


def _parameters(part: Any, where: str, sources: Mapping[str, Provenance]) -> Iterator[Parameter]:
    for field in dataclasses.fields(part):
        item, path, declared = getattr(part, field.name), _join(where, field.name), declaration(field)
        if left_out(part, field, where, sources):
            continue
        if declared is not None:
            provenance = sources.get(path, Provenance("assumed", "set in a program"))
            yield Parameter(path, declared.meaning, declared.unit, item, provenance)
        elif isinstance(item, Priors):
            for name, ends, stated in range_rows(item):
                provenance = sources.get(_join(path, name), Provenance("assumed", "set in a program"))
                yield Parameter(_join(path, name), stated.meaning, stated.unit, ends, provenance)
        elif dataclasses.is_dataclass(item):
            yield from _parameters(item, path, sources)
        elif field.name == "effects":
            for name, effect in catalogue.named(item).items():
                yield from _parameters(effect, _join(path, name), sources)
        elif isinstance(item, tuple):
            for i, member in enumerate(item):
                yield from _parameters(member, f"{path}.{i + 1}", sources)


def _plain(part: Any) -> object:
    if not dataclasses.is_dataclass(part):
        return part
    plain: dict[str, object] = {}
    for field in dataclasses.fields(part):
        item, declared = getattr(part, field.name), declaration(field)
        if field.name == "sources" or item is None or (field.name in ("effects", "priors") and not item):
            continue
        if left_out(part, field, "", {}):
            continue
        if isinstance(item, Priors):
            plain[field.name] = _plain_ranges(item)
        elif field.name == "effects":
            plain[field.name] = {name: _plain(effect) for name, effect in catalogue.named(item).items()}
        elif declared is not None:
            plain[json_name(field.name, declared.unit)] = list(item) if isinstance(item, tuple) else item
        elif isinstance(item, tuple):
            plain[field.name] = [_plain(member) for member in item]
        else:
            plain[field.name] = _plain(item)
    return plain


def _plain_ranges(priors: Priors) -> dict[str, dict[str, object]]:
    plain: dict[str, dict[str, object]] = {}
    for name, ends, stated in range_rows(priors):
        effect, _, parameter = name.partition(".")
        plain.setdefault(effect, {})[json_name(parameter, stated.unit)] = list(ends)
    return plain


def _join(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name


def _nearest(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(known)}"


def _unit_hint(declared: Declaration | None) -> str:
    if declared is None:
        return ""
    return f", {declared.meaning}" + (f", in {declared.unit}" if declared.unit != "1" else "")
