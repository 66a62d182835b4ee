"""Calls hooks from compiled loops through their addresses, so that one compiled loop serves every set of effects."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from models.compiled import inlined
from models.effects.base import Effect, Place

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

READING, CONTROL, COMMAND, THRUST, PATH, LIMIT, FRICTION, FORCE = (int(place) for place in Place)

_VECTOR: Final = types.float64[::1]
_SIGNATURE: Final = types.float64(types.float64, _VECTOR, _VECTOR, _VECTOR, types.float64[:, ::1])
_COMPILED: Final = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]


class Hooks(NamedTuple):
    """The hooks of H effects as the loops read them; those at place i are first[i] .. first[i + 1]."""

    law: Any  # (H,) addresses, or the functions themselves where nothing is compiled
    first: Integers  # (9,)
    span: Integers  # (H, 4) each one's part of `parameters` and of `memory`: from, to, from, to
    parameters: Array
    memory: Array


def pack(effects: Sequence[Effect], elements: int) -> Hooks:
    """The hooks of these effects, one after another in this order, their memory at zero; SI."""
    values = [effect.values() for effect in effects]
    sizes = [effect.memory(elements) for effect in effects]
    ends = np.concatenate([[0], np.cumsum([v.size for v in values])]).astype(np.int64)
    memory = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    laws, span, first = [], [], [0]
    for place in Place:
        for i, effect in enumerate(effects):
            if place in effect.hooks:
                laws.append(_address(effect.hooks[place]))
                span.append((ends[i], ends[i + 1], memory[i], memory[i + 1]))
        first.append(len(laws))
    return Hooks(
        law=np.array(laws, np.int64) if _COMPILED else tuple(laws),
        first=np.array(first),
        span=np.array(span, np.int64).reshape(-1, 4),
        parameters=np.concatenate([np.empty(0), *values]),
        memory=np.zeros(int(memory[-1])),
    )


@inlined
def act(place: int, value: float, hooks: Hooks, now: Array, contact: Array) -> float:
    """What the hooks at a place make of a value, one after another; units: Place, SI."""
    for j in range(hooks.first[place], hooks.first[place + 1]):
        value = call(
            hooks.law[j],
            value,
            hooks.parameters[hooks.span[j, 0] : hooks.span[j, 1]],
            now,
            hooks.memory[hooks.span[j, 2] : hooks.span[j, 3]],
            contact,
        )
    return value


@cache
def _address(law: Any) -> Any:
    """Where the compiled law stands in memory; its module keeps it there. Compiled, or read from disk, at first use."""
    if not _COMPILED:
        return law
    law.compile(_SIGNATURE.args)
    built = law.overloads[_SIGNATURE.args]
    if built.signature.return_type != types.float64:
        raise TypeError(
            f"{law.__module__}.{law.__name__}: a hook must return a float, not {built.signature.return_type}"
        )
    return built.library.get_pointer_to_function(built.fndesc.llvm_func_name)


@intrinsic
def _call_address(typing: Any, law: Any, value: Any, p: Any, now: Any, memory: Any, contact: Any) -> Any:  # noqa: ARG001
    """A call of the compiled function at the address `law`, as numba itself calls one of its functions."""

    def build(context: Any, builder: Any, _: Any, given: Any) -> Any:
        convention = context.call_conv
        kind = convention.get_function_type(_SIGNATURE.return_type, _SIGNATURE.args)
        function = builder.inttoptr(given[0], kind.as_pointer())
        _, result = convention.call_function(builder, function, _SIGNATURE.return_type, _SIGNATURE.args, given[1:])
        return result

    return types.float64(types.int64, *_SIGNATURE.args), build


def _call_python(law: Any, *given: Any) -> Any:
    return law(*given)


call: Any = _call_address if _COMPILED else _call_python
