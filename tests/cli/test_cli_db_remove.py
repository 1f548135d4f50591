"""``priorfill db remove`` and ``db compact``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from db_cli import run, small_clip

from priorfill.database import PriorDatabase
from priorfill.database.segments import HEADER_BYTES


@pytest.fixture
def ids(here: Path) -> dict[tuple[str, str], str]:
    """A database `db`; the first digits of its clips' hashes, by name and subject."""
    with PriorDatabase.create("db") as database:
        for seed, (name, subject) in enumerate(
            [("walk1", "anna"), ("walk2", "anna"), ("walk1", "ben"), ("run[1]", "")]
        ):
            database.add(small_clip(name, seed, subject=subject))
        return {(r.name, r.subject): r.content[:8] for r in database.clips()}


def left() -> list[tuple[str, str]]:
    with PriorDatabase.open("db") as database:
        return sorted((record.name, record.subject) for record in database.clips())


def test_by_name(ids: dict[tuple[str, str], str]) -> None:
    result = run("db", "remove", "-d", "db", "walk1")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == (
        f"removed walk1 (anna, 1.00 s, {ids['walk1', 'anna']})\n"
        f"removed walk1 (ben, 1.00 s, {ids['walk1', 'ben']})\n"
        "removed 2 clips, 2.00 s of motion\n"
    )
    assert left() == [("run[1]", ""), ("walk2", "anna")]
    assert run("db", "verify", "-d", "db").exit_code == 0


def test_by_pattern_subject_and_id(ids: dict[tuple[str, str], str]) -> None:
    assert run("db", "remove", "-d", "db", "--subject", "b*", "walk*").exit_code == 0
    assert left() == [("run[1]", ""), ("walk1", "anna"), ("walk2", "anna")]
    result = run("db", "remove", "-d", "db", ids["run[1]", ""], "walk2")
    assert f"removed run[1] (1.00 s, {ids['run[1]', '']})\n" in result.stdout
    assert left() == [("walk1", "anna")]
    assert run("db", "remove", "-d", "db", "--subject", "anna").exit_code == 0
    assert left() == []


def test_dry_run(ids: dict[tuple[str, str], str]) -> None:
    before = {path: path.read_bytes() for path in Path("db").rglob("*") if path.is_file()}
    result = run("db", "remove", "-d", "db", "--dry-run", "walk*")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0].startswith("would remove walk1 (anna, 1.00 s, ")
    assert lines[3:] == ["would remove 3 clips, 3.00 s of motion"]
    assert before == {path: path.read_bytes() for path in Path("db").rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["walk1", "jump"], "db: no clip is called jump"),
        (["Walk1"], "db: no clip is called Walk1"),
        (["--subject", "ben", "walk2"], "db: no clip of subject ben is called walk2"),
        (["--subject", "c*"], "db: has no clip of subject c*"),
        (["0123456789"], "db: no clip is called 0123456789"),
    ],
)
def test_a_name_without_a_match_removes_nothing(
    arguments: list[str], text: str, ids: object
) -> None:
    result = run("db", "remove", "-d", "db", *arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"priorfill: {text}; see: priorfill db list --database db\n"
    assert len(left()) == 4


def test_nothing_named(ids: object) -> None:
    result = run("db", "remove", "-d", "db")
    assert result.exit_code == 2
    assert "name the clips: NAME... or --subject PATTERN" in result.stderr
    assert len(left()) == 4


def test_locked(ids: object) -> None:
    with PriorDatabase.open("db", write=True):
        for line in (["remove", "walk1"], ["compact"]):
            result = run("db", *line, "-d", "db")
            assert result.exit_code == 1
            assert "is writing to this database" in result.stderr
        assert run("db", "remove", "-d", "db", "walk1", "--dry-run").exit_code == 0


def test_compact(ids: object) -> None:
    assert run("db", "compact", "-d", "db").stdout == "nothing to free\n"
    size = sum(path.stat().st_size for path in Path("db/segments").iterdir())
    run("db", "remove", "-d", "db", "walk*")
    with PriorDatabase.open("db") as reader:
        (record,) = reader.clips()
        positions = reader.positions(record)
        result = run("db", "compact", "-d", "db")
        # Windows keeps what the reader has mapped until the next command that writes
        freed = "0 bytes" if sys.platform == "win32" else "7.7 kB"
        assert (result.exit_code, result.stdout) == (0, f"{freed} freed\n")
        assert (reader.positions(record) == positions).all()
    if sys.platform == "win32":
        run("db", "compact", "-d", "db")
    left = sum(path.stat().st_size for path in Path("db/segments").iterdir())
    assert left - HEADER_BYTES == (size - HEADER_BYTES) / 4
    assert run("db", "verify", "-d", "db").stdout.startswith("1 clip checked")
    assert run("db", "compact", "-d", "db").stdout == "nothing to free\n"
