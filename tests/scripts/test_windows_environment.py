"""``scripts/windows`` and ``scripts/test_windows``: the Windows Python, without making one."""

from __future__ import annotations

import os
import sys
import threading
import time
import zipfile
from pathlib import Path

import pytest
from scripted import SCRIPTS, load_script

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="a Windows Python is made under wine on Linux"
)

commands = load_script("commands")
complex_functions = load_script("complex_functions")
packages = load_script("packages")
stable_abi = load_script("stable_abi")
environment = load_script("environment")
run_tests = load_script("run_tests")


@pytest.fixture(autouse=True)
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of programs, the only one on the path with those of the system."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "sh").symlink_to("/bin/sh")
    for name in ("cat", "mktemp", "rm", "sleep"):
        (found,) = [file for file in (Path("/bin") / name,) if file.exists()]
        (folder / name).symlink_to(found)
    monkeypatch.setenv("PATH", str(folder))
    return folder


def program(folder: Path, name: str, lines: str) -> None:
    """Write a shell script in the place of a program."""
    file = folder / name
    file.write_text(f"#!/bin/sh\n{lines}\n", encoding="utf-8")
    file.chmod(0o755)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Path]:
    """Environments without contents, and where they were made."""
    found: list[Path] = []

    def make(new: Path, folder: Path, wheel: Path | None) -> None:
        found.append(folder)
        (new / "python" / "Lib" / "site-packages").mkdir(parents=True)
        environment._write_wrapper(new, folder)

    monkeypatch.setattr(environment, "_make", make)
    library = tmp_path / "ucrtbase.dll"
    library.write_bytes(b"of wine")
    monkeypatch.setattr(environment, "WINE_LIBRARY", library)
    return found


# ------------------------------------------------------------------------------ is it there?


def test_missing_programs_are_named_with_the_packages_that_have_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(environment, "WINE_LIBRARY", tmp_path / "none.dll")
    monkeypatch.setattr(sys, "argv", ["environment.py", str(tmp_path / "new")])
    assert environment.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("not on this machine: wine, x86_64-w64-mingw32-gcc, ")
    assert "install wine64, wine and gcc-mingw-w64-x86-64-win32" in line
    assert not (tmp_path / "new").exists()


def test_tests_are_unavailable_without_wine(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tests.main([]) == run_tests.UNAVAILABLE
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("no tests under wine: not on this machine: wine")


def test_the_folder_is_the_one_that_is_named_or_in_the_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PRIORFILL_WINE", str(tmp_path / "named"))
    assert run_tests.environment_folder() == tmp_path / "named"
    monkeypatch.delenv("PRIORFILL_WINE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run_tests.environment_folder() == tmp_path / "priorfill" / "wine"


# --------------------------------------------------------------------------- made completely


def test_an_environment_is_made_once_and_again_when_its_inputs_change(
    made: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "environment"
    for _ in range(2):
        environment.make_environment(folder)
    assert made == [folder]
    environment.WINE_LIBRARY.write_bytes(b"of a later wine")
    environment.make_environment(folder)
    monkeypatch.setattr(sys, "version", "3.12.1")
    environment.make_environment(folder)
    wheel = tmp_path / "priorfill-1-py3-none-any.whl"
    wheel.write_bytes(b"a wheel")
    environment.make_environment(folder, wheel=wheel)
    wheel.write_bytes(b"another wheel")
    environment.make_environment(folder, wheel=wheel)
    assert len(made) == 5
    assert sorted(file.name for file in tmp_path.iterdir() if "environment" in file.name) == [
        "environment"
    ]


def test_every_file_that_decides_the_contents_is_an_input() -> None:
    modules = {f"scripts/windows/{file.name}" for file in (SCRIPTS / "windows").glob("*.*")}
    assert modules - set(environment.INPUTS) == {"scripts/windows/run_tests.py"}


def test_an_interrupted_environment_is_made_anew(
    made: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(new: Path, folder: Path, wheel: Path | None) -> None:
        new.mkdir()
        (new / "half").touch()
        raise KeyboardInterrupt

    folder = tmp_path / "environment"
    with monkeypatch.context() as patch:
        patch.setattr(environment, "_make", stop)
        with pytest.raises(KeyboardInterrupt):
            environment.make_environment(folder)
    assert not folder.exists()
    environment.make_environment(folder)
    assert made == [folder]
    assert not (folder / "half").exists()


def test_an_old_environment_stays_until_the_new_one_is_complete(
    made: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "environment"
    environment.make_environment(folder)
    environment.WINE_LIBRARY.write_bytes(b"of a later wine")

    def fail(new: Path, folder: Path, wheel: Path | None) -> None:
        raise commands.NotMadeError("no network")

    monkeypatch.setattr(environment, "_make", fail)
    with pytest.raises(commands.NotMadeError, match="no network"):
        environment.make_environment(folder)
    assert (folder / "python.sh").exists()


def test_a_folder_with_other_contents_is_left_alone(made: list[Path], tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter").touch()
    with pytest.raises(commands.NotMadeError, match="contains something else"):
        environment.make_environment(tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter").exists()
    assert made == []


def test_one_process_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    order: list[str] = []

    def second() -> None:
        with environment.locked(tmp_path / "environment"):
            order.append("second")

    with environment.locked(tmp_path / "environment"):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.2)
        order.append("first")
    thread.join(10.0)
    assert order == ["first", "second"]
    assert "waiting for another process" in capsys.readouterr().err


def test_the_checkout_is_found_whatever_letters_its_path_has(
    made: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "environment"
    environment.make_environment(folder)
    monkeypatch.setattr(environment, "CHECKOUT", Path("/somewhere/Übung 'ő"))
    environment._write_site(folder, None)
    site = folder / "python" / "Lib" / "site-packages" / "sitecustomize.py"
    assert repr("Z:/somewhere/Übung 'ő") in site.read_text("utf-8")
    compile(site.read_text("utf-8"), site, "exec")
    environment._write_site(folder, Path("a.whl"))
    assert "Z:" not in site.read_text("utf-8")


# -------------------------------------------------------------------------------- its parts


def write_wheel(file: Path, **contents: str) -> Path:
    """Write a wheel; underscores of names are the slashes of its paths."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, text in contents.items():
            archive.writestr(name.replace("__", "/"), text)
    return file


def test_wheels_are_unpacked_each_into_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    standard = tmp_path / "stdlib"
    for name in ("json/decoder.py", "test/test_json.py", "lib-dynload/x.so", "abc.py"):
        (standard / name).parent.mkdir(parents=True, exist_ok=True)
        (standard / name).touch()
    monkeypatch.setattr(packages.sysconfig, "get_path", lambda name: standard)
    wheels, python = tmp_path / "wheels", tmp_path / "python"
    wheels.mkdir()
    dlls = ("python311.dll", "VCRUNTIME140.dll", "_socket.pyd", "_wmi.pyd", "api-ms-win-x.dll")
    write_wheel(
        wheels / "panda3d-1-cp311.whl",
        panda3d__core="",
        **{f"deploy_libs__{name}": name for name in dlls},
    )
    write_wheel(wheels / "numpy-2-cp311.whl", numpy__core="")
    own = write_wheel(
        tmp_path / "priorfill-1-py3-none-any.whl", priorfill__cli="", **{"p.dist-info__x": ""}
    )
    site = python / "Lib" / "site-packages"
    packages.unpack_python(wheels, python)
    packages.unpack_wheels(wheels, site)
    packages.unpack_wheel(own, site, metadata_only=True)
    files = {file.relative_to(python).as_posix() for file in python.rglob("*") if file.is_file()}
    assert files == {
        "Lib/abc.py",
        "Lib/json/decoder.py",
        "Lib/site-packages/numpy/core",
        "Lib/site-packages/p.dist-info/x",
        "python311.dll",
        "VCRUNTIME140.dll",
        "DLLs/_socket.pyd",
    }
    packages.unpack_wheel(own, site)
    assert (site / "priorfill" / "cli").exists()


def test_the_c_runtime_forwards_what_it_does_not_have(
    tmp_path: Path, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = (
        "[Ordinal/Name Pointer] Table\n\t[   0] creal\n\t[   1] malloc\n\t[   2] cpow\n\n[x] y\n"
    )
    program(programs, "x86_64-w64-mingw32-objdump", f"cat <<'END'\n{table}END")
    program(programs, "x86_64-w64-mingw32-gcc", "true")
    library = tmp_path / "wine.dll"
    library.write_bytes(bytes(range(200)))
    monkeypatch.setattr(complex_functions, "WINE_LIBRARY", library)
    folder = tmp_path / "runtime"
    folder.mkdir()
    complex_functions.build_ucrtbase(folder)
    assert (folder / "ucrtbase.def").read_text().splitlines() == [
        "LIBRARY ucrtbase.dll",
        "EXPORTS",
        " creal = own_creal",
        ' "malloc" = "ucrtwine.malloc"',
        " cpow = own_cpow",
    ]
    code = (folder / "ucrtbase.c").read_text()
    assert "double own_creal(Double x) { return creal(in(x)); }" in code
    assert "Float own_cexpf(Float x) { return outf(cexpf(inf(x))); }" in code
    assert not any((folder / "ucrtwine.dll").read_bytes()[complex_functions.BUILTIN_MARK])


def test_the_stable_abi_is_that_of_pythons_own_library(tmp_path: Path, programs: Path) -> None:
    table = "[Ordinal/Name Pointer] Table\n\t[   0] Py_Main\n\n"
    program(programs, "x86_64-w64-mingw32-objdump", f"cat <<'END'\n{table}END")
    # arguments: -shared -o OUTPUT CODE DEFINITIONS
    program(programs, "x86_64-w64-mingw32-gcc", 'cat "$5" >"$3"')
    stable_abi.build_stable_abi(tmp_path / "python311.dll")
    lines = (tmp_path / "python3.dll").read_text().splitlines()
    assert lines[2:] == [' "Py_Main" = "python311.Py_Main"']


def test_programs_that_fail_say_what_failed(
    programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(programs, "failing", "echo first; echo ERROR: the reason >&2; exit 3")
    with pytest.raises(commands.NotMadeError, match=r"^no wheel: ERROR: the reason$"):
        commands.run(["failing"], "no wheel")
    with pytest.raises(commands.NotMadeError, match=r"^no wheel: .*not-there"):
        commands.run(["not-there"], "no wheel")
    program(programs, "hanging", "exec sleep 60")
    monkeypatch.setattr(commands, "LIMIT", 0.1)
    with pytest.raises(commands.NotMadeError, match="not done within 0 s"):
        commands.run(["hanging"], "no wheel")


# ------------------------------------------------------------------------------------- runs


@pytest.fixture
def wine(made: list[Path], programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an environment of a wine that runs nothing, but notes what it should run."""
    folder = tmp_path / "Umgebung für wine"
    noted = f'echo "$WINEPREFIX" "$@" >>"{tmp_path}/noted"'
    program(
        programs, "wine", f'{noted}; case "$*" in *hang*) exec sleep 60;; esac; echo out; exit 5'
    )
    program(programs, "wineserver", noted)
    program(programs, "x86_64-w64-mingw32-gcc", "true")
    monkeypatch.setenv("PRIORFILL_WINE", str(folder))
    return folder


def notes(tmp_path: Path) -> list[str]:
    return (tmp_path / "noted").read_text("utf-8").splitlines()


def test_arguments_go_to_pytest_and_its_status_comes_back(
    wine: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_tests.main(["-m", "windows", "a b"]) == 5
    assert capfd.readouterr().out == "out\n"
    *_, run, end = notes(tmp_path)
    assert run.startswith(f"{wine}/prefix {wine}/python/python.exe -m pytest --numprocesses ")
    assert run.endswith(f"cache_dir=Z:{wine}/pytest_cache -m windows a b")
    assert end == f"{wine}/prefix --kill"


def test_tests_end_after_the_limit(
    wine: Path, programs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # as wine's server does, it ends the programs of its prefix
    program(
        programs, "wineserver", f'case "$*" in *kill*) /bin/kill "$(cat "{tmp_path}/id")";; esac'
    )
    program(
        programs, "wine", f'case "$*" in *hang*) echo $$ >"{tmp_path}/id"; exec sleep 60;; esac'
    )
    start = time.monotonic()
    assert run_tests.main(["--limit", "0.5", "hang"]) == 1
    assert time.monotonic() - start < 30.0
    assert "did not end within 0 s" in capsys.readouterr().err


def test_the_shell_script_is_a_program_that_runs_it() -> None:
    script = SCRIPTS / "test_windows"
    assert os.access(script, os.X_OK)
    assert 'scripts/windows/run_tests.py "$@"' in script.read_text("utf-8")
