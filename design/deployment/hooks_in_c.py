"""Turns an effect's hooks, Python functions of one signature (models/effects/base.py), into C.

What a hook may be made of: assignments, `if`, `for` over a range, `return`, arithmetic, comparisons, `math`, `min`,
`max`, `abs` and `int`, numbers of its module, and the entries of its arguments. So an effect of one's own is translated
like those of the catalogue, and what goes beyond is refused by name.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from design.deployment.templating import hexadecimal
from models.effects.base import Hook

SIGNS: Final[Mapping[type[ast.operator], str]] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "/",
    ast.Mod: "%",
    ast.BitAnd: "&",
    ast.BitXor: "^",
    ast.BitOr: "|",
    ast.RShift: ">>",
    ast.LShift: "<<",
}
COMPARED: Final[Mapping[type[ast.cmpop], str]] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
MATHS: Final = frozenset(
    {
        *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "expm1"),
        *("log", "log1p", "log10", "sqrt", "floor", "ceil", "fabs", "hypot", "pow"),
    }
)
TWO: Final = {"max": "larger", "min": "smaller"}


class HookError(ValueError):
    """A hook that cannot be turned into C; the message says what it is made of that is not known here."""


@dataclass(frozen=True)
class Text:
    """An expression in C, and whether it is a whole number."""

    text: str
    whole: bool = False


def in_c(name: str, hook: Hook, memory: int) -> str:
    """The hook as a C function of this name, for an effect that keeps so many numbers [-]. Raises HookError."""
    function: Any = getattr(hook, "py_func", hook)
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    translation = _Translation(function.__globals__, memory, f"{function.__module__}.{function.__name__}")
    lines = translation.block(tree.body, 1)
    declared = [f"    {'long long' if whole else 'double'} {one};" for one, whole in translation.variables.items()]
    head = (
        f"static double {name}(double value, const double *p, const double *now, double *memory, element_row *contact)"
    )
    unused = "    (void)p; (void)now; (void)memory; (void)contact;"
    return "\n".join([head, "{", *declared, unused, *lines, "}"]) + "\n"


@dataclass
class _Translation:
    known: Mapping[str, Any]
    memory: int
    where: str
    variables: dict[str, bool] = field(default_factory=dict)

    def refuse(self, node: ast.AST) -> HookError:
        return HookError(f"{self.where}: {ast.unparse(node)!r} has no translation into C; write it in simpler terms")

    def block(self, statements: Sequence[ast.stmt], depth: int) -> list[str]:
        return [line for one in statements for line in self.statement(one, "    " * depth, depth)]

    def statement(self, node: ast.stmt, pad: str, depth: int) -> list[str]:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return []  # a docstring
        if isinstance(node, ast.Return) and node.value is not None:
            return [f"{pad}return {self.value(node.value).text};"]
        if isinstance(node, ast.AugAssign):
            whole = ast.BinOp(node.target, node.op, node.value)
            return [f"{pad}{self.place(node.target, self.value(whole))} = {self.value(whole).text};"]
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            return self.assignment(node.targets[0], node.value, pad)
        if isinstance(node, ast.If):
            lines = [f"{pad}if ({self.value(node.test).text}) {{", *self.block(node.body, depth + 1)]
            return [*lines, f"{pad}}} else {{", *self.block(node.orelse, depth + 1), f"{pad}}}"]
        if isinstance(node, ast.For):
            return self.loop(node, pad, depth)
        raise self.refuse(node)

    def assignment(self, target: ast.expr, value: ast.expr, pad: str) -> list[str]:
        if not isinstance(target, ast.Tuple):
            made = self.value(value)
            return [f"{pad}{self.place(target, made)} = {made.text};"]
        if not isinstance(value, ast.Tuple) or len(value.elts) != len(target.elts):
            raise self.refuse(value)
        made_all = [self.value(one) for one in value.elts]  # all are computed before any is assigned
        kinds = ["long long" if one.whole else "double" for one in made_all]
        lines = [f"{pad}{{"]
        lines += [
            f"{pad}    {kind} now_{i} = {one.text};" for i, (kind, one) in enumerate(zip(kinds, made_all, strict=True))
        ]
        for i, (one, made) in enumerate(zip(target.elts, made_all, strict=True)):
            lines.append(f"{pad}    {self.place(one, made)} = now_{i};")
        return [*lines, f"{pad}}}"]

    def loop(self, node: ast.For, pad: str, depth: int) -> list[str]:
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise self.refuse(node.iter)
        ends = [self.value(one).text for one in call.args]
        if len(ends) not in {1, 2} or not isinstance(node.target, ast.Name):
            raise self.refuse(node.iter)
        first, last = ends if len(ends) == 2 else ("0", ends[0])
        counter = self.place(node.target, Text("0", whole=True))
        head = f"{pad}for ({counter} = {first}; {counter} < {last}; {counter}++) {{"
        return [head, *self.block(node.body, depth + 1), f"{pad}}}"]

    def place(self, node: ast.expr, value: Text) -> str:
        if isinstance(node, ast.Name):
            name = f"v_{node.id}"
            self.variables[name] = self.variables.get(name, True) and value.whole
            return name
        return self.value(node).text

    def value(self, node: ast.expr) -> Text:
        """An expression."""
        kinds = {
            ast.Constant: self.constant,
            ast.Name: self.name,
            ast.Subscript: self.entry,
            ast.Attribute: self.attribute,
            ast.BinOp: self.operation,
            ast.UnaryOp: self.unary,
            ast.Compare: self.comparison,
            ast.BoolOp: self.logic,
            ast.IfExp: self.choice,
            ast.Call: self.call,
        }
        if type(node) not in kinds:
            raise self.refuse(node)
        translated: Text = kinds[type(node)](node)  # type: ignore[operator]
        return translated

    def constant(self, node: ast.Constant) -> Text:
        return self.number(node.value, node)

    def number(self, value: object, node: ast.expr) -> Text:
        if isinstance(value, bool | int):
            return Text(f"{int(value)}LL", whole=True)
        if isinstance(value, float):
            return Text(f"({hexadecimal(value)})")
        raise self.refuse(node)

    def name(self, node: ast.Name) -> Text:
        if f"v_{node.id}" in self.variables:
            return Text(f"v_{node.id}", self.variables[f"v_{node.id}"])
        if node.id == "value":
            return Text("value")
        return self.number(self.known.get(node.id), node)

    def entry(self, node: ast.Subscript) -> Text:
        if not (isinstance(node.value, ast.Name) and node.value.id in {"p", "now", "memory", "contact"}):
            raise self.refuse(node)
        at = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        return Text(node.value.id + "".join(f"[{self.value(one).text}]" for one in at))

    def attribute(self, node: ast.Attribute) -> Text:
        if isinstance(node.value, ast.Name) and (node.value.id, node.attr) == ("memory", "size"):
            return Text(f"{self.memory}LL", whole=True)
        if isinstance(node.value, ast.Name) and (node.value.id, node.attr) == ("math", "pi"):
            return Text("(0x1.921fb54442d18p+1)")
        raise self.refuse(node)

    def operation(self, node: ast.BinOp) -> Text:
        one, two = self.value(node.left), self.value(node.right)
        whole = one.whole and two.whole
        if isinstance(node.op, ast.Pow):
            if isinstance(node.right, ast.Constant) and node.right.value == 2:
                return Text(f"square({one.text})")
            return Text(f"pow({one.text}, {two.text})")
        if type(node.op) not in SIGNS or (isinstance(node.op, ast.FloorDiv | ast.Mod) and not whole):
            raise self.refuse(node)
        if isinstance(node.op, ast.Div) and whole:
            one, whole = Text(f"(double){one.text}"), False
        return Text(f"({one.text} {SIGNS[type(node.op)]} {two.text})", whole)

    def unary(self, node: ast.UnaryOp) -> Text:
        one = self.value(node.operand)
        if isinstance(node.op, ast.USub):
            return Text(f"(-{one.text})", one.whole)
        if isinstance(node.op, ast.Not):
            return Text(f"(!{one.text})", whole=True)
        raise self.refuse(node)

    def comparison(self, node: ast.Compare) -> Text:
        terms = [self.value(one).text for one in (node.left, *node.comparators)]
        if any(type(one) not in COMPARED for one in node.ops):
            raise self.refuse(node)
        pairs = zip(terms[:-1], node.ops, terms[1:], strict=True)
        return Text("(" + " && ".join(f"{a} {COMPARED[type(op)]} {b}" for a, op, b in pairs) + ")", whole=True)

    def logic(self, node: ast.BoolOp) -> Text:
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return Text("(" + sign.join(self.value(one).text for one in node.values) + ")", whole=True)

    def choice(self, node: ast.IfExp) -> Text:
        test, one, two = self.value(node.test), self.value(node.body), self.value(node.orelse)
        return Text(f"({test.text} ? {one.text} : {two.text})", one.whole and two.whole)

    def call(self, node: ast.Call) -> Text:
        given = [self.value(one) for one in node.args]
        texts = [one.text for one in given]
        if isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            if node.func.value.id == "math" and node.func.attr in MATHS:
                return Text(f"{node.func.attr}({', '.join(texts)})")
        elif isinstance(node.func, ast.Name):
            name = node.func.id
            if name in TWO and len(texts) == 2:
                return Text(f"{TWO[name]}({texts[0]}, {texts[1]})")
            if name == "abs" and len(texts) == 1:
                return Text(f"fabs({texts[0]})")
            if name in {"int", "float"} and len(texts) == 1:
                kind = "long long" if name == "int" else "double"
                return Text(f"(({kind}){texts[0]})", whole=name == "int")
        raise self.refuse(node)
