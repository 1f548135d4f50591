"""The tests on the Windows Python under wine.

    scripts/test_windows [--limit SECONDS] [arguments of pytest]

The environment is made on the first run, and again when what it is made from has changed, in the
folder that ``PRIORFILL_WINE`` names, or in the user's cache. All programs that run in it are ended
when the tests have ended, or after ``--limit`` seconds.

The exit status is that of pytest; 1 also if the limit was exceeded; 77 if the environment cannot be
made, for example because wine is not installed.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from commands import NotMadeError
from environment import CHECKOUT, check_programs, locked, make_environment, wine_variables

__all__ = ["main"]

UNAVAILABLE = 77
"""Exit status of what could not be tried, as other programs that run tests have it."""

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "PRIORFILL_THREADS")
"""Numbers of threads: the tests use all cores."""

ENDING = 30.0
"""Seconds for programs to end when they are told to."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tests."""
    parser = argparse.ArgumentParser(
        usage="scripts/test_windows [--limit SECONDS] [arguments of pytest]", allow_abbrev=False
    )
    parser.add_argument("--limit", type=float, help="seconds for the tests")
    own, others = parser.parse_known_args(arguments)
    # `timeout` and cancelled jobs of CI: what runs in wine must end too
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    folder = environment_folder()
    try:
        check_programs()
        with locked(folder):
            make_environment(folder)
            return run_tests(folder, others, limit=own.limit)
    except NotMadeError as error:
        print(f"no tests under wine: {error}", file=sys.stderr)
        return UNAVAILABLE


def environment_folder() -> Path:
    """Return the folder of the environment."""
    given = os.environ.get("PRIORFILL_WINE")
    if given:
        return Path(given).resolve()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "priorfill" / "wine"


def run_tests(folder: Path, arguments: Sequence[str], *, limit: float | None) -> int:
    """Run pytest in an environment, and end all programs that are left in it."""
    command = [
        folder / "python.sh", "-m", "pytest",
        "--numprocesses", str(os.cpu_count()),
        "--override-ini", f"cache_dir=Z:{folder}/pytest_cache",
        *arguments,
    ]  # fmt: skip
    variables = {**os.environ, **dict.fromkeys(THREADS, "1")}
    process = subprocess.Popen(command, cwd=CHECKOUT, env=variables)
    try:
        return process.wait(limit)
    except subprocess.TimeoutExpired:
        print(f"the tests under wine did not end within {limit:.0f} s", file=sys.stderr)
        return 1
    finally:
        _end_all(folder)
        process.wait(ENDING)


def _end_all(folder: Path) -> None:
    """End the programs of an environment, wine's services and server included."""
    subprocess.run(
        ["wineserver", "--kill"], env=wine_variables(folder), timeout=ENDING, check=False,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
