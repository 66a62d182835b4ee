"""Writes the controller for every target and compares what can be run here with the reference; plain results."""

from __future__ import annotations

import hashlib
import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import assemble, design_deadbeat
from design.deadbeat import DesignError
from design.deployment.c_source import law_sources, loop_sources, selftest_sources
from design.deployment.comments import turned_comments
from design.deployment.drive_file import controller_to_json
from design.deployment.drive_profile import Drive, cascade_of, on_the_drive, profiles
from design.deployment.fmu import fmu
from design.deployment.hooks_in_c import HookError
from design.deployment.matlab import matlab_files, vectors_csv
from design.deployment.plant_source import plant_sources
from design.deployment.structured_text import structured_text
from design.deployment.vectors import Vectors, golden
from design.effect_compensation import designed_with_effects, with_effects
from design.validation import last_errors, sequence
from models.controller import Controller, ControllerError, References, load, references
from models.deployment.coefficients import Coefficients, load_coefficients
from models.deployment.learning_numbers import Learning
from models.deployment.running_law import RunningLaw
from models.effects.base import Place
from models.feedback.forms import described
from models.machine import Machine
from models.quantity import show, turned
from models.records.settling import settling_time
from models.simulation.simulator import simulate
from studies.as_known import limit_rows
from studies.beforehand import require_designable
from studies.command import to_text
from studies.export.evaluator import Library
from studies.export.options import ExportOptions
from studies.export.page import readme
from studies.export.proof import prove
from studies.export.tables import PERIODS
from studies.options import BadInputError
from studies.sticking import found_in
from studies.sticking import rows as sticking_rows
from studies.study import Answer, Check, Progress

Array = NDArray[np.float64]


NEVER: Final = "motions never settle under this controller; that the code is the same law says nothing about that"


@dataclass(frozen=True)
class _Given:
    """The controller, the text of its file and its numbers."""

    text: str
    controller: Controller
    known: Coefficients
    settled: float


def compute(machine: Machine, options: ExportOptions, progress: Progress) -> Answer:
    """Answers the study's question for `machine`. Raises BadInputError for a controller that cannot be exported."""
    given = _given(machine, options)
    known = given.known
    progress(0.1, "computing the vectors")
    vectors = golden(known, options.seed)
    progress(0.2, "writing the law")
    sources = _sources(machine, given, vectors)
    files = _files(machine, given, vectors, sources, options)
    progress(0.3, "running structured text")
    results: dict[str, Any] = {
        "quick": options.quick,
        "target": options.target,
        "law": sizes(known, given.settled),
        "responses": _responses(known),
        "vectors": {"count": vectors.asked.size, "statuses": sorted(set(vectors.status.tolist()))},
        "structured_text": {"first_that_differs": _first_in_text(known, vectors)},
        "reference": {"largest_difference_N": _beside_the_simulation(machine, given)},
    }
    progress(0.4, "running the drive's own cascade")
    results["drive"] = _drive(machine, given)
    results |= found_in(machine, given.controller.feedback)
    if options.proof:
        progress(0.5, "proving that the code is the same")
        simulated = _loop_as_in_c(machine, given)
        results["proof"] = {**prove(machine, known, sources, options, progress), "closed_loop_simulated": simulated}
    page = readme(given.text, known, results, list(files))
    files["README.md"] = turned(page) if machine.axis == "rotary" else page
    return Answer(results, _checks(known, results), files, [*_summary(results), *limit_rows(machine)])


def _given(machine: Machine, options: ExportOptions) -> _Given:
    paths = options.controller_json
    with tempfile.TemporaryDirectory() as folder:
        path = paths[0] if paths else Path(folder) / "controller.json"
        if not paths:
            path.write_text(to_text(_designed(machine)), encoding="utf-8")
        try:
            controller = load(path)
            known = load_coefficients(
                path, machine.drive.rated_thrust, machine.drive.offset, options.anti_windup or 0.0
            )
            text = path.read_text(encoding="utf-8")
        except ControllerError as error:
            raise BadInputError(str(error)) from error
    if controller.sample_time != machine.sample_time:
        raise BadInputError(
            f"{path}: runs at {controller.sample_time:g} s and the machine at {machine.sample_time:g} s; "
            "give the machine that it was designed for with --machine"
        )
    if options.anti_windup is not None and known.tracking == 0:
        raise BadInputError(
            "--anti-windup: this controller is not a PID with an integral; state it in the machine file"
        )
    if options.anti_windup is not None and known.tracking > 1:
        raise BadInputError(
            f"--anti-windup: {show(options.anti_windup, 's')} is shorter than a sample; "
            f"give at least {show(machine.sample_time, 's')}"
        )
    return _Given(text, controller, known, float(json.loads(text).get("settling_time_s") or 0.0))


def _designed(machine: Machine) -> dict[str, Any]:
    """The content of controller.json for the machine's specification."""
    require_designable(machine)
    try:
        whole, deadbeat, _ = designed_with_effects(machine, design_deadbeat)
        controller = with_effects(assemble(machine, deadbeat, whole.plant), machine)
    except DesignError as error:
        raise BadInputError(f"--machine: {error}") from error
    return controller_to_json(machine, controller, deadbeat.stroke, deadbeat.settling_time)


def _sources(machine: Machine, given: _Given, vectors: Vectors) -> dict[str, dict[str, str]]:
    """C by what it is of: the law, its self-test, the plant and the closed loop."""
    try:
        plant = plant_sources(machine)
    except HookError as error:
        raise BadInputError(f"--machine: {error}") from error
    sources = {
        "law": law_sources(given.known, _origin(machine, given)),
        "selftest": selftest_sources(given.known, vectors),
        "plant": plant,
        "loop": loop_sources(given.known),
    }
    return {part: turned_comments(texts) for part, texts in sources.items()} if machine.axis == "rotary" else sources


def _origin(machine: Machine, given: _Given) -> str:
    """What the law was made from, for the comments of its sources, which hold ASCII only."""
    name = machine.name.encode("ascii", "replace").decode().replace("*/", "").replace("\n", " ")
    return f"{name}, controller.json with SHA-256 {hashlib.sha256(given.text.encode()).hexdigest()[:16]}"


def _files(
    machine: Machine,
    given: _Given,
    vectors: Vectors,
    sources: Mapping[str, Mapping[str, str]],
    options: ExportOptions,
) -> dict[str, Any]:
    """What is written, by name."""
    asked, known, ts = options.target, given.known, machine.sample_time
    turns = machine.axis == "rotary"
    files: dict[str, Any] = {"controller.json": given.text, "vectors.csv": vectors_csv(vectors)}
    if asked in {"all", "c"}:
        for part in sources.values():
            files |= {f"c/{name}": text for name, text in part.items()}
    if asked in {"all", "fmi3"}:
        law = fmu("controller", sources["law"], ts, "the positioning law", start_thrust=known.start, turns=turns)
        files["fmi3/axis_controller.fmu"] = law
        files["fmi3/axis_plant.fmu"] = fmu("plant", sources["plant"], ts, "the nonsmooth axis", turns=turns)
    if asked in {"all", "st"}:
        files |= {f"st/{name}": text for name, text in structured_text(known, vectors).items()}
    if asked in {"all", "matlab"}:
        texts = matlab_files(known, _origin(machine, given))
        texts = turned_comments(texts) if turns else texts
        files |= {f"matlab/{name}": text for name, text in texts.items()}
    if asked in {"all", "cia402"}:
        files["cia402/profiles.csv"] = _profiles(machine, given, options)
    return files


def _profiles(machine: Machine, given: _Given, options: ExportOptions) -> str:
    target = sequence(machine, given.known.stroke, periods=1)
    interval = options.drive_interval or machine.sample_time
    increment = machine.scale.resolution or 1e-6 * given.known.stroke
    try:
        drive = Drive(interval, increment, machine.drive.rated_thrust)
        made = profiles(references(given.controller, target), given.known.delay, machine.sample_time, drive)
    except ValueError as error:
        raise BadInputError(f"--drive-interval: {error}") from error
    return "\n".join(made.rows()) + "\n"


def sizes(known: Coefficients, settled: float) -> dict[str, Any]:
    """Sizes of the law: what a sample computes and remembers, the latter to 8 bytes on a 64-bit computer; SI."""
    taps, elements = len(known.position), len(known.stiffness)
    states = len(known.law.c) if known.law is not None else 0
    products = 3 * taps + elements + (states * states + 4 * states + 1 if states else 7)
    reals = known.memory + 2 * (elements + 1) + (states + 1) + 10
    largest = max(abs(number) for number in known.thrust)
    friction = sum(k * x for k, x in zip(known.stiffness, known.limit, strict=True))
    left = known.thrust_limit - friction - abs(known.start)  # the constant force takes its share at either end
    more = {"memory_double_bytes": 0, "memory_single_bytes": 0}
    if known.learning is not None:
        products, more = products + 3, _sizes_of(known, known.learning)
    return {
        "sample_time_s": known.sample_time,
        "settling_time_s": settled,
        "stroke_m": known.stroke,
        "thrust_limit_N": known.thrust_limit,
        "coefficients": taps,
        "delay_samples": known.delay,
        "elements": elements,
        "states": states,
        "products": products,
        "memory_double_bytes": 8 * (known.memory + 3 + reals) + 48 + more["memory_double_bytes"],
        "memory_single_bytes": 8 * (known.memory + 3) + 4 * reals + 56 + more["memory_single_bytes"],
        "largest_step_m": max(left, 0.0) / largest if largest > 0 else float("inf"),
        "wipe_s": 0.0 if known.wipe is None else 2 * (known.wipe.count + known.wipe.still) * known.sample_time,
        "learning": None if known.learning is None else _sizes_of(known, known.learning),
    }


def _sizes_of(known: Coefficients, learning: Learning) -> dict[str, Any]:
    """What learning takes beside the law: motions, memory, and products a sample, at a motion's end and a round's."""
    lengths, elements, taps = len(learning.length), len(known.stiffness), len(known.position)
    doubles, reals = 5 * lengths + 15, lengths * elements + taps + 3
    return {
        "motions": 2 + learning.rounds * learning.motions,
        "rest_s": (learning.rest + 1) * known.sample_time,
        "products": lengths + 2,
        "products_at_rest": lengths * (elements + 2),
        "products_of_a_round": 16 * lengths + 2 * taps,
        "memory_double_bytes": 8 * (doubles + reals) + 16,
        "memory_single_bytes": 8 * doubles + 4 * reals + 16,
    }


def _responses(known: Coefficients) -> dict[str, Any]:
    """What the law plays for a step of the target by one stroke, over time."""
    ends = {"position_m": (known.position, 1.0), "path_m": (known.path, 1.0), "thrust_N": (known.thrust, 0.0)}
    played = {name: known.stroke * np.array([*row, end]) for name, (row, end) in ends.items()}
    return {"time_s": np.arange(len(known.position) + 1) * known.sample_time, **played}


def _first_in_text(known: Coefficients, vectors: Vectors) -> int:
    """The first vector that differs in structured text, or -1; both forms of the files."""
    files = structured_text(known, vectors)
    found = -1
    for names in (("FB_AxisLaw.TcPOU", "PRG_AxisCheck.TcPOU"), ("axis_law.xml",)):
        library = Library()
        for name in names:
            (library.add_twincat if name.endswith(".TcPOU") else library.add_plcopen)(files[name])
        check = library.make("PRG_AxisCheck")
        while not check.values["bDone"]:
            check.call()
        found = max(found, int(check.values["nFirstDiffering"]))
    return found


def _beside_the_simulation(machine: Machine, given: _Given) -> float:
    """The largest difference [N] between the reference and the simulated controller over the specification's motions.

    Both as the design has them: without what only a drive adds (a plan, a path of the compensator's own, an anti-windup
    that was asked for here), on the nominal machine.
    """
    nominal, bare = replace(machine, effects=()), replace(given.controller, effect_compensation=None)
    target, known = sequence(machine, given.known.stroke, periods=PERIODS), given.known
    record = simulate(nominal, bare, target).record
    law = RunningLaw(replace(known, tracking=0.0, start=machine.drive.offset))
    thrust, _ = law.run(np.zeros(target.size), np.column_stack([target, record.position]))
    return float(np.max(np.abs(thrust - np.clip(record.command, -known.thrust_limit, known.thrust_limit))))


def _loop_as_in_c(machine: Machine, given: _Given) -> float:
    """When the slowest motion settles [s] under what the C of law and plant have: no noise, no plan, and no effect that
    acts in the controller."""
    effects = tuple(one for one in machine.effects if Place.CONTROL not in one.hooks)
    quiet = replace(machine, effects=effects, scale=replace(machine.scale, noise=0.0))
    bare = replace(given, controller=replace(given.controller, effect_compensation=None))
    target = sequence(machine, given.known.stroke, periods=PERIODS)
    return _achieved(quiet, bare.controller, target, references(bare.controller, target))["slowest_s"]


def _drive(machine: Machine, given: _Given) -> dict[str, Any]:
    """What the motions achieve with a drive that keeps its own cascade, beside the whole scheme."""
    target, controller = sequence(machine, given.known.stroke, periods=PERIODS), given.controller
    known = references(given.controller, target)
    whole = _achieved(machine, controller, target, known)
    never = math.isinf(whole["slowest_s"])
    try:
        cascade = cascade_of(machine)
    except ValueError as error:
        return {"rows": [], "reason": str(error), "never": never}
    cases = list[tuple[str, Controller, References]]()
    for name, torque, rounded in (
        ("cascade; set point, velocity and torque offset", True, False),
        ("the same, rounded to increments and 0.1 % of the rating", True, True),
        ("cascade; set point and velocity offset only", False, True),
    ):
        cases.append((name, *on_the_drive(machine, controller, known, torque=torque, rounded=rounded)))
    rows = [{"name": name, **_achieved(machine, law, target, known)} for name, law, known in cases]
    rows.insert(0, {"name": "the whole scheme", **whole})
    return {"cascade": described(cascade), "rows": rows, "reason": "", "never": never}


def _achieved(machine: Machine, controller: Controller, target: Array, known: References) -> dict[str, float]:
    """Slowest settling [s] and largest error at the settling time [m] of the last period's motions."""
    position = simulate(machine, controller, target, given=known).position
    wanted, errors = machine.specification, last_errors(position, target, PERIODS)
    late = round(wanted.settling_time / machine.sample_time)
    return {
        "slowest_s": max(settling_time(error, wanted.tolerance, machine.sample_time) for error in errors),
        "error_m": max(float(np.max(np.abs(error[late:]), initial=0.0)) for error in errors),
    }


def _checks(known: Coefficients, results: Mapping[str, Any]) -> tuple[Check, ...]:
    checks = [
        Check(
            "reference beside the simulated controller",
            results["reference"]["largest_difference_N"],
            "N",
            1e-9 * known.thrust_limit,
            "rounding",
        ),
        Check(
            "files of structured text that differ from the vectors",
            float(results["structured_text"]["first_that_differs"] >= 0),
            "1",
            0,
            "0 ULP",
        ),
    ]
    proof = results.get("proof")
    if proof is not None:
        checks += [Check(f"largest difference, {row['name']}", row["ulp"], "1", 0, "0 ULP") for row in proof["same"]]
        checks.append(Check("planted faults that were missed", len(proof["missed"]), "1", 0, "each is caught"))
        limit = proof["closed_loop_simulated"] + known.sample_time
        checks.append(
            Check("slowest motion, C law with C plant", proof["closed_loop"], "s", limit, "simulation, to a sample")
        )
    return tuple(checks)


def _summary(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    law = results["law"]
    rows = [
        ("products a sample", str(law["products"])),
        (
            "memory in double and single precision",
            f"{law['memory_double_bytes']} and {law['memory_single_bytes']} bytes",
        ),
        ("largest step within the thrust limit", show(law["largest_step_m"], "m", 3)),
        ("vectors", str(results["vectors"]["count"])),
        *((f"slowest motion: {row['name']}", show(row["slowest_s"], "s")) for row in results["drive"]["rows"]),
        *((("WARNING, simulated on the machine", NEVER),) if results["drive"]["never"] else ()),
        *sticking_rows(results),
    ]
    return [*rows, *((one["name"], one["text"]) for one in results.get("proof", {}).get("said", []))]
