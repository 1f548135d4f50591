"""Rules of CONTRIBUTING.md that can be checked: lengths, parameters, layout, words, links."""

from __future__ import annotations

import ast
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from package_source import PACKAGE, modules, relative, text_of, tree_of

ROOT = Path(__file__).resolve().parents[1]

MAX_LINES = 60
"""Lines of a function, without its docstring and without the functions inside it."""

MAX_PARAMETERS = 8
"""Parameters of a function, without ``self`` and ``cls``."""

COMPILED = (
    "energy/descent_kernels.py",
    "search/kd_tree_kernels.py",
    "search/kd_tree_search_kernels.py",
    "search/kernels.py",
)
"""Modules of compiled loops, which take arrays one by one."""

TOP_LEVEL = {"__init__", "__main__", "errors", "clip", "gaps", "interop"}
"""Modules directly in the package."""

MACHINE = re.compile(r"/(home|root|Users)/\w|[A-Z]:\\Users\\")
"""Paths of the machines that the project was written on."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(tree: ast.AST) -> Iterator[Function]:
    """All functions and methods, those inside functions included."""
    for node in ast.walk(tree):
        if isinstance(node, Function):
            yield node


def is_command(function: Function) -> bool:
    """Whether click calls a function, with a parameter for each option."""
    names = (ast.unparse(decorator) for decorator in function.decorator_list)
    return any(re.match(r"(click|\w+)\.(command|group|option|argument)\b", name) for name in names)


def length(function: Function) -> int:
    """Lines of a function without its docstring."""
    assert function.end_lineno is not None
    lines = function.end_lineno - function.lineno + 1
    first = function.body[0]
    if ast.get_docstring(function, clean=False) is not None:
        assert first.end_lineno is not None
        lines -= first.end_lineno - first.lineno + 1
    return lines


def parameters(function: Function) -> int:
    """Number of parameters, without ``self`` and ``cls``."""
    given = function.args
    names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def offenders(tree: ast.AST) -> list[str]:
    """Functions of a module that are too long or have too many parameters."""
    found = []
    for function in functions(tree):
        if is_command(function):
            continue
        if (lines := length(function)) > MAX_LINES:
            found.append(f"{function.name}: {lines} lines")
        if (count := parameters(function)) > MAX_PARAMETERS:
            found.append(f"{function.name}: {count} parameters")
    return found


def test_functions_are_short_and_take_few_parameters() -> None:
    found = {relative(file): offenders(tree_of(file)) for file in modules()}
    assert {name: which for name, which in found.items() if which and name not in COMPILED} == {}


def test_the_rule_finds_long_functions_and_many_parameters() -> None:
    body = "\n".join("    x = 1" for _ in range(MAX_LINES - 1))
    assert offenders(ast.parse(f'def f():\n    """Doc.\n\n    More.\n    """\n{body}')) == []
    assert offenders(ast.parse(f"def f():\n{body}\n    y = 2")) == ["f: 61 lines"]
    assert offenders(ast.parse("class C:\n    def f(self, a, b, c, d, e, f, g, *, h): ...")) == []
    assert offenders(ast.parse("def f(a, b, c, d, e, f, g, h, *, i): ...")) == ["f: 9 parameters"]
    assert offenders(ast.parse("@db.command()\ndef f(a, b, c, d, e, f, g, h, i): ...")) == []


def test_modules_at_the_top_are_the_shared_ones() -> None:
    assert {file.stem for file in PACKAGE.glob("*.py")} == TOP_LEVEL


def test_class_names_are_unique() -> None:
    names = Counter(
        node.name
        for file in modules()
        for node in ast.walk(tree_of(file))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert {name for name, count in names.items() if count > 1} == set()


def tracked() -> list[Path]:
    """The text files of the repository."""
    try:
        line = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        done = subprocess.run(line, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("needs a git checkout")
    files = [ROOT / name for name in done.stdout.decode().split("\0") if name]
    binary = (".sqlite", ".f32", ".png")
    return [file for file in files if file.is_file() and file.suffix not in binary]


def test_no_file_names_a_machine() -> None:
    found = []
    for file in tracked():
        if file != Path(__file__):
            for number, line in enumerate(file.read_text("utf-8").splitlines(), start=1):
                if MACHINE.search(line):
                    found.append(f"{file.relative_to(ROOT)}:{number}: {line.strip()}")
    assert found == []


def test_links_of_documents_lead_to_files() -> None:
    broken = []
    for document in (file for file in tracked() if file.suffix == ".md"):
        text = document.read_text(encoding="utf-8")
        broken += [
            f"{document.relative_to(ROOT)}: {link}"
            for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text)
            if "://" not in link and not (document.parent / link).exists()
        ]
    assert broken == []


def test_paths_in_documents_exist() -> None:
    """Files that documents name, such as ``scripts/golden.py`` or ``energy/terms.py``."""
    missing = []
    for document in (file for file in tracked() if file.suffix == ".md"):
        for path in re.findall(r"`((?:[\w-]+/)+[\w-]+\.py)", document.read_text(encoding="utf-8")):
            places = (ROOT / path, PACKAGE / path, document.parent / path)
            if "NAME" not in path and not any(place.exists() for place in places):
                missing.append(f"{document.relative_to(ROOT)}: {path}")
    assert missing == []


def test_the_glossary_page_names_every_module() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    words = set(re.findall(r"\w+", text))
    methods = ("methods/baumann2011", "methods/gloersen2016", "methods/tits2018", "methods/li2020")
    unnamed = [
        relative(file)
        for file in modules()
        if file.stem != "__init__"
        and not relative(file).startswith(methods)
        and file.stem not in words
    ]
    assert unnamed == []


def printers(tree: ast.AST) -> list[str]:
    """Calls that write to the terminal."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            to_stream = re.fullmatch(r"sys\.(__)?std(out|err)(__)?(\.buffer)?\.write(lines)?", name)
            if to_stream or re.fullmatch(PRINTS, name):
                found.append(f"line {node.lineno}: {name}")
    return found


PRINTS = r"(builtins\.)?print|(click\.)?s?echo(_via_pager)?|.*console\.(print|log)|warnings\.warn"
"""Names of functions that print."""

PRINTER = "cli/output.py"
"""The only module that prints, where what files contain is escaped."""


def test_one_module_prints() -> None:
    """What is printed elsewhere would reach the terminal with its control characters."""
    found = {relative(module): printers(tree_of(module)) for module in modules()}
    assert {name for name, calls in found.items() if calls} == {PRINTER}


def test_printing_is_seen() -> None:
    source = "import click, sys\nclick.echo('a')\nprint('b')\nsys.stdout.write('c')\nsay('d')"
    assert [found.partition(":")[0] for found in printers(ast.parse(source))] == [
        "line 2",
        "line 3",
        "line 4",
    ]


def test_writers_of_tables_escape_cells() -> None:
    """A text from a file must not become a formula of a spreadsheet."""
    texts = {relative(module): text_of(module) for module in modules()}
    writers = [name for name, text in texts.items() if re.search(r"csv\.(writer|DictWriter)", text)]
    assert writers
    assert [name for name in writers if "csv_cell(" not in texts[name]] == []
