"""``priorfill db add``: what is added and reported, and what stops it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_bytes import LABELS, C3DFile, standing
from click.testing import Result
from db_cli import gappy_and_filled, run, small_clip, with_residuals, write_clip

from priorfill.database import PriorDatabase
from priorfill.errors import DatabaseError
from priorfill.formats import SUFFIXES, read, write

READ = ", ".join(SUFFIXES)


def names(place: str | Path = "db") -> list[str]:
    with PriorDatabase.open(place) as database:
        return sorted(record.name for record in database.clips())


def test_files_and_folders(here: Path) -> None:
    write_clip(here / "clips" / "walk.c3d", 1)
    write_clip(here / "clips" / "deep" / "run.C3D", 2)
    (here / "clips" / "notes.txt").write_text("not a clip")
    (here / "clips" / "._walk.c3d").write_bytes(b"of another program")
    (here / "clips" / "folder.c3d").mkdir()
    write_clip(here / "jump.c3d", 3)

    result = run(
        "db", "add", "-v", "--database", "db", "--subject", "anna", "--licence", "CC0", "clips"
    )
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == (
        f"added {Path('clips/deep/run.C3D')}\nadded {Path('clips/walk.c3d')}\n"
        "added 2 clips, 2.00 s of motion\n"
    )
    result = run(
        "db", "add", "-v", "-d", "db", "--credit", "me", "--session", "2", "clips", "jump.c3d"
    )
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == (
        f"skipped {Path('clips/deep/run.C3D')}: is in the database already (as run); nothing to do"
        "\n"
        f"skipped {Path('clips/walk.c3d')}: is in the database already (as walk); nothing to do\n"
        "added jump.c3d\n"
        "added 1 clip, 1.00 s of motion, skipped 2 that are there already\n"
    )
    result = run("db", "add", "-v", "-d", "db", "jump.c3d")
    assert result.stdout.endswith("added 0 clips, skipped 1 that is there already\n")
    clips = json.loads(run("db", "list", "-d", "db", "--json").output)
    known = [
        tuple(clip[key] for key in ("name", "subject", "session", "licence", "credit", "source"))
        for clip in clips
    ]
    assert known == [
        ("jump", "", "2", "", "me", "jump.c3d"),
        ("run", "anna", "", "CC0", "", "run.C3D"),
        ("walk", "anna", "", "CC0", "", "walk.c3d"),
    ]


def test_patterns_that_the_shell_did_not_expand(here: Path) -> None:
    for seed, name in enumerate(["a/walk1.c3d", "a/walk2.c3d", "a/run1.c3d", "b/c/walk3.c3d"]):
        write_clip(here / name, seed)
    write_clip(here / "walk[1].c3d", 9)
    result = run("db", "add", "-v", "-d", "db", "a/walk?.c3d", "**/walk3.*", "walk[1].c3d")
    assert result.exit_code == 0
    assert names() == ["walk1", "walk2", "walk3", "walk[1]"]
    result = run("db", "add", "-v", "-d", "all", str(here / "*"))
    assert result.exit_code == 1  # the pattern also matches the database
    assert result.stderr == f"priorfill: {here / 'db'}: has no files that can be read ({READ})\n"
    assert len(names("all")) == 5
    result = run("db", "add", "-v", "-d", "db", "jump*.c3d")
    assert result.exit_code == 2
    assert result.stderr == (
        "priorfill: jump*.c3d: no file or folder matches this pattern; check it\n"
    )


def test_files_that_cannot_be_added_are_reported(here: Path) -> None:
    write_clip(here / "good.c3d")
    write_clip(here / "still.c3d", amplitude=1.0)
    (here / "bad.c3d").write_bytes(b"rubbish")
    (here / "empty").mkdir()
    result = run(
        "db",
        "add",
        "-v",
        "-d",
        "db",
        "empty",
        "bad.c3d",
        "still.c3d",
        "good.c3d",
        "good.c3d",
    )
    assert result.exit_code == 1
    assert result.stdout == "added good.c3d\nadded 1 clip, 1.00 s of motion, could not add 3\n"
    errors = result.stderr.splitlines()
    assert errors[0] == f"priorfill: empty: has no files that can be read ({READ})"
    assert errors[1].startswith("priorfill: bad.c3d: ")
    assert errors[2] == (
        "priorfill: still.c3d: is static (no marker moves by 10 mm); add clips with motion"
    )
    assert len(errors) == 3


def test_what_cannot_be_read_costs_itself(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that cannot be searched, a link without contents; permissions are not asked for."""
    write_clip(here / "good.c3d")
    for folder in ("in/closed", "in/.hidden"):
        (here / folder).mkdir(parents=True)
        (here / folder / "x.c3d").write_bytes(b"rubbish")
    scandir = os.scandir

    def scan(path: str) -> os._ScandirIterator:
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr("os.scandir", scan)
    monkeypatch.setattr("os.access", lambda path, mode, **how: mode != os.R_OK)
    result = run("db", "add", "-d", "db", "good.c3d", "in", "x" * 300)
    assert result.exit_code == 1
    assert result.stdout == "added 1 clip, 1.00 s of motion, could not add 2\n"
    errors = result.stderr.splitlines()
    closed = Path("in", "closed")
    assert errors[0] == (
        f"priorfill: {closed}: cannot be searched (Permission denied); check its permissions"
    )
    assert errors[1].startswith("priorfill: xxx")
    assert len(errors) == 2


def test_matlab_files_that_are_not_read_are_named(here: Path) -> None:
    write_clip(here / "in" / "good.c3d")
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    (here / "in" / "new.mat").write_bytes(text.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n")
    result = run("db", "add", "-d", "db", "in")
    assert result.exit_code == 1
    assert "added 1 clip" in result.stdout
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"priorfill: {Path('in', 'new.mat')}: is a MATLAB file of version 7.3")


def test_nothing_is_created_without_clips(here: Path) -> None:
    (here / "bad.c3d").write_bytes(b"rubbish")
    result = run("db", "add", "-v", "-d", "db", "bad.c3d")
    assert result.exit_code == 1
    assert not (here / "db").exists()


def test_a_folder_with_other_files_is_not_changed(here: Path) -> None:
    write_clip(here / "clips" / "good.c3d")
    result = run("db", "add", "-v", "-d", "clips", "clips/good.c3d")
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: clips: contains other files (good.c3d); "
        "give an empty or a new folder for a new database\n"
    )
    assert [path.name for path in (here / "clips").iterdir()] == ["good.c3d"]


def test_a_file_of_two_subjects(here: Path) -> None:
    records = np.concatenate([standing(120, seed=1), standing(120, seed=2)], axis=1)
    labels = [f"{who}:{label}" for who in ("Ben", "Anna") for label in LABELS]
    (here / "two.c3d").write_bytes(C3DFile(records, labels).bytes())
    result = run("db", "add", "-v", "-d", "db", "two.c3d")
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: two.c3d: holds 2 subjects (Anna, Ben); choose one (--subject)\n"
    )
    assert (
        run("db", "add", "-v", "-d", "db", "--subject", "carl", "two.c3d").stderr == result.stderr
    )
    assert run("db", "add", "-v", "-d", "db", "--subject", "Anna", "two.c3d").exit_code == 0
    assert run("db", "add", "-v", "-d", "db", "--subject", "Ben", "two.c3d").exit_code == 0
    clips = json.loads(run("db", "list", "-d", "db", "--json").output)
    assert [clip["subject"] for clip in clips] == ["Anna", "Ben"]


def test_options_for_reading(here: Path) -> None:
    records = standing(120)
    records[:, :, :3] /= 1000
    records[0, 0, :3] = 0
    (here / "odd.c3d").write_bytes(C3DFile(records, LABELS, rate=0.0).bytes())
    assert "(--unit m)" in run("db", "add", "-v", "-d", "db", "odd.c3d").stderr
    assert "(--rate)" in run("db", "add", "-v", "-d", "db", "--unit", "m", "odd.c3d").stderr
    # one frame at the origin is a spike
    options = ["--unit", "m", "--rate", "60", "--up", "+Z", "--keep-zeros", "--keep-artefacts"]
    assert run("db", "add", "-v", "-d", "db", *options, "odd.c3d").exit_code == 0
    (clip,) = json.loads(run("db", "list", "-d", "db", "--json").output)
    assert clip["original_rate"] == 60
    assert clip["present"][0] == clip["frames"][0]
    shutil.copy("odd.c3d", "odd2.c3d")
    # an invalid option concerns all files, and is reported once
    for option, value in (("--up", "sideways"), ("--unit", "parsec"), ("--rate", "-5")):
        rest = options if option == "--up" else []
        result = run("db", "add", "-v", "-d", "new", *rest, option, value, "odd.c3d", "odd2.c3d")
        assert result.exit_code == 2
        assert result.stderr.count(value) == 1
    assert not (here / "new").exists()


def test_interpolated_samples_are_not_measured(here: Path) -> None:
    _, filled, mask = gappy_and_filled(small_clip())
    with_residuals(here / "walk.c3d", filled, mask)
    assert run("db", "add", "-v", "-d", "db", "walk.c3d").exit_code == 0
    (clip,) = json.loads(run("db", "list", "-d", "db", "--json").output)
    assert clip["has_filled"]
    assert clip["measured"] == [30, 30, 30, 20]


def test_versions_of_a_recording_are_added_once(here: Path) -> None:
    gappy, filled, _ = gappy_and_filled(small_clip())
    write("gappy.c3d", gappy)
    write("filled.c3d", filled)
    assert run("db", "add", "-v", "-d", "db", "gappy.c3d").exit_code == 0
    result = run("db", "add", "-v", "-d", "db", "filled.c3d")
    assert result.exit_code == 0
    assert result.stdout.startswith("skipped filled.c3d: ")
    assert "priorfill db accept" in result.stdout
    assert names() == ["gappy"]


def add_until(error: BaseException, monkeypatch: pytest.MonkeyPatch, times: int = 2) -> Result:
    """Add 4 clips to a database that fails after some."""
    for number in range(4):
        write_clip(Path(f"{number}.c3d"), number)
    add, left = PriorDatabase.add, iter(range(times))

    def failing(*arguments: Any, **options: Any) -> Any:
        if next(left, None) is None:
            raise error
        return add(*arguments, **options)

    monkeypatch.setattr(PriorDatabase, "add", failing)
    return run("db", "add", "-v", "-d", "db", *(f"{number}.c3d" for number in range(4)))


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            OSError(28, "No space left on device"),
            "db: cannot be written (No space left on device); check free space and permissions",
        ),
        (OSError("odd"), "db: cannot be written (odd); check free space and permissions"),
        (
            DatabaseError("db/x: cannot be used now; try again"),
            "db/x: cannot be used now; try again",
        ),
    ],
)
def test_a_database_that_fails_stops_it(
    error: Exception, text: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = add_until(error, monkeypatch)
    assert result.exit_code == 1
    assert result.stdout == "added 0.c3d\nadded 1.c3d\n"
    assert result.stderr == f"priorfill: {text}; stopped at 2.c3d, 2 clips added before\n"
    monkeypatch.undo()
    os.chdir(here)
    assert names() == ["0", "1"]
    result = run("db", "add", "-v", "-d", "db", *(f"{number}.c3d" for number in range(4)))
    assert result.exit_code == 0
    assert names() == ["0", "1", "2", "3"]


def test_a_locked_database_stops_it(here: Path) -> None:
    write_clip(here / "a.c3d", 1)
    write_clip(here / "b.c3d", 2)
    with PriorDatabase.create("db"):
        result = run("db", "add", "-v", "-d", "db", "a.c3d", "b.c3d")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert "is writing to this database; wait until it has ended\n" in result.stderr
    assert result.stderr.count("\n") == 1


def test_interrupted(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = add_until(KeyboardInterrupt(), monkeypatch, times=1)
    assert result.exit_code == 130
    assert result.stdout == "added 0.c3d\n"
    assert result.stderr == "priorfill: interrupted\n"
    assert names() == ["0"]


def test_a_file_that_may_not_be_read(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_clip(here / "a.c3d", 1)
    write_clip(here / "b.c3d", 2)

    def refuse(path: Path, **options: object) -> object:
        if path.name == "a.c3d":
            raise PermissionError(13, "Permission denied")
        return read(path, **options)

    monkeypatch.setattr("priorfill.formats.read", refuse)
    result = run("db", "add", "-v", "-d", "db", "a.c3d", "b.c3d")
    assert result.exit_code == 1
    assert result.stderr == "priorfill: a.c3d: cannot be read (Permission denied)\n"
    assert result.stdout == "added b.c3d\nadded 1 clip, 1.00 s of motion, could not add 1\n"


PROGRAM = (
    "import signal\n"
    # shells start background processes with this signal ignored
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from priorfill.cli import main; main()"
)


CLIPS = 100
"""More clips than are added before the signal arrives."""


@pytest.mark.parametrize(
    "how",
    [
        "kill",
        pytest.param(
            "interrupt",
            marks=pytest.mark.skipif(
                sys.platform == "win32", reason="Windows interrupts all processes of a console"
            ),
        ),
    ],
)
def test_every_reported_clip_is_in_the_database(how: str, here: Path) -> None:
    """However the process ends: once its line is out, a clip is on the disk."""
    for number in range(CLIPS):
        write_clip(here / "clips" / f"{number:03}.c3d", number)
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "db", "add", "-v", "-d", "db", "clips"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(5)]
    if how == "kill":
        process.kill()
    else:
        process.send_signal(signal.SIGINT)
    rest, errors = process.communicate()
    lines += rest.splitlines(keepends=True)
    reported = [line.split()[1] for line in lines if line.endswith(".c3d\n")]
    assert lines[0] == f"added {Path('clips/000.c3d')}\n"
    assert len(reported) >= 5
    assert set(names()) >= {Path(name).stem for name in reported}
    if how == "interrupt" and len(reported) < CLIPS:  # otherwise it finished before the signal
        assert (process.returncode, errors) == (130, "priorfill: interrupted\n")
    assert run("db", "verify", "-d", "db").exit_code == 0


def test_results_go_to_stdout_despite_a_progress_bar(
    here: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A bar on the terminal must not divert the lines meant for a file or a pipe."""
    from priorfill.cli import main, progress

    write_clip(here / "a.c3d", 1)
    monkeypatch.setattr(progress, "WINDOWS", False)  # where both must be terminals
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    main(["db", "add", "-v", "-d", "db", "a.c3d"], standalone_mode=False)
    out, err = capfd.readouterr()
    assert out == "added a.c3d\nadded 1 clip, 1.00 s of motion\n"
    assert "Adding clips" in err


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ZeroDivisionError("by 0"), "bug in priorfill (ZeroDivisionError: by 0)"),
        (MemoryError(), "needs more memory than is available"),
    ],
)
def test_a_file_that_breaks_its_parser_does_not_stop_the_others(
    error: BaseException, words: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed, name in enumerate(["a", "b", "c"]):
        write_clip(here / f"{name}.c3d", seed)

    def failing(path: Path, **options: object) -> object:
        if path.name == "b.c3d":
            raise error
        return read(path, **options)

    monkeypatch.setattr("priorfill.formats.read", failing)
    result = run("db", "add", "-v", "-d", "db", "a.c3d", "b.c3d", "c.c3d")
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        *("added a.c3d", "added c.c3d"),
        "added 2 clips, 2.00 s of motion, could not add 1",
    ]
    assert result.stderr.startswith("priorfill: b.c3d: ")
    assert words in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_evaluation_goes_on_with_the_other_files(here: Path) -> None:
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
