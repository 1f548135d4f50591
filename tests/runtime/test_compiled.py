from __future__ import annotations

import importlib.util
import itertools
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from priorfill.errors import OptionError
from priorfill.runtime import code_files, compiled, machine_code, numba_compiler
from priorfill.runtime.compiled import cache_problem

SOURCE = """
import numpy as np
from priorfill.runtime.compiled import compiled

FACTOR, TABLE = 2.0, np.array([1, 2])

@compiled()
def times(x):
    return FACTOR * x

@compiled()
def double(x):
    return times(x)

@compiled()
def add(pair, count, factor, total):
    for i in range(count):
        for j in range(total.shape[1]):
            total[i, j] += factor * pair[0][i, j] + pair[1][j] + TABLE[0]
    return count > 1

@compiled()
def copied(values):
    return values.copy().sum()

@compiled()
def first(values):
    return values[0], values[1]
"""

DAMAGES = {
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "changed": lambda content: content[:-20] + bytes([content[-20] ^ 0x55]) + content[-19:],
    "zeros": lambda content: bytes(len(content)),
    "text": lambda content: b"not what was written\n",
}


@pytest.fixture(autouse=True)
def no_problem_yet(monkeypatch):
    monkeypatch.setattr(code_files, "_problems", [])


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return a function that loads the module as a new process would."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # it may be that of an earlier source
    path = tmp_path / "source.py"
    numbers = itertools.count()

    def load_anew(source: str = SOURCE):
        path.write_text(source)
        spec = importlib.util.spec_from_file_location(f"source_{next(numbers)}", path)
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
        return loaded

    return load_anew


@pytest.fixture
def load(module, monkeypatch):
    """Return a function that calls `double` as a new process would, and counts compilations."""
    compile_function = numba_compiler.compile_function
    compilations = []

    def compile_once(function, arguments):
        code = kept.get(function.digest)
        if code is None:
            code = kept[function.digest] = compile_function(function, arguments)
        compilations.append(function)
        return code

    monkeypatch.setattr(numba_compiler, "compile_function", compile_once)

    def load_anew(source: str = SOURCE, expected: float = 6.0) -> int:
        compilations.clear()
        assert module(source).double(3.0) == expected
        return len(compilations)

    return load_anew


kept: dict[bytes, bytes] = {}
"""Code by digest: what is tested is which code is read, and numba is slow."""


def files(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "cache").iterdir())


@pytest.mark.windows
def test_compiled_code_is_loaded_again(load, tmp_path):
    assert load() == 1
    assert len(files(tmp_path)) == 1
    assert load() == 0
    assert cache_problem() == ""


@pytest.mark.windows
def test_arguments_and_results(module):
    loaded = module()
    matrix = np.arange(6.0).reshape(2, 3)
    vector = np.array([10.0, 20.0, 30.0])
    total = np.zeros((2, 3))
    assert loaded.add((matrix, vector), np.int64(2), np.float64(0.5), total) is True
    np.testing.assert_array_equal(total, 0.5 * matrix + vector + 1)
    transposed, reverse = np.asfortranarray(matrix), vector[::-1]
    reverse.flags.writeable = False
    total = np.zeros((2, 6))[:, ::2]
    assert loaded.add((transposed, reverse), 1, 2.0, total) is False
    np.testing.assert_array_equal(total, [2.0 * matrix[0] + reverse + 1, [0.0] * 3])
    with pytest.raises(TypeError):
        loaded.double(np.float32(3.0))  # an integer in its place would lose digits
    with pytest.raises(TypeError, match="first returns"):
        loaded.first(vector)


def test_arrays_in_memory_that_differ_from_those_compiled_for(module):
    add = module().add
    plain = np.ones((2, 3)), np.zeros(3)
    swapped = plain[0], plain[1].astype(">f8")
    unaligned = plain[0], np.frombuffer(bytearray(25), np.float64, offset=1)
    total = np.zeros((2, 3))
    add(plain, 2, 1.0, total)
    add(unaligned, 2, 1.0, total)
    np.testing.assert_array_equal(total, np.full((2, 3), 4.0))
    with pytest.raises(Exception, match="Unsupported array dtype: >f8"):
        add(swapped, 2, 1.0, total)
    frozen = total.copy()
    frozen.flags.writeable = False
    with pytest.raises(Exception, match="Cannot modify readonly array"):
        add(plain, 2, 1.0, frozen)
    assert len(add._loaded) == 2, "code for aligned arrays would be called with others"


def test_functions_that_need_the_memory_management_of_numba(module, monkeypatch):
    asked = []
    monkeypatch.setattr(numba_compiler, "add_symbols", lambda: asked.append(1))
    for _ in range(2):
        assert module().copied(np.arange(4.0)) == 6.0
    assert len(asked) == 2
    assert module().double(1.0) == 2.0
    assert len(asked) == 2


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("FACTOR, TABLE = 2.0", "FACTOR, TABLE = 4.0", 12.0),  # a constant of what it calls
        ("return times(x)", "return times(x) + 1.0", 7.0),
        ("return FACTOR * x", "return FACTOR - x", -1.0),
        ("@compiled()\ndef double", "@compiled(fastmath=True)\ndef double", 6.0),
    ],
)
def test_code_of_another_source_is_replaced(load, tmp_path, before, after, expected):
    load()
    changed = SOURCE.replace(before, after)
    assert changed != SOURCE
    assert load(changed, expected) == 1
    assert load(changed, expected) == 0
    assert len(files(tmp_path)) == 1


DEPENDENT = """
import math
import numpy as np
from priorfill.runtime.compiled import compiled

NUMBER, TABLES, SINGLE = 2, (np.arange(2000), 1), np.float32(1.0)

@compiled()
def scale(x, by=3):
    return by * math.pi * x

@compiled()
def compute(x):
    for item in [NUMBER * value for value in x]:
        x[0] += scale(item) + TABLES[0][1] + SINGLE
"""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("by=3", "by=4"),
        ("NUMBER, TABLES, SINGLE = 2", "NUMBER, TABLES, SINGLE = 4"),  # in a comprehension
        ("np.arange(2000)", "np.r_[:1000, 0, 1001:2000]"),  # in the middle
        ("np.float32(1.0)", "np.float64(1.0)"),
    ],
)
def test_what_code_is_found_by(module, before, after):
    assert before in DEPENDENT
    usual = module(DEPENDENT).compute.digest
    assert module(DEPENDENT).compute.digest == usual
    assert module(DEPENDENT.replace(before, after)).compute.digest != usual


def test_constants_that_are_replaced_after_the_first_call(module, monkeypatch):
    loaded = module(DEPENDENT)
    usual = loaded.compute.digest
    monkeypatch.setattr(loaded, "NUMBER", 5)
    assert loaded.compute.digest != usual
    monkeypatch.undo()
    monkeypatch.setattr("math.pi", 3.0)  # of another module
    assert loaded.compute.digest != usual


def test_large_integers_do_not_change_the_code(module, monkeypatch):
    given = []
    monkeypatch.setattr(numba_compiler, "compile_function", lambda _, args: given.append(args))
    monkeypatch.setattr(compiled, "load", lambda *_: lambda words: None)
    monkeypatch.setattr(code_files, "keep", lambda *_: None)
    module().add(2**63, (1.5, np.int64(3)))  # a uint64 for numba: -1 would be 2**64 - 1
    assert given == [(0, (0.0, 0))]


def test_arrays_of_records_are_refused(module):
    with pytest.raises(TypeError, match="not of numbers"):
        module().copied(np.zeros(2, dtype=[("x", np.float64)]))


def test_numba_is_set_not_to_compile(module, monkeypatch):
    monkeypatch.setattr("numba.core.config.DISABLE_JIT", 1)
    with pytest.raises(OptionError, match="unset it"):
        module().double(3.0)


def test_code_of_another_system_is_not_loaded(load, tmp_path, monkeypatch):
    load()
    monkeypatch.setattr(compiled, "describe_system", lambda: "another processor")
    assert load() == 1
    assert len(files(tmp_path)) == 2


def test_what_describes_the_system(monkeypatch):
    def described() -> str:
        machine_code.describe_system.cache_clear()
        return machine_code.describe_system()

    usual = described()
    monkeypatch.setenv("NUMBA_CACHE_DIR", "elsewhere")
    assert described() == usual
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    assert described() != usual
    monkeypatch.undo()
    assert described() == usual


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_files_are_replaced(load, tmp_path, damage):
    load()
    (path,) = files(tmp_path)
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert load() == 1
    assert load() == 0
    assert cache_problem() == ""


@pytest.mark.skipif(os.name == "nt", reason="POSIX only")
def test_pipes_instead_of_files(load, tmp_path):
    load()
    (path,) = files(tmp_path)
    path.unlink()
    os.mkfifo(path)
    assert load() == 1


def test_a_folder_that_cannot_be_written(load, tmp_path, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(code_files, "replace_file", refuse)
    assert load() == 1
    assert cache_problem() == f"{tmp_path / 'cache'}: No space left on device"


@pytest.mark.windows
@pytest.mark.parametrize("writable", [True, False])
def test_a_program_folder_that_takes_no_files(load, tmp_path, monkeypatch, writable):
    (tmp_path / "__pycache__").write_text("no folder")
    users = tmp_path / "user" / "cache"
    if not writable:
        users.parent.write_text("no folder")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name, **_: users)
    assert load() == 1
    assert load() == (0 if writable else 1)
    assert (str(users) in cache_problem()) is not writable


def test_files_are_kept_next_to_the_source(load, tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert load() == 1
    assert len(list((tmp_path / "__pycache__").glob("source.double-*.code"))) == 1
    assert load() == 0


@pytest.mark.windows
def test_files_that_another_process_reads(load, monkeypatch):
    def refuse(*_: object) -> None:
        error = PermissionError(13, "Access is denied")
        error.winerror = 5
        raise error

    monkeypatch.setattr("priorfill.runtime.atomic_file.finish_file", refuse)
    assert load() == 1
    assert cache_problem() == ""


def test_threads_load_a_function_once(module, monkeypatch):
    double = module().double
    loads = []
    monkeypatch.setattr(compiled, "load", lambda code, _: loads.append(code) or (lambda words: 6.0))
    threads = [threading.Thread(target=double, args=(3.0,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(loads) == 1


def test_compiled_code_is_loaded_without_numba():
    program = (
        "import sys, numpy as np\n"
        "from priorfill.geometry.rotation_kernels import nearest_rotations\n"
        "from priorfill.runtime.elementary import exp\n"
        "nearest_rotations(np.eye(3)[None], np.empty((1, 3, 3)))\n"
        "assert exp(0.0) == 1.0\n"
        "print('numba' in sys.modules)\n"
    )
    runs = [
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert runs[-1].stdout.strip() == "False"


def test_memory_of_arrays_is_freed_by_numba(tmp_path):
    # in a process of its own: memory that is freed wrongly ends it
    source = """
import sys
import numpy as np
from numba import njit
from numba.core.runtime import rtsys
from priorfill.runtime.compiled import compiled

def summed(values):
    total = 0.0
    for count in range(100):
        total += (values + count).sum()
    return total

def first(values):
    return values[0] + values.sum()

compiled()(first)(np.zeros(4))
print(compiled()(summed)(np.zeros(4)), njit(summed)(np.zeros(4)))
made = rtsys.get_allocation_stats()
print(made.mi_alloc >= 200, made.mi_alloc - made.mi_free)
"""
    path = tmp_path / "source.py"
    path.write_text(source)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_NRT_STATS": "1"}
    found = subprocess.run(
        [sys.executable, path], env=environment, capture_output=True, text=True, check=False
    )
    assert found.stdout.split() == ["19800.0", "19800.0", "True", "0"], found.stderr
    assert found.returncode == 0
