"""Every effect that there is, found in the modules of this package: one's own is one more file in its folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from typing import Final, cast

import models.effects
from models.effects.base import FAMILIES, Effect, parameters

MANY: Final = 0.03  # 1/m; times a period's least length, the step of its fits: through a metre they stay in phase
PERIODS: Final = ("pitch", "length")
SIZES: Final = ("amplitude", "shape", "width")  # roles whose range a machine may state


def every() -> Mapping[str, type[Effect]]:
    """The effects by name, in the order in which they act: by family, module and place in the module."""
    found: dict[str, type[Effect]] = {}
    for kind in _kinds(tuple(models.effects.__path__)):
        if kind.name in found:
            other = found[kind.name].__module__
            raise ValueError(f"{kind.__module__}: the effect {kind.name!r} is in {other} already; name it otherwise")
        found[kind.name] = kind
    return found


@dataclass(frozen=True)
class Prior:
    """The sizes, from low to high [SI] but for their sign, that a parameter of an effect may have in one machine."""

    effect: str
    parameter: str
    low: float
    high: float


def looked_for(priors: Iterable[Prior] = ()) -> Mapping[str, type[Effect]]:
    """The effects by name that a diagnosis of one machine looks for, in their order: the usual ones and those of which
    it states sizes, with these; SI."""
    stated = tuple(priors)
    wanted = {prior.effect for prior in stated}
    return {name: ranged(kind, stated) for name, kind in every().items() if kind.usual or name in wanted}


def ranged(kind: type[Effect], priors: Iterable[Prior]) -> type[Effect]:
    """The class of an effect with other prior ranges: those of its name in `priors`, SI. The same class every time."""
    own = tuple(prior for prior in priors if prior.effect == kind.name)
    return _ranged(kind, own) if own else kind


@cache
def _ranged(kind: type[Effect], own: tuple[Prior, ...]) -> type[Effect]:
    stated, changed, fine = {prior.parameter: prior for prior in own}, [], kind.fine
    for declared, usual in zip(fields(kind), parameters(kind), strict=True):
        if usual.name not in stated:
            continue
        low, high = stated[usual.name].low, stated[usual.name].high
        prior = (usual.role, -high if usual.low < 0 else low, high, (low * high) ** 0.5)
        changed.append((usual.name, declared.type, field(metadata={**declared.metadata, "prior": prior})))
        if usual.name in PERIODS and low < usual.low:
            fine = MANY * low
    same = {"__doc__": kind.__doc__, "fine": fine}
    return cast(type[Effect], make_dataclass(kind.__name__, changed, bases=(kind,), frozen=True, namespace=same))


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects in the order in which they act."""
    order = {name: i for i, name in enumerate(every())}
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
