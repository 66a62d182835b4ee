"""Both FMUs, validated and run by FMPy: they close the loop as the simulator does."""

from __future__ import annotations

import io
import math
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from design.deployment.c_source import law_sources
from design.deployment.fmu import fmu
from design.deployment.plant_source import plant_sources
from models.deployment.coefficients import load_coefficients
from models.simulation.simulator import simulate
from tests.design.deployment.compiling import NEEDS_CC, compiled
from tests.models.deployment.laws import designed, motions, written

FLAGS = ("-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-lm", "-Wno-conversion", "-Wno-unused-function")


def archives(folder: Path) -> dict[str, tuple[dict[str, str], bytes]]:
    machine, _ = designed("PID")
    sources = {
        "controller": law_sources(load_coefficients(written("PID", folder), math.nan, math.nan), "a test"),
        "plant": plant_sources(replace(machine, scale=replace(machine.scale, noise=0.0))),
    }
    return {kind: (one, fmu(kind, one, machine.sample_time, "a test")) for kind, one in sources.items()}


def sources_in(archive: bytes, folder: Path) -> list[str]:
    """Unpacks the sources of an FMU into a folder; the names of those to compile."""
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        names = [name for name in opened.namelist() if name.startswith("sources/")]
        for name in names:
            (folder / Path(name).name).write_bytes(opened.read(name))
    return sorted(Path(name).name for name in names if name.endswith(".c"))


def loaded(kind: str, sources: dict[str, str], archive: bytes, folder: Path) -> tuple[Any, dict[str, int]]:
    """The FMU with a library made of nothing but the sources in it."""
    place = folder / kind
    place.mkdir()
    names = sources_in(archive, place)
    library = compiled(place, names, FLAGS, f"axis_{kind}.so").read_bytes()
    machine, _ = designed("PID")
    whole = fmu(kind, sources, machine.sample_time, "a test", {f"x86_64-linux/axis_{kind}.so": library})
    path = folder / f"axis_{kind}.fmu"
    path.write_bytes(whole)
    assert validate_fmu(str(path)) == []
    description = read_model_description(str(path), validate=True)
    slave = FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=extract(str(path), unzipdir=str(folder / f"{kind}_unpacked")),
        modelIdentifier=f"axis_{kind}",
        instanceName=kind,
    )
    slave.instantiate()
    slave.enterInitializationMode()
    return slave, {one.name: one.valueReference for one in description.modelVariables}


def test_equal_inputs_give_equal_bytes(tmp_path: Path) -> None:
    assert {kind: one for kind, (_, one) in archives(tmp_path).items()} == {
        kind: one for kind, (_, one) in archives(tmp_path).items()
    }


@NEEDS_CC
def test_the_two_fmus_close_the_loop_as_the_simulator_does(tmp_path: Path) -> None:
    machine, controller = designed("PID")
    machine = replace(machine, scale=replace(machine.scale, noise=0.0))
    target, ts = motions(machine, 4), machine.sample_time
    response = simulate(machine, controller, target)
    parts = {kind: loaded(kind, *one, tmp_path) for kind, one in archives(tmp_path).items()}
    (law, of_law), (plant, of_plant) = parts["controller"], parts["plant"]
    plant.exitInitializationMode()
    law.setFloat64([of_law["start_thrust"]], plant.getFloat64([of_plant["start_thrust"]]))
    law.exitInitializationMode()
    reading, command = np.empty(target.size), np.empty(target.size)
    for k, wanted in enumerate(target.tolist()):
        (reading[k],) = plant.getFloat64([of_plant["reading"]])
        law.setFloat64([of_law["target"], of_law["position"]], [wanted, reading[k]])
        law.doStep(k * ts, ts)
        (command[k],) = law.getFloat64([of_law["thrust"]])
        plant.setFloat64([of_plant["command"]], [command[k]])
        plant.doStep(k * ts, ts)
    assert reading == pytest.approx(response.record.position, abs=1e-15)
    limit = machine.drive.rated_thrust
    assert command == pytest.approx(np.clip(response.record.command, -limit, limit), abs=1e-9)
    with pytest.raises(Exception, match="fmi3DoStep"):
        law.doStep(0.0, 0.7 * ts)
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        law.setFloat64([of_law["start_thrust"]], [1.0])
    law.terminate()
    law.freeInstance()
    plant.terminate()
    plant.freeInstance()
