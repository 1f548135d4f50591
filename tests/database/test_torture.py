"""A few rounds of scripts/checks/torture_database.py: nothing is lost."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from platforms import on_wine
from scripted import load_script

from priorfill.database import PriorDatabase

FILES = 24
ROUNDS = 1
"""Rounds of each kind; the script itself runs hundreds."""

KINDS = ["kill", "full", "fsync", "held"]
if sys.platform != "win32":
    KINDS.append("term")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("torture_database")


@pytest.fixture(scope="module")
def torture(script: ModuleType, in_memory: Path) -> Iterator[Any]:
    with script.Torture(in_memory, seed=7, files=FILES, mounts=False, forks=True) as torture:
        yield torture


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_lost(torture: Any, kind: str) -> None:
    torture.rows.clear()
    torture.run(kind, ROUNDS)
    assert [fault for row in torture.rows for fault in row.faults] == []
    assert all(row.rounds == ROUNDS for row in torture.rows if not row.skipped)
    assert sum(row.found for row in torture.rows) > 0


@pytest.mark.windows
def test_nothing_is_lost_while_a_reader_holds_files(script: ModuleType, in_memory: Path) -> None:
    """Processes are started as on Windows; the reader maps what a compaction replaces."""
    operations = ["compact"] if on_wine() else ["compact", "remove"]  # which starts slowly
    options = {"seed": 5, "files": 12, "mounts": False, "reader": True, "workers": True}
    with script.Torture(in_memory / "held", **options) as torture:
        torture.run("kill", 1, operations)
    assert [fault for row in torture.rows for fault in row.faults] == []
    assert [row.disturbed for row in torture.rows] == [1] * len(operations)
    assert all(row.held > 0 for row in torture.rows)


def test_a_reader_notices_changed_bytes(script: ModuleType, tmp_path: Path) -> None:
    made = script.Materials(tmp_path, 6)
    with script.Reader(made.known) as reader:
        reader.open(made.start, made.own)
        assert reader.check() == 1
        with (made.start / "segments" / "000001.f32").open("r+b") as file:
            file.seek(100)
            file.write(b"changed")
        with pytest.raises(script.WrongError, match="damaged"):
            reader.check()


def test_leftovers_are_noticed(script: ModuleType, tmp_path: Path) -> None:
    start = script.Materials(tmp_path, 6).start
    script.check_nothing_left(start)
    (start / "segments" / "000002.f32").write_bytes(b"")
    with pytest.raises(script.WrongError, match="left segments"):
        script.check_nothing_left(start)


def test_exchanged_files_are_noticed(torture: Any) -> None:
    torture.rows.clear()
    torture.run("swap", 3)
    (row,) = torture.rows
    assert (row.faults, row.rounds) == ([], 3)


def test_losses_and_damage_are_noticed(script: ModuleType, tmp_path: Path) -> None:
    """A removed clip and a changed byte make the comparison fail."""
    made = script.Materials(tmp_path, 6)
    known, start = made.known, made.start
    assert script.contents(start, known) == made.own
    with PriorDatabase.open(start, write=True) as database:
        gone, *_ = database.clips()
        database.remove([gone])
    assert set(made.own) - set(script.contents(start, known)) == {gone.name}
    segment = start / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[(gone.offset + gone.nbytes + 8) % len(data)] ^= 1
    segment.write_bytes(data)
    with pytest.raises(script.WrongError, match="damaged"):
        script.contents(start, known)


def test_an_undisturbed_plan(torture: Any) -> None:
    """An undisturbed plan gives the content it predicts."""
    torture.rows.clear()
    torture.run("none", 1)
    (row,) = torture.rows
    assert (row.faults, row.disturbed) == ([], 0)


def test_a_replaced_catalogue_leaves_no_unfinished_checksum(
    script: ModuleType, tmp_path: Path
) -> None:
    """Its writer could not rename the checksum file, or was killed before."""
    start = script.Materials(tmp_path, 6).start
    (start / "catalogue.checksum.new").write_bytes(b"unfinished")
    with PriorDatabase.open(start, write=True) as database:
        database.remove(database.clips()[:1])
        database.compact()
    assert sorted(path.name for path in start.glob("catalogue*")) == [
        "catalogue-2.checksum",
        "catalogue-2.sqlite",
    ]
