#!/usr/bin/env python
"""A Windows Python with priorfill, under wine.

    python scripts/windows/environment.py FOLDER

Makes the environment in FOLDER unless it is there and up to date (1 minute, 1.2 GB), and prints how
to use it: ``FOLDER/python.sh`` takes the arguments of Python. Needs Linux on x86-64, CPython 3.11
to 3.14, wine and mingw (Debian: wine64, gcc-mingw-w64-x86-64).

Python's DLLs come from the wheel of panda3d, which contains them; the rest of the standard library
from the Python that runs this script; packages are those of ``constraints.txt``, for Windows.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

from complex_functions import MINGW, WINE_LIBRARY, build_ucrtbase
from stable_abi import build_stable_abi

__all__ = ["main", "make_environment", "missing_programs"]

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]

PYTHON = f"{sys.version_info.major}{sys.version_info.minor}"
"""Version of Python, as in the names of wheels and DLLs."""

EXTRA = ("panda3d", "colorama")
"""Packages beyond those of priorfill: Python's DLLs; what click and pytest need on Windows only."""

NOT_TESTED = ("ruff", "mypy")
"""Development packages that no test imports."""

LEFT_OUT = (
    "site-packages",
    "lib-dynload",
    "config-3*",
    "test",
    "__pycache__",
    "idlelib",
    "lib2to3",
)
"""Parts of the standard library that are not copied."""

SITE = """
import _winapi

# Debian 12's wine lacks it; every Windows that Python 3.12 supports has it
if hasattr(_winapi, "CopyFile2"):
    del _winapi.CopyFile2
"""

WRAPPER = """#!/bin/sh
# Python of Windows under wine, which accepts no files and terminals as standard streams, only pipes
export WINEPREFIX='{folder}/prefix' WINEDEBUG=-all WINEARCH=win64
export WINEDLLOVERRIDES='ucrtbase,ucrtwine=n;mscoree,mshtml='
unset PYTHONDONTWRITEBYTECODE # without compiled files, an import takes a minute
status=$(mktemp)
trap 'rm -f "$status"' EXIT
run() {{
    cat /dev/null | wine '{folder}/python/python.exe' "$@"
    echo $? >"$status"
}}
{{ {{ run "$@" 2>&4 | cat >&3; }} 4>&1 | cat >&2; }} 3>&1
exit "$(cat "$status")"
"""


def main() -> int:
    """Make the environment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder.resolve()
    missing = missing_programs()
    if missing:
        print(f"not on this machine: {', '.join(missing)}", file=sys.stderr)
        return 1
    make_environment(folder)
    print(folder / "python.sh")
    return 0


def missing_programs() -> list[str]:
    """Return what is needed and not there."""
    programs = [name for name in ("wine", MINGW + "gcc") if shutil.which(name) is None]
    return programs + [str(path) for path in (WINE_LIBRARY,) if not path.exists()]


def make_environment(folder: Path) -> None:
    """Make the environment in a folder unless it is there and up to date."""
    stamp, inputs = folder / "made-from", _inputs()
    if stamp.exists() and stamp.read_text() == inputs:
        return
    if folder.exists():
        shutil.rmtree(folder)
    wheels, python = folder / "wheels", folder / "python"
    for new in (wheels, python / "DLLs"):
        new.mkdir(parents=True)
    _download(wheels)
    _install(wheels, python)
    _compile(python)
    _make_prefix(folder)
    wrapper = folder / "python.sh"
    wrapper.write_text(WRAPPER.format(folder=folder))
    wrapper.chmod(0o755)
    stamp.write_text(inputs)


def _inputs() -> str:
    """Return a checksum of all that decides what the environment contains."""
    files = [*sorted(HERE.glob("*.*")), CHECKOUT / "pyproject.toml", CHECKOUT / "constraints.txt"]
    contents = b"".join(file.read_bytes() for file in files if file.is_file())
    return hashlib.sha256(contents + PYTHON.encode() + str(CHECKOUT).encode()).hexdigest()


def _download(wheels: Path) -> None:
    """Download the wheels of Windows for priorfill's dependencies, and those of its tests."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))
    wanted = [*project["project"]["dependencies"], *project["dependency-groups"]["dev"], *EXTRA]
    wanted = [name for name in wanted if not name.startswith(NOT_TESTED)]
    # pip's markers (such as "on Windows only") describe this machine, not the wheels
    subprocess.run(
        [
            sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check",
            "--dest", wheels, "--platform", "win_amd64", "--python-version", PYTHON,
            "--implementation", "cp", "--abi", f"cp{PYTHON}", "--abi", "abi3", "--abi", "none",
            "--only-binary=:all:", "--constraint", CHECKOUT / "constraints.txt", *wanted,
        ],
        check=True,
    )  # fmt: skip


def _install(wheels: Path, python: Path) -> None:
    """Unpack the standard library, Python's DLLs, the packages, and refer to the checkout."""
    ignore = shutil.ignore_patterns(*LEFT_OUT)
    shutil.copytree(sysconfig.get_path("stdlib"), python / "Lib", ignore=ignore)
    packages = python / "Lib" / "site-packages"
    packages.mkdir()
    for wheel in wheels.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            if wheel.name.startswith("panda3d"):
                _unpack_dlls(archive, python)
            else:
                archive.extractall(packages)
    (packages / "sitecustomize.py").write_text(SITE)
    (packages / "priorfill.pth").write_text(f"Z:{CHECKOUT}\n")
    wheel = _build_wheel(wheels.parent)
    with zipfile.ZipFile(wheel) as archive:  # metadata only: the code is the checkout's
        archive.extractall(packages, [n for n in archive.namelist() if ".dist-info/" in n])


def _unpack_dlls(archive: zipfile.ZipFile, python: Path) -> None:
    for name in archive.namelist():
        folder, _, file = name.rpartition("/")
        # wine has the first kind, and the second crashes it
        if folder == "deploy_libs" and not file.startswith(("api-ms-", "_wmi")):
            main = file.lower().startswith(("python", "vcruntime"))
            (python / ("" if main else "DLLs") / file).write_bytes(archive.read(name))


def _build_wheel(folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check",
               "--no-deps", "--wheel-dir", folder, CHECKOUT]  # fmt: skip
    subprocess.run(command, check=True)
    return next(folder.glob("priorfill-*.whl"))


def _compile(python: Path) -> None:
    """Build ``python.exe`` and ``python3.dll``."""
    build_stable_abi(python / f"python{PYTHON}.dll")
    subprocess.run(
        [
            MINGW + "gcc", "-municode", "-O2", f'-DPYTHON_DLL=L"python{PYTHON}.dll"',
            "-o", python / "python.exe", HERE / "launch.c",
        ],
        check=True,
    )  # fmt: skip


def _make_prefix(folder: Path) -> None:
    """Make the folder that wine keeps Windows in."""
    build = folder / "ucrtbase"
    build.mkdir()
    build_ucrtbase(build)
    environment = {
        **os.environ,
        "WINEPREFIX": str(folder / "prefix"),
        "WINEDEBUG": "-all",
        "WINEARCH": "win64",
        "WINEDLLOVERRIDES": "mscoree,mshtml=",
    }
    version = [r"HKCU\Software\Wine", "/v", "Version", "/d", "win10", "/f"]
    for command in (["wineboot", "-i"], ["wine", "reg", "add", *version], ["wineserver", "-w"]):
        subprocess.run(command, env=environment, check=True, stdin=subprocess.DEVNULL,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    system = folder / "prefix" / "drive_c" / "windows" / "system32"
    for library in build.glob("*.dll"):
        shutil.copy(library, system)


if __name__ == "__main__":
    sys.exit(main())
