"""The environment of a checkout: `checkout.py`, and the scripts that call it."""

from __future__ import annotations

import ast
import shutil
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from scripted import SCRIPTS, load_script

pytestmark = pytest.mark.windows

checkout = load_script("checkout")

ENTRIES = ("check.py", "demo.py", "make_environment.py", "test.py")
"""What can be run, by any Python."""

PARALLEL = ("--numprocesses", "auto", "--dist", "worksteal")
"""Arguments of pytest for tests on all cores."""

NEEDS_SHELL = pytest.mark.skipif(
    sys.platform == "win32" or shutil.which("bash") is None,
    reason="needs bash; on Windows, the scripts ending in .py are called",
)

Commands = list[tuple[str, ...]]


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> Commands:
    """The arguments that the environment's Python is called with."""
    found: Commands = []

    def record(venv: Path, *arguments: str) -> int:
        found.append(arguments)
        return 1 if "--bad" in arguments else 0

    monkeypatch.setattr(checkout, "environment", lambda: Path("env"))
    monkeypatch.setattr(checkout, "_run", record)
    monkeypatch.setattr(checkout, "_run_last", record)
    for name in checkout.THREADS:
        monkeypatch.setenv(name, "7")
    return found


def test_tests_follow_style_and_types(commands: Commands) -> None:
    assert checkout.test(["-m", "not realdata"]) == 0
    assert commands == [
        ("-m", "ruff", "check", "."),
        ("-m", "ruff", "format", "--check", "."),
        ("-m", "mypy"),
        ("-m", "pytest", *PARALLEL, "-m", "not realdata"),
    ]
    assert {checkout.os.environ[name] for name in checkout.THREADS} == {"1"}


def test_nothing_follows_a_failed_check(
    commands: Commands, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkout, "CHECKS", (("ruff",), ("mypy", "--bad"), ("other",)))
    assert checkout.test([]) == 1
    assert commands == [("-m", "ruff"), ("-m", "mypy", "--bad")]


def test_the_demo_gets_its_arguments(commands: Commands) -> None:
    assert checkout.demo(["--output", "a b"]) == 0
    assert commands == [("-m", "priorfill", "demo", "--output", "a b")]


def test_programs_run_in_the_checkout_and_import_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkout, "python_of", lambda venv: Path(sys.executable))
    monkeypatch.chdir(tmp_path)
    program = (
        "import pathlib, sys, priorfill\n"
        f"root = pathlib.Path({str(checkout.ROOT)!r})\n"
        "assert pathlib.Path.cwd() == root\n"
        "assert pathlib.Path(priorfill.__file__).parents[1] == root\n"
        "sys.exit(int(sys.argv[1]))"
    )
    assert checkout._run(tmp_path, "-c", program, "5") == 5


# the environment


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A checkout without environment; the list of what is installed, which takes no time."""
    root = tmp_path / "Prüfung 1"
    root.mkdir()
    for name in ("pyproject.toml", "constraints.txt"):
        (root / name).write_text(name, encoding="utf-8")
    found: list[str] = []

    def create(venv: Path) -> None:
        found.append("venv")
        python = checkout.python_of(venv)
        python.parent.mkdir()
        python.touch()

    def runs(venv: Path) -> tuple[int, ...]:
        return (3, 11) if checkout.python_of(venv).exists() else ()

    monkeypatch.delenv("PRIORFILL_VENV", raising=False)
    monkeypatch.setattr(checkout, "ROOT", root)
    monkeypatch.setattr(checkout, "_create", create)
    monkeypatch.setattr(checkout, "_version", runs)
    monkeypatch.setattr(checkout, "_has_pip", lambda venv: True)
    monkeypatch.setattr(checkout, "_install", lambda python, *what: found.append(what[-1]))
    return found


WHOLE = ["venv", "pip>=25.1", "dev"]
AGAIN = ["pip>=25.1", "dev"]


def test_an_environment_is_made_once(installed: list[str]) -> None:
    assert checkout.environment() == checkout.ROOT / ".venv"
    assert installed == WHOLE
    checkout.environment()
    assert installed == WHOLE


def test_it_is_brought_up_to_date(installed: list[str]) -> None:
    for name in ("pyproject.toml", "constraints.txt"):
        checkout.environment()
        installed.clear()
        (checkout.ROOT / name).write_text("changed", encoding="utf-8")
        checkout.environment()
        assert installed == AGAIN


def test_it_follows_a_checkout_that_is_moved(
    installed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    checkout.environment()
    installed.clear()
    moved = checkout.ROOT.rename(checkout.ROOT.with_name("moved"))
    monkeypatch.setattr(checkout, "ROOT", moved)
    checkout.environment()
    assert installed == AGAIN


def test_another_python_is_noticed(installed: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    checkout.environment()
    installed.clear()
    monkeypatch.setattr(checkout, "_version", lambda venv: (3, 13))
    checkout.environment()
    assert installed == AGAIN


def test_a_broken_environment_is_made_anew(installed: list[str]) -> None:
    """The Python that it was made with is gone."""
    (checkout.environment() / "remains").touch()
    installed.clear()
    checkout.python_of(checkout.ROOT / ".venv").unlink()
    assert not (checkout.environment() / "remains").exists()
    assert installed == WHOLE


def test_other_folders_are_not_removed(
    installed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "file").touch()
    monkeypatch.setenv("PRIORFILL_VENV", str(tmp_path / "mine"))
    with pytest.raises(SystemExit, match="remove the folder, or give"):
        checkout.environment()
    assert (tmp_path / "mine" / "file").exists()
    assert installed == []


@pytest.mark.parametrize("step", ["_create", "_install", "_write_path_file"])
def test_an_interrupted_set_up_is_continued(
    installed: list[str], monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    def interrupted(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as only_here:
        only_here.setattr(checkout, step, interrupted)
        for _ in range(2):
            with pytest.raises(SystemExit) as ending:
                checkout.environment()
            assert ending.value.code == 130
    checkout.environment()
    assert installed[-1] == "dev"
    assert checkout._is_up_to_date(checkout.ROOT / ".venv")


def test_an_interrupted_update_is_not_taken_as_complete(
    installed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even if the checkout then is as it was at the last complete one."""
    checkout.environment()
    constraints = checkout.ROOT / "constraints.txt"
    constraints.write_text("changed", encoding="utf-8")
    with monkeypatch.context() as only_here:
        only_here.setattr(checkout, "_install", lambda *arguments: sys.exit("no network"))
        with pytest.raises(SystemExit):
            checkout.environment()
    constraints.write_text("constraints.txt", encoding="utf-8")
    installed.clear()
    checkout.environment()
    assert installed == AGAIN


def test_two_do_not_make_it_at_once(
    installed: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(sqlite3.connect(checkout.ROOT / ".venv.lock", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        second = threading.Thread(target=checkout.environment)
        second.start()
        while "waiting for another process" not in capsys.readouterr().err:
            time.sleep(0.01)
        assert installed == []
        other.rollback()
        second.join()
    assert installed == WHOLE


def test_the_second_finds_what_the_first_has_made(
    installed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[bool] = []
    checks: Callable[[Path], bool] = checkout._is_up_to_date
    checkout.environment()
    installed.clear()

    def missed_once(venv: Path) -> bool:
        seen.append(bool(seen) and checks(venv))
        return seen[-1]

    monkeypatch.setattr(checkout, "_is_up_to_date", missed_once)
    checkout.environment()
    assert seen == [False, True]
    assert installed == []


@pytest.mark.parametrize("place", ["Lib/site-packages", "lib/python3.11/site-packages"])
def test_paths_with_umlauts_are_found_by_every_python(installed: list[str], place: str) -> None:
    folder = checkout.ROOT / ".venv" / place
    folder.mkdir(parents=True)
    (folder / "_priorfill.pth").write_text(str(checkout.ROOT), encoding="utf-8")
    checkout._write_path_file(checkout.ROOT / ".venv")
    path = (folder / "_priorfill.pth").read_text(encoding="ascii").strip()
    assert (folder / path).resolve() == checkout.ROOT


def test_a_path_file_never_keeps_python_from_starting(
    installed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkout.locale, "getencoding", lambda: "cp1252")
    monkeypatch.setattr(checkout, "ROOT", checkout.ROOT / "Číčo ü")
    folder = tmp_path / "elsewhere" / "Lib" / "site-packages"
    folder.mkdir(parents=True)
    (folder / "_priorfill.pth").touch()
    checkout._write_path_file(tmp_path / "elsewhere")
    assert "?í?o ü" in (folder / "_priorfill.pth").read_text(encoding="cp1252")


# versions of Python


@pytest.mark.parametrize("script", [*ENTRIES, "python_version.py"])
def test_every_python_can_read_the_scripts(script: str) -> None:
    tree = ast.parse((SCRIPTS / script).read_text(encoding="ascii"))
    new = (ast.JoinedStr, ast.AnnAssign, ast.NamedExpr, ast.arg, ast.AsyncFunctionDef)
    assert not [node for node in ast.walk(tree) if isinstance(node, new)]


@pytest.mark.parametrize("script", ENTRIES)
def test_the_version_is_checked_first(script: str) -> None:
    tree = ast.parse((SCRIPTS / script).read_text(encoding="utf-8"))
    docstring, first, *_ = tree.body
    assert isinstance(docstring, ast.Expr)
    assert isinstance(first, ast.Import)
    assert first.names[0].name == "python_version"


def test_older_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "python_version")
    monkeypatch.setattr(sys, "version_info", (3, 10, 13, "final", 0))
    with pytest.raises(SystemExit, match=r"needs Python 3\.11 or newer; this is Python 3\.10\.13"):
        load_script("python_version")


# shell scripts, with a stand-in for the environment


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment whose Python prints its arguments."""
    folder = tmp_path / "environment"
    python = checkout.python_of(folder)
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\n[ "$1" = -c ] && echo 3 11 || echo "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    (folder / checkout.STAMP).write_text(checkout._inputs(folder), encoding="utf-8")
    monkeypatch.setenv("PRIORFILL_VENV", str(folder))
    return folder


@NEEDS_SHELL
@pytest.mark.parametrize(
    ("script", "arguments", "lines"),
    [
        ("environment", (), ["{environment}"]),
        ("check", (), ["-m ruff check .", "-m ruff format --check .", "-m mypy"]),
        ("demo", ("--output", "o"), ["-m priorfill demo --output o"]),
        ("profile", ("a.c3d",), ["{scripts}/bench/profile_fill.py a.c3d"]),
        (
            "test",
            ("tests",),
            [
                "-m ruff check .",
                "-m ruff format --check .",
                "-m mypy",
                f"-m pytest {' '.join(PARALLEL)} tests",
            ],
        ),
    ],
)
def test_shell_scripts_call_those_of_python(
    environment: Path, tmp_path: Path, script: str, arguments: tuple[str, ...], lines: list[str]
) -> None:
    done = subprocess.run(
        [str(SCRIPTS / script), *arguments], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        line.format(environment=environment, scripts=SCRIPTS) for line in lines
    ]


@NEEDS_SHELL
def test_find_python_says_when_there_is_none(tmp_path: Path) -> None:
    (tmp_path / "python3").write_text("#!/bin/sh\nexit 1\n", encoding="utf-8")  # an older one
    (tmp_path / "python3").chmod(0o755)
    bash = str(shutil.which("bash"))
    done = subprocess.run(
        [bash, str(SCRIPTS / "find_python")],
        capture_output=True,
        text=True,
        env={"PATH": str(tmp_path)},
    )
    assert done.returncode == 1
    assert done.stderr == "priorfill needs Python 3.11 or newer; install it and run this again\n"
