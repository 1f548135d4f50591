"""Packages for Windows and the parts of Python, downloaded and unpacked on Linux."""

from __future__ import annotations

import shutil
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

from commands import run

__all__ = ["build_wheel", "download", "unpack_python", "unpack_wheel", "unpack_wheels"]

PYTHON = f"{sys.version_info.major}{sys.version_info.minor}"
"""Version of Python, as in the names of wheels and DLLs."""

DLLS = "panda3d"
"""The package that contains Python's DLLs."""

EXTRA = (f"{DLLS}==1.10.16", "colorama")
"""Packages beyond those of priorfill: Python's DLLs; what click and pytest need on Windows only."""

NOT_TESTED = ("ruff", "mypy", "playwright", "distributed", "cryptography")
"""Development packages that no test imports on Windows; pages and clusters are tested on Linux."""

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

NOT_FOR_WINE = ("api-ms-", "_wmi")
"""DLLs that are not unpacked: wine has the first, and the second crashes it."""

NEXT_TO_PYTHON = ("python", "vcruntime")
"""DLLs that belong in the folder of ``python.exe``."""

# Warnings, such as those of folders of wheels that an installation of pip names and does not have,
# are not shown; errors are.
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "--quiet")


def download(checkout: Path, wheels: Path) -> None:
    """Download the wheels of Windows for priorfill's dependencies, and those of its tests."""
    project = tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))
    wanted = [*project["project"]["dependencies"], *project["dependency-groups"]["dev"], *EXTRA]
    wanted = [name for name in wanted if not name.startswith(NOT_TESTED)]
    # pip's markers (such as "on Windows only") describe this machine, not the wheels
    run(
        [
            *PIP, "download", "--dest", wheels, "--platform", "win_amd64", "--python-version",
            PYTHON, "--implementation", "cp", "--abi", f"cp{PYTHON}", "--abi", "abi3", "--abi",
            "none", "--only-binary=:all:", "--constraint", checkout / "constraints.txt", *wanted,
        ],
        "the packages for Windows could not be downloaded",
    )  # fmt: skip


def build_wheel(checkout: Path, folder: Path) -> Path:
    """Build priorfill's wheel in a folder."""
    command = [*PIP, "wheel", "--no-deps", "--wheel-dir", folder, checkout]
    run(command, "the wheel of priorfill could not be built")
    return next(folder.glob("priorfill-*.whl"))


def unpack_python(wheels: Path, python: Path) -> None:
    """Copy the standard library, and unpack Python's DLLs."""
    ignore = shutil.ignore_patterns(*LEFT_OUT)
    shutil.copytree(sysconfig.get_path("stdlib"), python / "Lib", ignore=ignore)
    (python / "Lib" / "site-packages").mkdir()
    (python / "DLLs").mkdir()
    (wheel,) = wheels.glob(f"{DLLS}-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            folder, _, file = name.rpartition("/")
            if folder == "deploy_libs" and not file.startswith(NOT_FOR_WINE):
                main = file.lower().startswith(NEXT_TO_PYTHON)
                (python / ("" if main else "DLLs") / file).write_bytes(archive.read(name))


def unpack_wheels(wheels: Path, packages: Path) -> None:
    """Unpack all wheels of a folder but that of Python's DLLs."""
    for wheel in sorted(wheels.glob("*.whl")):
        if not wheel.name.startswith(f"{DLLS}-"):
            unpack_wheel(wheel, packages)


def unpack_wheel(wheel: Path, packages: Path, *, metadata_only: bool = False) -> None:
    """Unpack a wheel, or no more than what it says about its package."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        if metadata_only:
            names = [name for name in names if ".dist-info/" in name]
        archive.extractall(packages, names)
