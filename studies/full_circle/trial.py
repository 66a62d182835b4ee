"""The circle on machines that are withheld: each is asked, named, redesigned and run; then its truth is opened."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any, Final

from models.machine import load as default_machine
from models.nominal_file import load
from studies.blind_trial.committing import commit, require_committed
from studies.command import to_text
from studies.effort import foresee
from studies.full_circle import benches, policies, scoring, withheld
from studies.full_circle.options import CircleOptions
from studies.full_circle.steps import Steps, program
from studies.gap_diagnosis.records import disabled
from studies.options import BadInputError
from studies.study import Answer, Check, Progress

DEFAULT_MACHINES: Final = 4
QUICK_MACHINES: Final = 1
GROUP, EACH = 8, 6  # of the drawn cases: neighbours are on so many machines, and so many of a group are on each
SLOW_CASE: Final = 6  # a case of the default seed whose controller samples slowly, so that it is worked on fast
MIN_JUDGED_MACHINES: Final = 30  # machines from which on the targets are checked
A_CASE: Final = 500.0  # s of one core
QUICK_CASE: Final = 10.0
MEMORY_BYTES: Final = 1.5e9  # that a trial holds
SOURCE: Final = "what the circle is to reach"
TOLD_MACHINES: Final = 10  # machines that are told as stories
ACTIVE: Final = "active"
OPENED: Final = "-opened"  # at the end of the name of a machine's truth, as a folder and as a step
GOALS: Final = {name: "redesign" if name == ACTIVE else "name" for name in policies.POLICIES}
QUICKLY: Final = {ACTIVE: "refit"}
SECONDS: Final = 60.0  # of machine time for a diagnosis, that of the first record included
RECORDS: Final = 5  # for a diagnosis, the first one included
CURVE_TIMES_S: Final = tuple(float(second) for second in range(0, round(SECONDS) + 1, 5))  # s of the curve


def compute(options: CircleOptions, progress: Progress) -> Answer:
    """Works on the withheld machines of a seed. Raises BadInputError for what can't be used."""
    for name in ("controller", "column", "mapping", "recipe"):
        if getattr(options, name):
            raise BadInputError(f"--{name}: is for the records of one's own axis; give --records too, or leave it out")
    disabled(options.disable, default_machine())
    output = options.output or Path("reports/out/full_circle")
    count = options.cases if options.cases is not None else QUICK_MACHINES if options.quick else DEFAULT_MACHINES
    cores = min(os.cpu_count() or 1, count)
    foresee(
        {f"{count} machines": count * (QUICK_CASE if options.quick else A_CASE) / cores},
        MEMORY_BYTES,
        options,
        progress,
    )
    steps = Steps(output / "sealed" / "steps", program())
    names = [f"machine-{number + 1:03d}" for number in range(count)]
    case = {name: case_of(number, quick=options.quick) for number, name in enumerate(names)}
    used = {
        answer_of(name, policy): {
            "seed": options.seed,
            "case": case[name],
            "disabled": list(options.disable),
            "terms": {"policy": policy, "goal": goal, "seconds": SECONDS, "records": RECORDS},
        }
        for name in names
        for policy, goal in (QUICKLY if options.quick else GOALS).items()
    }
    (output / "sealed" / "null").mkdir(parents=True, exist_ok=True)  # no process reads a folder newer than itself
    if any(steps.kept(name, made_from) is None for name, made_from in used.items()):
        _forget_truths(output / "sealed")
    answers = _over(steps, used, partial(_worked, output), lambda share, text: progress(0.8 * share, text))
    answers = {name: {**one, "of": steps.mark(used[name])} for name, one in answers.items()}
    committed = output / "sealed" / "answers_committed.json"
    require_committed(committed, answers, output / "sealed")
    commit(committed, answers)
    ran = {
        f"{name}{OPENED}": {
            "seed": options.seed,
            "case": case[name],
            "design": "redesign" in answers[name] and not options.quick,
            "of": answers[name]["of"],
        }
        for name in names
    }
    opened = _over(steps, ran, partial(_opened, output), lambda share, text: progress(0.8 + 0.15 * share, text))
    cases = [{**answers[name], **opened[f"{name}{OPENED}"], "case": name} for name in names]
    done = [one for one in cases if "failed" not in one]
    found = [
        policies.scored(name, policy, answers[answer_of(name, policy)], opened[f"{name}{OPENED}"]["label"])
        for name in names
        for policy in ({} if options.quick else GOALS)
    ]
    results = {
        "mode": "withheld",
        "quick": options.quick,
        "seed": options.seed,
        "count": count,
        "failed": [{"case": name, "why": one["failed"]} for name, one in answers.items() if "failed" in one],
        "shares": scoring.shares(done),
        "rates": scoring.rates(done),
        "policies": told_of(found),
        "cases": [_row(one) for one in done],
        "stories": [_story(one) for one in done[:TOLD_MACHINES]],
        "enough": count >= MIN_JUDGED_MACHINES,
    }
    return Answer(results, tuple(_checks(results)), {}, _summary(results))


def _forget_truths(sealed: Path) -> None:
    """Deletes what earlier runs opened, in their folders and steps: no truth is there while an answer is worked on."""
    for one in sealed.glob(f"*{OPENED}"):
        shutil.rmtree(one)
    for one in sealed.glob(f"steps/*{OPENED}.json"):
        one.unlink()


def answer_of(machine: str, policy: str) -> str:
    """The name of a policy's answer for a machine; the active one's is what the redesign follows from."""
    return machine if policy == ACTIVE else f"{machine}-{policy.replace(' ', '-')}"


def told_of(found: Sequence[policies.Result]) -> dict[str, Any]:
    """By policy, its rates and the curve of right names over machine time [s]; empty without results."""
    curves = policies.right_over_time(found, CURVE_TIMES_S)
    return {
        "times_s": list(CURVE_TIMES_S),
        "of": {
            name: {
                "rates": {key: one.plain() for key, one in rates.items()},
                "right_over_time": [one.plain() for one in curves[name]],
                "seconds": [one.seconds for one in found if one.policy == name],
            }
            for name, rates in policies.rates(found).items()
        },
    }


def case_of(number: int, *, quick: bool) -> int:
    """The number among the drawn cases of the one that is worked on as this one: each on a machine of its own."""
    if quick:
        return SLOW_CASE + EACH * GROUP * number
    return EACH * GROUP * (number // GROUP) + number % GROUP


def _over(
    steps: Steps,
    used: Mapping[str, Mapping[str, Any]],
    work: Callable[[str, Mapping[str, Any]], dict[str, Any]],
    tell: Callable[[float, str], None],
) -> dict[str, Any]:
    """What `work` makes of each step, by name and what it is made from: several at a time, each by processes of its
    own. What an earlier run kept is not made again."""
    found = {name: kept for name, made_from in used.items() if (kept := steps.kept(name, made_from)) is not None}
    left = [name for name in used if name not in found]
    with ThreadPoolExecutor(max(min(os.cpu_count() or 1, len(left)), 1)) as pool:
        running = {pool.submit(work, name, used[name]): name for name in left}
        for one in as_completed(running):
            name = running[one]
            found[name] = steps.keep(name, used[name], one.result())
            tell(len(found) / len(used), f"{name}: {found[name].get('failed') or 'done'}")
    return found


def _worked(output: Path, name: str, made_from: Mapping[str, Any]) -> dict[str, Any]:
    """One answer for a machine: by a policy, as far as its goal."""
    folder = output / "sealed" / name
    shutil.rmtree(folder, ignore_errors=True)
    task = {name: made_from[name] for name in ("seed", "disabled", "terms")}
    task["cache"] = str((output / "sealed" / "null").absolute())
    return benches.answered(f"{made_from['seed']} {made_from['case']}", folder.absolute(), task)


def _opened(output: Path, name: str, made_from: Mapping[str, Any]) -> dict[str, Any]:
    """What one machine was in truth, and what designs with the truth achieve on it."""
    folder, machine = output / "sealed" / name, f"{made_from['seed']} {made_from['case']}"
    shutil.rmtree(folder, ignore_errors=True)
    opened = benches.truth(machine, folder / "truth.json")
    (folder / "true.json").write_text(to_text(opened["nominal"]), encoding="utf-8")
    if not made_from["design"]:
        return {"truth": None, "label": opened["label"]}
    with benches.benches(machine, folder) as found:
        main = found.of("truth-1")
        assert main.nominal is not None
        known, true = load(main.nominal), load(folder / "true.json")
        limits = withheld.Limits(
            main.limits.distance, main.limits.speed, main.limits.feedforward, main.limits.machine_time
        )
        ask = withheld.asking(folder, known.sample_time, lambda asked: found.run(asked, known.sample_time))
        best = withheld.with_truth(known, true, limits, ask, made_from["seed"])
    return {"truth": best, "label": opened["label"]}


def _row(one: Mapping[str, Any]) -> dict[str, Any]:
    """One machine in the table of all."""
    label = one["label"]
    return {
        "case": one["case"],
        "kind": label["kind"],
        "true": list(label["name"]) or list(label["parameters"]),
        "outcome": one["named"]["outcome"],
        "named": list(one["named"]["effects"]),
        "machine_s": one["begun_s"] + one.get("course", {}).get("seconds", 0.0),
        "chosen": one["redesign"]["chosen"],
        "rolled_back": one["rolled_back"],
        "specified_s": one["redesign"]["specified"]["settling_s"],
        "before": one["before"],
        "after": one["after"],
        "truth": one["truth"],
        "beside": one["beside"],
        "share": {name: scoring.recovered(one, "after", name) for name in scoring.QUANTITIES},
    }


def _story(one: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "case": one["case"],
        "begun_s": one["begun_s"],
        "course": one.get("course"),
        "pictures": one["pictures"],
        "specified": one["redesign"]["specified"],
        "designs": one["redesign"]["designs"],
        "unmet": one["redesign"]["unmet"],
    }


def _checks(results: Mapping[str, Any]) -> list[Check]:
    """That every machine has an answer and, for enough of them, what the circle is to reach."""
    found = [Check("machines without an answer", float(len(results["failed"])), "1", 0.0, SOURCE)]
    if not results["enough"]:
        return found
    for name in scoring.QUANTITIES:
        share = results["shares"]["after"][name]
        if share["count"]:
            found.append(Check(f"median share recovered of {name}", share["median"], "1", 0.8, SOURCE, ">="))
    worse, inside = (results["rates"][name] for name in ("worse_when_run", "inside_settling"))
    if worse["tries"]:
        found.append(Check("redesigns worse when run", worse["share"], "1", 0.01, SOURCE))
    if inside["tries"]:
        found.append(Check("settling within its interval", inside["share"], "1", 0.85, SOURCE, ">="))
    return found


def _summary(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = [("machines", f"{len(results['cases'])} of {results['count']} worked on")]
    for way, said in scoring.WAYS.items():
        for name in scoring.QUANTITIES:
            share = results["shares"][way][name]
            if share["count"]:
                ends = "" if share["low"] is None else f" ({100 * share['low']:.0f} to {100 * share['high']:.0f} %)"
                rows.append(
                    (f"share recovered of {name}, {said}", f"{100 * share['median']:.0f} %{ends} of {share['count']}")
                )
    for name, one in results["rates"].items():
        if one["tries"]:
            told = f"{one['hits']} of {one['tries']} ({100 * one['low']:.0f} to {100 * one['high']:.0f} %)"
            rows.append((name.replace("_", " "), told))
    return rows
