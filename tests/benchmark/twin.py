"""The C twin: the simulator's scheme in C, built into a temporary folder and called through ctypes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from models.feedback.law import Law
from models.simulation.kernel import Loop, Run

SOURCE: Final = Path(__file__).with_name("twin.c")
FLAGS: Final = ("-O3", "-march=native", "-Wall", "-Wextra", "-shared", "-fPIC")
MODES: Final = 8
ELEMENTS: Final = 64
STATES: Final = 16  # of a law in place of the PID


class Twin(Protocol):
    """Fills `run` as `kernel.run_one` does, and under a law as `effect_kernel.run_effects` does."""

    def __call__(self, loop: Loop, run: Run, law: Law | None = None) -> None: ...


class NoTwinError(Exception):
    """Why there is no C twin here."""


class _Machine(ctypes.Structure):
    """`Machine` of twin.c."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("sample_time", "thrust_limit", "resolution", "offset", "start")),
        *((name, ctypes.c_double) for name in ("kp", "ki", "kd", "tau")),
        ("step", ctypes.c_double * 2),
        ("phi", ctypes.c_double * 4 * MODES * 2),
        ("gamma", ctypes.c_double * 2 * MODES * 2),
        *((name, ctypes.c_double * ELEMENTS) for name in ("stiffness", "limit", "z")),
        ("a", ctypes.c_double * STATES * STATES),
        ("b", ctypes.c_double * 2 * STATES),
        *(("c", ctypes.c_double * STATES), ("d", ctypes.c_double * 2)),
        *((name, ctypes.c_double * STATES) for name in ("hold", "reset")),
        ("counts", ctypes.c_int64 * 2),
        *((name, ctypes.c_int64) for name in ("delay", "reference_delay", "modes", "elements")),
        *((name, ctypes.c_int64) for name in ("states", "keeps_to_the_rating")),
    )


def build() -> Twin:
    """The twin as a function that fills `run` as `kernel.run_one` does. Raises NoTwinError where it can't be built."""
    compiler = next((path for name in ("gcc", "cc", "clang") if (path := shutil.which(name))), None)
    if compiler is None:
        raise NoTwinError("no C compiler is on the PATH")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "twin.so"
        command = [compiler, *FLAGS, str(SOURCE), "-o", str(library), "-lm"]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode != 0:
            raise NoTwinError(f"{Path(compiler).name} failed: {built.stderr.strip().splitlines()[-1]}")
        function = ctypes.CDLL(str(library)).twin  # stays loaded when the file is gone
    signal = np.ctypeslib.ndpointer(np.float64, ndim=1, flags="C_CONTIGUOUS")
    function.argtypes = [ctypes.POINTER(_Machine), ctypes.c_size_t, *[signal] * 7]
    function.restype = None

    def run_twin(loop: Loop, run: Run, law: Law | None = None) -> None:
        signals = (run.reference, run.feedforward, run.noise, run.reading, run.command, run.position, run.friction)
        function(_machine(loop, run, law), run.reference.size, *signals)

    return run_twin


def _machine(loop: Loop, run: Run, law: Law | None) -> _Machine:
    modes, elements = run.state.shape[0], run.z.size
    if modes > MODES or elements > ELEMENTS or np.any(loop.damping > 0):
        raise ValueError(f"the twin takes up to {MODES} modes and {ELEMENTS} elements without damping")
    machine = _Machine(loop.sample_time, loop.thrust_limit, loop.resolution, loop.offset, run.start, *loop.gains)
    machine.delay, machine.reference_delay = int(loop.delays[0]), int(loop.delays[1])
    machine.modes, machine.elements = modes, elements
    np.ctypeslib.as_array(machine.counts)[:] = loop.counts
    np.ctypeslib.as_array(machine.step)[:] = loop.step
    np.ctypeslib.as_array(machine.phi)[:, :modes] = loop.phi
    np.ctypeslib.as_array(machine.gamma)[:, :modes] = loop.gamma
    for field, values in (("stiffness", loop.stiffness), ("limit", loop.limit), ("z", run.z)):
        np.ctypeslib.as_array(getattr(machine, field))[:elements] = values
    if law is not None:
        states = len(law.c)
        if states > STATES:
            raise ValueError(f"the twin takes a law of up to {STATES} states")
        machine.states, machine.keeps_to_the_rating = states, law.keeps_to_the_rating
        np.ctypeslib.as_array(machine.a)[:states, :states] = law.a
        for name in ("b", "c", "hold", "reset"):
            np.ctypeslib.as_array(getattr(machine, name))[:states] = getattr(law, name)
        np.ctypeslib.as_array(machine.d)[:] = law.d
    return machine
