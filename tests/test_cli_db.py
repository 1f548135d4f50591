"""``priorfill db`` and the group itself: output, exit status, what is left on disk."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.formats import write


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def write_clip(path: Path, seed: int = 0, frames: int = 120, amplitude: float = 200.0) -> Path:
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / 120
    place = rng.uniform(200, 900, (1, 4, 3))
    swing = amplitude * np.sin(2 * np.pi * rng.uniform(0.5, 2, (1, 4, 3)) * t)
    path.parent.mkdir(parents=True, exist_ok=True)
    write(path, Clip(place + swing, ("LASI", "RASI", "SACR", "C7"), 120.0, name=path.stem))
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in a folder of its own, so that messages have short paths."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PRIORFILL_DEBUG", raising=False)
    return tmp_path


def test_add_list_info_verify(here: Path) -> None:
    write_clip(here / "clips" / "walk.c3d", 1)
    write_clip(here / "clips" / "deep" / "run.C3D", 2)
    (here / "clips" / "notes.txt").write_text("not a clip")
    write_clip(here / "jump.c3d", 3)

    result = run("db", "add", "--database", "db", "--subject", "anna", "--licence", "CC0", "clips")
    assert (result.exit_code, result.output) == (0, "added 2 clips (2.00 s)\n")
    result = run("db", "add", "-d", "db", "--credit", "me", "--session", "2", "clips", "jump.c3d")
    assert result.exit_code == 0
    assert result.output == (
        "skipped clips/deep/run.C3D: is in the database already (as run); nothing to do\n"
        "skipped clips/walk.c3d: is in the database already (as walk); nothing to do\n"
        "added 1 clip (1.00 s), skipped 2 that are there already\n"
    )

    assert run("db", "list", "-d", "db").output == (
        "name  subject  session  marker set  markers     s   Hz  licence\n"
        "jump  -        2        -                 4  1.00  120  -\n"
        "run   anna     -        -                 4  1.00  120  CC0\n"
        "walk  anna     -        -                 4  1.00  120  CC0\n"
    )
    listed = json.loads(run("db", "list", "-d", "db", "--json").output)
    assert [clip["name"] for clip in listed] == ["jump", "run", "walk"]
    jump = listed[0]
    assert len(jump.pop("content")) == 64
    assert jump.pop("added").endswith("+00:00")
    assert jump.pop("version")
    assert jump == {
        "name": "jump",
        "subject": "",
        "session": "2",
        "source": "jump.c3d",
        "licence": "",
        "credit": "me",
        "original_rate": 120.0,
        "rate": 30.0,
        "frames": [30, 15, 8],
        "labels": ["LASI", "RASI", "SACR", "C7"],
        "marker_set": "",
        "has_filled": False,
        "synthetic": False,
        "seconds": 1.0,
        "bytes": 53 * 4 * 12,
    }

    lines = run("db", "info", "-d", "db").output.splitlines()
    assert lines[:-1] == [
        "database     db",
        "format       version 1",
        "clips        3",
        "subjects     1",
        "length       3.00 s, 90 frames at 30 Hz",
        "levels       30, 15, 7.5 Hz",
        "marker sets  not known (3)",
    ]
    facts = json.loads(run("db", "info", "-d", "db", "--json").output)
    assert facts["clips"] == 3
    assert facts["marker_sets"] == {"": 3}
    assert facts["path"] == "db"

    result = run("db", "verify", "-d", "db")
    assert (result.exit_code, result.output) == (
        0,
        "3 clips checked, all are as they were added\n",
    )


def test_what_cannot_be_added_is_reported_and_the_others_go_on(here: Path) -> None:
    write_clip(here / "good.c3d")
    write_clip(here / "still.c3d", amplitude=1.0)
    (here / "bad.c3d").write_bytes(b"rubbish")
    (here / "empty").mkdir()
    result = run(
        "db", "add", "-d", "db", "no.c3d", "empty", "bad.c3d", "still.c3d", "good.c3d", "good.c3d"
    )
    assert result.exit_code == 1
    assert result.stdout == "added 1 clip (1.00 s), could not add 4\n"
    errors = result.stderr.splitlines()
    assert errors[0] == "priorfill: no.c3d: there is no such file or folder; check the name"
    assert errors[1] == "priorfill: empty: has no files that can be read (.c3d)"
    assert errors[2].startswith("priorfill: bad.c3d: ")
    assert errors[3] == (
        "priorfill: still.c3d: is static (no marker moves by 10 mm); add clips with motion"
    )
    assert len(errors) == 4


def test_nothing_to_add_makes_nothing(here: Path) -> None:
    result = run("db", "add", "-d", "db", "no.c3d")
    assert result.exit_code == 1
    assert not (here / "db").exists()


def test_a_folder_with_other_files_stays_as_it_is(here: Path) -> None:
    write_clip(here / "clips" / "good.c3d")
    result = run("db", "add", "-d", "clips", "clips/good.c3d")
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: clips: has other files in it (good.c3d); "
        "give an empty or a new folder for a new database\n"
    )
    assert [path.name for path in (here / "clips").iterdir()] == ["good.c3d"]


def test_verify_names_the_damaged_clip(here: Path) -> None:
    run("db", "add", "-d", "db", write_clip(here / "a.c3d", 1), write_clip(here / "b.c3d", 2))
    segment = here / "db" / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[10] ^= 4
    segment.write_bytes(bytes(data))
    result = run("db", "verify", "-d", "db")
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: db: positions of clip a are damaged (level 0); "
        "restore the database from a copy\n"
    )


def test_empty_database(here: Path) -> None:
    PriorDatabase.create("db").close()
    assert run("db", "list", "-d", "db").output == "db: the database has no clips\n"
    assert json.loads(run("db", "list", "-d", "db", "--json").output) == []
    assert "clips        0\n" in run("db", "info", "-d", "db").output
    assert run("db", "verify", "-d", "db").exit_code == 0


@pytest.mark.parametrize("command", ["list", "info", "verify"])
def test_no_database(command: str, here: Path) -> None:
    result = run("db", command, "--database", "no")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr == (
        "priorfill: no: there is no database; make one with: priorfill db add --database no ...\n"
    )
    result = run("db", command, "--database", ".")
    assert result.exit_code == 1
    assert "is not a priorfill database" in result.stderr
    assert run("db", command).exit_code == 2  # --database is missing


# --- the group -------------------------------------------------------------------------------


def test_help_and_version() -> None:
    result = run("--help")
    assert result.exit_code == 0
    for command in ("fill", "inspect", "db", "demo"):
        assert f"\n  {command} " in result.output
    assert run("--version").output == "priorfill 0.1.0\n"
    assert run("nonsense").exit_code == 2


def test_help_imports_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "from priorfill.cli import main\n"
        "for line in (['--help'], ['db', 'add', '--help'], ['inspect', '--help']):\n"
        "    try:\n"
        "        main(line)\n"
        "    except SystemExit as end:\n"
        "        assert end.code == 0\n"
        "heavy = {'numpy', 'scipy', 'numba', 'ezc3d', 'rich'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (PermissionError(13, "Permission denied", "x.c3d"), 1, "x.c3d: Permission denied"),
        (OSError(28, "No space left on device"), 1, "No space left on device"),
        (FileNotFoundError("two\nlines"), 1, "priorfill: two lines"),
        (MemoryError(), 1, "there is not enough memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ZeroDivisionError("oops"), 1, "(ZeroDivisionError: oops); please report"),
    ],
)
def test_errors_are_one_line(
    error: BaseException, status: int, text: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(PriorDatabase, "open", fail)
    result = run("db", "info", "-d", "db")
    assert result.exit_code == status
    assert result.stdout == ""
    assert result.stderr.startswith("priorfill: ")
    assert text in result.stderr
    assert result.stderr.count("\n") == 1
    monkeypatch.setenv("PRIORFILL_DEBUG", "1")
    again = run("db", "info", "-d", "db")
    assert again.exit_code == 1
    assert again.exception is error or isinstance(error, KeyboardInterrupt)


def test_broken_pipe_is_quiet(here: Path) -> None:
    PriorDatabase.create("db").close()
    script = (
        "import sys; from priorfill.cli import main; import click\n"
        "click.echo = lambda *a, **k: (_ for _ in ()).throw(BrokenPipeError())\n"
        "main(['db', 'info', '-d', 'db'])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (141, b"", b"")


def test_progress_is_silent_off_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    from priorfill.cli.progress import progress

    with progress(3, "Working") as show:
        show(1, None)
        show(3, 3)
    assert capsys.readouterr() == ("", "")


def test_progress_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from priorfill.cli.progress import progress

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with progress(None, "Work [1/2]") as show:
        show(1, 3)
        show(3, None)
    out, err = capsys.readouterr()
    assert out == ""
    assert "Work [1/2]" in err
    assert "3/3" in err


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0, "0.00 s"),
        (59.94, "59.94 s"),
        (60, "1 min 00 s"),
        (3599.6, "1 h 00 min"),
        (7980, "2 h 13 min"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    from priorfill.cli.output import duration

    assert duration(seconds) == text


def test_commands_are_click_commands() -> None:
    with click.Context(main) as context:
        for name in ("db", "inspect"):
            assert isinstance(main.get_command(context, name), click.Command)
        assert main.get_command(context, "nonsense") is None
