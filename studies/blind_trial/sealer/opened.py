"""What a sealed machine is in truth, for whoever asks once all answers are committed.

    python -m studies.blind_trial.sealer.opened --file FILE

The first line on its input is "SEED CASE", as for on_request. FILE then holds the true values in the form of a
nominal.json, and the label: what is wrong with the machine, by name and size.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.blind_trial.sealer.machines import cases
from studies.blind_trial.sealer.machines.axis import shifted


def truth(found: cases.Plan) -> dict[str, Any]:
    """The true machine's nominal.json, and the case's label."""
    true = shifted(found.bench.axis, found.shift)
    return {"nominal": true.nominal("the sealed machine, opened"), "label": found.body()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes the truth; exit status 0, or 2 with one line for a first line that can't be used."""
    parser = argparse.ArgumentParser(prog="studies.blind_trial.sealer.opened", description=__doc__)
    parser.add_argument("--file", type=Path, required=True, metavar="FILE", help="where the truth goes")
    file = parser.parse_args(arguments).file
    numbers = sys.stdin.readline().split()
    if len(numbers) != 2 or not all(one.isdecimal() for one in numbers):
        print('error: the first line must be "SEED CASE", two whole numbers from 0 on', file=sys.stderr)
        return 2
    found = cases.plan(int(numbers[0]), int(numbers[1]), "sealed")
    file.write_text(json.dumps(truth(found), indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
