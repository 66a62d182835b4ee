"""Small packs whose records are short, so that answering them takes a moment."""

from __future__ import annotations

import gzip
import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from studies.blind_trial.guard import SEALER_FOLDER

Packer = Callable[..., Path]


@pytest.fixture
def small_pack(tmp_path: Path) -> Packer:
    """Makes a pack of cases with 200 samples of one wave, and its key beside it: kinds and names as given."""

    def make(*bodies: dict[str, object], place: str = "pack") -> Path:
        folder = tmp_path / place
        folder.mkdir()
        shutil.copyfile(SEALER_FOLDER / "nominal.json", folder / "nominal.json")
        key, commitments = {}, {}
        for k, content in enumerate(bodies, start=1):
            case = f"case-{k:02d}"
            (folder / case).mkdir()
            (folder / case / "suite.csv.gz").write_bytes(wave(k))
            if content.get("disabled"):
                (folder / case / "disabled.json").write_text(json.dumps(content["disabled"]), encoding="utf-8")
            body = json.dumps({"case": case, **content})
            key[case] = {"nonce": f"salt {k}", "body": body}
            commitments[case] = hashlib.sha256(f"salt {k}{body}".encode()).hexdigest()
        (folder / "commitments.json").write_text(json.dumps(commitments), encoding="utf-8")
        (tmp_path / f"{place}-key.json").write_text(json.dumps(key), encoding="utf-8")
        return folder

    return make


def wave(number: int) -> bytes:
    """A record of 200 samples: a sine of 3 um under a force, another frequency for each number."""
    time = np.arange(200) * 5e-4
    position = np.round(3e-6 * np.sin(2 * np.pi * (5 + number) * time), 7)
    rows = [f"{t:.4f},0,0,0,{1e6 * x:.6g},{x:.9g}" for t, x in zip(time, position, strict=True)]
    head = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
    return gzip.compress("\n".join([head, *rows, ""]).encode(), mtime=0)
