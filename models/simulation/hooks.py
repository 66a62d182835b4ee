"""Calls hooks from compiled loops through their addresses, so that one compiled loop serves every set of effects."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
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
        value = call(hooks.law[j], value, hooks.span[j], hooks.parameters, now, hooks.memory, contact)
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
def _call_address(
    typing: Any,  # noqa: ARG001
    law: Any,  # noqa: ARG001
    value: Any,  # noqa: ARG001
    span: Any,
    parameters: Any,
    now: Any,
    memory: Any,
    contact: Any,
) -> Any:
    """A call of the compiled function at the address `law`, as numba itself calls one of its functions.

    The arrays are lent: to count their holders, as the slices of a compiled function do, takes longer than a short law.
    Raises TypingError where the arrays are not those that a law is compiled for.
    """
    if (parameters, now, memory, contact) != _SIGNATURE.args[1:] or span != types.int64[::1]:
        raise TypingError(f"a law takes {_SIGNATURE.args[1:]}, not {(parameters, now, memory, contact)}")

    def build(context: Any, builder: Any, _: Any, given: Any) -> Any:
        address, before, spans, *arrays = given
        ends = make_array(span)(context, builder, spans).data
        ends = [builder.load(builder.gep(ends, [context.get_constant(types.intp, i)])) for i in range(4)]

        def lent(array: Any, kind: Any, part: Any) -> Any:
            whole, view = make_array(kind)(context, builder, array), make_array(kind)(context, builder)
            data, shape = whole.data, whole.shape
            if part:
                data, shape = builder.gep(data, part[:1]), [builder.sub(part[1], part[0])]
            populate_array(view, data, shape, whole.strides, whole.itemsize, meminfo=None)
            return view._getvalue()

        kinds, parts = (parameters, now, memory, contact), (ends[:2], None, ends[2:], None)
        convention = context.call_conv
        kind = convention.get_function_type(_SIGNATURE.return_type, _SIGNATURE.args)
        _, result = convention.call_function(
            builder,
            builder.inttoptr(address, kind.as_pointer()),
            _SIGNATURE.return_type,
            _SIGNATURE.args,
            [before, *map(lent, arrays, kinds, parts)],
        )
        return result

    return types.float64(types.int64, types.float64, span, parameters, now, memory, contact), build


def _call_python(
    law: Any, value: float, span: Integers, parameters: Array, now: Array, memory: Array, contact: Array
) -> Any:
    return law(value, parameters[span[0] : span[1]], now, memory[span[2] : span[3]], contact)


call: Any = _call_address if _COMPILED else _call_python
