"""What test_baseline.py compares a quick run with; `make baseline` runs this module to write it anew.

    python -m tests.studies.baseline

Only what the test reads is kept, so that a change of results is a change of a few lines that can be read.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from studies.catalogue import every
from studies.command import CHECK_MISSED, main, to_text

FOLDER: Final = Path(__file__).parents[2] / "reports" / "baseline"


def kept(results: dict[str, Any]) -> dict[str, Any]:
    """The part of a results.json that is kept: the resolved machine and the checks."""
    return {key: results[key] for key in ("study", "machine", "checks")}


def write() -> int:
    """Writes the baseline of every study, or of none after a fault; the exit status."""
    texts = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, study in every().items():
            output = Path(folder) / name
            status = main(study, ["--quick", "--no-report", "--output", str(output)])
            if status > CHECK_MISSED:
                return status
            texts[name] = to_text(kept(json.loads((output / "results.json").read_text(encoding="utf-8"))))
    for name, text in texts.items():
        (FOLDER / name).mkdir(parents=True, exist_ok=True)
        (FOLDER / name / "results.json").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(write())
