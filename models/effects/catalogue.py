"""Every effect that there is, found in the modules of this package: one's own is one more file in its folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields
from functools import cache
from typing import Final

import models.effects
from models.effects.base import FAMILIES, Effect, parameters
from models.effects.priors import USUAL, Priors
from models.plant import Plant
from models.quantity import Declaration, declaration

SIZES: Final = ("amplitude", "shape", "period", "width")  # roles whose range a machine may state


def every() -> Mapping[str, type[Effect]]:
    """The effects by name that are laws with parameters, in the order in which they act: by family, module and place in
    the module."""
    return {name: kind for name, kind in readable().items() if not kind.tabulated}


def readable() -> Mapping[str, type[Effect]]:
    """The effects by name that a file may hold, tables of measured values among them, in the order of `every`."""
    found: dict[str, type[Effect]] = {}
    for kind in _kinds(tuple(models.effects.__path__)):
        if kind.name in found:
            other = found[kind.name].__module__
            raise ValueError(f"{kind.__module__}: the effect {kind.name!r} is in {other} already; give it another name")
        found[kind.name] = kind
    return found


def range_declarations(kind: type[Effect]) -> Mapping[str, Declaration]:
    """The parameters of an effect whose sizes a machine may state, each with how its range is declared [SI]."""
    return {
        item.name: Declaration(item.unit, f"least and most of: {item.meaning}", None, None, stated.below)
        for field, item in zip(fields(kind), parameters(kind), strict=True)
        if item.role in SIZES and (stated := declaration(field))
    }


def looked_for(
    priors: Priors = USUAL, axis: str = "linear", has: Collection[str] = (), plant: Plant | None = None
) -> Mapping[str, type[Effect]]:
    """The effects by name that may be in a machine with these priors, in their order: the usual ones of its axis, those
    of which it states sizes [SI], and those that go with the effects that its file says it has; without those that need
    another plant than its, where that is given."""
    stated = priors.by_effect()

    def may_be(name: str, kind: type[Effect]) -> bool:
        usual = axis in kind.common_on or name in stated or any(one in kind.beside for one in has)
        return usual and (plant is None or kind.placed(plant) != ())

    return {name: kind for name, kind in every().items() if may_be(name, kind)}


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects in the order in which they act."""
    order = {name: i for i, name in enumerate(readable())}
    return tuple(sorted(effects, key=lambda effect: order.get(effect.name, len(order))))


def beyond(own: Iterable[Effect], effects: Iterable[Effect]) -> list[Effect]:
    """The effects without the first ones of each name, as many as stand in `own`."""
    left, more = [effect.name for effect in own], []
    for effect in effects:
        if effect.name in left:
            left.remove(effect.name)
        else:
            more.append(effect)
    return more


def paired(own: Iterable[Effect], effects: Iterable[Effect]) -> Mapping[str, tuple[Effect, Effect]]:
    """The effects of `own` by name as of `named`, each with the one of `effects` that has its place among those of its
    name; without those of names of which there are fewer."""
    given, members = list(own), dict[str, list[Effect]]()
    for effect in effects:
        members.setdefault(effect.name, []).append(effect)
    counts = Counter(effect.name for effect in given)
    pairs = {}
    for path, effect in named(given).items():
        same = members.get(effect.name, [])
        if len(same) >= counts[effect.name]:
            number = int(path.rpartition(".")[2]) - 1 if path != effect.name else 0
            pairs[path] = (effect, same[number])
    return pairs


def named(effects: Iterable[Effect]) -> Mapping[str, Effect]:
    """The effects by name as in a machine file's paths: "cogging", or "cogging.1" and "cogging.2" of two."""
    members: dict[str, list[Effect]] = {}
    for effect in effects:
        members.setdefault(effect.name, []).append(effect)
    paths: dict[str, Effect] = {}
    for name, same in members.items():
        for i, effect in enumerate(same):
            paths[name if len(same) == 1 else f"{name}.{i + 1}"] = effect
    return paths


@cache
def _kinds(folders: tuple[str, ...]) -> tuple[type[Effect], ...]:
    found: list[type[Effect]] = []
    for module in pkgutil.iter_modules(folders):
        content = vars(importlib.import_module(f"{models.effects.__name__}.{module.name}"))
        for item in content.values():
            if isinstance(item, type) and issubclass(item, Effect) and item.__module__ == content["__name__"]:
                if item is Effect:
                    continue
                if item.family not in FAMILIES:
                    raise ValueError(f"{item.__module__}.{item.__name__}: family is one of {', '.join(FAMILIES)}")
                found.append(item)
    return tuple(sorted(found, key=lambda kind: FAMILIES.index(kind.family)))
