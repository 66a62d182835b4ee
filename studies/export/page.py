"""The page that goes with the exported code, for who puts it on a drive."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from design.deployment.templating import filled
from models.deployment.coefficients import Coefficients
from models.quantity import show

FOLDERS: Final = {
    "c/": "C99, double or single precision (`-DAXIS_FLOAT`): `cc -std=c99 -O2 -ffp-contract=off -DAXIS_MAIN "
    "axis_law.c axis_selftest.c` replays the vectors; `axis_closed_loop.c` with `axis_plant.c` closes the loop with "
    "the nonsmooth axis, and `axis_session.c` runs them through resets, a wipe and a learning",
    "fmi3/": "FMI 3.0 co-simulation FMUs with sources: the law, and the nonsmooth axis to test it on (give the law the "
    "plant's reading, step the law, then step the plant with its thrust)",
    "st/": "structured text: function block and test program for TwinCAT (`.TcPOU`) and as PLCopen XML",
    "matlab/": "MATLAB: `axis_law.m`, and `axis_check.m`, which replays the vectors",
    "cia402/": "set point, velocity and torque offset over the specification's motions, for a drive with its own "
    "cascade",
}


def readme(text: str, known: Coefficients, results: Mapping[str, Any], names: Sequence[str]) -> str:
    """The page; text: the controller's file; names: of the files that are written."""
    law = results["law"]
    return filled(
        "README.md.j2",
        repr,
        k=known,
        title="The positioning law",
        rows=_rows(known, json.loads(text), law),
        wipe_time=law["wipe_s"],
        largest=law["largest_step_m"],
        learning=law["learning"],
        settled=law["settling_time_s"] + known.delay * known.sample_time,
        vectors=results["vectors"]["count"],
        folders=[(name, said) for name, said in FOLDERS.items() if any(one.startswith(name) for one in names)],
        never=results["drive"]["never"],
        sticking=results.get("sticking"),
        show=show,
    )


def _rows(known: Coefficients, content: Mapping[str, Any], law: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The values that whoever commissions the axis looks for."""
    rows = [
        (
            "stroke and settling time it was designed for",
            f"{show(known.stroke, 'm')}, {show(law['settling_time_s'], 's')}",
        ),
        ("thrust limit", show(known.thrust_limit, "N")),
        ("reference waits for the dead time", f"{known.delay} samples"),
        ("feedforward", f"{law['coefficients']} coefficients each of x_T\\*, u_ff and the compensator's path"),
        ("friction compensator", f"{law['elements']} element{'' if law['elements'] == 1 else 's'}"),
        (
            "products a sample; memory",
            f"{law['products']}; {law['memory_double_bytes']} bytes ({law['memory_single_bytes']} in single precision)",
        ),
    ]
    if known.law is None:
        pid = known.pid
        gains = [show(pid.kp, "N/m"), show(pid.ki, "N/(m s)"), show(pid.kd, "N s/m"), show(pid.derivative_filter, "s")]
        rows.insert(1, ("PID in parallel form: kp, ki, kd, derivative filter", ", ".join(gains)))
    else:
        rows.insert(1, ("feedback", f"a law of {law['states']} states, e to thrust; see controller.json"))
    if law["learning"] is not None:
        taught = law["learning"]
        products = taught["products"], taught["products_at_rest"], taught["products_of_a_round"]
        rows.append(
            (
                "of which learning takes; products more while it learns: a sample, a motion's end, a round's",
                f"{taught['memory_double_bytes']} bytes ({taught['memory_single_bytes']}); "
                + ", ".join(map(str, products)),
            )
        )
    if content.get("scale_resolution_m"):
        rows.append(("one step of the scale", show(content["scale_resolution_m"], "m")))
    return rows
