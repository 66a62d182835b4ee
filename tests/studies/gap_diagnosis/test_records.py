"""What only looks wrong about records is refused with the way out in the message, and used where they are trusted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.records.units import loop_time
from models.machine import load as load_machine
from models.records.files import Loaded
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import check, filled, loaded
from studies.identify_machine import own_records
from studies.options import BadInputError
from tests.models.records.test_checks import MASS, moving

MACHINE = load_machine()
PATHS = (Path("a.csv"), Path("b.csv"))


def test_records_that_look_of_two_machines_are_refused_unless_they_are_trusted() -> None:
    records = [moving(), moving(mass=2 * MASS)]
    with pytest.raises(
        BadInputError, match=r"a.csv and b.csv are of two machines.*right as it is, give --trust-records"
    ):
        check(MACHINE, records, PATHS)
    (doubt,) = check(MACHINE, records, PATHS, trusted=True)
    assert doubt.startswith("Not refused, as the records are trusted: a.csv and b.csv are of two machines")
    assert doubt.endswith("diagnose each with its own machine file.")
    assert check(MACHINE, [moving(), moving()], PATHS) == ()


def test_a_position_within_a_few_steps_of_its_scale_may_be_trusted_to_move() -> None:
    records = [moving(2e-5, step=1e-5)]
    with pytest.raises(BadInputError, match=r"a.csv: nothing moves; .* --trust-records"):
        check(MACHINE, records, PATHS[:1])
    assert check(MACHINE, records, PATHS[:1], trusted=True)[0].startswith(
        "Not refused, as the records are trusted: nothing moves"
    )


def test_how_each_record_was_read_is_told_before_the_work(tmp_path: Path) -> None:
    record = own_records.motions(MACHINE, 1)
    signals = {
        "Zeit [ms]": 1e3 * MACHINE.sample_time * np.arange(record.position.size),
        "Soll [um]": 1e6 * record.reference,
        "Kraft [N]": record.command,
        "Ist [um]": 1e6 * record.position,
    }
    path = tmp_path / "moves.csv"
    rows = np.column_stack(list(signals.values()))
    np.savetxt(path, rows, fmt="%.12g", delimiter=";", header=";".join(signals), comments="Logger 4\n")
    told: list[str] = []
    column = ("time=Zeit", "reference=Soll", "command=Kraft", "position=Ist")
    options = DiagnosisOptions(record=(path,), column=column)
    loaded(MACHINE, options, lambda _share, text: told.append(text))
    assert told[0].startswith(
        f"read {path}\nASCII, columns separated by semicolons, names in line 2, numbers from line 3"
    )
    assert "  position   Ist     um    1e-06 m" in told[0].split("\n")
    assert f"{record.position.size:,} samples every 500 µs" in told[0]


def test_motions_are_counted_as_the_machines_own_loop_cuts_them() -> None:
    """A loop twenty times slower answers to twenty times longer motions; shorter ones do not stand alone."""
    pid = MACHINE.control.pid
    slow = replace(pid, kp=pid.kp / 400, ki=pid.ki / 8000, kd=pid.kd / 20)
    drowsy = replace(MACHINE, control=replace(MACHINE.control, pid=slow))
    assert loop_time(drowsy) == pytest.approx(20 * loop_time(MACHINE))
    records = [moving(), moving()]
    check(MACHINE, records, PATHS)
    with pytest.raises(BadInputError, match=r"a.csv, b.csv: .* too few, some have to be left out"):
        check(drowsy, records, PATHS)


def test_a_log_that_is_too_long_by_what_is_interpolated_says_so(tmp_path: Path) -> None:
    """15,400 samples every 500 µs had held more than 120,000, of which nothing said where they were from."""
    log = own_records.motions(MACHINE, 1).thinned(2)
    count, path = log.position.size, tmp_path / "log.csv"
    time = log.sample_time * np.arange(count)
    rows = np.column_stack([time, log.command, log.position, log.reference])
    np.savetxt(path, rows, fmt="%.12g", delimiter=",", header="time_s,command_N,position_m,reference_m", comments="")
    options = DiagnosisOptions(record=(path,), most_samples=count + 1)
    said = f"more than {count + 1:,} samples together, with those interpolated between the {count:,} of the logs; leave"
    with pytest.raises(BadInputError, match=said):
        loaded(MACHINE, options, lambda _share, _text: None)


def test_a_log_of_every_nth_sample_is_filled_as_long_as_it_follows_the_loop() -> None:
    record = own_records.motions(MACHINE, 1)
    few = int(loop_time(MACHINE) / MACHINE.sample_time)
    for every, kept in ((1, True), (2, True), (few, True), (few + 1, False), (2 * few, False)):
        log = Loaded("log.csv", "12ab", record.thinned(every), (), ("Said before.",))
        if not kept:
            with pytest.raises(RecordError, match=f"one of {every} of the machine's controller; these are too few"):
                filled(MACHINE, log)
            continue
        whole = filled(MACHINE, log)
        assert isinstance(whole.content, Record)
        assert whole.content.sample_time == pytest.approx(MACHINE.sample_time)
        assert whole.content.every == every
        assert whole.findings[0] == "Said before."
        assert any(f"It has one of {every} samples" in one for one in whole.findings) == (every > 1)
    uneven = Loaded("log.csv", "12ab", replace(record, sample_time=2.3 * record.sample_time), (), ())
    with pytest.raises(RecordError, match=r"is sampled every 1\.15 ms, and the machine's controller runs every 500 µs"):
        filled(MACHINE, uneven)
