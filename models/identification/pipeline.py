"""Which machine is this? From records to a machine with uncertainties, whatever the records show.

Each record is recognised (recognise.py), identified by the method for its kind (joint/), and put into the machine
(into_machine.py): frequency responses and excitations first, which give the plant; then slow records, which give the
friction; then motions, which judge both and give what is missing; then fast records by inverse dynamics; last the noise
of the scale, at rest. A value that an earlier record gave stays, but for the offset, which is the mean of all records
by their deviations, or the machine file's where none of them tells it better, and for the damping of the friction's
elements, which the record that knows it best gives.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from models.identification.joint.agreement import with_offset_shown
from models.identification.joint.at_rest import with_noise
from models.identification.joint.fast_records import from_dynamics
from models.identification.joint.motion_records import from_motion
from models.identification.joint.response_records import from_response
from models.identification.joint.slow_records import from_hysteresis
from models.identification.joint.steps import Identified, LeftOut, Settings
from models.identification.recognise import read, recognised, replayable
from models.identification.unusable import UnusableError
from models.machine import Machine
from models.records.checks import moves
from models.records.columns import Columns
from models.records.files import Loaded
from models.records.kinds import KINDS
from models.records.record import Record
from models.records.tables.sizes import RecordError

UNSOLVED: Final = (
    "no machine close to that of the machine file reproduces this record, taken as {kind}; check its units and signs, "
    "and mass, friction and control of the machine file"
)
FAILED: Final = (
    'the method for records of the kind {kind} fails on it, in the words of its library: "{words}"; check its columns '
    "and units, or name its kind; where these are right, that is a fault of this program"
)


def identify(
    machine: Machine,
    records: Sequence[str | Path | Loaded],
    *,
    kinds: Sequence[str] = (),
    pass_band: float | None = None,
    modes: int | None = None,
    rolled: bool = False,
    tell: Callable[[float, str], None] | None = None,
) -> Identified:
    """Which machine the records show, with standard deviations; what they don't show stays as in `machine`.

    records: files of any kind that models.records.files reads, their columns as machine.record maps them, or what
    `recognise.read` made of them. kinds: one of "response", "excitation", "hysteresis", "motion", "dynamics" or "auto"
    for each; recognised by default. pass_band [Hz]: of the low-pass for friction, by default 80 times the frequency
    of its loops, or 5.8 times that of a fast record's motion. modes: how many vibration modes a frequency response
    has, by default the fewest that pass. rolled: frequency responses in files were measured while the axis rolled.
    tell: hears the share that is done [1] and a sentence, before each record.
    A frequency response that friction bends throughout, beside another one, and motions that no machine close to the
    known one reproduces, beside any other record, are left out, and told in the remarks and in `left_out`.
    Raises RecordError, a sentence that begins with the file's name, for a record that can't be used or is of another
    kind, and ValueError for an option that means nothing.

    >>> found = pos.identify(machine, [folder / "moves.csv"], kinds=["motion"])
    >>> found.machine.sources["plant.dead_time"].record
    'moves.csv'
    """
    if isinstance(records, str | Path):
        raise ValueError(f"records: must be a list of files; give [{str(records)!r}]")
    if pass_band is not None and not pass_band > 0:
        raise ValueError(f"pass_band: must be above 0 Hz, not {pass_band:g}")
    if modes is not None and modes < 0:
        raise ValueError(f"modes: must be at least 0, not {modes}")
    loaded = [one if isinstance(one, Loaded) else read(machine, Path(one)) for one in records]
    if kinds and (len(kinds) != len(loaded) or not set(kinds) <= {"auto", *KINDS}):
        raise ValueError(f"kinds: must be one of auto, {', '.join(KINDS)} for each of the {len(loaded)} records")
    known = [
        recognised(machine, one) if kind == "auto" else kind
        for one, kind in zip(loaded, kinds or ["auto"] * len(loaded), strict=True)
    ]
    loaded = [
        one if given is one else replayable(machine, one, kind, machine.record or Columns())
        for given, one, kind in zip(records, loaded, known, strict=True)
    ]
    # What an experiment on another machine showed is left out.
    found = Identified(replace(machine, name=f"{machine.name}, identified", published=None), records=tuple(loaded))
    settings = Settings(pass_band, modes, rolled)
    queue = sorted(zip(known, loaded, strict=True), key=lambda item: KINDS.index(item[0]))
    for i, (kind, one) in enumerate(queue):
        if tell is not None:
            tell(i / len(loaded), f"identifying from {one.name} ({kind})")
        try:
            _check_movement(machine, one)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # ends in a refusal, not in warnings
                found = _METHODS[kind](found, kind, one, settings)
        except ValueError as error:
            unsolved = UNSOLVED if kind == "motion" else FAILED  # which alone asks for a machine that is close
            why = str(error) if (ours := _is_ours(error)) else unsolved.format(kind=kind, words=error)
            came_to_nothing = isinstance(error, UnusableError) or not ours
            if not (came_to_nothing and _beside_others(kind, found, [kind for kind, _ in queue[i + 1 :]])):
                raise RecordError(f"{one.name}: {why}") from error
            found = replace(found, left_out=(*found.left_out, LeftOut(one.name, kind, why)))
    return with_noise(with_offset_shown(found, machine), loaded)


def _check_movement(machine: Machine, one: Loaded) -> None:
    """Raises UnusableError for a record of an axis that rests."""
    if isinstance(one.content, Record) and not moves(one.content, machine.friction):
        raise UnusableError("the axis rests in it, so that it shows neither mass nor friction; give records of motions")


def _beside_others(kind: str, found: Identified, to_come: Sequence[str]) -> bool:
    """Whether a record of no use may be left out: a response where others give the plant, and motions or slow loops
    where anything else gave something, or yet may."""
    if kind in {"motion", "hysteresis"}:
        return bool(found.steps or to_come)
    responses = {"response", "excitation"}
    return kind in responses and (found.has("response") or not responses.isdisjoint(to_come))


def _is_ours(error: ValueError) -> bool:
    """Whether this program raised an error, and no library, whose words say nothing to who gave the record."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    return str(frame.f_globals["__name__"]).partition(".")[0] == __name__.partition(".")[0]


_METHODS: Final[Mapping[str, Callable[[Identified, str, Loaded, Settings], Identified]]] = {
    "response": from_response,
    "excitation": from_response,
    "hysteresis": from_hysteresis,
    "motion": from_motion,
    "dynamics": from_dynamics,
}
