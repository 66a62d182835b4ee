"""What each record gave, and the machine that all of them together make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from models.identification import modes, motion
from models.identification.estimate import Estimate, not_identifiable
from models.identification.force.fit import ForceFit
from models.identification.into_machine import Holdable, drag_of, lag_of, spring_of
from models.identification.modal.fitting import Beside
from models.identification.modal.remarks import ResponseStep
from models.machine import Machine
from models.records.files import Loaded
from models.records.record import Record


@dataclass(frozen=True)
class Settings:
    """How records are identified. pass_band [Hz]: of the low-pass for friction, None: the usual one. modes: how many
    vibration modes, None: as many as a response shows. rolled: responses in files were measured while the axis
    rolled."""

    pass_band: float | None = None
    modes: int | None = None
    rolled: bool = False


@dataclass(frozen=True)
class ForceStep:
    """What a record gave by its force: a slow one its friction, a fast one its dynamics, of which `held` is what a
    machine file can hold."""

    fit: ForceFit
    held: Holdable | None = None

    @property
    def estimate(self) -> Estimate:
        """The parameters of the force [SI]."""
        return self.fit.estimate


@dataclass(frozen=True)
class Difference:
    """By how much a motion record departs from what the records before it said: relative, or the dead time's in sample
    times [1], with its standard deviation."""

    name: str
    size: float
    std: float


@dataclass(frozen=True)
class MotionStep:
    """What a motion record gave, and how far it agrees with the records before it."""

    fit: motion.MotionFit
    differences: tuple[Difference, ...]

    @property
    def estimate(self) -> Estimate:
        """Mass, friction and presliding length relative to the machine as the records before had it [1], and more."""
        return self.fit.estimate


@dataclass(frozen=True)
class Step:
    """One record: what it is (one of KINDS), the file, what it gave, and remarks on it in whole sentences."""

    kind: str
    loaded: Loaded
    gave: ResponseStep | ForceStep | MotionStep
    remarks: tuple[str, ...] = ()

    @property
    def result(self) -> str:
        """The kind of its result: an excitation gives a response."""
        return "response" if self.kind == "excitation" else self.kind


@dataclass(frozen=True)
class LeftOut:
    """A record that its method could not use, what it was taken for (one of KINDS), and why, without its name."""

    name: str
    kind: str
    why: str


@dataclass(frozen=True, repr=False)
class Identified:
    """The machine that the records show, each identified value with its record and standard deviation, and how.

    steps: what each record gave, in the order in which they were identified. left_out: records that gave nothing.
    of_all: what is to be said of all records together. records: all that were given, which judge what one shows of
    another's way.

    >>> pos.identify(machine, [folder / "moves.csv"])
    Identified('Linear-motor table with rolling ball guides, identified', moves.csv: motion)
    """

    machine: Machine
    steps: tuple[Step, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    of_all: tuple[str, ...] = ()
    records: tuple[Loaded, ...] = ()

    def __repr__(self) -> str:
        """The machine's name and what each record was taken for; no unit [-]."""
        records = (f"{step.loaded.name}: {step.kind}" for step in self.steps)
        return f"Identified({', '.join([repr(self.machine.name), *records])})"

    @property
    def estimates(self) -> Mapping[str, Estimate]:
        """What each record gave [SI], by the record's name."""
        return {step.loaded.name: step.gave.estimate for step in self.steps}

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know of the values, in whole sentences: what the records can't show or tell apart, or disagree in. Of
        several records each sentence begins with the file's name."""
        several = len(self.steps) + len(self.left_out) > 1
        said = (f"{step.loaded.name}: {one}" if several else one for step in self.steps for one in step.remarks)
        return (*(f"{one.name}: is left out: {one.why}." for one in self.left_out), *said, *self.of_all)

    def earlier(self, name: str) -> list[tuple[float, float]]:
        """Value and standard deviation of a parameter [SI] in every record so far that has it."""
        having = (step.gave.estimate for step in self.steps if name in step.gave.estimate.names)
        return [(estimate.value(name), estimate.deviation(name)) for estimate in having]

    def last(self, result: str) -> ResponseStep | ForceStep | MotionStep | None:
        """What the last record with this kind of result gave."""
        return next((step.gave for step in reversed(self.steps) if step.result == result), None)

    @property
    def slow(self) -> ForceFit | None:
        """The friction of the last slow record."""
        gave = self.last("hysteresis")
        return gave.fit if isinstance(gave, ForceStep) else None

    def misfit(self, gave: ResponseStep) -> float:
        """Reduced chi-square [1] of this machine, as its file has it, on a response that it was identified from."""
        spring = spring_of(self.machine) or gave.fit.spring  # what pulls as one there is none of the file's
        beside = Beside(lag_of(self.machine), drag_of(self.machine), spring)
        return modes.misfit(gave.measured, gave.fit.used, self.machine.plant, beside)

    def has(self, *results: str) -> bool:
        """Whether a record had a result of one of these kinds."""
        return any(step.result in results for step in self.steps)


def record_of(loaded: Loaded) -> Record:
    """The record over time that a file holds [SI]. Raises ValueError for a frequency response."""
    if not isinstance(loaded.content, Record):
        raise ValueError("is a frequency response, not a record over time; name its kind response")
    return loaded.content


def with_step(
    found: Identified,
    machine: Machine,
    kind: str,
    loaded: Loaded,
    gave: ResponseStep | ForceStep | MotionStep,
    remarks: Sequence[str],
) -> Identified:
    """What was identified so far and one step more: the machine as it is after it, and remarks on the record."""
    remarks = (*remarks, *not_identifiable(gave.estimate, ("offset",)))
    return replace(found, machine=machine, steps=(*found.steps, Step(kind, loaded, gave, remarks)))
