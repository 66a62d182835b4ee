"""`python -m tests.coverage [N] [FIRST]`: N random axes from a seed on, each by a multisine and by a sweep."""

from __future__ import annotations

import sys

import numpy as np

from tests.coverage.trial import by_parameter, tried

WITHIN = 1.96


def main(count: int, first: int, kinds: tuple[str, ...]) -> None:
    """Prints each axis, then the share of right orders and the pulls by parameter."""
    for kind in kinds:
        results, refusals = [], 0
        for seed in range(first, first + count):
            try:
                one = tried(seed, kind)
            except ValueError as error:
                refusals += 1
                print(f"{kind} of axis {seed} is refused: {error}", flush=True)
                continue
            results.append(one)
            if one.refusal:
                print(f"{kind} of axis {seed}: a later study refuses the file: {one.refusal}")
            worst = max(one.pulls.items(), key=lambda item: abs(item[1]), default=("", 0.0))
            print(
                f"{kind} of axis {seed}: {one.found} of {one.there} modes, chi-square {one.chi_square:.2f}, {worst}",
                flush=True,
            )
        right = sum(one.found == one.there for one in results)
        later = sum(bool(one.refusal) for one in results)
        print(f"{kind}: the order is right in {right} of {count}; {refusals} records are refused, {later} files later")
        for name, pulls in by_parameter(results).items():
            inside, rms = float(np.mean(np.abs(pulls) < WITHIN)), float(np.sqrt(np.mean(pulls**2)))
            print(f"  {name:20s} n {pulls.size:4d}  mean {np.mean(pulls):+.2f}  rms {rms:.2f}  {100 * inside:.1f} %")


if __name__ == "__main__":
    words = sys.argv[1:]
    numbers = [int(word) for word in words if word.isdigit()]
    count, first = [*numbers, *(40, 0)[len(numbers) :]][:2]
    main(count, first, tuple(word for word in words if word.isalpha()) or ("multisine", "sweep"))
