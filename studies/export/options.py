"""Options of export besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from studies.options import BadInputError, Options, choice, flag, paths, quantity, whole

EXPORT_TARGETS: Final = ("all", "c", "fmi3", "st", "matlab", "cia402")


@dataclass(frozen=True, kw_only=True)
class ExportOptions(Options):
    """The controller, what it is exported as, and how far that is proved."""

    controller_json: tuple[Path, ...] = paths(
        "CONTROLLER_JSON",
        "the controller.json of deadbeat_design or trajectory_optimisation; a machine.toml beside it is its machine "
        "(default: the deadbeat design of the machine)",
        reviewable=True,
    )
    target: str = choice(
        "what to write: C99, FMI 3.0 (not 2.0) FMUs of controller and plant, IEC 61131-3 structured text, MATLAB, or "
        "CiA 402 profiles for a drive that keeps its own cascade",
        EXPORT_TARGETS,
    )
    anti_windup: float | None = quantity(
        "s",
        "TIME",
        "time constant with which a PID's integral gives back what the limit cuts off the command (default: it does "
        "not; a law has the anti-windup that the machine file states)",
        above=0,
    )
    drive_interval: float | None = quantity(
        "s",
        "TIME",
        'from one set point of the CiA 402 profiles to the next, such as "1 ms" (default: the sample time)',
        above=0,
    )
    proof: bool = flag(
        "compile the C with cc and replay --samples vectors at every optimisation, through the FMU, in structured "
        "text, and a tenth of them in Octave if it is installed; needs a C compiler and some minutes",
        reviewable=False,
    )
    samples: int = whole("N", "vectors of --proof (default: 1000000)", 1000, 100_000_000, default=1_000_000)
    tables: int = whole(
        "N",
        "tables that are off in everything at once, on each of which --proof runs the law in C in a loop with the "
        "table in C (default: 200)",
        0,
        100_000,
        default=200,
    )
    duration: float = quantity(
        "s",
        "TIME",
        'time over which --proof compares single precision with double, such as "24 h" (default: 1 h)',
        default=3600.0,
        text="1 h",
        above=0,
    )

    def usual_machine(self) -> Path | None:
        """The machine that the design left beside its controller."""
        if len(self.controller_json) > 1:
            raise BadInputError(f"CONTROLLER_JSON: {len(self.controller_json)} files; give one controller.json")
        beside = [path.parent / "machine.toml" for path in self.controller_json]
        return next((path for path in beside if path.is_file()), None)
