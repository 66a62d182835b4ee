"""A learned law as a draft of an effect: a file for models/effects/, to be made a law with parameters of its own.

The draft holds the measured curve and one parameter, a factor on it, so that a diagnosis finds it again in the records
of other days and a machine file can hold it as [effects.NAME]; at a factor of 1 it is [effects.measured].
"""

from __future__ import annotations

import json
import keyword
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from models.effects.catalogue import readable
from studies.folder import write_at_once
from studies.gap_diagnosis.unknown_law import has_curve, in_words
from studies.options import BadInputError

Results = Mapping[str, Any]

A_LINE: Final = 5  # numbers in a line of the table
TEXT: Final = '''"""{law}, as gap_diagnosis learned it from {records}.

A draft: put the law in the place of the table where you know one, with the range of its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Final

from models.effects.base import Array, Effect, parameter
from models.effects.measured import Measured

CURVE: Final = Measured(
{table}
)


@dataclass(frozen=True)
class {title}(Effect):
    """{law}, as it was measured."""

    name: ClassVar = "{name}"
    family: ClassVar = "structure"
    coordinate: ClassVar = "{coordinate}"
    parity: ClassVar = "{parity}"
    equation: ClassVar = r"a\\,F(s)"
    source: ClassVar = "assumed: a curve that was measured, and no law"
    hooks: ClassVar = CURVE.hooks
    depends_on_time: ClassVar = {by_time}
    factor: float = parameter("1", "factor a of the measured curve", 0.1, 10.0, "amplitude", signed=True)

    def memory(self, elements: int) -> int:
        """As many numbers as the table keeps."""
        return CURVE.memory(elements)

    def values(self) -> Array:
        """The table's parameters (P,) [SI], its forces times the factor."""
        return replace(CURVE, force=tuple(self.factor * force for force in CURVE.force)).values()
'''


def require_draftable(file: Path, *, overwrite: bool) -> None:
    """Raises BadInputError for a file that cannot become one of an effect, or that is somebody's work already."""
    name = file.stem
    if file.suffix != ".py" or not name.isidentifier() or name != name.lower() or keyword.iskeyword(name):
        raise BadInputError(
            f"--draft-effect: {file.name} cannot be a file of models/effects; give a name in lower-case letters, such "
            "as my_law.py"
        )
    if name in readable():
        raise BadInputError(f"--draft-effect: an effect is called {name!r} already; give another name")
    if not file.absolute().parent.is_dir():
        raise BadInputError(f"--draft-effect: the folder {file.parent} does not exist; create it")
    if file.exists() and not overwrite:
        raise BadInputError(f"--draft-effect: {file} exists; give another name, or --overwrite")


def written(file: Path, output: Path) -> str:
    """What became of the draft, for a reader; the results are those in the study's folder."""
    whole = json.loads((output / "results.json").read_text(encoding="utf-8"))
    results = whole["results"]
    learned = results["learned"]
    if not has_curve(learned):
        why = learned["reason"] if learned else "the records need no law without a name"
        return f"no draft: {why}"
    write_at_once(file, draft(learned, file.stem, [one["name"] for one in results["records"]]))
    return f"draft:   {file}"


def draft(learned: Results, name: str, records: Sequence[str]) -> str:
    """The text of the effect's file; the law as results.json has it, in SI units."""
    return TEXT.format(
        law=f"A{in_words(learned)[1:]}",
        records=json.dumps(", ".join(records))[1:-1],
        table="\n".join(_table(learned)),
        title="".join(part.capitalize() for part in name.split("_")) or "Law",
        name=name,
        coordinate=learned["coordinate"],
        parity="even" if learned["symmetry"] in {"plain", "even"} else "odd",
        by_time=learned["coordinate"] == "time",
    )


def _table(learned: Results) -> Iterator[str]:
    yield f'    "{learned["coordinate"]}",'
    for name, numbers in (("knots", learned["knots"]), ("force", learned["values"])):
        yield f"    {name}=("
        for i in range(0, len(numbers), A_LINE):
            yield f"        {', '.join(repr(float(number)) for number in numbers[i : i + A_LINE])},"
        yield "    ),"
    yield f'    symmetry="{learned["symmetry"]}",'
    yield f"    slow={learned['slow_m_per_s']!r},"
    yield f"    turn={learned['turn_m']!r},"
