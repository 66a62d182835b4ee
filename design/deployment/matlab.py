"""The law as a MATLAB function, translated from its structured text, so that its operations are written down once.

Only what MATLAB and Octave have in common is used. A variable of the function block becomes a field of `law`, a
constant one of `law.coefficients`, both under the name that they have there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Final

from design.deployment.structured_text import Unit, Variable, law_unit
from design.deployment.templating import filled
from design.deployment.vectors import Vectors
from models.deployment.coefficients import Coefficients

RENAMED: Final = {"nStatus": "status", "fThrust": "thrust"}  # what a caller looks for
SIGNS: Final = {":=": "=", "=": "==", "<>": "~=", "[": "(1 + ", "]": ")"}
WORDS: Final = {"AND": "&&", "OR": "||", "NOT": "~", "TRUE": "true", "FALSE": "false", "DINT_TO_LREAL": ""}
TOKEN: Final = re.compile(r"\d+\.\d+(?:E[+-]?\d+)?|\d+|[A-Za-z_]\w*|:=|<>|<=|>=|.")
MODULO: Final = re.compile(r"(\([^()]*\)|\w+) MOD (\([^()]*\)|\w+)")
PATTERNS: Final = (
    (re.compile(r"\(\* (.*) \*\)"), "% {}"),
    (re.compile(r"IF (.*) THEN"), "if {}"),
    (re.compile(r"ELSIF (.*) THEN"), "elseif {}"),
    (re.compile(r"ELSE()"), "else{}"),
    (re.compile(r"FOR (.*) DO"), "for {}"),
    (re.compile(r"END_(?:IF|FOR)();"), "end{}"),
    (re.compile(r"([^:]+ := .*);"), "{};"),
)


def matlab_files(known: Coefficients, origin: str) -> dict[str, str]:
    """The functions by file name; coefficients in SI units. origin: of the law, for a comment."""
    unit = law_unit(known)
    constants = {one.name: _value(one) for one in unit.variables if one.section == "VAR CONSTANT"}
    memory = {
        RENAMED.get(one.name, one.name): _value(one)
        for one in unit.variables
        if one.section in {"VAR", "VAR_OUTPUT"} and not _is_counter(one)
    }
    law = filled(
        "axis_law.m.j2",
        repr,
        origin=origin,
        learns=known.learning is not None,
        constants=constants,
        memory=memory,
        body="\n".join(statements(unit)),
    )
    return {"axis_law.m": law, **{f"{name}.m": filled(f"{name}.m.j2", repr) for name in ("axis_check", "axis_replay")}}


def vectors_csv(vectors: Vectors) -> str:
    """The vectors as CSV for any program: see the head for what is asked and in which unit [m], [N]."""
    head = (
        "asked (0 step; 1 reset; 2 wipe; 3 plan; 4 learn; 5 init),target_m (reset: position_m),"
        "position_m (reset: thrust_N),thrust_N,status"
    )
    return "\n".join([head, *(",".join(map(_readable, row)) for row in vectors.rows())]) + "\n"


def statements(unit: Unit) -> Iterator[str]:
    """The lines of the unit's body in MATLAB. Raises ValueError for a line that is not one statement of the subset."""
    scopes = {one.name: _scope(one) for one in unit.variables}

    def word(token: str) -> str:
        return scopes.get(token, "") + RENAMED.get(token, token)

    depth = 0
    for line in map(str.strip, unit.body.splitlines()):
        depth -= line.startswith(("END_", "ELS"))
        yield "    " * depth + _translated(line, word) if line else ""
        depth += line.startswith(("IF ", "FOR ", "ELS"))


def _scope(one: Variable) -> str:
    """What stands before a variable's name: inputs and counters are variables of the function itself."""
    if one.section == "VAR_INPUT" or _is_counter(one):
        return ""
    return "k." if one.section == "VAR CONSTANT" else "law."


def _is_counter(one: Variable) -> bool:
    """Whether it counts within one call only; MATLAB's `for` takes no field of a struct."""
    return len(one.name) == 1


def _translated(line: str, word: Callable[[str], str]) -> str:
    for pattern, matlab in PATTERNS:
        found = pattern.fullmatch(line)
        if found and line.startswith("(*"):
            return matlab.format(found[1])
        if found:
            return matlab.format(_expression(found[1], word))
    raise ValueError(f"{line!r} is not a statement that can be written in MATLAB")


def _expression(text: str, word: Callable[[str], str]) -> str:
    """An expression, an assignment or the range of a FOR."""
    ranged = re.fullmatch(r"(\w) := (.*) TO (.*)", text)
    if ranged:
        return f"{ranged[1]} = {_expression(ranged[2], word)}:{_expression(ranged[3], word)}"
    tokens = TOKEN.findall(MODULO.sub(r"mod(\1, \2)", text))
    return "".join(SIGNS.get(one, WORDS[one] if one in WORDS else word(one)) for one in tokens).replace("~ ", "~")


def _value(one: Variable) -> str:
    """The initial value; what has none begins at 0."""
    values = [{"TRUE": "true", "FALSE": "false"}.get(value, value) for value in one.values]
    if one.count is None:
        return values[0] if values else "false" if one.kind == "BOOL" else "0"
    return f"[{', '.join(values)}]" if values else f"zeros(1, {one.count})"


def _readable(number: float) -> str:
    """A number as both MATLAB and others read it."""
    if math.isfinite(number):
        return repr(number)
    return "NaN" if math.isnan(number) else "Inf" if number > 0 else "-Inf"
