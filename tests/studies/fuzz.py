"""Machine files spoiled by a seeded mutation: each is refused in one line or answered; `make fuzz` tries ten thousand.

python -m tests.studies.fuzz [--count N] [--seed N]; every 500 mutants are counted on stderr, and Ctrl-C ends it with
what it has.
"""

from __future__ import annotations

import argparse
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from design.controller import assemble, design_deadbeat
from design.deadbeat import DesignError, least_peak_thrust
from design.feasibility import require_designable
from models.machine import DEFAULT, Machine, MachineError, load
from models.plant import sampled_matrices
from models.simulation.simulator import simulate

SHIPPED: Final = (DEFAULT, DEFAULT.parent / "emps.toml")
CASCADE: Final = """\
anti_windup = { value = "5 ms" }

[control.cascade]
position_gain = { value = "100 1/s" }
velocity_gain = { value = "10000 N s/m" }
integral_time = { value = "20 ms" }
velocity_filter = { value = "0.2 ms" }
velocity_feedforward = { value = "1" }
acceleration_feedforward = { value = "44 kg" }
proportional_weight = { value = "1" }

[[control.filters.notch]]
frequency = { value = "81 Hz" }
damping = { value = "0.2" }
depth = { value = "0.5" }

[[control.filters.low_pass]]
frequency = { value = "600 Hz" }
damping = { value = "0.7" }

[[control.filters.section]]
numerator = { value = ["1", "0.2"] }
denominator = { value = ["1.2", "0.1", "-0.1"] }

"""  # in place of the default machine's PID
TOLD: Final = 500  # mutants from one count to the next
SECONDS: Final = 20  # of the processor for one mutant
LONGEST_LINE: Final = 600  # characters of a message
ODD: Final = (
    "0", "-0", "-1", "1e308", "-1e308", "1e-308", "5e-324", "nan", "inf", "-inf", "1e999", "0x10", "1_000", "", " ",
    "1,5", "535", "3.8e-5", "1e9", "1e-9", "1e15", "9" * 400, "½", "١",
)  # fmt: skip
UNITS: Final = (
    "m",
    "um",
    "s",
    "ms",
    "N",
    "kg",
    "Hz",
    "N/m",
    "1/kg",
    "",
    "m m",
    "furlong",
    "dB",
    "degC",
    "m**99999",
    "/",
)
NUMBER: Final = re.compile(r'"(-?[\d.]+(?:e[-+]?\d+)?)( [^"]*)?"')


class HungError(Exception):
    """A mutant took longer than it may."""


@dataclass(frozen=True)
class Mutant:
    """The text of a machine file, and how it was spoiled."""

    text: str
    how: str


@cache
def texts() -> tuple[str, ...]:
    """The machine files that are spoiled: those that are shipped, and the default one under a cascade with filters."""
    shipped = [path.read_text(encoding="utf-8") for path in SHIPPED]
    before, _, rest = shipped[0].partition("[control.pid]")
    return (*shipped, before + CASCADE + rest[rest.index("[specification]") :])


def mutant(rng: random.Random) -> Mutant:
    """A shipped machine file with one to three mutations."""
    text = rng.choice(texts())
    chosen = rng.choices([one for one, _ in MUTATIONS], [weight for _, weight in MUTATIONS], k=rng.choice((1, 1, 2, 3)))
    for mutation in chosen:
        text = mutation(text, rng)
    return Mutant(text, ", ".join(mutation.__name__ for mutation in chosen))


def _replaced(text: str, match: re.Match[str] | None, new: str) -> str:
    return text if match is None else text[: match.start()] + new + text[match.end() :]


def _a_number(text: str, rng: random.Random) -> re.Match[str] | None:
    return rng.choice([*NUMBER.finditer(text)] or [None])


def scaled(text: str, rng: random.Random) -> str:
    """A number by a factor, often a large one."""
    match = _a_number(text, rng)
    if match is None:
        return text
    factor = 10 ** rng.choice((rng.uniform(-1, 1), rng.uniform(-4, 4), rng.uniform(-14, 14)))
    number = float(match[1]) * factor * rng.choice((1, 1, 1, -1))
    return _replaced(text, match, f'"{number:.6g}{match[2] or ""}"')


def odd_number(text: str, rng: random.Random) -> str:
    """A number that is none, or that is at the end of all floats."""
    match = _a_number(text, rng)
    return text if match is None else _replaced(text, match, f'"{rng.choice(ODD)}{match[2] or ""}"')


def odd_unit(text: str, rng: random.Random) -> str:
    """Another unit."""
    match = _a_number(text, rng)
    return text if match is None else _replaced(text, match, f'"{match[1]} {rng.choice(UNITS)}"')


def odd_whole(text: str, rng: random.Random) -> str:
    """Another whole number."""
    match = rng.choice([*re.finditer(r"(?<=value = )\d+", text)] or [None])
    new = ("0", "1", "-1", "100", "1000", "9" * 30, "nan", "true", "[]", "{}", "2.5", "1979-05-27", '"5"')
    return _replaced(text, match, rng.choice(new))


def without_line(text: str, rng: random.Random) -> str:
    """A line less."""
    lines = text.splitlines(keepends=True)
    del lines[rng.randrange(len(lines))]
    return "".join(lines)


def doubled_line(text: str, rng: random.Random) -> str:
    """A line twice, or in another place."""
    lines = text.splitlines(keepends=True)
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return "".join(lines)


def noise(text: str, rng: random.Random) -> str:
    """A few characters changed."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(text))
        text = text[:at] + rng.choice("[]{}\"'=.,#\n\\0 9eE-+µ\x00\u202e") + text[at + rng.randint(0, 2) :]
    return text


def more_modes(text: str, rng: random.Random) -> str:
    """Some modes more, up to very many, often close to each other."""
    count, first = rng.choice((1, 2, 3, 5, 21, 51, 200)), rng.uniform(5, 200)
    apart = rng.choice((0.0, 1e-9, 0.1, 3.0, 30.0))
    modes = [
        f'[[plant.modes]]\ngain = "{10 ** rng.uniform(-6, -2):.4g} 1/kg"\nfrequency = "{first + i * apart:.12g} Hz"\n'
        f'damping = "{rng.choice((0.0, 1e-9, 0.01, 0.5, 0.999)):g}"\n\n'
        for i in range(count)
    ]
    return text.replace("[control]", "".join(modes) + "[control]", 1)


def nested(text: str, rng: random.Random) -> str:
    """A value that is nested deeply."""
    depth, (left, right) = rng.choice((3, 100, 5000)), rng.choice((("[", "]"), ("{a=", "}")))
    match = _a_number(text, rng)
    return _replaced(text, match, left * depth + "1" + right * depth)


def long(text: str, rng: random.Random) -> str:
    """A very long key, text or list."""
    size = rng.choice((300, 20_000))
    match = _a_number(text, rng)
    new = rng.choice(("[" + '"1 N", ' * size + "]", '"' + "7" * size + ' N"', '"' + "x" * size + '"'))
    return _replaced(text, match, new) if rng.random() < 0.7 else f"{'k' * size} = 1\n{text}"


def effect(text: str, rng: random.Random) -> str:
    """A table of an effect, of its priors or of a tolerance."""
    name = rng.choice(("cogging", "viscous_friction", "floor_vibration", "encoder_error", "no_such_effect"))
    key = rng.choice(("amplitude", "pitch", "phase", "coefficient", "frequency"))
    value = f'"{rng.choice((*ODD, "2", "0.03"))} {rng.choice(UNITS)}"'
    return f"{text}\n[{rng.choice(('effects', 'priors', 'tolerance'))}.{name}]\n{key} = {value}\n"


MUTATIONS: Final[tuple[tuple[Callable[[str, random.Random], str], float], ...]] = (
    (scaled, 8), (odd_number, 3), (odd_unit, 1), (odd_whole, 1), (without_line, 1), (doubled_line, 1), (noise, 1),
    (more_modes, 1), (nested, 0.3), (long, 0.3), (effect, 1),
)  # fmt: skip


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Raises HungError where the block takes longer [s] of the processor, so that a busy machine hangs nothing."""

    def hung(_number: int, _frame: object) -> None:
        raise HungError(f"took longer than {seconds} s")

    before = signal.signal(signal.SIGVTALRM, hung)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def outcome(text: str, folder: Path) -> str:
    """What becomes of a machine file: "refused at loading", "refused to design" or "designed".

    Raises what must not be: any error that is not one sentence, AssertionError for a design that is wrong, HungError.
    """
    path = folder / "mutant.toml"
    path.write_text(text, encoding="utf-8")
    try:
        machine = load(path)
    except MachineError as error:
        _one_line(error)
        return "refused at loading"
    try:
        require_designable(machine)
        _designed(machine)
    except DesignError as error:
        _one_line(error)
        return "refused to design"
    return "designed"


def _one_line(error: Exception) -> None:
    said = " ".join(str(error).split())
    assert len(said) < LONGEST_LINE, said


def _designed(machine: Machine) -> None:
    """A deadbeat for the machine, which has to bring it to rest, and the start of a motion with it."""
    wanted, ts = machine.specification, machine.sample_time
    deadbeat = design_deadbeat(machine)
    assert np.all(np.isfinite(deadbeat.thrust))
    a, b, c = sampled_matrices(machine.plant, ts, whole_delay=False)
    state = np.zeros(len(a))
    for thrust in deadbeat.thrust:
        state = a @ state + b[:, 0] * thrust
    for _ in range(3):
        assert abs(float(c[0] @ state) - wanted.stroke) < 1e-6 * wanted.stroke
        state = a @ state
    if deadbeat.thrust.size <= 60:  # a larger program takes longer than all else
        least = least_peak_thrust(machine.plant, ts, deadbeat.settling_time, wanted.stroke)
        assert least <= 1.000001 * float(np.max(np.abs(deadbeat.thrust)))
    samples = min(round(wanted.interval / ts), 500)
    response = simulate(machine, assemble(machine, deadbeat), np.full(samples, wanted.stroke))
    assert np.all(np.isfinite(response.position))


def fuzz(count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """How often each outcome came, and what went wrong, one line each; as far as an interruption lets it come."""
    outcomes, wrong = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as folder, suppress(KeyboardInterrupt):
        rng = random.Random(seed)
        for i in range(count):
            if i and i % TOLD == 0:
                print(
                    f"{i} of {count}: {len(wrong)} wrong, {dict(outcomes)}",
                    *wrong,
                    sep="\n",
                    file=sys.stderr,
                    flush=True,
                )
            one, begin = mutant(rng), time.process_time()
            try:
                with at_most(SECONDS):
                    outcomes[outcome(one.text, Path(folder))] += 1
            except Exception as error:  # whatever else comes out is what is looked for
                kept = Path(tempfile.gettempdir()) / f"mutant-{seed}-{i}.toml"
                kept.write_text(one.text, encoding="utf-8")
                said = " ".join(str(error).split())[:300]
                wrong.append(f"mutant {i} ({one.how}; {kept}): {type(error).__name__}: {said}")
            outcomes[f"slower than {SECONDS // 2} s"] += time.process_time() - begin > SECONDS / 2
    return outcomes, wrong


def main() -> int:
    """Prints the outcomes; 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="of mutants (default: 10000)")
    parser.add_argument("--seed", type=int, default=0, help="of the mutations (default: 0)")
    given = parser.parse_args()
    outcomes, wrong = fuzz(given.count, given.seed)
    print(*(f"{number:6d} {name}" for name, number in sorted(outcomes.items())), *wrong, sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
