#!/usr/bin/env python
"""A Windows Python with priorfill, under wine.

    python scripts/windows/environment.py FOLDER

Makes the environment in FOLDER unless it is there and up to date (half a minute, 1.3 GB), and
prints how to use it: ``FOLDER/python.sh`` takes the arguments of Python. Needs Linux on x86-64,
CPython 3.11 to 3.14, wine and mingw (Debian: wine64, wine, gcc-mingw-w64-x86-64-win32).

Python's DLLs come from the wheel of panda3d, which contains them; the rest of the standard library
from the Python that runs this script; packages are those of ``constraints.txt``, for Windows.
priorfill is that of the checkout, or with ``--wheel FILE`` that of a wheel.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shlex
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from commands import NotMadeError, run
from complex_functions import MINGW, WINE_LIBRARY, build_ucrtbase
from filelock import FileLock, Timeout
from packages import (
    PYTHON,
    build_wheel,
    download,
    unpack_python,
    unpack_wheel,
    unpack_wheels,
)
from stable_abi import build_stable_abi

__all__ = ["check_programs", "locked", "main", "make_environment", "wine_variables"]

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]

INPUTS = (
    *(f"scripts/windows/{name}.py" for name in ("commands", "complex_functions", "environment")),
    *(f"scripts/windows/{name}" for name in ("packages.py", "stable_abi.py", "launch.c")),
    "pyproject.toml",
    "constraints.txt",
)
"""Files of the checkout that decide what the environment contains."""

STAMP = "made-from"
"""File with a checksum of the inputs. It is written last, and marks a folder as replaceable."""

SITE = """
import os
import sys
import _winapi

# Debian 12's wine lacks it; every Windows that Python 3.12 supports has it
if hasattr(_winapi, "CopyFile2"):
    del _winapi.CopyFile2
"""
"""What Python imports when it starts."""

REFER = """
# a .pth file is read in the code page, which may lack letters of the path
sys.path.append(os.path.abspath({path!r}))
"""

WRAPPER = """#!/bin/sh
# Python of Windows under wine, which accepts no files and terminals as standard streams, only pipes
here={folder}
export WINEPREFIX="$here/prefix" {variables}
export PYTHONPYCACHEPREFIX='C:\\pycache' # compiled files of Linux in the checkout stay as they are
unset PYTHONDONTWRITEBYTECODE # without compiled files, an import takes a minute
# wine's services inherit the streams of the process that starts them, and would keep pipes open
wineserver --persistent=10 >/dev/null 2>&1
wine cmd /c exit </dev/null >/dev/null 2>&1
status=$(mktemp)
trap 'rm -f "$status"' EXIT
run() {{
    cat /dev/null | wine "$here/python/python.exe" "$@"
    echo $? >"$status"
}}
{{ {{ run "$@" 2>&4 | cat >&3; }} 4>&1 | cat >&2; }} 3>&1
exit "$(cat "$status")"
"""

VARIABLES = {
    "WINEDEBUG": "-all",
    "WINEARCH": "win64",
    "WINEDLLOVERRIDES": "ucrtbase,ucrtwine=n;mscoree,mshtml=",
}


def main() -> int:
    """Make the environment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--wheel", type=Path, help="install priorfill from this wheel")
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    try:
        check_programs()
        with locked(folder):
            make_environment(folder, wheel=arguments.wheel)
    except NotMadeError as error:
        print(error, file=sys.stderr)
        return 1
    print(folder / "python.sh")
    return 0


def check_programs() -> None:
    """Raise `NotMadeError` if wine or mingw is not on this machine."""
    programs = [name for name in ("wine", MINGW + "gcc") if shutil.which(name) is None]
    missing = programs + [str(path) for path in (WINE_LIBRARY,) if not path.exists()]
    if missing:
        raise NotMadeError(
            f"not on this machine: {', '.join(missing)}; on Debian, install wine64, wine and "
            "gcc-mingw-w64-x86-64-win32"
        )


def locked(folder: Path) -> FileLock:
    """Return the lock of an environment, held, for one process at a time to make or end it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(f"{folder}.lock")
    try:
        lock.acquire(blocking=False)
    except Timeout:
        print(f"waiting for another process that uses {folder}", file=sys.stderr)
        lock.acquire()
    return lock


def wine_variables(folder: Path) -> dict[str, str]:
    """Return the environment variables that programs of wine need."""
    return {**os.environ, **VARIABLES, "WINEPREFIX": str(folder / "prefix")}


def make_environment(folder: Path, *, wheel: Path | None = None) -> None:
    """Make the environment in a folder unless it is there and up to date.

    It is made next to the folder and then renamed: what was interrupted is made again.
    """
    stamp, inputs = folder / STAMP, _inputs(wheel)
    if not stamp.exists() and folder.is_dir() and any(folder.iterdir()):
        raise NotMadeError(f"{folder} contains something else; give a folder that is new or empty")
    if not stamp.exists() or stamp.read_text("utf-8") != inputs:
        print(f"making a Windows Python in {folder} (once)", file=sys.stderr)
        new = folder.with_name(f"{folder.name}.new")
        shutil.rmtree(new, ignore_errors=True)
        _make(new, folder, wheel)
        (new / STAMP).write_text(inputs, "utf-8")
        _replace(folder, new)
    _write_site(folder, wheel)


def _inputs(wheel: Path | None) -> str:
    """Return a checksum of all that decides what the environment contains."""
    files = [*(CHECKOUT / name for name in INPUTS), WINE_LIBRARY, *([wheel] if wheel else [])]
    digest = hashlib.sha256(sys.version.encode())
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _make(new: Path, folder: Path, wheel: Path | None) -> None:
    """Make an environment in a new folder, for use under another name."""
    python = new / "python"
    packages = python / "Lib" / "site-packages"
    with tempfile.TemporaryDirectory(dir=new.parent) as temporary:
        wheels, own = Path(temporary) / "wheels", Path(temporary) / "own"
        with ThreadPoolExecutor() as pool:  # downloads take as long as all else
            tasks = [
                pool.submit(download, CHECKOUT, wheels),
                pool.submit(_make_prefix, new),
                *([] if wheel else [pool.submit(build_wheel, CHECKOUT, own)]),
            ]
            for task in tasks:
                task.result()
        unpack_python(wheels, python)
        unpack_wheels(wheels, packages)
        # the code is the checkout's unless a wheel was given
        unpack_wheel(wheel or next(own.glob("*.whl")), packages, metadata_only=wheel is None)
    _compile(python)
    _write_wrapper(new, folder)


def _write_wrapper(new: Path, folder: Path) -> None:
    variables = " ".join(f"{name}={shlex.quote(value)}" for name, value in VARIABLES.items())
    wrapper = new / "python.sh"
    wrapper.write_text(WRAPPER.format(folder=shlex.quote(str(folder)), variables=variables))
    wrapper.chmod(0o755)


def _write_site(folder: Path, wheel: Path | None) -> None:
    """Write what Python imports when it starts, with the place of this checkout."""
    refer = "" if wheel else REFER.format(path=f"Z:{CHECKOUT}")
    packages = folder / "python" / "Lib" / "site-packages"
    (packages / "sitecustomize.py").write_text(SITE + refer, "utf-8")


def _replace(folder: Path, new: Path) -> None:
    """Put a new environment in the place of an old one."""
    old = folder.with_name(f"{folder.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if folder.exists():
        folder.rename(old)
    new.rename(folder)
    shutil.rmtree(old, ignore_errors=True)


def _compile(python: Path) -> None:
    """Build ``python.exe`` and ``python3.dll``."""
    build_stable_abi(python / f"python{PYTHON}.dll")
    run(
        [
            MINGW + "gcc", "-municode", "-O2", f'-DPYTHON_DLL=L"python{PYTHON}.dll"',
            "-o", python / "python.exe", HERE / "launch.c",
        ],
        "python.exe could not be built",
    )  # fmt: skip


def _make_prefix(folder: Path) -> None:
    """Make the folder that wine keeps Windows in."""
    build = folder / "ucrtbase"
    build.mkdir(parents=True)
    build_ucrtbase(build)
    variables = {**wine_variables(folder), "WINEDLLOVERRIDES": "mscoree,mshtml="}
    version = ["HKCU\\Software\\Wine", "/v", "Version", "/d", "win10", "/f"]
    for command in (["wineboot", "-i"], ["wine", "reg", "add", *version], ["wineserver", "-w"]):
        run(command, "wine could not be set up", environment=variables)
    system = folder / "prefix" / "drive_c" / "windows" / "system32"
    for library in build.glob("*.dll"):
        shutil.copy(library, system)


if __name__ == "__main__":
    sys.exit(main())
