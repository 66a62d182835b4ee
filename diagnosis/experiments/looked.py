"""Looks at records that came one after another, as an engineer takes them by hand: what each found, and how sure it is.

Who diagnoses again with every new record has that many chances of a false name. The names of the first look have the
chance of one look. What a later look gives for the first time counts where records have confirmed it that had not
chosen it (e_process.py). So over all looks the chance of a false name is that of one look and policy.CHANCE at most.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from diagnosis.baseline import Baseline, refit_and_null
from diagnosis.experiments.active import Settings
from diagnosis.experiments.e_process import EProcess, tested
from diagnosis.experiments.look import Found, Look, look
from diagnosis.experiments.policy import CHANCE
from models.machine import Machine
from models.records.record import Record

Say = Callable[[str], None]


@dataclass(frozen=True)
class EarlierLooks:
    """Looks before the present one: over how many records each was, what it found, the e-process by then; the last."""

    counts: tuple[int, ...]
    found: tuple[Found, ...]
    processes: tuple[EProcess, ...]
    last: Look


def earlier_looks(
    machine: Machine,
    records: Sequence[Record],
    counts: Sequence[int],
    settings: Settings,
    *,
    begun: EProcess,
    say: Say = lambda _text: None,
) -> EarlierLooks:
    """The looks at the first `counts` of the records, in growing order and at least one [SI].

    begun: the e-process that the first of them goes on from. Raises RecordError as a diagnosis does.
    """
    found, processes, last = list[Found](), list[EProcess](), None
    for count in counts:
        say(f"the look at the first {'record' if count == 1 else f'{count} records'}")
        baseline = refit_and_null(machine, records[:count], criteria=settings.criteria, cache=settings.cache)
        process = begun if last is None else tested(last, baseline, processes[-1])
        last = look(baseline, seed=settings.seed, disabled=settings.disabled)
        found.append(last.found)
        processes.append(process)
    assert last is not None
    return EarlierLooks(tuple(counts), tuple(found), tuple(processes), last)


def with_last(earlier: EarlierLooks, baseline: Baseline) -> tuple[EProcess, ...]:
    """The e-processes of all looks, the present one's included; baseline: of all records."""
    return (*earlier.processes, tested(earlier.last, baseline, earlier.processes[-1]))


def standing(
    names: Collection[str], first: Collection[str], processes: Sequence[EProcess], chance: float = CHANCE
) -> tuple[str, ...]:
    """Those of the names that count: of the first look, or confirmed by the time of any look; chance [1]: that a false
    one is ever confirmed."""
    return tuple(name for name in names if name in first or any(one.is_confirmed(name, chance) for one in processes))
