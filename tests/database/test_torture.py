"""A few rounds of scripts/checks/torture_database.py: nothing is lost."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from scripted import load_script

FILES = 24
ROUNDS = 1
"""Rounds of each kind; the script itself runs hundreds."""


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("torture_database")


@pytest.fixture(scope="module")
def torture(script: ModuleType, in_memory: Path) -> Any:
    return script.Torture(in_memory, seed=7, files=FILES, mounts=False, forks=True)


@pytest.mark.parametrize("kind", ["kill", "term", "hup", "full", "fsync"])
def test_nothing_is_lost(torture: Any, kind: str) -> None:
    torture.rows.clear()
    torture.run(kind, ROUNDS)
    assert [fault for row in torture.rows for fault in row.faults] == []
    assert all(row.rounds == ROUNDS for row in torture.rows if not row.skipped)
    assert sum(row.found for row in torture.rows) > 0


def test_exchanged_files_are_noticed(torture: Any) -> None:
    torture.rows.clear()
    torture.run("swap", 6)
    (row,) = torture.rows
    assert (row.faults, row.rounds) == ([], 6)


def test_losses_and_damage_are_noticed(script: ModuleType, tmp_path: Path) -> None:
    """A removed clip and a changed byte make the comparison fail."""
    torture = script.Torture(tmp_path, files=FILES, mounts=False, forks=True)
    known, start = torture.known, tmp_path / "start"
    assert script.contents(start, known) == torture.own
    with script.PriorDatabase.open(start, write=True) as database:
        gone, *_ = database.clips()
        database.remove([gone])
    assert set(torture.own) - set(script.contents(start, known)) == {gone.name}
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
