"""The law, and the machine it was designed for, as FMI 3.0 co-simulation FMUs with sources."""

from __future__ import annotations

import hashlib
import io
import uuid
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from design.deployment.templating import filled, hexadecimal
from models.quantity import rotary

UUID_NAMESPACE: Final = uuid.UUID("0f0a7b52-2f0b-4d0c-9a55-0c5d2f2f6f11")
LONGEST_AGO: Final = (1980, 1, 1, 0, 0, 0)  # so that equal inputs give equal bytes


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU: its type, causality, unit and start value."""

    name: str
    kind: str
    causality: str
    unit: str
    meaning: str
    start: float = 0.0


VARIABLES: Final = {
    "controller": (
        Variable("target", "Float64", "input", "m", "the target r"),
        Variable("position", "Float64", "input", "m", "the reading x of the scale"),
        Variable("start_position", "Float64", "parameter", "m", "the reading at rest from which the law starts"),
        Variable("start_thrust", "Float64", "parameter", "N", "the thrust that is on the axis when the law starts"),
        Variable("wipe", "Boolean", "parameter", "", "whether it begins with the motion that makes the friction known"),
        Variable("learn", "Boolean", "parameter", "", "whether it begins with that motion and then learns from others"),
        Variable("thrust", "Float64", "output", "N", "the command u"),
        Variable(
            "status", "Int32", "output", "", "1 target missing, 2 reading missing, 4 limited, 8 wiping, 16 learning"
        ),
        Variable("feedback", "Float64", "output", "N", "u_fb"),
        Variable("feedforward", "Float64", "output", "N", "u_ff"),
        Variable("compensation", "Float64", "output", "N", "u_rf"),
        Variable("error", "Float64", "output", "m", "x_T* after its delay, less x"),
        Variable(
            "learned_force", "Float64", "output", "", "the friction's force that was learned, over the nominal one"
        ),
        Variable("learned_length", "Float64", "output", "", "its presliding length, likewise"),
        Variable("learned_offset", "Float64", "output", "N", "the constant force that was learned"),
        Variable("learned_mass", "Float64", "output", "", "what the mass is off by, over the nominal one"),
        Variable("learned_dead_time", "Float64", "output", "s", "what the dead time is off by"),
    ),
    "plant": (
        Variable("command", "Float64", "input", "N", "the command u"),
        Variable("noise", "Float64", "input", "m", "noise of the scale, added before it is rounded"),
        Variable("reading", "Float64", "output", "m", "what the scale shows"),
        Variable("position", "Float64", "output", "m", "where the table is"),
        Variable("velocity", "Float64", "output", "m/s", "how fast it moves"),
        Variable("friction", "Float64", "output", "N", "the friction, as thrust"),
        Variable("start_thrust", "Float64", "output", "N", "the thrust that holds the table at the start"),
    ),
}
INSTANCE: Final = "void *instance"
WHICH: Final = "const reference which[], size_t count"
TYPES: Final = {
    "Float32": "float",
    "Int8": "int8_t",
    "UInt8": "uint8_t",
    "Int16": "int16_t",
    "UInt16": "uint16_t",
    "UInt32": "uint32_t",
    "Int64": "int64_t",
    "UInt64": "uint64_t",
    "String": "char *",
}
DERIVATIVE: Final = (
    f"{INSTANCE}, const reference unknowns[], size_t n_unknowns, const reference knowns[], size_t n_knowns, "
    "const double seed[], size_t n_seed, double sensitivity[], size_t n_sensitivity"
)
OTHERS: Final = {
    "fmi3EnterEventMode": "",
    "fmi3GetBinary": f"{WHICH}, size_t sizes[], const uint8_t *values[], size_t size",
    "fmi3SetBinary": f"{WHICH}, const size_t sizes[], const uint8_t *const values[], size_t size",
    "fmi3GetClock": f"{WHICH}, bool values[]",
    "fmi3SetClock": f"{WHICH}, const bool values[]",
    "fmi3GetNumberOfVariableDependencies": "reference variable, size_t *count",
    "fmi3GetVariableDependencies": (
        "reference dependent, size_t indices[], reference independents[], size_t others[], int kinds[], size_t count"
    ),
    "fmi3GetFMUState": "void **state",
    "fmi3SetFMUState": "void *state",
    "fmi3FreeFMUState": "void **state",
    "fmi3SerializedFMUStateSize": "void *state, size_t *size",
    "fmi3SerializeFMUState": "void *state, uint8_t bytes[], size_t size",
    "fmi3DeserializeFMUState": "const uint8_t bytes[], size_t size, void **state",
    "fmi3EnterConfigurationMode": "",
    "fmi3ExitConfigurationMode": "",
    "fmi3GetIntervalDecimal": f"{WHICH}, double intervals[], int qualifiers[]",
    "fmi3GetIntervalFraction": f"{WHICH}, uint64_t counters[], uint64_t resolutions[], int qualifiers[]",
    "fmi3GetShiftDecimal": f"{WHICH}, double shifts[]",
    "fmi3GetShiftFraction": f"{WHICH}, uint64_t counters[], uint64_t resolutions[]",
    "fmi3SetIntervalDecimal": f"{WHICH}, const double intervals[]",
    "fmi3SetIntervalFraction": f"{WHICH}, const uint64_t counters[], const uint64_t resolutions[]",
    "fmi3SetShiftDecimal": f"{WHICH}, const double shifts[]",
    "fmi3SetShiftFraction": f"{WHICH}, const uint64_t counters[], const uint64_t resolutions[]",
    "fmi3EvaluateDiscreteStates": "",
    "fmi3UpdateDiscreteStates": "bool *update, bool *terminate, bool *nominals, bool *states, bool *has, double *next",
    "fmi3EnterContinuousTimeMode": "",
    "fmi3CompletedIntegratorStep": "bool no_return, bool *event, bool *terminate",
    "fmi3SetTime": "double time",
    "fmi3SetContinuousStates": "const double states[], size_t count",
    "fmi3GetContinuousStateDerivatives": "double derivatives[], size_t count",
    "fmi3GetEventIndicators": "double indicators[], size_t count",
    "fmi3GetContinuousStates": "double states[], size_t count",
    "fmi3GetNominalsOfContinuousStates": "double nominals[], size_t count",
    "fmi3GetNumberOfEventIndicators": "size_t *count",
    "fmi3GetNumberOfContinuousStates": "size_t *count",
    "fmi3EnterStepMode": "",
    "fmi3GetOutputDerivatives": f"{WHICH}, const int32_t orders[], double values[], size_t size",
    "fmi3ActivateModelPartition": "reference clock, double time",
}


def absent() -> list[tuple[str, str]]:
    """Names and parameters in C of the functions of FMI 3.0 that neither FMU supports, but has to have."""
    found = []
    for kind, ctype in TYPES.items():
        for verb, const in (("Get", ""), ("Set", "const ")):
            values = (
                f"{'const ' if kind == 'String' else const}{ctype} {'const ' if const and kind == 'String' else ''}"
            )
            found.append((f"fmi3{verb}{kind}", f"{INSTANCE}, {WHICH}, {values}values[], size_t size"))
    found += [(name, DERIVATIVE) for name in ("fmi3GetDirectionalDerivative", "fmi3GetAdjointDerivative")]
    return found + [(name, f"{INSTANCE}, {rest}" if rest else INSTANCE) for name, rest in OTHERS.items()]


def fmu(
    kind: str,
    sources: Mapping[str, str],
    sample_time: float,
    description: str,
    binaries: Mapping[str, bytes] | None = None,
    start_thrust: float = 0.0,
    *,
    turns: bool = False,
) -> bytes:
    """The archive of a "controller" or a "plant" made of these sources, for communication steps of sample_time [s].

    binaries: shared libraries by their path below binaries/, such as "x86_64-linux/axis_plant.so". start_thrust [N]:
    the value with which the controller's parameter of that name starts. turns: whether the axis is rotary.
    """
    token = f"{{{uuid.uuid5(UUID_NAMESPACE, hashlib.sha256(''.join(sources.values()).encode()).hexdigest())}}}"
    given = {
        "kind": kind,
        "token": token,
        "description": description.replace("&", "and").replace("<", "").replace('"', "'"),
        "sample_time": sample_time,
        "turns": turns,
        "variables": [
            replace(
                one,
                unit=rotary(one.unit) if turns else one.unit,
                start=start_thrust if one.name == "start_thrust" else one.start,
            )
            for one in VARIABLES[kind]
        ],
        "absent": absent(),
    }
    whole = {**sources, f"fmu_{kind}.c": filled("fmu.c.j2", hexadecimal, **given)}
    files: dict[str, str | bytes] = {
        "modelDescription.xml": filled("model_description.xml.j2", repr, **given),
        "sources/buildDescription.xml": filled("build_description.xml.j2", repr, kind=kind, sources=sorted(whole)),
        **{f"sources/{name}": text for name, text in whole.items()},
        **{f"binaries/{name}": content for name, content in (binaries or {}).items()},
    }
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_STORED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, LONGEST_AGO), content)
    return made.getvalue()
