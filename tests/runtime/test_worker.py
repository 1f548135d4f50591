"""Work in a process that may crash, hang or eat memory, and files that are read in one."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from db_cli import run, write_clip

from priorfill.cli import batch
from priorfill.runtime.worker import (
    CRASH,
    DONE,
    HANG,
    MEMORY,
    RAISED,
    Worker,
)


def test_limits():
    """What hangs is ended, what eats memory is refused, and the next item is done."""
    with Worker(time.sleep, seconds=0.3, memory=2**28) as worker:
        assert worker.do(0).kind == DONE
        assert worker.do(60) == (HANG, "took more than 0.3 s")
        assert worker.do(0).kind == DONE
        kind, value = worker.do("x")
        assert kind == RAISED
        assert value.startswith("TypeError at worker.py")
    with Worker(bytes, seconds=60, memory=2**28) as worker:
        assert worker.do(2**29).kind == MEMORY
        assert worker.do(2**10) == (DONE, bytes(2**10))
    with Worker(os._exit, seconds=60, memory=2**28) as worker:
        assert worker.do(3) == (CRASH, "exit status 3")


def evil_reader(item):
    """Read a file whose name says what its contents make a reader do."""
    path, _ = item
    if path.stem == "crash":
        os.abort()
    if path.stem == "hang":
        time.sleep(60)
    if path.stem == "fault":
        raise ZeroDivisionError("by 0")
    if path.stem == "eat":
        return bytes(1 << 50)
    return batch.read_apart(item)


def evil_files(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    for seed, name in enumerate(["a", "crash", "b", "hang", "fault", "eat", "z"]):
        write_clip(Path(f"{name}.c3d"), seed)
    Path("bad.c3d").write_bytes(b"rubbish")
    monkeypatch.setattr(batch, "read_apart", evil_reader)
    monkeypatch.setattr(batch, "PATIENCE", 2.0)
    return ["a.c3d", "crash.c3d", "b.c3d", "hang.c3d", "fault.c3d", "eat.c3d", "bad.c3d", "z.c3d"]


def test_one_file_cannot_stop_the_others(here, monkeypatch):
    files = evil_files(monkeypatch)
    result = run("db", "add", "-d", "db", *files)
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        *("added a.c3d", "added b.c3d", "added z.c3d"),
        "added 3 clips (3.00 s), could not add 5",
    ]
    errors = result.stderr.splitlines()
    assert [error.split(": ")[1] for error in errors] == [
        *("crash.c3d", "hang.c3d", "fault.c3d", "eat.c3d", "bad.c3d"),
    ]
    assert "crashed (signal 6)" in errors[0]
    assert "reading took more than 2.01 s and was ended" in errors[1]
    assert "ZeroDivisionError" in errors[2]
    assert "needs more memory than there is" in errors[3]
    assert "is not a C3D file" in errors[4]


def test_an_evaluation_goes_on_with_the_others(here):
    write_clip(here / "a.c3d", 1)
    (here / "bad.c3d").write_bytes(b"rubbish")
    common = ["-m", "linear", "--copies", "1", "-j", "0"]
    result = run("evaluate", "bad.c3d", "a.c3d", *common)
    assert result.exit_code == 1
    assert result.stderr.startswith("priorfill: bad.c3d: ")
    assert "of 1 clip;" in result.stdout
    result = run("evaluate", "bad.c3d", "bad.c3d", *common)
    assert (result.exit_code, result.stdout) == (1, "")
    assert "none of the 2 files can be read" in result.stderr
