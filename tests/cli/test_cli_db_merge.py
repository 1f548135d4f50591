"""``priorfill db merge``."""

from __future__ import annotations

from pathlib import Path

import pytest
from db_cli import gappy_and_filled, run, small_clip

from priorfill.database import ClipOrigin, ClipRecord, PriorDatabase


def make(place: str, *seeds: int, **options: float) -> None:
    with PriorDatabase.create(place, **options) as database:
        for seed in seeds:
            database.add(small_clip(f"clip{seed}", seed, subject="anna"), ClipOrigin(licence="CC0"))


def clips(place: str) -> list[ClipRecord]:
    with PriorDatabase.open(place) as database:
        return sorted(database.clips(), key=lambda record: record.name)


def test_merge(here: Path) -> None:
    make("a", 1, 2)
    make("b", 2, 3)
    make("c", 4)
    result = run("db", "merge", "-d", "a", "b", "c")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == (
        "b: added 1 clip, 1.00 s of motion, skipped 1 that is there already\n"
        "c: added 1 clip, 1.00 s of motion\n"
    )
    assert [record.name for record in clips("a")] == ["clip1", "clip2", "clip3", "clip4"]
    assert {record.licence for record in clips("a")} == {"CC0"}
    assert [record.name for record in clips("b")] == ["clip2", "clip3"]
    assert run("db", "verify", "-d", "a").exit_code == 0


@pytest.mark.parametrize("is_empty_folder", [False, True])
def test_into_a_new_one(is_empty_folder: bool, here: Path) -> None:
    """It gets the rate and the levels of the first."""
    make("b", 1, rate=40.0, levels=2)
    if is_empty_folder:
        (here / "a").mkdir()
    assert run("db", "merge", "-d", "a", "b").exit_code == 0
    assert [record.rate for record in clips("a")] == [40.0]


def test_filled_samples_stay_filled(here: Path) -> None:
    gappy, filled, mask = gappy_and_filled(small_clip())
    with PriorDatabase.create("a") as database:
        database.add(gappy)
    with PriorDatabase.create("b") as database:
        database.accept(filled, mask, filled_by="gpr")
    run("db", "merge", "-d", "a", "b")
    (record,) = clips("a")
    assert record.measured == (30, 30, 30, 20)


def test_other_levels(here: Path) -> None:
    make("a", 1)
    make("b", 2, rate=40.0)
    result = run("db", "merge", "-d", "a", "b")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "b: has 3 levels from 40 Hz on" in result.stderr
    assert result.stderr.count("\n") == 1


def test_nothing_is_merged_if_one_is_wrong(here: Path) -> None:
    make("a", 1)
    make("b", 2)
    for line, text in (
        (["b", "no"], "no: there is no database"),
        (["b", "a"], "a: is the database to merge into; leave it out"),
        (["b", "../" + here.name + "/a"], "is the database to merge into; leave it out"),
    ):
        result = run("db", "merge", "-d", "a", *line)
        assert result.exit_code == 2
        assert result.stdout == ""
        assert text in result.stderr
    assert len(clips("a")) == 1
    assert run("db", "merge", "-d", "new", "no").exit_code == 2
    assert not (here / "new").exists()
    assert run("db", "merge", "-d", "a").exit_code == 2


def test_a_damaged_clip_is_left_out(here: Path) -> None:
    make("a", 1)
    make("b", 2, 3)
    segment = here / "b" / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[100] ^= 4  # behind the header
    segment.write_bytes(bytes(data))
    result = run("db", "merge", "-d", "a", "b")
    assert result.exit_code == 1
    assert result.stdout == "b: added 1 clip, 1.00 s of motion, left out 1 damaged\n"
    assert result.stderr.startswith("priorfill: b: positions of clip clip2 are damaged")
    assert [record.name for record in clips("a")] == ["clip1", "clip3"]
