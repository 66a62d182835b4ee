"""Runs the exported code beside the reference, on many inputs and for long, and faults planted in it."""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.deployment.c_source import selftest_sources
from design.deployment.fmu import fmu
from design.deployment.structured_text import structured_text
from design.deployment.vectors import Vectors, golden, many, steady
from design.validation import last_errors, sequence
from models.deployment.coefficients import Coefficients
from models.deployment.running_law import INIT, LEARN, RESET, STEP, WIPE
from models.machine import Machine
from models.quantity import show
from models.records.settling import settling_time
from studies.export.compiling import compiled
from studies.export.evaluator import Library
from studies.export.faults import FAULTS
from studies.export.octave import PROGRAM, in_octave
from studies.export.options import ExportOptions
from studies.export.tables import PERIODS, on_tables
from studies.options import BadInputError
from studies.study import Progress

Array = NDArray[np.float64]

SAME: Final = {
    "C at -O0": ("-O0",),
    "C at -O2": ("-O2",),
    "C at -O3": ("-O3",),
}
MOST_STEADY: Final = 7_200_000  # samples of motions without a reset, an hour at 2 kHz
MOST_IN_OCTAVE: Final = 100_000  # samples, at some milliseconds each
FUNCTION_NAMES: Final = ("init", "reset", "wipe", "learn", "learned", "plan", "step", "selftest")


def ulps(one: Array, two: Array) -> float:
    """The largest distance of two arrays in units in the last place; infinite where one is not a number."""
    if not (np.all(np.isfinite(one)) and np.all(np.isfinite(two))):
        return float("inf")
    a, b = (
        np.where(bits < 0, np.iinfo(np.int64).min - bits, bits) for bits in (one.view(np.int64), two.view(np.int64))
    )
    apart = np.sign(a) != np.sign(b)  # whose difference may be too large for an integer
    distance = np.where(apart, np.abs(a.astype(float)) + np.abs(b.astype(float)), np.abs(np.where(apart, 0, a - b)))
    return float(np.max(distance, initial=0.0))


def prove(
    machine: Machine,
    known: Coefficients,
    sources: Mapping[str, Mapping[str, str]],
    options: ExportOptions,
    progress: Progress,
) -> dict[str, Any]:
    """Whether the code gives the reference's bits, and what single precision and fused operations change; SI.

    Raises BadInputError where there is no compiler.
    """
    if shutil.which("cc") is None:
        raise BadInputError("--proof: there is no C compiler (cc); install one, or leave --proof out")
    vectors = many(known, options.seed + 1, options.samples)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in sources.values():
            for file, text in part.items():
                (folder / file).write_text(text, encoding="utf-8")
        same = [{"name": name, "ulp": _in_c(folder, vectors, flags)[0]} for name, flags in SAME.items()]
        hours = steady(known, options.seed + 2, min(round(options.duration / known.sample_time), MOST_STEADY))
        same.append({"name": "C at -O2, motions without a reset", "ulp": _in_c(folder, hours, ("-O2",))[0]})
        progress(0.6, "replaying the vectors through the FMU")
        same.append({"name": "FMU through FMPy", "ulp": _in_fmu(folder, known, sources["law"], vectors)})
        progress(0.75, "replaying the vectors in structured text")
        same.append({"name": "structured text", "ulp": _in_text(known, vectors)})
        if PROGRAM is not None:
            progress(0.8, "replaying the vectors in Octave")
            same.append({"name": "MATLAB file in Octave", "ulp": _in_octave(folder / "octave", known, vectors)})
        fused, fused_N = _in_c(folder, vectors, ("-O3", "-march=native", "-ffp-contract=fast"))
        _, single_N = _in_c(folder, vectors, ("-O2", "-DAXIS_FLOAT"))
        progress(0.9, "single precision over a long time")
        day = _long(folder, machine, known, options.duration)
        progress(0.95, "planted faults")
        missed, planted = missed_faults(folder, known, options.seed)
        closed = _closed_loop(folder, machine, known)
        tables = _on_tables(folder, machine, known, options, progress)
    return {
        "vectors": options.samples,
        "steady": hours.asked.size,
        "same": same,
        "missed": missed,
        "planted": planted,
        "fused_N": fused_N,
        "single_N": single_N,
        "closed_loop": closed,
        "long": {key: day[key] for key in ("samples", "thrust_N", "position_m")},
        **tables,
        "said": _said(options, fused, fused_N, single_N, day, planted) + _said_of(tables),
    }


def _on_tables(
    folder: Path, machine: Machine, known: Coefficients, options: ExportOptions, progress: Progress
) -> dict[str, Any]:
    """The tables' results under their key, unless none are asked for."""
    count = options.tables

    def told(done: int) -> None:
        progress(0.96 + 0.04 * done / count, f"closed the loop with {done} of {count} tables")

    return {"tables": on_tables(folder, machine, known, count, options.seed + 3, told)} if count else {}


def _said_of(tables: Mapping[str, Any]) -> list[dict[str, str]]:
    return [
        {
            "name": f"tables off in everything, {row['name']}",
            "text": f"{row['hits']} of {one['tables']} (at least {100 * row['low']:.1f} % at 95 % confidence); the "
            f"slowest {show(row['slowest_s'], 's')}",
        }
        for one in tables.values()
        for row in one["rows"]
    ]


def _said(
    options: ExportOptions, fused: float, fused_N: float, single_N: float, day: Mapping[str, float], planted: int
) -> list[dict[str, str]]:
    rows = {
        "with fused operations, at most": f"{fused:.3g} ULP, {show(fused_N, 'N', 2)}",
        "single precision on the vectors, at most": show(single_N, "N", 2),
        f"single precision over {options.duration / 3600:.3g} h, at most": (
            f"{show(day['thrust_N'], 'N', 2)}; in loops of their own {show(day['position_m'], 'm', 2)}"
        ),
        "time of a sample here": show(day["sample_s"], "s", 2),
        "planted faults": str(planted),
        **({} if PROGRAM else {"MATLAB file": "not run, as there is no octave-cli"}),
    }
    return [{"name": name, "text": text} for name, text in rows.items()]


def _in_c(folder: Path, vectors: Vectors, flags: Sequence[str]) -> tuple[float, float]:
    """The largest difference in C [ULP] and [N]; infinite where a status differs in double precision."""
    program = compiled(folder, ("axis_law.c", "axis_replay.c"), flags, "replay")
    given = np.column_stack([vectors.asked, vectors.given]).tobytes()
    found = np.frombuffer(subprocess.run([str(program)], input=given, capture_output=True, check=True).stdout)
    thrust, status = np.ascontiguousarray(found.reshape(-1, 2).T)
    if "-DAXIS_FLOAT" not in flags and not np.array_equal(status, vectors.status):
        return float("inf"), float("inf")
    return ulps(thrust, vectors.thrust), float(np.max(np.abs(thrust - vectors.thrust)))


def _in_text(known: Coefficients, vectors: Vectors) -> float:
    library = Library()
    law_text = structured_text(known, golden(known, 0))["FB_AxisLaw.TcPOU"]
    law = library.make(library.add_twincat(law_text))
    found = np.zeros(vectors.asked.size)
    for k, (asked, (one, two)) in enumerate(zip(vectors.asked.tolist(), vectors.given.tolist(), strict=True)):
        if asked == RESET:
            law.call(nAsked=asked, fPosition=one, fStart=two)
        else:
            law.call(nAsked=asked, fTarget=one, fPosition=two)
        if asked == 0:
            found[k] = law.values["fThrust"]
            if law.values["nStatus"] != vectors.status[k]:
                return float("inf")
    return ulps(found, vectors.thrust)


def _in_octave(folder: Path, known: Coefficients, vectors: Vectors) -> float:
    """On the first tenth of the vectors, as Octave is slow."""
    count = min(vectors.asked.size // 10, MOST_IN_OCTAVE)
    first = Vectors(vectors.asked[:count], vectors.given[:count], vectors.thrust[:count], vectors.status[:count])
    thrust, status = in_octave(folder, known, first)
    asked = first.asked == STEP
    if not np.array_equal(status[asked], first.status[asked]):
        return float("inf")
    return ulps(thrust[asked], first.thrust[asked])


def _in_fmu(folder: Path, known: Coefficients, law: Mapping[str, str], vectors: Vectors) -> float:
    """Through FMPy, each part from one reset to the next in an instance of its own; parts with a plan end there.

    An instance begins as designed: parts in which something has been learned before are not run.
    """
    from fmpy import extract, read_model_description
    from fmpy.fmi3 import FMU3Slave

    made = fmu("controller", law, known.sample_time, "the positioning law")
    with zipfile.ZipFile(io.BytesIO(made)) as archive:
        (folder / "fmu_controller.c").write_bytes(archive.read("sources/fmu_controller.c"))
    library = compiled(
        folder,
        ("axis_law.c", "fmu_controller.c"),
        ("-O2", "-shared", "-fPIC", "-fvisibility=hidden"),
        "axis_controller.so",
    )
    platform = "x86_64-linux" if sys.platform.startswith("linux") else "x86_64-darwin"
    whole = fmu(
        "controller",
        law,
        known.sample_time,
        "the positioning law",
        {f"{platform}/axis_controller.so": library.read_bytes()},
    )
    (folder / "axis_controller.fmu").write_bytes(whole)
    description = read_model_description(str(folder / "axis_controller.fmu"))
    place = {one.name: one.valueReference for one in description.modelVariables}
    unpacked = extract(str(folder / "axis_controller.fmu"), unzipdir=str(folder / "unpacked"))
    resets = np.flatnonzero(vectors.asked == RESET)
    found, used = np.zeros(vectors.asked.size), np.zeros(vectors.asked.size, bool)
    for begin, end in zip(resets, [*resets[1:].tolist(), vectors.asked.size], strict=True):
        taught = np.flatnonzero(np.isin(vectors.asked[:begin], (LEARN, INIT)))
        if taught.size and vectors.asked[taught[-1]] == LEARN:
            continue
        slave = FMU3Slave(
            guid=description.instantiationToken,
            unzipDirectory=unpacked,
            modelIdentifier="axis_controller",
            instanceName="law",
        )
        slave.instantiate()
        slave.enterInitializationMode()
        slave.setFloat64([place["start_position"], place["start_thrust"]], vectors.given[begin].tolist())
        asked = vectors.asked[begin + 1] if begin + 1 < end else STEP
        slave.setBoolean([place["wipe"], place["learn"]], [asked == WIPE, asked == LEARN])
        slave.exitInitializationMode()
        for k in range(begin + 1 + (asked in {WIPE, LEARN}), end):
            if vectors.asked[k] != 0:
                break
            slave.setFloat64([place["target"], place["position"]], vectors.given[k].tolist())
            slave.doStep(0.0, known.sample_time)
            found[k], used[k] = slave.getFloat64([place["thrust"]])[0], True
        slave.freeInstance()
    return ulps(found[used], vectors.thrust[used])


def _long(folder: Path, machine: Machine, known: Coefficients, duration: float) -> dict[str, float]:
    """Single beside double precision for a duration [s], without the scale's rounding in the way; SI."""
    renamed = [f"-Daxis_law_{name}=axis_single_{name}" for name in FUNCTION_NAMES]
    compiled(folder, ("axis_law.c",), ("-O2", "-c", "-DAXIS_FLOAT", *renamed), "single.o")
    plant = (folder / "axis_plant.c").read_text(encoding="utf-8")
    resolution = machine.scale.resolution.hex()
    (folder / "exact_plant.c").write_text(
        plant.replace(f"resolution = {resolution}", "resolution = 0.0"), encoding="utf-8"
    )
    program = compiled(folder, ("axis_law.c", "exact_plant.c", "axis_day.c", "single.o"), ("-O2",), "day")
    samples = round(duration / known.sample_time)
    motion = round(machine.specification.interval / known.sample_time)
    done = subprocess.run([str(program), str(samples), str(motion)], capture_output=True, text=True, check=True)
    thrust, position, nanoseconds, _ = map(float, done.stdout.split())
    return {"samples": samples, "thrust_N": thrust, "position_m": position, "sample_s": 1e-9 * nanoseconds}


def missed_faults(folder: Path, known: Coefficients, seed: int) -> tuple[list[str], int]:
    """The faults, planted in the axis_law.c of a folder, that its self-test does not catch; how many were planted."""
    for name, text in selftest_sources(known, golden(known, seed)).items():
        (folder / name).write_text(text, encoding="utf-8")
    compiled(folder, ("axis_selftest.c",), ("-O0", "-c", "-DAXIS_MAIN"), "selftest.o")
    right, missed, planted = (folder / "axis_law.c").read_text(encoding="utf-8"), [], 0
    for name, (text, fault) in FAULTS.items():
        if text not in right or (name == "no anti-windup" and known.tracking == 0):
            continue
        planted += 1
        (folder / "axis_fault.c").write_text(right.replace(text, fault), encoding="utf-8")
        program = compiled(folder, ("axis_fault.c", "selftest.o"), ("-O0", "-w"), "fault")
        try:
            status = subprocess.run([str(program)], capture_output=True, check=False, timeout=60).returncode
        except subprocess.TimeoutExpired:
            status = 1
        if status == 0:
            missed.append(name)
    return missed, planted


def _closed_loop(folder: Path, machine: Machine, known: Coefficients) -> float:
    """When the slowest motion of the second period has settled [s], with the law and the plant in C."""
    target = sequence(machine, known.stroke, periods=PERIODS)
    program = compiled(folder, ("axis_law.c", "axis_plant.c", "axis_closed_loop.c"), ("-O2",), "closed_loop")
    found = subprocess.run([str(program)], input=target.tobytes(), capture_output=True, check=True).stdout
    position = np.frombuffer(found).reshape(-1, 3)[:, 2]
    errors, tolerance = last_errors(position, target, PERIODS), machine.specification.tolerance
    return max(settling_time(error, tolerance, machine.sample_time) for error in errors)
