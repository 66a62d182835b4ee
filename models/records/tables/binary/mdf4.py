"""MDF4 files (ASAM), by the optional package asammdf: every channel with its unit, and its group's times as its clock.

asammdf reads the samples by compiled code that does not check what the file states, so a damaged file can end the
process that reads it: that is another one than this.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Collection
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np

from models.records.tables.binary import mdf4_process
from models.records.tables.binary.extras import check_installed
from models.records.tables.sizes import Limits, RecordError
from models.records.tables.table import Table

ROOT: Final = Path(__file__).parents[4]
FILE_MARK: Final = b"MDF     "
UNFINISHED: Final = b"UnFinMF "


def table_of_mdf4(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them, converted], or all for None.

    A channel is called by its name, or "group/name" where several have it; a group is called by its acquisition, or its
    number from 0 on. Raises RecordError for a file that is too large, and ValueError for one that is damaged.
    """
    check_installed("asammdf", "MDF4")
    _check_head(path)
    question = {"path": str(path.resolve()), "limits": asdict(limits), "wanted": None if wanted is None else [*wanted]}
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
    done = subprocess.run(
        [sys.executable, "-P", "-m", mdf4_process.__name__],
        input=json.dumps(question).encode(),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": paths},
        check=False,
    )
    if done.returncode != 0 or not done.stdout:
        raise RecordError("is damaged: reading it broke off; export it again")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        said = json.loads(str(archive["arr_0"]))
        if "refused" in said:
            raise RecordError(said["refused"])
        if "failed" in said:
            raise ValueError(said["failed"])
        columns = {name: archive[f"arr_{number}"] for number, name in enumerate(said["columns"], start=1)}
    return Table(columns, said["names"], said["units"], said["clocks"])


def _check_head(path: Path) -> None:
    """Raises RecordError for a file that does not begin as a finished MDF file of version 4 does."""
    with path.open("rb") as file:
        head = file.read(16)
    if head[:8] == UNFINISHED:
        raise RecordError("was not finished by its logger; finalise it there, or export it again")
    if head[:8] != FILE_MARK:
        raise RecordError("is not an MDF file, whatever its name ends in; give the one that the logger wrote")
    if head[8:9] != b"4":
        version = head[8:16].decode("ascii", "replace").strip(" \0")
        raise RecordError(f"is an MDF file of version {version}; convert it to version 4")
