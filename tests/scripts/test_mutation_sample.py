"""scripts/mutation_sample.py: the operators, the draw, the selection of tests, and the report."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import psutil
import pytest
from scripted import SCRIPTS, load_script

sample = load_script("mutation_sample")  # puts scripts/ on the path
from mutation import reach, run  # noqa: E402
from mutation import sites as places  # noqa: E402

ROOT = SCRIPTS.parent
EVERY = 15
"""Every 15th numeric module is checked, and every third fault in it."""

MEASURES = """
    def area(a, b):
        return a * b


    def total(a, b):
        return a + b


    def count(n):
        i = 0
        while i != n:
            i += 1
        return i
"""
TESTS = """
    from tiny.measures import area, count, total


    def test_area():
        assert area(2, 3) == 6


    def test_total_of_nothing_more():
        assert total(2, 0) == 2


    def test_count():
        assert count(3) == 3
"""


def write(folder: Path, **files: str) -> Path:
    """A checkout with the package `tiny`; double underscores are folders."""
    for name, text in {"tiny____init__": "", **files}.items():
        file = folder / f"{name.replace('__', '/', 1)}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(dedent(text), encoding="utf-8")
    return folder


def faults(source: str) -> list[tuple[str, str]]:
    """Operator and changed line of each fault of a source."""
    found = places.sites("tiny/m.py", dedent(source).encode())
    return [(site.operator, site.after) for site in found]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("y = a + (b)  # +", {("add-sub", "y = a - (b)  # +")}),
        ("y = (a - b) * σ", {("add-sub", "y = (a + b) * σ"), ("mul-div", "y = (a - b) / σ")}),
        ("y = (a + b) ** n", {("add-sub", "y = (a - b) ** n"), ("power", "y = (a + b)")}),
        ("y = -a", {("unary-minus", "y = a")}),
        ("y = not a", {("not", "y = a")}),
        ("y = ~a", {("~", "y = a")}),
        ("y = a <= b", {("boundary", "y = a < b"), ("opposite", "y = a > b")}),
        ("y = a == b", {("opposite", "y = a != b")}),
        ("y = a and b and c", {("and-or", "y = a or b and c"), ("and-or", "y = a and b or c")}),
        ("y = a & b", {("bit-and-or", "y = a | b")}),
        ("y = min(a, b)", {("min-max", "y = max(a, b)")}),
        ("y = np.maximum(a, b)", {("min-max", "y = np.minimum(a, b)")}),
        ("y = a[2]", {("number", "y = a[3]")}),
        ("y = f(0.0, 1.5)", {("number", "y = f(1.0, 1.5)"), ("number", "y = f(0.0, 3.0)")}),
        ("y = f(a, True)", {("true-false", "y = f(a, False)")}),
        ("y = np.sqrt(a)", {("drop-call", "y = (a)")}),
        ("y = a.sum(axis=0)", {("axis", "y = a.sum(axis=1)")}),
        ("y += a", {("add-sub", "y -= a"), ("drop-statement", "pass")}),
        ("a.sort()", {("drop-statement", "pass")}),
        ("a[b] = c", {("drop-statement", "pass")}),
        ("y = a[1:]", {("slice", "y = a[:-1]"), ("number", "y = a[2:]")}),
        ("y = np.where(c, a, b)", {("where-swap", "y = np.where(c, b, a)")}),
    ],
)
def test_operators(line, expected):
    assert set(faults(f"def f(y, a, b, c, n, σ):\n    {line}\n")) == expected


def test_a_named_constant_and_a_field_are_doubled_or_halved():
    found = faults("""
        LIMIT = 3.0

        @dataclass(frozen=True)
        class Options:
            rate: float = 8.0
        """)
    assert [operator for operator, _ in found] == ["constant", "constant"]
    assert found[0][1] in {"LIMIT = 6.0", "LIMIT = 1.5"}
    assert found[1][1] in {"rate: float = 16.0", "rate: float = 4.0"}


def test_what_has_no_faults():
    assert not faults('''
        """Doc 1 + 1."""
        from m import a

        __all__ = ["a" + "b"]
        NAME = "n"
        if TYPE_CHECKING:
            SIZE = 1

        class Kind(Enum):
            A = 1

        @cached(maxsize=4)
        def f(x: "1 < 2" = None, progress=lambda done: done + 1) -> Literal[3]:
            """Doc 2 * 2."""
            if x:
                raise ValueError(f"{x + 1} of {2}")
            progress(x)
            return zip(a, x, strict=True), f"{x * 2}", "a" + NAME
        ''')


@pytest.mark.parametrize("path", sample.numeric_modules(ROOT, "priorfill")[::EVERY])
def test_faults_of_the_package_are_other_python(path):
    content = (ROOT / path).read_bytes()
    tree = ast.dump(ast.parse(content))
    for site in places.sites(path, content)[::3]:
        assert ast.dump(ast.parse(site.plant(content))) != tree, site.key


def test_keys_are_unique_and_stay_when_lines_are_added_above():
    content = dedent(MEASURES) + "def twice(a):\n    return a + a + a\n"
    before = [site.key for site in places.sites("tiny/m.py", content.encode())]
    moved = f"import math\n\nX = 'x'\n{content}".encode()
    assert [site.key for site in places.sites("tiny/m.py", moved)] == before
    assert len(set(before)) == len(before)
    assert before[-1] == "tiny/m.py::twice::add-sub::return a + a + a::1"


def test_a_seed_draws_the_same_faults():
    found = places.sites("tiny/m.py", dedent(MEASURES).encode())
    drawn, passed = sample.draw(found, 3, 5)
    assert (drawn, passed) == (sample.draw(reversed(found), 3, 5)[0], [])
    assert any(sample.draw(found, 3, seed)[0] != drawn for seed in range(5))
    others, passed = sample.draw(found, 3, 5, [drawn[0].key])
    assert passed == drawn[:1]
    assert others[:2] == drawn[1:]


def test_shipped_equivalents_have_reasons(tmp_path):
    assert all(sample.read_equivalents(SCRIPTS / "mutation" / "equivalents.toml").values())
    file = tmp_path / "e.toml"
    file.write_text("[[equivalent]]\nkey = '''a::f::not::x['y']::0'''\nreason = 'r'\n", "utf-8")
    assert sample.read_equivalents(file) == {"a::f::not::x['y']::0": "r"}


def test_numeric_modules_are_those_of_the_numeric_folders():
    found = sample.numeric_modules(ROOT, "priorfill")
    folders = {Path(path).parts[1] for path in found if len(Path(path).parts) > 2}
    assert folders == {
        *("artefacts", "constraints", "energy", "evaluation", "filling", "geometry", "gp"),
        *("markers", "methods", "report", "search", "signal", "skeleton", "synthetic"),
    }
    stems = {Path(path).stem for path in found}
    assert not stems & {"__init__", "errors", "interop", "runner", "plots", "overrides", "demo"}


@pytest.fixture
def compiled(tmp_path) -> Path:
    """A package with a constant, a compiled function, and a caller of each."""
    return write(
        tmp_path,
        tiny__limits="LIMIT = 4.0\n\n\ndef unused():\n    return LIMIT\n",
        tiny__kernels="from tiny.limits import LIMIT\n\n@njit\ndef add(a):\n    return a + LIMIT\n",
        tiny__calls="from tiny.kernels import add as plus\n\n\ndef use(a):\n    return plus(a)\n",
        tests__test_calls="",
    )


def test_a_constant_in_compiled_code_is_reached_through_the_caller(compiled):
    record = reach.Record(
        "tests/test_calls.py", ["*", "one", "two"], [0.0, 2.0, 1.0], [], {"tiny/calls.py": {5: [2]}}
    )
    readers = reach.Readers(compiled, "tiny")
    site = places.sites("tiny/limits.py", (compiled / "tiny/limits.py").read_bytes())[0]
    assert reach.Reach(compiled, readers, [record]).tests(site) == [(record, [2])]
    assert readers.recompiled("tiny/limits.py") == ["tiny/kernels.py"]
    assert readers.recompiled("tiny/calls.py") == []


def test_what_a_fixture_of_several_tests_executes_is_reached_by_all_that_pass():
    lines = {"tiny/m.py": {1: [0], 2: [1]}}
    record = reach.Record("tests/test_m.py", ["*", "a", "b"], [0.0, 1.0, 1.0], [], lines)
    assert record.executing("tiny/m.py", 1, 2) == {1, 2}
    assert record.executing("tiny/m.py", 2, 2) == {1}


def test_only_the_first_test_files_within_the_limit_are_run():
    first, second, third = (
        (reach.Record(f"tests/test_{name}.py", ["*", name], [0.0, 4.0], [], {}), [1])
        for name in "abc"
    )
    assert run.within(1.0, [first, second]) == [first]
    assert run.within(9.0, [first, second, third]) == [first, second]
    assert run.within(99.0, [first, second]) == [first, second]


def test_a_fault_is_removed_and_changes_files_that_compile_it(compiled, tmp_path):
    workspace = run.Workspace(compiled, tmp_path / "w")
    files = [workspace.copy / "tiny" / name for name in ("limits.py", "kernels.py")]
    before = [(file.read_bytes(), file.stat().st_mtime_ns) for file in files]
    site = places.sites("tiny/limits.py", files[0].read_bytes())[0]
    with workspace.fault(site, ["tiny/kernels.py"]) as environment:
        assert files[0].read_bytes() == site.plant(before[0][0])
        kernels = files[1].read_bytes()
        assert kernels != before[1][0]
        assert ast.dump(ast.parse(kernels)) == ast.dump(ast.parse(before[1][0]))
        assert environment["NUMBA_CACHE_DIR"] != str(workspace.compiled)
    assert [(file.read_bytes(), file.stat().st_mtime_ns) for file in files] == before


LEAVE = """
import subprocess, sys
left = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
print(left.pid, flush=True)
"""
"""Starts a process and leaves it behind."""


def test_processes_that_tests_leave_behind_are_killed(compiled, tmp_path):
    workspace = run.Workspace(compiled, tmp_path / "w")
    other = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    workspace.process = subprocess.Popen(
        [sys.executable, "-c", LEAVE], stdout=subprocess.PIPE, start_new_session=True
    )
    left = psutil.Process(int(workspace.process.stdout.readline()))
    workspace.process.wait()
    assert left.is_running()
    workspace.kill()
    psutil.wait_procs([left], timeout=30)
    assert not left.is_running() or left.status() == psutil.STATUS_ZOMBIE
    assert other.poll() is None
    other.communicate(b"\n")
    workspace.process.stdout.close()


def test_a_strong_test_catches_and_a_weak_one_does_not(tmp_path, capsys):
    root = write(tmp_path / "checkout", tiny__measures=MEASURES, tests__test_tiny=TESTS)
    common = ["--checkout", str(root), "--package", "tiny", "--cache", str(tmp_path / "cache")]
    output = tmp_path / "out.json"
    found = places.sites("tiny/measures.py", (root / "tiny/measures.py").read_bytes())
    multiply, add, *_, endless = [s for s in found if s.operator in {"mul-div", "add-sub"}] + [
        site for site in found if site.operator == "drop-statement"
    ]
    listed = [site for site in found if site not in (multiply, add)]
    equivalents = tmp_path / "equivalents.toml"
    equivalents.write_text(
        "".join(f"[[equivalent]]\nkey = '{s.key}'\nreason = 'r'\n" for s in listed), "utf-8"
    )
    line = [*common, "--json", str(output), "--equivalents", str(equivalents)]
    assert sample.main(line) == 0
    ends = {f["key"]: (f["result"], f["test"], f["reached"])
            for f in json.loads(output.read_text("utf-8"))["faults"]}  # fmt: skip
    assert ends == {
        multiply.key: ("caught", "tests/test_tiny.py::test_area", 1),
        add.key: ("survived", "", 1),
    }
    printed = capsys.readouterr().out
    assert f"caught 1 of 2 (50%), 0 of them by a timeout; {len(listed)} equivalent" in printed
    assert "    - return a + b\n    + return a - b\n" in printed

    assert sample.main([*common, "--key", endless.key, "--timeout", "0.5"]) == 0
    printed = capsys.readouterr().out
    assert "recorded" not in printed  # it is in the cache
    assert "caught 1 of 1 (100%), 1 of them by a timeout" in printed
