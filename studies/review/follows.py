"""Whether a report follows from its inputs: files as they were written, inputs as they were, the same once more.

The folder may be a stranger's. What is reviewed is a copy; the study is run again by options that reach nothing
outside, in a process with limits. "Follows" is said only where the run gave every file that is in the folder, and no
other.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

from models.machine import DEFAULT
from studies.catalogue import every
from studies.command import CHECK_MISSED, DONE, to_text
from studies.interrupt import remove_if_interrupted
from studies.manifest import ROOT, SOURCES, hashes, lock_hash, sha256, source_files, tree_hash, versions
from studies.options import BadInputError
from studies.review.bounded import Limits, run
from studies.review.claims import Claim, GivenFile, read_claim, read_manifest, study_of
from studies.review.copying import copied, visible
from studies.review.differences import Difference, differences
from studies.study import Progress, Study

MANIFEST: Final = "manifest.json"
SAME_OF_RUNS: Final = ("format", "study", "options", "figures", "tables")
"""What two runs of the same write into their manifests alike."""
DATA: Final = {".json", ".toml", ".csv"}
NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Review:
    """What a review found.

    edited: outputs that are not as the run wrote them. changed: inputs that are not as the run had them.
    verdict: "identical" (byte for byte), "equal" (within the tolerance), "different" or "cannot run".
    unequal: the outputs whose bytes the second run did not give. first: the first number beyond the tolerance, or the
    largest within it. reason: why it can't be run, or what but a number is different.
    """

    edited: tuple[str, ...]
    changed: tuple[str, ...]
    verdict: str
    unequal: tuple[str, ...] = ()
    first: Difference | None = None
    reason: str = ""

    @property
    def follows(self) -> bool:
        """Whether the report follows from its inputs in this environment."""
        return not self.edited and not self.changed and self.verdict in {"identical", "equal"}


@dataclass(frozen=True)
class Taken:
    """A folder that is reviewed: the copy, the names of the files in it, what its manifest claims, how it is called."""

    copy: Path
    names: frozenset[str]
    claim: Claim
    called: str

    def results(self) -> Any:
        """The content of results.json; None where it can't be read."""
        return _json(self.copy / "results.json")


def review(
    folder: Path, tolerance: float, progress: Progress, given: Sequence[Path] = (), limits: Limits | None = None
) -> Review:
    """Reviews a report's folder; numbers may differ by the relative `tolerance` [1] and count as equal.

    given: files from outside the folder that the run read, such as records. Raises BadInputError for a folder that
    holds what no study writes, or that was made with what a review does not run.
    """
    limits = limits or Limits()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        remove_if_interrupted(place)
        taken = _taken(folder, place / "folder")
        files = _staged(taken, given, place / "inputs")
        progress(0.05, f"will run {taken.claim.command()} (at most {limits.seconds:g} s, {limits.memory >> 20} MB)")
        changed = [*_changed(taken), *_changed_files(taken.claim, files)]
        progress(0.1, f"running {taken.claim.study.name} again")
        again = place / "again"
        failed = _run_again(taken, files, place, limits, again)
        if failed:
            return Review(tuple(_edited(taken)), tuple(changed), "cannot run", reason=failed)
        if "machine.toml" in taken.names and sha256(taken.copy / "machine.toml") != taken.claim.machine:
            changed += _changed_parameters(taken, again)
        edited = (*_edited(taken), *_of_another_run(taken, again))
        return _judged(taken, again, tolerance, edited, tuple(changed), limits)


def compared(before: Path, after: Path, place: Path, progress: Progress, limits: Limits) -> tuple[Path, dict[str, Any]]:
    """What changes from one report's folder to the other: a folder, below `place`, with results.json and report, and
    the content of results.json. Raises BadInputError."""
    studies = [_results_of(folder, place / side) for side, folder in (("before", before), ("after", after))]
    if studies[0] != studies[1]:
        raise BadInputError(f"{before} is of {studies[0]}, {after} of {studies[1]}; give two of one study")
    progress(0.1, "comparing")
    made = place / "made"
    task = {"do": "compare", "output": str(made)}
    results = {side: str(place / side / "results.json") for side in ("before", "after")}
    if failed := _done({**task, **results}, place, limits, (DONE,)):
        raise BadInputError(f"{before}, {after}: can't be compared ({failed}); run the study again")
    return made, _json(made / "results.json")


def _results_of(folder: Path, place: Path) -> str:
    """Copies a report's folder to `place`; the name of its study. Raises BadInputError for one without results."""
    copied(folder, place, _left_out(every().values()))
    study = study_of(read_manifest(place, str(folder)), str(folder))
    content = _json(place / "results.json")
    if not isinstance(content, dict) or content.get("study") != study.name:
        raise BadInputError(f"{folder}/results.json: can't be read; run the study again")
    return study.name


def _taken(folder: Path, copy: Path) -> Taken:
    names = copied(folder, copy, _left_out(every().values()))
    claim = read_claim(read_manifest(copy, str(folder)), str(folder))
    left_out = {f"{name}/" for name in _left_out([claim.study])}
    return Taken(copy, names - left_out, claim, str(folder))


def _left_out(studies: Iterable[Study]) -> tuple[str, ...]:
    """Folders that studies keep for their next run, which are not among their results."""
    return tuple(name for study in studies for name in study.keeps if name not in study.writes)


def _json(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None


def _staged(taken: Taken, given: Sequence[Path], place: Path) -> dict[GivenFile, Path]:
    """Copies of the files that the run was given: from the folder, from those handed over, from the project itself.

    Paths of the manifest are looked up nowhere else. Raises BadInputError for a file that is in none of these places.
    """
    staged: dict[GivenFile, Path] = {}
    place.mkdir()
    inside = {sha256(taken.copy / name): taken.copy / name for name in sorted(taken.names) if name[-1] != "/"}
    handed = {sha256(file): file for file in given if file.is_file()}
    for number, file in enumerate(taken.claim.files):
        named = next((one for one in given if one.name == file.name and one.is_file()), None)
        source = inside.get(file.sha256) or handed.get(file.sha256) or _of_project(file.path) or named
        if source is None:
            raise BadInputError(
                f"{taken.called}: {visible(file)} lies outside the folder, where a review reads nothing; "
                f"give it the file with --input {visible(file.name)}"
            )
        staged[file] = place / str(number) / file.name
        staged[file].parent.mkdir()
        for machine in DEFAULT.parent.glob("*.toml"):  # what an ensemble is based on
            shutil.copyfile(machine, staged[file].parent / machine.name)
        shutil.copyfile(source, staged[file])
    return staged


def _of_project(path: str) -> Path | None:
    """A file of the project's own folders, by its path from the root; None for any other."""
    place = Path(path)
    if place.is_absolute() or not place.parts or place.parts[0] not in SOURCES or ".." in place.parts:
        return None
    whole = (ROOT / place).resolve()
    own = whole in {file.resolve() for file in source_files()}
    return whole if own and whole.is_relative_to(ROOT.resolve()) else None


def _edited(taken: Taken) -> list[str]:
    """What in the folder is not as the manifest says."""
    outputs = taken.claim.outputs
    changed = {name for name in taken.names & set(outputs) if sha256(taken.copy / name) != outputs[name]}
    found = [
        f"{visible(name)} is {'not as the run wrote it' if name in changed else 'missing'}"
        for name in sorted(changed | (set(outputs) - taken.names))
    ]
    others = taken.names - {MANIFEST, *outputs}
    found += [f"{visible(name)} is not of this run: the manifest does not list it" for name in sorted(others)]
    if "results.json" in changed | others:
        found.append("the report is not made from these results: it is older than they are, or they were edited")
    return found


def _of_another_run(taken: Taken, again: Path) -> list[str]:
    """What the second run shows of the folder's manifest: files that a run does not write, or that were left out."""
    written = set(hashes(again)) - {MANIFEST}
    found = [f"{visible(name)} is not what a run writes" for name in sorted(set(taken.claim.outputs) - written)]
    found += [f"{name} is missing, which a run writes" for name in sorted(written - set(taken.claim.outputs))]
    before, now = taken.claim.content, _json(again / MANIFEST)
    found += [
        f"manifest.json: {visible(one, 200)}"
        for key in SAME_OF_RUNS
        for one in differences({key: before.get(key)}, {key: now.get(key)})
    ]
    return found + [f"manifest.json: {visible(key)} is not of a run" for key in sorted(set(before) - set(now))]


def _changed(taken: Taken) -> list[str]:
    inputs, found = taken.claim.content["inputs"], []
    if inputs["source"]["sha256"] != tree_hash(source_files()):
        found.append(f"source: another than at commit {visible(inputs['source'].get('commit'))}")
    if inputs["lock"]["sha256"] != lock_hash():
        found.append("requirements.lock: other pinned versions")
    before, now = taken.claim.content["versions"], versions()
    for name in sorted({*before, *now}):
        if now.get(name) != before.get(name):
            was, is_now = visible(before.get(name, "none")), now.get(name, "none")
            found.append(f"version of {visible(name)}: {was} before, {is_now} now")
    copy = taken.copy / "machine.toml"
    if taken.claim.default_machine and copy.is_file() and sha256(copy) != sha256(DEFAULT):
        found.append("machine: the manifest says the default one, machine.toml is another")
    return found


def _changed_files(claim: Claim, staged: Mapping[GivenFile, Path]) -> list[str]:
    return [f"{visible(file)}: has changed" for file in claim.files if sha256(staged[file]) != file.sha256]


def _changed_parameters(taken: Taken, again: Path) -> list[str]:
    """Which parameters of the machine file are not those of results.json."""
    before, now = taken.results(), _json(again / "results.json")
    before = before.get("machine", {}) if isinstance(before, dict) else {}
    found = [f"machine: {visible(one, 200)}" for one in differences(before, now["machine"])]
    return found or ["machine.toml: its text has changed, its values have not"]


def _run_again(taken: Taken, files: Mapping[GivenFile, Path], place: Path, limits: Limits, again: Path) -> str:
    """Runs the study with the manifest's options on the machine beside the results; what went wrong, if anything."""
    machine = taken.copy / "machine.toml"
    if not machine.is_file():
        return "machine.toml is missing"
    default = taken.claim.default_machine and sha256(machine) == sha256(DEFAULT)
    named: dict[str, list[str]] = {}
    for file, path in files.items():
        named.setdefault(file.option, []).append(str(path))
    task = {
        "do": "run",
        "study": taken.claim.study.name,
        "options": {name: value for name, value in taken.claim.options.items() if name not in named},
        "files": named,
        "machine": None if default else str(machine),
        "output": str(again),
    }
    return _done(task, place, limits, (DONE, CHECK_MISSED))


def _done(task: Mapping[str, Any], place: Path, limits: Limits, good: Sequence[int]) -> str:
    """Does a task in a process of its own; what went wrong, if anything."""
    work = place / f"work-{task['do']}"
    work.mkdir()
    ended = run(task, work, limits, lambda text: print(text, file=sys.stderr, flush=True))
    if ended.status is None:
        return f"stopped after {limits.seconds:g} s; --time-limit allows more"
    return "" if ended.status in good else visible(ended.said or f"ended with status {ended.status}", 300)


def _judged(
    taken: Taken, again: Path, tolerance: float, edited: tuple[str, ...], changed: tuple[str, ...], limits: Limits
) -> Review:
    """Compares all files of the folder with all of the second run."""
    written = frozenset(hashes(again))
    names = sorted((taken.names | written) - {MANIFEST})
    unequal = tuple(
        name
        for name in names
        if name not in taken.names
        or name not in written
        or (taken.copy / name).read_bytes() != (again / name).read_bytes()
    )
    if not unequal:
        return Review(edited, changed, "identical")
    try:
        found = list(differences(taken.results(), _json(again / "results.json")))
    except RecursionError:
        return Review(edited, changed, "different", unequal, reason="results.json is nested too deep")
    beyond = [one for one in found if not within(one, tolerance)]
    if beyond:
        return Review(edited, changed, "different", unequal, beyond[0])
    if alien := _alien(taken, again, unequal, tolerance, limits):
        return Review(edited, changed, "different", unequal, reason=alien)
    largest = max(found, key=lambda one: one.relative or 0.0, default=None)
    return Review(edited, changed, "equal", unequal, largest)


def within(one: Difference, tolerance: float) -> bool:
    """Whether a difference is one of two numbers, by no more than the relative tolerance [1]."""
    return one.relative is not None and one.relative <= tolerance


def _alien(taken: Taken, again: Path, unequal: Sequence[str], tolerance: float, limits: Limits) -> str:
    """Of results that are equal within the tolerance: the first file that does not go with them, if any.

    Data must be equal within the tolerance, too; the report must be, to the byte, what the folder's results give.
    """
    for name in unequal:
        if not ((taken.copy / name).is_file() and (again / name).is_file()):
            return f"{visible(name)} is not in both"
        if Path(name).suffix in DATA and not _same_data(taken.copy / name, again / name, tolerance):
            return f"{visible(name)} holds other values"
    told = [name for name in unequal if Path(name).suffix not in DATA]
    if not told:
        return ""
    if "results.json" not in unequal:
        return f"{visible(told[0])} is not what these results give"
    made = again.parent / "told"
    task = {"do": "render", "study": taken.claim.study.name, "results": str(taken.copy / "results.json")}
    failed = _done({**task, "output": str(made)}, again.parent, limits, (DONE,))
    if failed:
        return failed
    given = hashes(made)
    other = [name for name in told if given.get(name) != sha256(taken.copy / name)]
    return f"{visible(other[0])} is not what these results give" if other else ""


def _same_data(here: Path, there: Path, tolerance: float) -> bool:
    return (_same_json if here.suffix == ".json" else _same_text)(here, there, tolerance)


def _same_json(here: Path, there: Path, tolerance: float) -> bool:
    """Whether a JSON file is as a study writes it (no key twice, no NaN) and its numbers are within the tolerance."""
    content = _json(here)
    try:
        written = to_text(content) == here.read_text(encoding="utf-8")
        return written and all(within(one, tolerance) for one in differences(content, _json(there)))
    except (ValueError, RecursionError):
        return False


def _same_text(here: Path, there: Path, tolerance: float) -> bool:
    """Whether two texts are the same but for numbers within the tolerance."""
    try:
        one, other = (file.read_text(encoding="utf-8") for file in (here, there))
    except ValueError:
        return False
    if NUMBER.split(one) != NUMBER.split(other):
        return False
    pairs = zip_longest(NUMBER.findall(one), NUMBER.findall(other), fillvalue="nan")
    return all(a == b or all(within(found, tolerance) for found in differences(float(a), float(b))) for a, b in pairs)
