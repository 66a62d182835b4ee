"""Whether a report follows from its inputs: files as they were written, inputs as they were, the same once more."""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from models.machine import DEFAULT, MachineError, load, to_json
from studies.catalogue import find
from studies.command import BAD_INPUT, main, plain
from studies.manifest import ROOT, lock_hash, sha256, source_files, tree_hash, versions
from studies.options import BadInputError
from studies.review.differences import Difference, differences
from studies.study import Progress


@dataclass(frozen=True)
class Review:
    """What a review found.

    edited: outputs that are not as the run wrote them. changed: inputs that are not as the run had them.
    verdict: "identical" (byte for byte), "equal" (within the tolerance), "different" or "cannot run".
    unequal: the outputs whose bytes the second run did not give. first: the first number beyond the tolerance, or the
    largest within it.
    """

    edited: tuple[str, ...]
    changed: tuple[str, ...]
    verdict: str
    unequal: tuple[str, ...]
    first: Difference | None

    @property
    def follows(self) -> bool:
        """Whether the report follows from its inputs in this environment."""
        return not self.edited and not self.changed and self.verdict in {"identical", "equal"}


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a report's folder. Raises BadInputError for a folder that has none."""
    try:
        content = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        outputs, study = content["outputs"], content["study"]
    except OSError as error:
        raise BadInputError(f"{folder}: has no manifest.json; give a folder that a study wrote") from error
    except (ValueError, KeyError, TypeError) as error:
        raise BadInputError(f"{folder}/manifest.json: is not the manifest of a study; run the study again") from error
    if not isinstance(outputs, dict) or not isinstance(study, str):
        raise BadInputError(f"{folder}/manifest.json: is not the manifest of a study; run the study again")
    return dict(content)


def review(folder: Path, tolerance: float, progress: Progress) -> Review:
    """Reviews a report's folder; numbers may differ by the relative `tolerance` [1] and count as equal."""
    manifest = read_manifest(folder)
    progress(0.05, "comparing files and inputs with the manifest")
    edited, changed = tuple(_edited(folder, manifest)), tuple(_changed(folder, manifest))
    progress(0.1, f"running {manifest['study']} again")
    with tempfile.TemporaryDirectory() as place:
        again = Path(place)
        if not _ran(folder, manifest, again):
            return Review(edited, changed, "cannot run", (), None)
        unequal = tuple(name for name in sorted(manifest["outputs"]) if not _same(folder / name, again / name))
        if not unequal:
            return Review(edited, changed, "identical", (), None)
        found = list(differences(_results(folder), _results(again)))
    beyond = [one for one in found if one.relative is None or one.relative > tolerance]
    if beyond:
        return Review(edited, changed, "different", unequal, beyond[0])
    largest = max(found, key=lambda one: one.relative or 0.0, default=None)
    return Review(edited, changed, "equal", unequal, largest)


def _edited(folder: Path, manifest: Mapping[str, Any]) -> list[str]:
    found = []
    for name, expected in sorted(manifest["outputs"].items()):
        if not (folder / name).is_file():
            found.append(f"{name} is missing")
        elif sha256(folder / name) != expected:
            found.append(f"{name} is not as the run wrote it")
    if any(one.startswith("results.json is not") for one in found):
        found.append("the report is not made from these results: it is older than they are, or they were edited")
    return found


def _changed(folder: Path, manifest: Mapping[str, Any]) -> list[str]:
    inputs, found = manifest["inputs"], []
    if inputs["source"]["sha256"] != tree_hash(source_files()):
        found.append(f"source: another than at commit {inputs['source']['commit']}")
    if inputs["lock"]["sha256"] != lock_hash():
        found.append("requirements.lock: other pinned versions")
    now = versions()
    for name, before in sorted(manifest["versions"].items()):
        if now.get(name) != before:
            found.append(f"version of {name}: {before} before, {now.get(name, 'none')} now")
    for file in inputs["files"]:
        path = ROOT / file["file"]
        if not path.exists():
            found.append(f"--{file['option']} {file['file']}: is no longer there")
        elif sha256(path) != file["sha256"]:
            found.append(f"--{file['option']} {file['file']}: has changed")
    copy = folder / inputs["machine"]["copy"]
    if copy.is_file() and sha256(copy) != inputs["machine"]["sha256"]:
        found += _changed_parameters(folder, copy)
    return found


def _changed_parameters(folder: Path, copy: Path) -> list[str]:
    """Which parameters of the machine file are not those of results.json."""
    try:
        machine = plain(to_json(load(copy)))
    except MachineError as error:
        return [f"machine.toml: can't be read any more ({error})"]
    found = [f"machine: {one}" for one in differences(_results(folder).get("machine", {}), machine)]
    return found or ["machine.toml: its text has changed, its values have not"]


def _results(folder: Path) -> Any:
    try:
        return json.loads((folder / "results.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _same(one: Path, other: Path) -> bool:
    return one.is_file() and other.is_file() and one.read_bytes() == other.read_bytes()


def _ran(folder: Path, manifest: Mapping[str, Any], again: Path) -> bool:
    """Runs the study with the manifest's options on the machine beside the results; False where that can't be."""
    study = find(manifest["study"])
    if study is None:
        raise BadInputError(
            f"{folder}: {manifest['study']!r} is not a study of this version; check out the manifest's commit"
        )
    copy = folder / manifest["inputs"]["machine"]["copy"]
    arguments = ["--output", str(again)]
    if not (manifest["inputs"]["machine"]["default"] and _same(copy, DEFAULT)):
        arguments += ["--machine", str(copy)]
    positional = []
    for file in manifest["inputs"]["files"]:
        path = str(ROOT / file["file"])
        if file["option"] == "record":
            positional.append(path)
        else:
            arguments += [f"--{file['option'].replace('_', '-')}", path]
    for name, value in sorted(manifest["options"].items()):
        arguments += _argument(name, value)
    with contextlib.redirect_stdout(io.StringIO()):
        return main(study, [*positional, *arguments]) != BAD_INPUT


def _argument(name: str, value: Any) -> list[str]:
    option = f"--{name.replace('_', '-')}"
    if value is None or value is False or value == []:
        return []
    if value is True:
        return [option]
    if isinstance(value, list):
        return [part for item in value for part in (option, str(item))]
    return [option, str(value)]
