"""``priorfill db list``, ``info`` and ``verify``, and the group of all commands."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import click
import pytest
from db_cli import gappy_and_filled, run, small_clip, write_clip

from priorfill.cli import main
from priorfill.database import ClipOrigin, PriorDatabase


def make_database(place: Path) -> None:
    """A database of jump (no subject), run and walk (anna), and a filled walk (ben)."""
    with PriorDatabase.create(place) as database:
        database.add(small_clip("walk", 1, subject="anna"), ClipOrigin(licence="CC0"))
        database.add(small_clip("run", 2, frames=240, subject="anna"), ClipOrigin(session="2"))
        database.add(small_clip("jump", 3, labels=("LASI", "RASI", "SACR", "HEAD"), rate=60.0))
        _, filled, mask = gappy_and_filled(small_clip("walk", 4, subject="ben"))
        database.accept(filled, mask, filled_by="gpr")


def listed(*arguments: str) -> list[tuple[str, str]]:
    result = run("db", "list", "-d", "db", "--json", *arguments)
    assert result.exit_code == 0
    return [(clip["name"], clip["subject"]) for clip in json.loads(result.output)]


def test_list(here: Path) -> None:
    make_database(here / "db")
    with PriorDatabase.open(here / "db") as database:
        ids = {(record.name, record.subject): record.content[:8] for record in database.clips()}
        (date,) = {record.added[:10] for record in database.clips()}
    first, second = run("db", "list", "-d", "db").output.rstrip().split("\n\n")  # 80 columns
    rest = "-                 4"
    assert first.splitlines() == [
        "name  id        subject  session  marker set  markers     s   Hz  measured",
        f"jump  {ids['jump', '']}  -        -        {rest}  2.00   60   100.0 %",
        f"run   {ids['run', 'anna']}  anna     2        {rest}  2.00  120   100.0 %",
        f"walk  {ids['walk', 'anna']}  anna     -        {rest}  1.00  120   100.0 %",
        f"walk  {ids['walk', 'ben']}  ben      -        {rest}  1.00  120    91.7 %",
    ]
    assert second.splitlines() == [
        "name  added       licence",
        f"jump  {date}  -",
        f"run   {date}  -",
        f"walk  {date}  CC0",
        f"walk  {date}  -        filled: gpr",
    ]


def test_list_of_a_session_and_of_markers_in_any_case(here: Path) -> None:
    make_database(here / "db")
    assert listed("--session", "2") == [("run", "anna")]
    assert len(listed("--marker", "lasi,c7")) == 3
    assert listed("--marker", "LASI,LKNE") == []


def test_list_as_json(here: Path) -> None:
    make_database(here / "db")
    clips = json.loads(run("db", "list", "-d", "db", "--json").output)
    assert [clip["name"] for clip in clips] == ["jump", "run", "walk", "walk"]
    walk = clips[3]
    assert len(walk.pop("content")) == 64
    assert walk.pop("added").endswith("+00:00")
    assert walk.pop("version")
    assert walk == {
        "name": "walk",
        "subject": "ben",
        "session": "",
        "source": "",
        "licence": "",
        "credit": "",
        "original_rate": 120.0,
        "original_frames": 120,
        "rate": 30.0,
        "frames": [30, 15, 8],
        "labels": ["LASI", "RASI", "SACR", "C7"],
        "marker_set": "",
        "has_filled": True,
        "filled_by": "gpr",
        "present": [30, 30, 30, 30],
        "measured": [30, 30, 30, 20],
        "synthetic": False,
        "virtual_markers": False,
        "seconds": 1.0,
        "bytes": 53 * 4 * 12,
    }
    assert clips[0]["has_filled"] is False


def test_list_some(here: Path) -> None:
    make_database(here / "db")
    content = json.loads(run("db", "list", "-d", "db", "--json").output)[3]["content"]
    assert listed("--name", "walk") == [("walk", "anna"), ("walk", "ben")]
    assert listed("--name", "*u*") == [("jump", ""), ("run", "anna")]
    assert listed("--name", "run", "--name", "jump") == [("jump", ""), ("run", "anna")]
    assert listed("--name", content[:8]) == [("walk", "ben")]
    assert listed("--subject", "a*") == [("run", "anna"), ("walk", "anna")]
    assert listed("--subject", "") == [("jump", "")]
    assert listed("--subject", "ben", "--name", "walk") == [("walk", "ben")]
    assert listed("--marker", "HEAD") == [("jump", "")]
    assert listed("--marker", "HEAD", "--marker", "C7") == []
    assert run("db", "list", "-d", "db", "--name", "Walk").output == "db: no clip of 4 matches\n"


def test_info_and_verify(here: Path) -> None:
    make_database(here / "db")
    lines = run("db", "info", "-d", "db").output.splitlines()
    assert lines[:-1] == [
        "database     db",
        "format       version 3",
        "clips        4",
        "subjects     2",
        "length       6.00 s, 180 frames at 30 Hz",
        "levels       30, 15, 7.5 Hz",
        "marker sets  unknown (4)",
        "licence      none (3)",
        "licence      CC0 (1)",
    ]
    facts = json.loads(run("db", "info", "-d", "db", "--json").output)
    assert facts["clips"] == 4
    assert facts["marker_sets"] == {"": 4}
    assert facts["path"] == "db"

    result = run("db", "verify", "-d", "db")
    assert (result.exit_code, result.output) == (
        0,
        "4 clips checked, no damage found\n",
    )


def test_verify_names_the_damaged_clip(here: Path) -> None:
    run("db", "add", "-d", "db", write_clip(here / "a.c3d", 1), write_clip(here / "b.c3d", 2))
    segment = here / "db" / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[100] ^= 4  # behind the header
    segment.write_bytes(bytes(data))
    result = run("db", "verify", "-d", "db")
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: db: positions of clip a are damaged (level 0); "
        "restore the database from a copy, or remove the clip\n"
    )


def test_a_damaged_row_is_named(here: Path) -> None:
    make_database(here / "db")
    with closing(sqlite3.connect("db/catalogue.sqlite")) as connection, connection:
        connection.execute("UPDATE clips SET licence = 'none' WHERE name = 'run'")
    text = (
        "priorfill: db: the catalogue's row of clip run is damaged, so it is left out; "
        "restore the database from a copy\n"
    )
    result = run("db", "list", "-d", "db", "--json")
    assert (result.exit_code, result.stderr) == (0, text)
    assert len(json.loads(result.stdout)) == 3
    result = run("db", "export", "-d", "db", "-o", "out", "--measured-only")
    assert (result.exit_code, result.stderr) == (1, text)
    assert result.stdout.endswith("exported 3 clips, 4.00 s of motion, could not export 1\n")
    result = run("db", "verify", "-d", "db")
    assert result.exit_code == 1
    assert "row of clip run is damaged" in result.stderr
    assert run("db", "remove", "-d", "db", "walk").exit_code == 1


def test_empty_database(here: Path) -> None:
    PriorDatabase.create("db").close()
    assert run("db", "list", "-d", "db").output == "db: the database has no clips\n"
    assert json.loads(run("db", "list", "-d", "db", "--json").output) == []
    assert "clips        0\n" in run("db", "info", "-d", "db").output
    assert run("db", "verify", "-d", "db").exit_code == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["list"],
        ["info"],
        ["verify"],
        ["compact"],
        ["remove", "walk"],
        ["remove", "walk", "--dry-run"],
        ["export", "-o", "out"],
    ],
)
def test_no_database(arguments: list[str], here: Path) -> None:
    command, *rest = arguments
    result = run("db", command, "--database", "no", *rest)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr == (
        "priorfill: no: there is no database; make one with: priorfill db add --database no ...\n"
    )
    result = run("db", command, "--database", ".", *rest)
    assert result.exit_code == 1
    assert "is not a priorfill database" in result.stderr
    assert run("db", command, *rest).exit_code == 2  # --database is missing
    assert list(here.iterdir()) == []


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
        "from priorfill.cli.db import db\n"
        "lines = [['--help'], ['db', '--help'], ['inspect', '--help'], ['fill', '--help']]\n"
        "for line in lines + [['db', name, '--help'] for name in db.commands]:\n"
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
    from priorfill.cli import progress

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(progress, "WINDOWS", False)  # where both must be terminals
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with progress.progress(None, "Work [1/2]") as show:
        show(1, 3)
        show(3, None)
    out, err = capsys.readouterr()
    assert out == ""
    assert "Work [1/2]" in err
    assert "3/3" in err


def test_progress_of_a_fill_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from priorfill.cli import progress

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(progress, "WINDOWS", False)  # where both must be terminals
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with progress.fill_progress("a.c3d") as show:
        read = capsys.readouterr().err  # the first paint is at once
        show(0, 4321)
        show(1234, 4321)
    filled = capsys.readouterr().err
    assert "reading and checking a.c3d" in read
    assert "filling a.c3d" in filled
    assert "1,234/4,321 samples" in filled


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
