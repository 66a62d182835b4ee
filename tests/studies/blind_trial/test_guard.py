"""Planted violations are detected: a readable key, a leaked label, shared code."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from studies.blind_trial import guard, landlock
from studies.blind_trial.answering import Conditions, answer_case
from studies.blind_trial.packs import read_pack
from tests.studies.blind_trial import ways
from tests.studies.blind_trial.cheats import KEY, NOTES, WAYS
from tests.studies.blind_trial.conftest import Packer

ROOT = Path(__file__).parents[3]
CHEATS = "tests.studies.blind_trial.cheats"


def test_every_way_to_the_key_or_the_sealer_is_shut_and_spoils_the_answer(
    small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key, notes = tmp_path / "pack-key.json", tmp_path / "notes.json"
    monkeypatch.setenv(KEY, str(key))
    monkeypatch.setenv(NOTES, str(notes))
    (case,) = read_pack(small_pack({"name": ["cogging"]})).cases
    found = answer_case(case, Conditions(forbidden=(key,), diagnosis=CHEATS))
    assert json.loads(notes.read_text(encoding="utf-8")) == []
    assert len(found["refused"]) >= len(WAYS)
    assert found["verdict"]["outcome"] == "failed"
    assert found["error"].startswith("refused")


def test_every_cheat_reaches_the_key_where_nothing_is_forbidden(tmp_path: Path) -> None:
    """Otherwise the test above would pass for attempts that do nothing. (Forking the test process is not tried.)"""
    key = tmp_path / "key.json"
    key.write_text("{}", encoding="utf-8")
    for name in WAYS.keys() - {"fork"}:
        (tmp_path / "key.json.other").unlink(missing_ok=True)
        WAYS[name](str(key))


def test_the_fonts_that_matplotlib_looks_for_on_a_new_machine_are_no_attempt(tmp_path: Path) -> None:
    """It starts a program of the system where it has no list of them yet, and the libraries of a design import it."""
    program = (
        "import sys; from studies.blind_trial.guard import forbid; refused = forbid(sys.argv[1:]);"
        "import control, matplotlib.pyplot; print(refused)"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "key.json")]
    settings = {**os.environ, "MPLCONFIGDIR": str(tmp_path)}
    done = subprocess.run(command, check=True, cwd=ROOT, env=settings, stdout=subprocess.PIPE, text=True)
    assert done.stdout.strip() == "[]"
    assert list(tmp_path.glob("fontlist*"))


@pytest.fixture
def open_key(small_pack: Packer, tmp_path: Path) -> Path:
    """A key file in a folder of its own, beside a folder that anyone may read."""
    folder = tmp_path / "secret"
    (folder / "open").mkdir(parents=True)
    small_pack({"name": ["cogging"]})
    return (tmp_path / "pack-key.json").rename(folder / "key.json")


@pytest.mark.skipif(not landlock.version(), reason="the kernel has no Landlock: the README names what is open")
def test_the_kernel_shuts_what_no_hook_can(open_key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the hook and without; the process that asks has the key open, too."""
    program = (
        "import sys; from studies.blind_trial import landlock; from tests.studies.blind_trial import ways;"
        "assert landlock.close(sys.argv[1:]); print(ways.leading(sys.argv[1]))"
    )
    with open_key.open():
        alone = [sys.executable, "-c", program, str(open_key)]
        assert subprocess.run(alone, cwd=ROOT, capture_output=True, text=True, check=True).stdout == "[]\n"
    notes = tmp_path / "notes.json"
    monkeypatch.setenv(ways.KEY, str(open_key))
    monkeypatch.setenv(ways.NOTES, str(notes))
    (case,) = read_pack(tmp_path / "pack").cases
    with open_key.open():
        answer_case(case, Conditions(forbidden=(open_key,), diagnosis=ways.__name__))
    assert json.loads(notes.read_text(encoding="utf-8")) == []


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="some ways lead through /proc")
@pytest.mark.parametrize("way", ways.WAYS)
def test_every_way_leads_to_a_key_that_is_not_shut(way: str, open_key: Path) -> None:
    """Otherwise the test above would pass for attempts that do nothing."""
    program = f"from tests.studies.blind_trial.ways import WAYS; WAYS[{way!r}]({str(open_key)!r})"
    with open_key.open():
        done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_only_what_is_shut_is_not_granted(tmp_path: Path) -> None:
    for name in ("a/b/key", "a/b/beside", "a/c/other", "top"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "a" / "link").symlink_to("b/key")
    (tmp_path / "a" / "b" / "same").hardlink_to(tmp_path / "a" / "b" / "key")
    shut = [str(tmp_path / "a" / "b" / "key"), str(tmp_path / "a" / "b" / "later"), str(tmp_path / "top")]
    found = [one for one in landlock.granted(shut) if one.startswith(str(tmp_path))]
    assert sorted(found) == [str(tmp_path / "a" / "b" / "beside"), str(tmp_path / "a" / "c")]
    within = [str(tmp_path / "a"), *shut]
    assert not [one for one in landlock.granted(within) if one.startswith(str(tmp_path))]
    assert "/proc" in landlock.granted(shut) or not Path("/proc").exists()


def test_a_leaked_label_is_found_by_name_and_by_content(tmp_path: Path) -> None:
    names = ["cogging", "stribeck", "play"]
    (tmp_path / "case-01").mkdir()
    (tmp_path / "disabled.json").write_text('["play"]', encoding="utf-8")
    record = tmp_path / "case-01" / "suite.csv.gz"
    record.write_bytes(gzip.compress(b"time_s\n0\n"))
    assert guard.leaks(tmp_path, names) == []
    record.write_bytes(gzip.compress(b"time_s\n0\n# cogging\n"))
    (tmp_path / "case-01" / "stribeck.txt").touch()
    expected = ["case-01/stribeck.txt holds 'stribeck'", "case-01/suite.csv.gz holds 'cogging'"]
    assert guard.leaks(tmp_path, names) == expected
    record.write_bytes(gzip.compress(b"0" * (guard.CHUNK_BYTES - 3) + b"cogging"))  # across the ends of two chunks
    assert guard.leaks(tmp_path, names) == expected
    record.write_bytes(gzip.compress(bytes(10_000_000)))
    hidden = "case-01/suite.csv.gz expands to more than 0.002 GB, and so was not searched to its end"
    assert guard.leaks(tmp_path, names, largest=2_000_000) == [expected[0], hidden]


FUNCTION = '''
def force(z, step, limit):
    """Moves and slips."""
    total = 0.0
    for i in range(len(z)):
        z[i] = max(-limit[i], min(z[i] + step, limit[i]))
        total += 3.0 * z[i] + limit[i] * step / (1.0 + total * total)
        total -= 0.5 * step
    return total
'''


def test_one_code_in_both_is_found_even_with_other_names(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir()
    other.mkdir()
    (one / "a.py").write_text(f"import numpy\n{FUNCTION}", encoding="utf-8")
    copied = FUNCTION.replace("limit", "bound").replace("total", "sum_").replace("Moves and slips.", "Mine.")
    (other / "b.py").write_text(copied, encoding="utf-8")
    assert guard.shared_code(one, [other], ["diagnosis"]) == ["a.py: force is b.py: force"]
    (other / "b.py").write_text(FUNCTION.replace("3.0", "4.0"), encoding="utf-8")
    assert guard.shared_code(one, [other], ["diagnosis"]) == []
    (one / "c.py").write_text("from diagnosis.residual import unknown_force\n", encoding="utf-8")
    assert guard.shared_code(one, [other], ["diagnosis"]) == ["c.py imports diagnosis.residual"]


def test_sealer_and_diagnosis_share_no_code() -> None:
    packages = ["models", "design", "diagnosis"]
    assert guard.shared_code(guard.SEALER_FOLDER, [ROOT / package for package in packages], packages) == []


def test_the_diagnosis_does_not_know_the_sealer() -> None:
    for package in ("models", "design", "diagnosis"):
        for file in (ROOT / package).rglob("*.py"):
            assert not any("blind_trial" in name for name in guard.imports(file))
