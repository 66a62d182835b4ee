"""The nominal machine of a pack: a nominal.json with the names of results.json, in SI, and the controller's PID.

    {"sample_time_s", "dead_time_s", "thrust_constant", "modes": [{"gain_per_kg", "frequency_Hz", "damping"}, ...],
     "friction": {"stiffness_N_per_m": [...], "limit_m": [...]}, "scale": {"resolution_m"},
     "controller": {"kp_N_per_m", "ki_N_per_ms", "kd_Ns_per_m", "derivative_filter_s", "reference_delay_samples"}}

The controller may hold set-point weights, or "cascade" in place of the gains of a PID; the file may hold "drive",
"specification", "tolerance" and "priors": all as results.json has them. What such a file leaves out (the drive's
ratings, the specification, the scale's noise) is that of the default machine and marked as assumed.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from models import machine
from models.controller import PID
from models.effects.catalogue import every, range_declarations
from models.feedback.forms import Cascade
from models.friction import Friction
from models.machine import Drive, Machine, MachineError, Scale, Specification, Tolerance
from models.machines.text_file import brief, text_of
from models.plant import Mode
from models.quantity import cut, declaration, json_name

Table = dict[str, Any]


def load(path: Path) -> Machine:
    """The machine in a nominal.json (SI). Raises MachineError, a sentence, for what is missing or impossible."""
    try:
        content = json.loads(text_of(path))
    except OSError as error:
        raise MachineError(f"{path}: can't be read ({error.strerror}); give an existing nominal.json") from error
    except RecursionError as error:
        raise MachineError(f"{path}: its objects are nested too deeply; give the nominal.json of a pack") from error
    except ValueError as error:
        raise MachineError(f"{path}: is not valid JSON ({brief(error)}); give the nominal.json of a pack") from error
    try:
        table = _Reader(path.name).machine(content)
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from error
    return machine.from_table({"name": str(content.get("name", path.resolve().parent.name)), **table}, path)


@dataclasses.dataclass(frozen=True)
class _Reader:
    """Turns a nominal.json into the content of a machine file, every value with its source; `file` names it there."""

    file: str

    def machine(self, content: object) -> Table:
        whole, default = _object(content, ""), machine.load()
        frictions = _object(_needed(whole, "friction", ""), "friction.")
        undamped = ["0 N s/m"] * len(_list(_needed(frictions, "limit_m", "friction."), "friction.limit_m"))
        modes = _list(_needed(whole, "modes", ""), "modes")
        control = _object(_needed(whole, "controller", ""), "controller.")
        return {
            "drive": self.part(Drive, whole.get("drive", {}), "drive.", default.drive),
            "scale": self.part(Scale, _needed(whole, "scale", ""), "scale.", Scale(resolution=0.0, noise=0.0)),
            "plant": {
                "dead_time": self.value(_needed(whole, "dead_time_s", ""), "s", "dead_time_s"),
                "thrust_constant": self.value(_needed(whole, "thrust_constant", ""), "1", "thrust_constant"),
                "modes": [self.part(Mode, mode, f"modes.{i + 1}.") for i, mode in enumerate(modes)],
            },
            "friction": {
                "damping": {"value": undamped, "source": f"assumed: not in {self.file}"},
                **self.part(Friction, frictions, "friction.", optional=("damping",)),
            },
            "control": {
                "sample_time": self.value(_needed(whole, "sample_time_s", ""), "s", "sample_time_s"),
                "reference_delay": self.count(control, "reference_delay_samples"),
                "compensator_elements": {
                    "value": "auto",
                    "source": f"assumed: not in {self.file}, so each study that compensates friction chooses it",
                },
                **self.feedback(control),
            },
            "specification": self.part(
                Specification, whole.get("specification", {}), "specification.", default.specification
            ),
            "tolerance": self.part(Tolerance, whole.get("tolerance", {}), "tolerance."),
            "priors": {
                name: self.ranges(name, table) if name in every() else table
                for name, table in _object(whole.get("priors", {}), "priors.").items()
            },
        }

    def part(
        self,
        kind: type,
        given: object,
        where: str,
        default: Drive | Scale | Specification | None = None,
        optional: tuple[str, ...] = (),
    ) -> Table:
        """The values of one dataclass under their names in results.json; those not given are the default's."""
        names, table = _object(given, where), Table()
        for field in dataclasses.fields(kind):
            declared = declaration(field)
            if declared is None:
                continue
            name = json_name(field.name, declared.unit)
            if name in names and field.type == "int":
                table[field.name] = self.count(names, name, where)
            elif name in names:
                table[field.name] = self.value(names[name], declared.unit, where + name)
            elif field.default is not dataclasses.MISSING:
                continue
            elif default is not None and not (kind is Scale and field.name == "resolution"):
                table[field.name] = self.assumed(getattr(default, field.name), declared.unit)
            elif field.name not in optional:
                raise MachineError(f"{where}{name}: missing; add it, {declared.meaning}")
        return table

    def feedback(self, control: Mapping[str, object]) -> Table:
        """The cascade if there is one, and the PID otherwise."""
        if "cascade" in control:
            return {"cascade": self.part(Cascade, control["cascade"], "controller.cascade.")}
        return {"pid": self.part(PID, control, "controller.")}

    def ranges(self, name: str, given: object) -> Table:
        """The ranges of an effect's sizes under their names in results.json."""
        declared, where, table = range_declarations(every()[name]), f"priors.{name}.", _object(given, f"priors.{name}.")
        known = {json_name(item, stated.unit): item for item, stated in declared.items()}
        for key in table:
            if key not in known:
                raise MachineError(f"{where}{key}: unknown; known here: {', '.join(known)}")
        return {known[key]: self.value(ends, declared[known[key]].unit, where + key) for key, ends in table.items()}

    def value(self, given: object, unit: str, where: str) -> Table:
        """A number, or a list of them, as a machine file writes it."""
        if isinstance(given, list):
            return {"value": [_text(item, unit, where) for item in given], "source": f"datasheet: {self.file}"}
        return {"value": _text(given, unit, where), "source": f"datasheet: {self.file}"}

    def count(self, names: Mapping[str, object], name: str, where: str = "controller.") -> Table:
        """A whole number without a unit."""
        return {"value": _needed(names, name, where), "source": f"datasheet: {self.file}"}

    def assumed(self, number: float, unit: str) -> Table:
        """The default machine's value for what the file leaves out."""
        text = number if isinstance(number, int) else _text(number, unit, "")
        return {"value": text, "source": f"assumed: not in {self.file}, as the default machine's"}


def _text(given: object, unit: str, where: str) -> str:
    if not isinstance(given, int | float) or isinstance(given, bool):
        raise MachineError(f"{where}: {cut(given)} must be a number; write one in SI units")
    try:
        number = float(given)
    except OverflowError:
        raise MachineError(f"{where}: {cut(str(given))} is too large for a number; write one in SI units") from None
    return f"{number!r} {unit}" if unit != "1" else repr(number)


def _needed(names: Mapping[str, object], name: str, where: str) -> object:
    if name not in names:
        raise MachineError(f"{where}{name}: missing; add it")
    return names[name]


def _object(given: object, where: str) -> Mapping[str, object]:
    if not isinstance(given, dict):
        raise MachineError(f"{where.rstrip('.') or 'the content'}: must be an object with names; write {{...}}")
    return given


def _list(given: object, where: str) -> list[object]:
    if not isinstance(given, list) or not given:
        raise MachineError(f"{where}: must be a list with at least one entry; write [...]")
    return given
