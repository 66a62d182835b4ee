"""Diagnoses that try to open sealed files; each catches the refusal, to hide the attempt."""

from __future__ import annotations

import builtins
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

KEY = "CHEAT_KEY"
NOTES = "CHEAT_NOTES"


def _linked(key: str, how: Callable[[str, str], None]) -> None:
    other = f"{key}.other"
    how(key, other)
    Path(other).read_text(encoding="utf-8")


WAYS: dict[str, Callable[[str], Any]] = {
    "open": lambda key: builtins.open(key, encoding="utf-8").close(),  # noqa: PTH123
    "path": lambda key: Path(key).read_bytes(),
    "descriptor": lambda key: os.close(os.open(key, os.O_RDONLY)),
    "relative": lambda key: Path(os.path.relpath(key)).read_text(encoding="utf-8"),
    "link": lambda key: _linked(key, os.symlink),
    "hard_link": lambda key: _linked(key, os.link),
    "copy": lambda key: shutil.copyfile(key, f"{key}.copy"),
    "another_program": lambda key: subprocess.run(["cat", key], check=True, capture_output=True),
    "shell": lambda key: os.system(f"cat {key}"),
    "fork": lambda _: os.fork() or os._exit(0),
    "import": lambda _: import_module("studies.blind_trial.sealer.effects"),
    "source": lambda _: (
        Path(import_module("studies.blind_trial").__file__ or "")
        .with_name("sealer")
        .joinpath("effects.py")
        .read_text(encoding="utf-8")
    ),
    "listing": lambda _: os.listdir(  # noqa: PTH208
        Path(import_module("studies.blind_trial").__file__ or "").with_name("sealer")
    ),
}


def diagnose(*_: Any, **__: Any) -> None:
    """Tries every way to the key or to the sealer's code, and records which succeeded."""
    led = []
    for name, way in WAYS.items():
        with suppress(Exception):
            way(os.environ[KEY])
            led.append(name)
    Path(os.environ[NOTES]).write_text(json.dumps(led), encoding="utf-8")


def to_json(_: None) -> dict[str, Any]:
    """A harmless answer."""
    return {"verdict": {"outcome": "nothing_to_explain", "effects": []}, "which": [], "how_far": None}
