"""The law as IEC 61131-3 structured text: a function block and a test program, for TwinCAT and as PLCopen XML."""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

from design.deployment.templating import filled
from design.deployment.vectors import MISSING, Vectors
from models.deployment.coefficients import Coefficients
from models.deployment.learning_numbers import Learning
from models.deployment.learning_steps import MAX_STROKE_MISS, learning_numbers
from models.deployment.running_law import MAX_POSITION_M, RESET

SECTIONS: Final = {
    "VAR_INPUT": "inputVars",
    "VAR_OUTPUT": "outputVars",
    "VAR": "localVars",
    "VAR CONSTANT": "localVars",
}
UUID_NAMESPACE: Final = uuid.UUID("5f2d1f6e-6d0e-4c59-8e5f-0a8e5f3f0c11")
STATE: Final = (
    *("fR", "fX", "fY", "fQ", "fU", "fBase", "fStep", "fForce", "fCompensation", "fPlan", "fError", "fFeedback"),
    *("fWanted", "fExcess", "fHeld", "fS", "fWay", "fLateWay", "fLastTarget", "fLastReading", "fLastBase"),
    *("fGivenPosition", "fGivenThrust", "fLastMoved", "fZero", "fIntegral", "fSlope", "fLastError"),
)
LEARNED: Final = ("fLearnedForce", "fLearnedLength", "fLearnedOffset", "fLearnedMass", "fLearnedDeadTime")
LEARNING: Final = (
    *("fScale", "fStretch", "fGain", "fHold", "fDirection", "fByMass", "fByLate", "fAllMass", "fAllLate", "fAllThrust"),
    *("fOut", "fBack", "fAbout", "fRest", "fThere", "fHere", "fSum", "fSquare", "fProduct", "fSpread", "fAlong"),
    *("fTried", "fMissed", "fFewest", "fCount", "fBeyond", "fOff", "fGone"),
)
LEARNING_COUNTERS: Final = ("nRound", "nSince", "nCounted", "nChosen", "nFirst", "nLast", "nTaught", "m", "n")
COUNTERS: Final = ("i", "j", "nNewest", "nLate", "nSample", "nLateSample", "nShare", "nWiped", "nPlanned")


@dataclass(frozen=True)
class Variable:
    """A declaration: in a section, of an elementary type, an array where `count` is not None; its initial values."""

    section: str
    name: str
    kind: str
    count: int | None = None
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unit:
    """A program organisation unit: its name and kind ("FUNCTION_BLOCK" or "PROGRAM"), variables and body."""

    name: str
    kind: str
    variables: tuple[Variable, ...]
    body: str


def decimal(value: float) -> str:
    """A double (SI) as structured text writes an LREAL, in as many digits as it takes to be read without rounding."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{int(exponent)}" if exponent else "")


def structured_text(known: Coefficients, vectors: Vectors) -> dict[str, str]:
    """The files by name: .TcPOU for TwinCAT, and both units in one PLCopen XML; coefficients in SI units."""
    units = (law_unit(known), _check(vectors))
    files = {f"{unit.name}.TcPOU": twincat(unit) for unit in units}
    return {**files, "axis_law.xml": plcopen(units)}


def law_unit(known: Coefficients) -> Unit:
    """The law as a function block; coefficients in SI units."""
    start = min(max(known.start, -known.thrust_limit), known.thrust_limit)
    body = filled("law.st.j2", decimal, k=known, start=start)
    return Unit("FB_AxisLaw", "FUNCTION_BLOCK", (*_interface(), *_constants(known), *_memory(known)), body)


def twincat(unit: Unit) -> str:
    """The unit as TwinCAT 3 stores it."""
    identity = uuid.uuid5(UUID_NAMESPACE, unit.name)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<TcPlcObject Version="1.1.0.1" ProductVersion="3.1.4024.0">\n'
        f'  <POU Name="{unit.name}" Id="{{{identity}}}" SpecialFunc="None">\n'
        f"    <Declaration><![CDATA[{declaration(unit)}]]></Declaration>\n"
        f"    <Implementation>\n      <ST><![CDATA[{unit.body}]]></ST>\n    </Implementation>\n"
        "  </POU>\n</TcPlcObject>\n"
    )


def declaration(unit: Unit) -> str:
    """The unit's head and variables as text."""
    lines = [f"{unit.kind} {unit.name}"]
    for section in SECTIONS:
        chosen = [one for one in unit.variables if one.section == section]
        if chosen:
            lines += [section, *(f"    {_declared(one)}" for one in chosen), "END_VAR"]
    return "\n".join(lines) + "\n"


def plcopen(units: Sequence[Unit]) -> str:
    """The units as PLCopen XML TC6 2.01."""
    time = "2000-01-01T00:00:00"  # the format asks for one; equal inputs give equal files
    pous = "".join(_pou(unit) for unit in units)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<project xmlns="http://www.plcopen.org/xml/tc6_0201">\n'
        f'  <fileHeader companyName="" productName="positioning" productVersion="1" creationDateTime="{time}"/>\n'
        '  <contentHeader name="axis_law"><coordinateInfo><fbd><scaling x="1" y="1"/></fbd><ld><scaling x="1" y="1"/>'
        '</ld><sfc><scaling x="1" y="1"/></sfc></coordinateInfo></contentHeader>\n'
        f"  <types><dataTypes/><pous>\n{pous}  </pous></types>\n"
        "  <instances><configurations/></instances>\n</project>\n"
    )


def _declared(one: Variable) -> str:
    kind = one.kind if one.count is None else f"ARRAY[0..{one.count - 1}] OF {one.kind}"
    if not one.values:
        return f"{one.name} : {kind};"
    return f"{one.name} : {kind} := {one.values[0] if one.count is None else '[' + ', '.join(one.values) + ']'};"


def _pou(unit: Unit) -> str:
    kind = {"FUNCTION_BLOCK": "functionBlock", "PROGRAM": "program"}[unit.kind]
    sections = []
    for section, tag in SECTIONS.items():
        chosen = "".join(_variable(one) for one in unit.variables if one.section == section)
        constant = ' constant="true"' if section == "VAR CONSTANT" else ""
        sections.append(f"<{tag}{constant}>\n{chosen}</{tag}>\n" if chosen else "")
    return (
        f'<pou name="{unit.name}" pouType="{kind}">\n<interface>\n{"".join(sections)}</interface>\n'
        f'<body><ST><xhtml xmlns="http://www.w3.org/1999/xhtml">{escape(unit.body)}</xhtml></ST></body>\n</pou>\n'
    )


def _variable(one: Variable) -> str:
    elementary = one.kind in {"LREAL", "DINT", "BOOL"}
    kind = f"<{one.kind}/>" if elementary else f'<derived name="{one.kind}"/>'
    simple = [f'<simpleValue value="{value}"/>' for value in one.values]
    if one.count is not None:
        dimension = f'<dimension lower="0" upper="{one.count - 1}"/>'
        kind = f"<array>{dimension}<baseType>{kind}</baseType></array>"
        simple = (
            [f"<arrayValue>{''.join(f'<value>{value}</value>' for value in simple)}</arrayValue>"] if simple else []
        )
    initial = f"<initialValue>{simple[0]}</initialValue>" if simple else ""
    return f'<variable name="{one.name}"><type>{kind}</type>{initial}</variable>\n'


def _interface() -> Iterator[Variable]:
    yield Variable("VAR_INPUT", "nAsked", "DINT")
    for name in ("fTarget", "fPosition", "fStart"):
        yield Variable("VAR_INPUT", name, "LREAL")
    yield Variable("VAR_OUTPUT", "fThrust", "LREAL")
    yield Variable("VAR_OUTPUT", "nStatus", "DINT")


def _constants(known: Coefficients) -> Iterator[Variable]:
    pid, keep, ts = known.pid, known.pid.pole(known.sample_time), known.sample_time
    numbers = {"FAR": MAX_POSITION_M, "THRUST_LIMIT": known.thrust_limit}
    tables = {"POSITION": known.position, "PATH": known.path, "THRUST": known.thrust}
    counts = {"MEMORY_END": known.memory - 1, "STEP_END": len(known.position) - 1}
    if known.stiffness:
        tables |= {"STIFFNESS": known.stiffness, "LIMIT": known.limit}
        counts["ELEMENT_END"] = len(known.stiffness) - 1
    if known.law is None:
        numbers |= {"SAMPLE_TIME": ts, "KP": pid.kp, "KI_TS": pid.ki * ts, "KD": pid.kd}
        numbers |= {"KEEP": keep, "REST": 1.0 - keep, "TRACKING": known.tracking}
    else:
        law = known.law
        tables |= {"LAW_A": sum(law.a, ()), "LAW_B": tuple(row[0] for row in law.b), "LAW_C": law.c}
        tables |= {"HOLD": law.hold, "RESET": law.reset}
        numbers["LAW_D"] = law.d[0]
        counts["STATE_END"] = len(law.c) - 1
    if known.wipe is not None:
        numbers |= {"WIPE_DISTANCE": known.wipe.distance, "WIPE_AMPLITUDE": known.wipe.amplitude}
        counts |= {"WIPE_COUNT": known.wipe.count, "WIPE_HALF": known.wipe.count + known.wipe.still}
    if known.learning is not None:
        more, few, rows = _of_learning(known, known.learning)
        numbers, counts, tables = numbers | more, counts | few, tables | rows
    if known.plan:
        tables["PLAN"], counts["PLAN_END"] = known.plan, len(known.plan) - 1
    for name, number in numbers.items():
        yield Variable("VAR CONSTANT", f"K_{name}", "LREAL", None, (decimal(number),))
    for name, count in counts.items():
        yield Variable("VAR CONSTANT", f"K_{name}", "DINT", None, (str(count),))
    for name, row in tables.items():
        yield Variable("VAR CONSTANT", f"K_{name}", "LREAL", len(row), tuple(map(decimal, row)))


def _of_learning(
    known: Coefficients, learning: Learning
) -> tuple[dict[str, float], dict[str, int], dict[str, tuple[float, ...]]]:
    """Numbers, counts and tables of the learning."""
    given = learning_numbers(learning, known.stroke, len(known.position))
    numbers = {"STROKE": known.stroke, "SAME": MAX_STROKE_MISS, "LEAST_FORCE": learning.least}
    numbers |= {"FAULTLESS_MASS": learning.faultless[0], "FAULTLESS_LATE": learning.faultless[1]}
    numbers |= {"MOST_MASS": learning.most[0], "MOST_LATE": learning.most[1]}
    counts = {"LENGTH_END": len(learning.length) - 1, "NOMINAL": learning.nominal, "WINDOW": learning.window}
    counts |= {"ROUNDS": learning.rounds, "MOTIONS": learning.motions, "MOTION_REST": learning.rest}
    counts["LOOK"] = len(learning.mass)
    tables = {"LENGTH": learning.length, "STRETCH": learning.stretch, "BY_MASS": learning.mass}
    tables |= {"BY_LATE": learning.dead_time}
    tables |= {"EARLY": tuple(given.early.tolist()), "SOONER": tuple(given.sooner.tolist())}
    return numbers, counts, tables


def _memory(known: Coefficients) -> Iterator[Variable]:
    """The instance's variables; it begins as after a reset at 0 with the file's start."""
    first = {"fIntegral": known.start} if known.law is None and known.pid.ki > 0 else {}
    for name in STATE:
        yield Variable("VAR", name, "LREAL", None, (decimal(first[name]),) if name in first else ())
    for name in COUNTERS:
        yield Variable("VAR", name, "DINT", None, ("-1",) if name in {"nWiped", "nPlanned"} else ())
    if known.learning is not None:
        yield from _memory_of_learning(known, len(known.learning.length))
    yield Variable("VAR", "bWiping", "BOOL")
    yield Variable("VAR", "aTarget", "LREAL", known.memory)
    yield Variable("VAR", "aChange", "LREAL", known.memory)
    if known.stiffness:
        yield Variable("VAR", "aElement", "LREAL", len(known.stiffness))
    if known.law is not None:
        begin = tuple(decimal(known.start * one) for one in known.law.hold)
        yield Variable("VAR", "aState", "LREAL", len(begin), begin)
        yield Variable("VAR", "aNext", "LREAL", len(begin))


def _memory_of_learning(known: Coefficients, lengths: int) -> Iterator[Variable]:
    """The instance's variables that learning needs; they begin as designed."""
    as_designed = {"fLearnedForce", "fLearnedLength", "fScale", "fStretch", "fGain"}
    for name in (*LEARNED, *LEARNING):
        yield Variable("VAR", name, "LREAL", None, ("1.0",) if name in as_designed else ())
    for name in LEARNING_COUNTERS:
        yield Variable("VAR", name, "DINT", None, ("-1",) if name in {"nRound", "nSince"} else ())
    yield Variable("VAR", "aPosition", "LREAL", len(known.position), tuple(map(decimal, known.position)))
    yield Variable("VAR", "aBank", "LREAL", lengths * len(known.stiffness))
    for name in ("aRestOut", "aRestBack", "aForce", "aSquare", "aProduct"):
        yield Variable("VAR", name, "LREAL", lengths)


def _check(vectors: Vectors) -> Unit:
    asked, first, second, start, thrust, status = zip(*map(_row, vectors.rows()), strict=True)
    count = len(asked)

    def table(name: str, kind: str, values: Sequence[str]) -> Variable:
        return Variable("VAR CONSTANT", f"K_{name}", kind, count, tuple(values))

    variables = (
        Variable("VAR_OUTPUT", "bDone", "BOOL"),
        Variable("VAR_OUTPUT", "nFirstDiffering", "DINT", None, ("-1",)),
        Variable("VAR CONSTANT", "K_VECTOR_END", "DINT", None, (str(count - 1),)),
        table("ASKED", "DINT", asked),
        table("FIRST", "LREAL", first),
        table("SECOND", "LREAL", second),
        table("START", "LREAL", start),
        table("THRUST", "LREAL", thrust),
        table("STATUS", "DINT", status),
        Variable("VAR", "fbLaw", "FB_AxisLaw"),
        Variable("VAR", "nVector", "DINT"),
    )
    return Unit("PRG_AxisCheck", "PROGRAM", variables, filled("check.st.j2", decimal))


def _row(row: Sequence[float]) -> tuple[str, str, str, str, str, str]:
    asked, one, two, thrust, status = row
    first, second = (decimal(number if math.isfinite(number) else MISSING) for number in (one, two))
    if asked == RESET:  # the reading and the thrust at the start
        return str(int(asked)), "0.0", first, second, decimal(thrust), str(int(status))
    return str(int(asked)), first, second, "0.0", decimal(thrust), str(int(status))
