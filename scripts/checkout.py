"""The environment of a checkout (`.venv`), and what is run in it. Needs no more than Python."""

from __future__ import annotations

import hashlib
import locale
import os
import shutil
import sqlite3
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from python_version import OLDEST

__all__ = ["check", "demo", "environment", "python_of", "test"]

ROOT = Path(__file__).resolve().parents[1]

STAMP = "priorfill-installed"
"""File of the environment with what it was made from; written last."""

INCOMPLETE = "incomplete\n"
"""The stamp until then: the folder is an environment of priorfill that may be removed."""

WAIT = 3600.0
"""Seconds to wait for another process that makes the environment."""

INTERRUPTED = 130
"""Exit status of a program that was interrupted."""

CHECKS = (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",))

THREADS = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "PRIORFILL_THREADS",
)
"""Numbers of threads. Tests already use all cores; threads of BLAS and of fills slow them down."""

PIP = ("-m", "pip", "--disable-pip-version-check", "install", "--quiet")


def environment() -> Path:
    """Return the folder of the environment, made or brought up to date if necessary."""
    venv = ROOT / (os.environ.get("PRIORFILL_VENV") or ".venv")
    try:
        if not _is_up_to_date(venv):
            with _one_at_a_time(venv):
                if not _is_up_to_date(venv):  # unless another process has made it meanwhile
                    _make(venv)
    except KeyboardInterrupt:
        print("interrupted; run this again to continue", file=sys.stderr)
        sys.exit(INTERRUPTED)
    return venv


def python_of(venv: Path) -> Path:
    """Return the path of an environment's Python."""
    folder = Path(sysconfig.get_path("scripts", "venv", vars={"base": str(venv)}))
    return folder / f"python{sysconfig.get_config_var('EXE') or ''}"


def check() -> int:
    """Check style and types, and return the exit status of what fails first."""
    venv = environment()
    for command in CHECKS:
        status = _run(venv, "-m", *command)
        if status:
            return status
    return 0


def test(arguments: Sequence[str]) -> int:
    """Check style and types, then run the tests, with arguments of pytest."""
    status = check()
    if status:
        return status
    os.environ.update(dict.fromkeys(THREADS, "1"))
    # each process gets half of the files in a row, and makes what the tests of a file share once
    parallel = ("--numprocesses", "auto", "--dist", "worksteal")
    return _run_last(environment(), "-m", "pytest", *parallel, *arguments)


def demo(arguments: Sequence[str]) -> int:
    """Fill a demo clip from the starter database, with arguments of `priorfill demo`."""
    return _run_last(environment(), "-m", "priorfill", "demo", *arguments)


# ---------------------------------------------------------------------------------- programs


def _run(venv: Path, *arguments: str) -> int:
    """Run the environment's Python in the checkout, and return its exit status."""
    process = subprocess.Popen([python_of(venv), *arguments], cwd=ROOT, env=_variables())
    while True:
        try:
            return process.wait()
        except KeyboardInterrupt:  # the process is interrupted as well, and ends by itself
            continue


def _run_last(venv: Path, *arguments: str) -> int:
    """Run the environment's Python in place of this process if possible."""
    if os.name == "posix":  # elsewhere this process would end at once, and the new one go on
        os.chdir(ROOT)
        python = str(python_of(venv))
        os.execve(python, [python, *arguments], _variables())
    return _run(venv, *arguments)


def _variables() -> dict[str, str]:
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    # tests start hundreds of programs, and each would compile all modules again
    variables.pop("PYTHONDONTWRITEBYTECODE", None)
    return variables


# ------------------------------------------------------------------------------------- set-up


def _is_up_to_date(venv: Path) -> bool:
    try:
        stamp = (venv / STAMP).read_text("utf-8")
    except FileNotFoundError:
        return False
    return stamp == _inputs(venv)


def _inputs(venv: Path) -> str:
    """Return what decides the contents of an environment."""
    digest = hashlib.sha256(os.fsencode(ROOT))
    for name in ("pyproject.toml", "constraints.txt"):
        digest.update((ROOT / name).read_bytes())
    return f"{digest.hexdigest()} Python {_version(venv)}\n"


def _version(venv: Path) -> tuple[int, ...]:
    """Return the version of an environment's Python; nothing if it does not run."""
    program = "import sys; print(*sys.version_info[:2])"
    try:
        done = subprocess.run(
            [python_of(venv), "-c", program], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return ()
    return tuple(int(number) for number in done.stdout.split())


@contextmanager
def _one_at_a_time(venv: Path) -> Iterator[None]:
    """Wait for other processes that make the same environment."""
    venv.parent.mkdir(parents=True, exist_ok=True)
    # SQLite's locks are in every Python, work on all systems, and end with their process
    try:
        lock = sqlite3.connect(f"{venv}.lock", timeout=0.0, isolation_level=None)
        try:
            lock.execute("BEGIN EXCLUSIVE")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY:
                raise
            print("waiting for another process that makes the environment", file=sys.stderr)
            lock.execute(f"PRAGMA busy_timeout = {WAIT * 1000:.0f}")
            lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.OperationalError as error:
        sys.exit(f"{venv}.lock: {error}; give another folder by PRIORFILL_VENV")
    with closing(lock):
        yield


def _make(venv: Path) -> None:
    """Make an environment, or bring it up to date."""
    print(f"making the environment {venv} (once)", file=sys.stderr)
    _prepare_folder(venv)
    python = str(python_of(venv))
    # dependency groups need pip 25.1
    _install(python, "--upgrade", "pip>=25.1")
    _install(python, "--constraint", "constraints.txt", "--editable", ".", "--group", "dev")
    _write_path_file(venv)
    (venv / STAMP).write_text(_inputs(venv), "utf-8")


def _prepare_folder(venv: Path) -> None:
    """Make an environment that has only pip, unless there is one."""
    stamp = venv / STAMP
    runs = _version(venv) >= OLDEST and _has_pip(venv)
    if not runs and venv.is_dir() and any(venv.iterdir()):
        if not stamp.exists():
            sys.exit(f"{venv} has no pip of Python 3.11 or newer; remove the folder, or give "
                     "another one by PRIORFILL_VENV")  # fmt: skip
        try:
            shutil.rmtree(venv)
        except OSError as error:
            sys.exit(f"{venv} cannot be made anew ({error}); close the programs that use it")
    venv.mkdir(parents=True, exist_ok=True)
    stamp.write_text(INCOMPLETE, "utf-8")
    if not runs:
        _create(venv)


def _has_pip(venv: Path) -> bool:
    command = [python_of(venv), "-m", "pip", "--version"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def _create(venv: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "venv", venv], stdout=sys.stderr, check=False)
    if done.returncode:
        sys.exit("Python's module venv failed; on Debian and Ubuntu, install python3-venv")


def _install(python: str, *arguments: str) -> None:
    done = subprocess.run([python, *PIP, *arguments], cwd=ROOT, stdout=sys.stderr, check=False)
    if done.returncode:
        sys.exit("packages could not be installed (see above); run this again to continue")


def _write_path_file(venv: Path) -> None:
    """Refer to the checkout in a way that every Python understands.

    pip writes the path of the checkout in UTF-8. Before version 3.13, Python reads it in the code
    page of the system, and with umlauts in it does not find the checkout, or does not even start.
    """
    places = ("Lib/site-packages", "lib/python3.*/site-packages")
    for file in {file for place in places for file in venv.glob(f"{place}/*priorfill.pth")}:
        inside = file.is_relative_to(ROOT)
        path = os.path.relpath(ROOT, file.parent) if inside else str(ROOT)
        file.write_text(path + "\n", locale.getencoding(), errors="replace")
