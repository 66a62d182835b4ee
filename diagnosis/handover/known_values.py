"""What a machine file knew of its values, beside those that a fit moved without saying how sure they are.

A fit that lacks a law has no deviations to be believed. The file that is made of it is the next diagnosis's all the
same, which keeps a mode as an earlier record told it only while its deviation stands there (`known_modes`). So a value
has the deviation that the given file states, and where it was moved farther, one as wide as the move.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from models.effects.base import parameters as parameters_of
from models.effects.catalogue import named
from models.machine import Machine, parameters
from models.machines.provenance import Provenance, Shares

Numbers = tuple[float, ...]


def with_known_deviations(given: Machine, better: Machine, *, believed: bool) -> Machine:
    """The better machine, with deviations [SI] beside the values that were moved from the given one's: those that the
    given file states, and never less than the move. believed: whether those that the fit gave are; else they only widen
    these. A value that is known by its tolerance alone still is, as is one that follows from others."""
    before = {one.name: one.number for one in parameters(given)}
    turns, switches = _of_role(given, "phase"), _of_role(given, "switch")
    sources = dict(better.sources)
    for one in parameters(better):
        then, now = _numbers(before.get(one.name)), _numbers(one.number)
        said, old = sources.get(one.name), given.sources.get(one.name)
        if said is None or said is old or said.kind == "derived" or one.name in switches:
            continue
        if not 0 < len(then) == len(now) or (believed and said.std is not None):
            continue
        known, fitted = _deviations(old, len(now)), _deviations(said, len(now))
        if not known and not fitted:  # known by its tolerance, or not at all
            continue
        away = [_move(*pair, turns=one.name in turns) for pair in zip(now, then, strict=True)]
        wide = np.max([away, known or (0.0,) * len(now), fitted or (0.0,) * len(now)], axis=0).tolist()
        shares: Shares = () if believed or old is None else old.shares  # of the errors that all of the given file has
        std = tuple(wide) if isinstance(one.number, tuple) else wide[0]
        sources[one.name] = replace(said, std=std, shares=shares)
    return replace(better, sources=sources)


def _of_role(machine: Machine, role: str) -> set[str]:
    """The dotted names of those parameters of a machine's effects that have this role."""
    return {
        f"effects.{path}.{item.name}"
        for path, effect in named(machine.effects).items()
        for item in parameters_of(type(effect))
        if item.role == role
    }


def _move(now: float, then: float, *, turns: bool) -> float:
    """How far a number was moved [SI]; turns: whether it is an angle."""
    return abs(math.remainder(now - then, math.tau) if turns else now - then)


def _numbers(number: object) -> Numbers:
    """The numbers of a value [SI]; none of one in words, or where there is none."""
    if isinstance(number, tuple):
        return tuple(float(one) for one in number if isinstance(one, (int, float)))
    return (float(number),) if isinstance(number, (int, float)) and not isinstance(number, bool) else ()


def _deviations(source: Provenance | None, count: int) -> Numbers:
    """The deviations [SI] that stand beside so many numbers; none where there is not one of each."""
    found = () if source is None or source.std is None else _numbers(source.std)
    return found if len(found) == count and bool(np.all(np.isfinite(found))) else ()
