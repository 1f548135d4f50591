"""Wheel and source distribution: what they contain, and that the installed package works."""

from __future__ import annotations

import contextlib
import importlib.metadata
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hatchling.build import build_sdist, build_wheel
from platforms import on_wine

ROOT = Path(__file__).resolve().parents[1]

MAX_MB = 8.0
"""Size of a distribution; the starter database takes half of it."""

COMMANDS = """
import sys
sys.path[:0] = {paths!r}
if __name__ == "__main__":
    import priorfill
    from priorfill.cli import main
    print(ascii(priorfill.__file__))
    for arguments in {commands!r}:
        try:
            main(arguments, prog_name="priorfill")
        except SystemExit as ending:
            print("status", arguments[0], ending.code, flush=True)
"""
"""Commands of an installed package, in one process."""


def build(source: Path, folder: Path, kind: str = "wheel") -> Path:
    """Build a distribution without network, and return its path."""
    with contextlib.chdir(source):  # as build programs do
        make = build_wheel if kind == "wheel" else build_sdist
        return folder / make(str(folder))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    return build(ROOT, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution of this checkout."""
    return build(ROOT, tmp_path_factory.mktemp("sdist"), "sdist")


def names_of(distribution: Path) -> set[str]:
    """The files in a wheel, or below the one folder of a source distribution."""
    if distribution.suffix == ".whl":
        with zipfile.ZipFile(distribution) as archive:
            return {name for name in archive.namelist() if ".dist-info/" not in name}
    with tarfile.open(distribution) as archive:
        return {name.partition("/")[2] for name in archive.getnames()}


def repository() -> set[str]:
    """The files of the repository."""
    try:
        line = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        done = subprocess.run(line, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("needs a git checkout")
    names = done.stdout.decode().split("\0")
    return {name for name in names if (ROOT / name).is_file()}


def test_the_wheel_has_the_package_and_what_ships_with_it(wheel: Path) -> None:
    expected = {name for name in repository() if name.startswith("priorfill/")} | {
        f"priorfill/_{name}" for name in repository() if name.startswith("database/")
    }
    assert names_of(wheel) == expected
    assert wheel.stat().st_size < MAX_MB * 1e6


def test_the_source_distribution_has_the_repository(sdist: Path) -> None:
    assert names_of(sdist) == repository() | {"PKG-INFO"}
    assert sdist.stat().st_size < MAX_MB * 1e6


def test_both_build_the_same_wheel(wheel: Path, sdist: Path, tmp_path: Path) -> None:
    """Whatever else lies in the checkout."""
    with tarfile.open(sdist) as archive:
        archive.extraction_filter = getattr(tarfile, "fully_trusted_filter", None)
        archive.extractall(tmp_path)
    (source,) = tmp_path.iterdir()
    for name in ("database/starter/lock", "demo-output/x.c3d", "priorfill/__pycache__/x.pyc", "x"):
        (source / name).parent.mkdir(exist_ok=True)
        (source / name).touch()
    assert build(source, tmp_path).read_bytes() == wheel.read_bytes()


def test_metadata(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    (distribution,) = importlib.metadata.distributions(path=[str(tmp_path)])
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert distribution.version == project["version"]
    (entry,) = distribution.entry_points
    assert (entry.name, entry.value) == ("priorfill", project["scripts"]["priorfill"])
    for system in ("Microsoft :: Windows", "MacOS", "POSIX :: Linux"):
        assert f"Operating System :: {system}" in project["classifiers"]


@pytest.mark.windows
def test_the_installed_package_works(wheel: Path, tmp_path: Path) -> None:
    """In a folder with spaces and umlauts, which nothing may be written to."""
    site = tmp_path / "Programme für alle"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    for file in site.rglob("*"):
        if file.is_file():
            file.chmod(0o444)
    before = {file: file.stat().st_mtime_ns for file in site.rglob("*") if file.is_file()}
    starter = str(site / "priorfill" / "_database" / "starter")
    demo, own = Path("Übung 1"), "eigene Daten"
    gaps, truth = str(demo / "demo_gaps.c3d"), str(demo / "demo_truth.c3d")
    commands = [
        ["demo", "--output", str(demo), "--method", "linear"],
        ["inspect", gaps],
        ["fill", gaps, "-o", "filled.c3d", "--method", "linear", "--database", starter],
        ["db", "verify", "--database", starter],
        ["db", "add", "--database", own, truth],
    ]
    if not on_wine():  # which starts processes slowly
        evaluate = ["evaluate", truth, "--methods", "linear", "--copies", "1", "--jobs", "1"]
        commands.append([*evaluate, "-o", "Ergebnis"])
    # without site, nothing refers to the checkout
    paths = [str(site), str(Path(np.__file__).parents[1])]
    program = tmp_path / "run.py"
    program.write_text(COMMANDS.format(paths=paths, commands=commands), encoding="utf-8")
    work = tmp_path / "Labor 1"
    work.mkdir()
    flags = ["-I", "-S", "-B"]
    if sys.pycache_prefix is not None:  # else, every module of the dependencies is compiled
        flags += ["-X", f"pycache_prefix={sys.pycache_prefix}"]
    done = subprocess.run(
        [sys.executable, *flags, str(program)], cwd=work, capture_output=True, timeout=300
    )
    output = done.stdout.decode(errors="replace")
    statuses = [line.split()[1:] for line in output.splitlines() if line.startswith("status ")]
    assert statuses == [
        ["demo", "3"],  # straight lines are not believed everywhere
        ["inspect", "0"],
        ["fill", "3"],
        ["db", "0"],
        ["db", "0"],
        *([] if on_wine() else [["evaluate", "0"]]),
    ], output + done.stderr.decode(errors="replace")
    assert ascii(str(site))[1:-1] in output.partition("\n")[0]
    assert {f: f.stat().st_mtime_ns for f in site.rglob("*") if f.is_file()} == before
