"""The text of a starter file: every value with its source, and with what it means and where to get a better one.

What is not answered follows from the answers, so that axes of any size get a file that runs.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from design.controller import design_deadbeat
from design.deadbeat import DesignError
from design.pid.rules import simc
from models.machine import Machine, MachineError, from_table
from models.machines.parts import MOST_COMPENSATED, usual_delay, usual_offset
from models.plant import Mode, Plant, delay_split
from models.quantity import AXES, QuantityError, is_rotary, listed, parse, rotary, show
from studies.beforehand import require_designable
from studies.new_machine.answers import ANSWERS, OPTIONAL
from studies.options import BadInputError

DEAD_TIME: Final = 1.5  # sample times: one until the command is out, half of one for the hold
ELEMENT_COUNT: Final = 5
AUTOMATIC: Final = (
    "assumed: chosen by the study, the fewest with which the design meets its specification with time to spare"
)
OFFSET_SOURCE: Final = "assumed: 1/750 of the rated thrust, at most 5 % of the friction"
FINEST: Final = 1 / 20  # of the presliding distance: the limit of the first element
CLOSED_LOOP: Final = 2.0  # time constant of the loop, in dead times: twice the tight setting of Skogestad's rule
AT_REST: Final = 0.8  # of the settling time: when x_T* rests on the target
LEAST_SAMPLES: Final = 4  # in which x_T* rests on the target; a rigid body needs two
MOST_SAMPLES: Final = 400  # likewise; with more, designs take long and gain nothing
INTERVAL: Final = 20  # settling times from one motion to the next, so that each begins at rest
MAX_INTERVAL_SAMPLES: Final = 20_000  # samples of that interval


def starter(answers: Mapping[str, str], name: str) -> str:
    """The machine file's text (TOML) from the answers, text with units by their names.

    Raises BadInputError for an answer that can't be, and where no feedforward is possible with them.
    """
    numbers = _numbers(answers)
    text = _text(answers, numbers, name)
    try:
        machine = from_table(tomllib.loads(text), Path("the answers"))
    except MachineError as error:
        raise BadInputError(str(error)) from error
    _require_reachable(machine)
    return text


def _numbers(answers: Mapping[str, str]) -> dict[str, float]:
    """The answers in SI, and the dead time where none is given. Raises BadInputError."""
    numbers = dict[str, float]()
    for one in (*ANSWERS, *OPTIONAL):
        if one.name not in answers:
            continue
        try:
            numbers[one.name] = parse(answers[one.name], one.unit)
        except QuantityError as error:
            raise BadInputError(f"{one.option}: {error}") from error
        if one.name != "offset" and not numbers[one.name] > 0:
            none = one.name == "friction_force" and numbers[one.name] == 0
            instead = "; for an axis without friction, as on an air bearing, give one far below all other forces" * none
            raise BadInputError(f"{one.option}: {answers[one.name]!r} must be above 0{instead}")
    return {"dead_time": DEAD_TIME * numbers["sample_time"], **numbers}


def _axis(answers: Mapping[str, str]) -> str:
    """Which kind of axis the answers' units are of, a key of AXES. Raises BadInputError where they mix both kinds."""
    kinds = {one.option: is_rotary(answers[one.name], one.unit) for one in (*ANSWERS, *OPTIONAL) if one.name in answers}
    turning = [option for option, rotary in kinds.items() if rotary]
    straight = [option for option, rotary in kinds.items() if rotary is False]
    if turning and straight:
        raise BadInputError(
            f"{listed(straight)}: in units of a linear axis, and {listed(turning)} of a rotary one; "
            "give all in rad, N m and kg m^2, or all in m, N and kg"
        )
    return AXES[bool(turning)]


def _require_reachable(machine: Machine) -> None:
    """Raises BadInputError where the answers ask for what the drive can't do, or the scale can't see."""
    try:
        require_designable(machine, "the answers")
        design_deadbeat(machine)
    except BadInputError as error:
        raise BadInputError(machine.wording(str(error))) from error
    except DesignError as error:
        said = machine.wording(str(error))
        raise BadInputError(f"--settling-time, --stroke, --rated-thrust: {said}") from error


def _reference_time(numbers: Mapping[str, float]) -> float:
    """The time [s] by which x_T* rests, so that the position does within the settling time, in whole samples."""
    ts, settling = numbers["sample_time"], numbers["settling_time"]
    latest = min(AT_REST * settling, settling - numbers["dead_time"] - 2 * ts)
    count = min(math.floor(latest / ts + 1e-9), MOST_SAMPLES)
    if count < LEAST_SAMPLES:
        least = max(LEAST_SAMPLES * ts / AT_REST, LEAST_SAMPLES * ts + numbers["dead_time"] + 2 * ts)
        raise BadInputError(
            f"--settling-time: {show(settling, 's')} are too few samples of {show(ts, 's')} beside a dead time of "
            f"{show(numbers['dead_time'], 's')}; give at least {show(least, 's')}, or a shorter --sample-time"
        )
    return count * ts


def _text(answers: Mapping[str, str], numbers: Mapping[str, float], name: str) -> str:
    ts, settling, reference = numbers["sample_time"], numbers["settling_time"], _reference_time(numbers)
    interval = min(INTERVAL * settling, MAX_INTERVAL_SAMPLES * ts)
    plant = Plant(numbers["dead_time"], 1.0, (Mode(1 / numbers["mass"], 0.0, 0.0),))
    pid = simc(plant, ts, CLOSED_LOOP * (plant.dead_time + ts / 2), 0.0)
    limits = np.geomspace(FINEST * numbers["presliding"], numbers["presliding"], ELEMENT_COUNT)
    stiffness = numbers["friction_force"] / ELEMENT_COUNT / limits
    axis = _axis(answers)
    kind = "" if axis == AXES[0] else f'axis = "{axis}"\n'
    angle, torque = (rotary(unit) if kind else unit for unit in ("m", "N"))

    def given(key: str) -> str:
        return _entry(_quoted(answers[key]), f"given: new_machine --{key.replace('_', '-')}")

    def number(value: float, unit: str, source: str) -> str:
        unit = rotary(unit) if kind else unit
        return _entry(_quoted(f"{value:.6g} {unit}" if unit else f"{value:.6g}"), source)

    def each(values: np.ndarray[tuple[int], np.dtype[np.float64]], unit: str, source: str) -> str:
        unit = rotary(unit) if kind else unit
        return _entry("[" + ", ".join(_quoted(f"{value:.6g} {unit}") for value in values) + "]", source)

    delay = given("dead_time") if "dead_time" in answers else number(numbers["dead_time"], "s", "assumed: 1.5 T_s")
    late = delay_split(numbers["dead_time"], ts)[0]
    rule = "derived: Skogestad's rule for the mass and the dead time"
    share = f"{ELEMENT_COUNT} elements of equal force"
    return f"""\
# A machine file to begin with. Every value is text with a unit and states its source: "given" came from you, "derived"
# follows from it, "assumed" is a guess to be replaced. Records of the axis replace most of them:
#   python -m studies.identify_machine --machine THIS_FILE --write-references FOLDER   (what to run on the axis)
#   python -m studies.identify_machine RECORD... --machine THIS_FILE                   (what its records say)
name = {_quoted(name)}
{kind}
[drive]
rated_thrust = {given("rated_thrust")} # the commands are forces; see [record]
rated_speed = {given("rated_speed")}
offset = {given("offset") if "offset" in answers else number(0, "N", "assumed: none")} # of gravity: M g less a balance
travel = {given("travel") if "travel" in answers else number(0, "m", "assumed: not known")} # for experiments; 0: open

[scale]
resolution = {given("resolution")}
noise = {number(0, "m", "assumed: not known")} # 0: 0.3 steps of the resolution are assumed where noise matters

[plant]
thrust_constant = {_entry(_quoted("1"), f"assumed: the reference is in {torque}")} # {torque} per {torque} commanded
dead_time = {delay} # from command to thrust; the hold's half sample comes on top

[[plant.modes]] # the rigid body; each vibration mode is one more [[plant.modes]] with its frequency and damping
gain = {number(1 / numbers["mass"], "1/kg", f"given: 1 / M, new_machine --mass {answers['mass']}")}
frequency = {_entry(_quoted("0 Hz"), "given: a rigid body")}
damping = {_entry(_quoted("0"), "given: a rigid body")}

[friction] # elements in parallel: springs that slip at their limit; slow loops on the axis identify them
limit = {each(limits, "m", f"assumed: {share} up to --presliding {answers['presliding']}")}
stiffness = {each(stiffness, "N/m", f"assumed: {share}, --friction-force {answers['friction_force']} together")}
damping = {each(np.zeros(ELEMENT_COUNT), "N s/m", "assumed: friction that does not depend on speed")}

[tolerance] # how well values are known, as standard deviations; of the others it is usual to state none
dead_time = {number(usual_delay(ts), "s", "assumed: 4 % of the sample time")}
offset = {number(usual_offset(numbers["rated_thrust"], numbers["friction_force"]), "N", OFFSET_SOURCE)}

[control]
sample_time = {given("sample_time")}
reference_delay = {_entry(str(late), "assumed: whole samples of the dead time")} # of x_T*; 0 if the drive has none
compensator_elements = {_entry(_quoted("auto"), AUTOMATIC)} # or a number from 1 to {MOST_COMPENSATED}

[control.pid] # replace it by the PID that runs, or by [control.cascade]
kp = {number(pid.kp, "N/m", rule)}
ki = {number(pid.ki, "N/(m s)", rule)}
kd = {number(pid.kd, "N s/m", rule)}
derivative_filter = {_entry(_quoted("0 s"), "assumed: none")}

[specification]
stroke = {given("stroke")}
tolerance = {given("tolerance")} # +-
settling_time = {given("settling_time")} # by which the position is within the tolerance; this is what is checked
reference_settling_time = {number(reference, "s", "derived: the settling time less a margin")} # by which x_T* rests
interval = {number(interval, "s", "assumed: from one motion to the next")}
motions = {_entry("5", "assumed: in one direction before the reversal")}

# [record] # how the records' columns are called; a motor's force constant belongs here:
# position = "x [m{angle}]"
# command = "current [A] * 42 {torque}/A"
"""


def _entry(value: str, source: str) -> str:
    return f"{{ value = {value}, source = {_quoted(source)} }}"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
