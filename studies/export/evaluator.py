"""Runs structured text: the subset of IEC 61131-3 that the export emits, read from the files as a PLC would get them.

It shares nothing with what writes the text. The text becomes Python: LREAL is a float, so that every operation rounds
as IEEE 754 says, and DINT an int. Statements: assignment, IF, FOR, and the call of an instance; types: LREAL, DINT,
BOOL, one-dimensional arrays, and function blocks that are known by then.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final
from xml.etree import ElementTree

TOKEN: Final = re.compile(
    r"\s+|\(\*.*?\*\)|(?P<number>\d+\.\d+(?:[eE][+-]?\d+)?|\d+)|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>:=|<>|<=|>=|\.\.|[-+*/()\[\];:,.=<>])",
    re.DOTALL,
)
CONVERSIONS: Final = {"DINT_TO_LREAL": "float"}
BINARY: Final = (
    {"OR": " or "},
    {"AND": " and "},
    {"=": " == ", "<>": " != ", "<": " < ", ">": " > ", "<=": " <= ", ">=": " >= "},
    {"+": " + ", "-": " - "},
    {"*": " * ", "/": " / ", "MOD": " % "},
)
"""Operators from the weakest to the strongest, with Python's sign; `%` only meets what is positive."""


class TextError(ValueError):
    """Structured text that is not of the subset; the message says what stands where something else was expected."""


@dataclass
class Instance:
    """A running instance of a unit: its variables by name, and its body."""

    kind: str
    values: dict[str, Any]
    body: Callable[[dict[str, Any]], None]

    def call(self, **inputs: Any) -> None:
        """Sets inputs, each of which the unit must have, and runs the body once."""
        unknown = inputs.keys() - self.values.keys()
        if unknown:
            raise TextError(f"{self.kind} has no {', '.join(sorted(unknown))}")
        self.values.update(inputs)
        self.body(self.values)


@dataclass
class Library:
    """The units that have been read, by name."""

    units: dict[str, Callable[[], Instance]] = field(default_factory=dict)

    def add_twincat(self, text: str) -> str:
        """Reads a .TcPOU; the unit's name."""
        root = ElementTree.fromstring(text)
        body = "".join(root.find("POU/Implementation/ST").itertext())  # type: ignore[union-attr]
        return self._add(str(root.findtext("POU/Declaration")), body)

    def add_plcopen(self, text: str) -> list[str]:
        """Reads all units of a PLCopen XML; their names."""
        return [self._add(_head(pou), _body(pou)) for pou in ElementTree.fromstring(text).iter(f"{TC6}pou")]

    def make(self, name: str) -> Instance:
        """A new instance of a unit, its variables at their initial values."""
        return self.units[name]()

    def _add(self, declaration: str, body: str) -> str:
        head = Parser(declaration)
        kind, name = head.take(), head.take()
        if kind not in {"FUNCTION_BLOCK", "PROGRAM"}:
            raise TextError(f"{kind} {name}: only function blocks and programs are run")
        makers = dict(head.declarations(self))
        parser = Parser(body)
        lines = parser.statements(makers.keys(), 1, end=())
        source = "def body(v):\n" + "\n".join(lines or ["    pass"])
        space: dict[str, Any] = {}
        built = compile(source, name, "exec")  # of this evaluator's own translation
        exec(built, {"__builtins__": {"float": float, "range": range}}, space)
        self.units[name] = lambda: Instance(name, {one: make() for one, make in makers.items()}, space["body"])
        return name


TC6: Final = "{http://www.plcopen.org/xml/tc6_0201}"


def _head(pou: ElementTree.Element) -> str:
    """A declaration as text, from a pou's interface."""
    kind = {"functionBlock": "FUNCTION_BLOCK", "program": "PROGRAM"}[pou.attrib["pouType"]]
    lines = [f"{kind} {pou.attrib['name']}", "VAR"]
    for variable in pou.iter(f"{TC6}variable"):
        type_of = variable.find(f"{TC6}type")
        assert type_of is not None
        array, shown = type_of.find(f"{TC6}array"), ""
        base = type_of[0] if array is None else array.find(f"{TC6}baseType")[0]  # type: ignore[index]
        name = base.attrib.get("name") or base.tag.removeprefix(TC6)
        if array is not None:
            dimension = array.find(f"{TC6}dimension")
            assert dimension is not None
            shown = f"ARRAY[{dimension.attrib['lower']}..{dimension.attrib['upper']}] OF "
        values = [one.attrib["value"] for one in variable.iter(f"{TC6}simpleValue")]
        initial = "" if not values else " := " + (values[0] if array is None else f"[{', '.join(values)}]")
        lines.append(f"{variable.attrib['name']} : {shown}{name}{initial};")
    return "\n".join([*lines, "END_VAR"])


def _body(pou: ElementTree.Element) -> str:
    return "".join(pou.find(f"{TC6}body/{TC6}ST").itertext())  # type: ignore[union-attr]


class Parser:
    """Reads tokens one after the other."""

    def __init__(self, text: str) -> None:
        """Splits the text. Raises TextError for a character that begins no token."""
        self._tokens, at = list[str](), 0
        while at < len(text):
            match = TOKEN.match(text, at)
            if match is None:
                raise TextError(f"{text[at : at + 20]!r} is not a token")
            if match.lastgroup:
                self._tokens.append(match.group())
            at = match.end()
        self._at = 0

    def peek(self) -> str:
        """The next token; empty at the end."""
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def take(self, *expected: str) -> str:
        """The next token, which must be one of those expected, if any are."""
        token = self.peek()
        if expected and token not in expected:
            raise TextError(f"{token!r} stands where {' or '.join(expected)} is expected")
        self._at += 1
        return token

    def declarations(self, library: Library) -> Iterator[tuple[str, Callable[[], Any]]]:
        """The variables of all sections, each with what makes its initial value."""
        while self.peek():
            self.take("VAR", "VAR_INPUT", "VAR_OUTPUT")
            if self.peek() == "CONSTANT":
                self.take()
            while self.peek() != "END_VAR":
                name = self.take()
                self.take(":")
                yield name, self._initial(library)
                self.take(";")
            self.take("END_VAR")

    def _initial(self, library: Library) -> Callable[[], Any]:
        count = 0
        if self.peek() == "ARRAY":
            for token in ("ARRAY", "[", "0", ".."):
                self.take(token)
            count = int(self.take()) + 1
            for token in ("]", "OF"):
                self.take(token)
        kind = self.take()
        if kind in library.units:
            return library.units[kind]
        zero: Mapping[str, Any] = {"LREAL": 0.0, "DINT": 0, "BOOL": False}
        if kind not in zero:
            raise TextError(f"{kind} is not a known type")
        convert = type(zero[kind])
        if self.peek() != ":=":
            return (lambda: [zero[kind]] * count) if count else (lambda: zero[kind])
        self.take(":=")
        if not count:
            value = convert(self._literal())
            return lambda: value
        values = [convert(self._literal()) for _ in range(count) if self.take("[", ",")]
        self.take("]")
        return lambda: list(values)

    def _literal(self) -> float:
        sign = -1 if self.peek() == "-" and self.take() else 1
        text = self.take()
        return sign * (float(text) if "." in text else int(text))

    def statements(self, names: Any, depth: int, end: tuple[str, ...]) -> list[str]:
        """Lines of Python of the statements up to one of the words `end`, which stays."""
        pad, lines = "    " * depth, list[str]()
        while self.peek() not in end and self.peek():
            word = self.peek()
            if word == "IF":
                lines += self._choice(names, depth)
            elif word == "FOR":
                lines += self._loop(names, depth)
            else:
                lines.append(pad + self._simple(names))
        return lines

    def _choice(self, names: Any, depth: int) -> list[str]:
        pad, lines, word = "    " * depth, list[str](), "if"
        while self.peek() in {"IF", "ELSIF"}:
            self.take()
            lines.append(f"{pad}{word} {self.expression(names)}:")
            self.take("THEN")
            lines += self.statements(names, depth + 1, ("ELSIF", "ELSE", "END_IF"))
            word = "elif"
        if self.peek() == "ELSE":
            self.take()
            lines += [f"{pad}else:", *self.statements(names, depth + 1, ("END_IF",))]
        self.take("END_IF")
        self.take(";")
        return lines

    def _loop(self, names: Any, depth: int) -> list[str]:
        self.take("FOR")
        counter = self._place(names)
        self.take(":=")
        first = self.expression(names)
        self.take("TO")
        last = self.expression(names)
        self.take("DO")
        lines = self.statements(names, depth + 1, ("END_FOR",))
        self.take("END_FOR")
        self.take(";")
        return [f"{'    ' * depth}for {counter} in range({first}, {last} + 1):", *lines]

    def _simple(self, names: Any) -> str:
        place = self._place(names)
        if self.peek() == "(":
            self.take("(")
            inputs = []
            while self.peek() != ")":
                name = self.take()
                self.take(":=")
                inputs.append(f"{name}={self.expression(names)}")
                if self.peek() == ",":
                    self.take()
            self.take(")")
            self.take(";")
            return f"{place}.call({', '.join(inputs)})"
        self.take(":=")
        value = self.expression(names)
        self.take(";")
        return f"{place} = {value}"

    def _place(self, names: Any) -> str:
        """A variable, an array's entry, or an instance's variable."""
        name = self.take()
        if name not in names:
            raise TextError(f"{name!r} is not declared")
        text = f"v[{name!r}]"
        if self.peek() == "[":
            self.take()
            text += f"[{self.expression(names)}]"
            self.take("]")
        if self.peek() == ".":
            self.take()
            text += f".values[{self.take()!r}]"
        return text

    def expression(self, names: Any, level: int = 0) -> str:
        """An expression as Python, in brackets as the levels of the operators say."""
        if level == len(BINARY):
            return self._operand(names)
        text = self.expression(names, level + 1)
        while self.peek() in BINARY[level]:
            sign = BINARY[level][self.take()]
            text = f"({text}{sign}{self.expression(names, level + 1)})"
        return text

    def _operand(self, names: Any) -> str:
        token = self.peek()
        if token in {"-", "NOT"}:
            self.take()
            return f"({'-' if token == '-' else 'not '}{self._operand(names)})"
        if token == "(":
            self.take()
            text = self.expression(names)
            self.take(")")
            return f"({text})"
        if token in CONVERSIONS:
            self.take()
            self.take("(")
            text = self.expression(names)
            self.take(")")
            return f"{CONVERSIONS[token]}({text})"
        if token in {"TRUE", "FALSE"}:
            return self.take().capitalize()
        if token[:1].isdigit():
            return self.take()
        return self._place(names)
