"""Every effect that there is, found in the modules of this package: one's own is one more file in its folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from typing import Any, ClassVar, Final, TypeVar, cast

import models.effects
from models.effects.base import FAMILIES, Effect, parameters
from models.quantity import declaration, value

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
class Sizes:
    """What sizes an effect may have in one machine, in place of its usual ones: each field a parameter's least and most
    [SI], whatever its sign, or None. A subclass for every effect: `sizes`. Raises ValueError for what is no range."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        """That there is a range, and each is one."""
        stated = {one.name: ends for one in fields(self) if (ends := getattr(self, one.name)) is not None}
        for name, ends in stated.items():
            if len(ends) != 2 or not 0 < ends[0] < ends[1]:
                raise ValueError(f"{name}: is no range; give its least and its most, the least above 0")
        if not stated:
            raise ValueError(f"has no range; give the least and the most of {fields(self)[0].name}, say")


Own = TypeVar("Own", Effect, Sizes)


@cache
def sizes(kind: type[Effect]) -> type[Sizes]:
    """The class of what a machine may state of an effect's sizes, its fields in SI."""
    rows: list[tuple[str, Any, Any]] = []
    for declared, item in zip(fields(kind), parameters(kind), strict=True):
        if item.role in SIZES:
            below = getattr(declaration(declared), "below", None)
            stated = value(item.unit, f"least and most of: {item.meaning}", below=below, default=None)
            rows.append((item.name, tuple[float, ...], stated))
    own = {
        "name": kind.name,
        "__module__": __name__,
        "__reduce__": lambda self: (_sizes_again, (kind, *(getattr(self, name) for name, *_ in rows))),
    }
    return cast(type[Sizes], make_dataclass(f"{kind.__name__}Sizes", rows, bases=(Sizes,), frozen=True, namespace=own))


def looked_for(priors: Iterable[Sizes] = ()) -> Mapping[str, type[Effect]]:
    """The effects by name that a diagnosis of one machine looks for, in their order: the usual ones and those of which
    it states sizes, with these; SI."""
    stated = {one.name: one for one in priors}
    return {name: ranged(kind, stated.get(name)) for name, kind in every().items() if kind.usual or name in stated}


@cache
def ranged(kind: type[Effect], stated: Sizes | None) -> type[Effect]:
    """The effect with its prior ranges as a machine states them, SI; the class itself where it states none."""
    changed: list[tuple[str, Any, Any]] = []
    for declared, usual in zip(fields(kind), parameters(kind), strict=True):
        ends = getattr(stated, usual.name, None)
        if ends is None:
            continue
        low, high = ends
        prior = (usual.role, -high if usual.low < 0 else low, high, (low * high) ** 0.5)
        changed.append((usual.name, declared.type, field(metadata={**declared.metadata, "prior": prior})))
    if not changed:
        return kind
    own = {
        "__doc__": kind.__doc__,
        "__module__": kind.__module__,
        "__reduce__": lambda self: (_effect_again, (kind, stated, *self.values())),
        "period_stated": kind.period_field in {name for name, *_ in changed},
    }
    return cast(type[Effect], make_dataclass(kind.__name__, changed, bases=(kind,), frozen=True, namespace=own))


def _sizes_again(kind: type[Effect], *ranges: tuple[float, ...] | None) -> Sizes:
    """What `pickle` makes of Sizes in another process, where their class has to be made first."""
    return sizes(kind)(*ranges)


def _effect_again(kind: type[Effect], stated: Sizes, *numbers: float) -> Effect:
    """The same for an effect with stated sizes."""
    return ranged(kind, stated)(*numbers)


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


def named(effects: Iterable[Own]) -> Mapping[str, Own]:
    """The effects, or what a machine states of them, by name as in a machine file's paths: "cogging", or "cogging.1"
    and "cogging.2" of two."""
    members: dict[str, list[Own]] = {}
    for effect in effects:
        members.setdefault(effect.name, []).append(effect)
    paths: dict[str, Own] = {}
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
