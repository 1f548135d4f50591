from __future__ import annotations

import importlib.util
import itertools
import os
import pickle
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest

from priorfill.runtime import compiled as module
from priorfill.runtime.compiled import ENTRY, cache_problem, compiled

SOURCE = "def double(x):\n    return 2 * x\n"

DAMAGES = {
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "changed": lambda content: content[:-20] + bytes([content[-20] ^ 0x55]) + content[-19:],
    "zeros": lambda content: bytes(len(content)),
    "text": lambda content: b"not what numba wrote\n",
}


@pytest.fixture(autouse=True)
def no_problem_yet(monkeypatch):
    monkeypatch.setattr(module, "_problems", [])


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Return a function that compiles `double` as a new process would, and counts cache hits."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "source.py"
    path.write_text(SOURCE)
    numbers = itertools.count()

    def load_anew() -> int:
        spec = importlib.util.spec_from_file_location(f"source_{next(numbers)}", path)
        source = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(source)
        double = compiled(ENTRY)(source.double)
        assert double(3.0) == 6.0
        return sum(double.stats.cache_hits.values())

    return load_anew


def files(folder: Path, suffix: str) -> list[Path]:
    return sorted((folder / "cache").rglob(f"*{suffix}"))


def test_compiled_code_is_loaded_again(load, tmp_path):
    assert load() == 0
    assert len(files(tmp_path, ".nbi")) == len(files(tmp_path, ".nbc")) == 1
    assert load() == 1
    assert cache_problem() == ""


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_files_are_replaced(load, tmp_path, suffix, damage):
    load()
    (path,) = files(tmp_path, suffix)
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert load() == 0
    assert load() == 1
    assert cache_problem() == ""


class Trap:
    """An object that makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.folder),)


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_files_without_a_checksum_are_not_unpickled(load, tmp_path, suffix):
    load()
    (path,) = files(tmp_path, suffix)
    path.write_bytes(pickle.dumps(numba.__version__) + pickle.dumps(Trap(tmp_path / "trap")))
    assert load() == 0
    path.write_bytes(pickle.dumps(Trap(tmp_path / "trap")))
    assert load() == 0
    assert not (tmp_path / "trap").exists()


@pytest.mark.skipif(os.name == "nt", reason="POSIX only")
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_pipes_instead_of_files(load, tmp_path, suffix):
    load()
    (path,) = files(tmp_path, suffix)
    path.unlink()
    os.mkfifo(path)
    assert load() == 0
    assert load() == 1


def test_a_folder_that_cannot_be_written(load, tmp_path, monkeypatch):
    load()
    for path in files(tmp_path, ".nbc") + files(tmp_path, ".nbi"):
        path.unlink()

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device", str(tmp_path / "cache" / "x.nbi"))

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._open_for_write", refuse)
    assert load() == 0
    assert cache_problem() == f"{tmp_path / 'cache'}: No space left on device"


@pytest.mark.windows
def test_no_folder_to_write_to(load, tmp_path, monkeypatch):
    # numba tries: the folder given, the one of the source, the user's
    (tmp_path / "cache").write_text("no folder")
    (tmp_path / "__pycache__").write_text("no folder")
    users = SimpleNamespace(user_cache_dir=str(tmp_path / "cache"))
    monkeypatch.setattr("numba.core.caching.AppDirs", lambda **names: users)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    assert load() == 0
    assert "can be written" in cache_problem()


@pytest.mark.windows
def test_a_program_folder_that_takes_no_files(load, tmp_path, monkeypatch):
    (tmp_path / "__pycache__").write_text("no folder")
    users = SimpleNamespace(user_cache_dir=str(tmp_path / "cache"))
    monkeypatch.setattr(module, "AppDirs", lambda **names: users)
    monkeypatch.setattr(module, "WINDOWS", True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    module._choose_folder.cache_clear()
    assert load() == 0
    assert len(files(tmp_path, ".nbc")) == 1
    assert load() == 1
    assert cache_problem() == ""


@pytest.mark.windows
def test_files_that_another_process_reads(load, tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        error = PermissionError(13, "Access is denied")
        error.winerror = 5
        raise error

    monkeypatch.setattr(os, "replace", refuse)
    assert load() == 0
    assert cache_problem() == ""
