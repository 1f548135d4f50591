"""Which tests reach a fault of ``scripts/mutation_sample.py``.

Each test file runs once under coverage, with a context for each test. Its record is cached, and
valid as long as the test file, the helper modules of the tests and the modules executed stay the
same. Coverage does not trace compiled functions: a test reaches a compiled function if it executes
a caller, and a constant if it executes a statement that reads it.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import subprocess
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mutation.operators import Place
from mutation.sites import Site, walk

SHARED = 0
"""Index of the lines that no single test executes: imports, fixtures of a module."""

RECORDING = 1800.0
"""Timeout of recording one test file, s."""

Run = Callable[[list[str], dict[str, str], float], "subprocess.CompletedProcess[str]"]
"""Runs pytest in a copy: arguments, additional environment variables, timeout (s)."""

Name = tuple[str, str]
"""Path of a module and a name in it, or "" and an attribute."""


@dataclass(frozen=True)
class Record:
    """The lines that the tests of a file execute.

    Attributes
    ----------
    file : str
        The test file, relative to the checkout.
    tests : list of str
        Node ids; the first element is a placeholder for all tests.
    seconds : list of float
        Duration of each test, s.
    failed : list of str
        Tests that fail without a fault.
    lines : dict
        Path of a module to line to indices of the tests that execute it.
    """

    file: str
    tests: list[str]
    seconds: list[float]
    failed: list[str]
    lines: dict[str, dict[int, list[int]]]

    def executing(self, path: str, first: int, last: int) -> set[int]:
        """Return the tests that execute any of some lines."""
        lines = self.lines.get(path, {})
        found = {test for line in range(first, last + 1) for test in lines.get(line, ())}
        return set(range(1, len(self.tests))) if SHARED in found else found


def digest(*contents: bytes) -> str:
    """Return a short hash of contents."""
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:32]


def recordings(root: Path) -> Path:
    """Return the folder of recordings, which may not exist: some tests are skipped without it."""
    return Path(os.environ.get("PRIORFILL_DATA", root.parent / "shared" / "data"))


def test_files(root: Path) -> list[str]:
    """Return the test files of a checkout, relative to it."""
    return sorted(f.relative_to(root).as_posix() for f in (root / "tests").rglob("test_*.py"))


class Recorder:
    """Makes and caches the records of test files."""

    def __init__(self, root: Path, package: str, cache: Path) -> None:
        self.root, self.package = root, package
        self.cache = cache / "records"
        self.cache.mkdir(parents=True, exist_ok=True)
        helpers = (f for f in sorted((root / "tests").rglob("*.py")) if f.name[:5] != "test_")
        with_recordings = str(recordings(root).is_dir()).encode()
        self.common = digest(with_recordings, *(f.read_bytes() for f in helpers))

    def place(self, file: str) -> Path:
        """Return the file of the cache for a test file."""
        content = (self.root / file).read_bytes()
        return self.cache / f"{digest(file.encode(), content, self.common.encode())}.json"

    def known(self, file: str) -> Record | None:
        """Return the record of a test file if it is in the cache and valid."""
        try:
            raw = json.loads(self.place(file).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        for path, content in raw["hashes"].items():
            if not (self.root / path).is_file() or self.hash(path) != content:
                return None
        return as_record(file, raw)

    def hash(self, path: str) -> str:
        """Return the hash of a file of the checkout."""
        return digest((self.root / path).read_bytes())

    def record(self, file: str, run: Run, scratch: Path) -> Record:
        """Run a test file under coverage and cache its record."""
        output = scratch / "record.json"
        output.unlink(missing_ok=True)
        environment = {"MUTATION_RECORD": str(output), "MUTATION_PACKAGE": self.package}
        done = run([file], environment, RECORDING)
        if not output.exists():
            raise RuntimeError(f"{file}: no record was made; pytest printed\n{done.stdout[-2000:]}")
        raw = json.loads(output.read_text(encoding="utf-8"))
        raw["hashes"] = {path: self.hash(path) for path in raw["lines"]}
        place = self.place(file)
        part = place.with_suffix(f".{os.getpid()}.{time.monotonic_ns()}")
        part.write_text(json.dumps(raw), encoding="utf-8")
        part.replace(place)
        return as_record(file, raw)


def as_record(file: str, raw: dict[str, Any]) -> Record:
    """Convert the JSON form of a record."""
    lines = {
        path: {int(line): tests for line, tests in found.items()}
        for path, found in raw["lines"].items()
    }
    return Record(file, raw["tests"], raw["seconds"], raw["failed"], lines)


class Readers:
    """Static analysis of a package: where names are read, and who imports what."""

    def __init__(self, root: Path, package: str) -> None:
        self.root = root
        self.paths = sorted(f.relative_to(root).as_posix() for f in (root / package).rglob("*.py"))
        self.modules = {
            path.removesuffix(".py").removesuffix("/__init__").replace("/", "."): path
            for path in self.paths
        }
        self.imported: dict[Name, Name] = {}
        self.imports: dict[str, set[str]] = defaultdict(set)
        self.places: dict[Name, list[tuple[str, Place]]] = defaultdict(list)
        self.compiling: set[str] = set()
        for path in self.paths:
            tree = ast.parse((root / path).read_bytes())
            self._read_imports(path, tree)
            for node, place in walk(tree, Place()):
                if place.compiled:
                    self.compiling.add(path)
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                    self.places[path, node.id].append((path, place))
                elif isinstance(node, ast.Attribute):
                    self.places["", node.attr].append((path, place))

    def _read_imports(self, path: str, tree: ast.AST) -> None:
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    whole = f"{node.module}.{alias.name}"
                    if source := self.modules.get(whole) or self.modules.get(node.module):
                        self.imports[path].add(source)
                        self.imported[path, alias.asname or alias.name] = (source, alias.name)

    @cached_property
    def local_names(self) -> dict[Name, list[Name]]:
        """Names under which other modules import a name."""
        found = defaultdict(list)
        for local, origin in self.imported.items():
            found[origin].append(local)
        return found

    def of(self, path: str, name: str) -> list[tuple[str, Place]]:
        """Return the places where a name of a module is read, also as an attribute."""
        found = list(self.places["", name])
        waiting, seen = [(path, name)], set()
        while waiting:
            local = waiting.pop()
            if local not in seen:
                seen.add(local)
                found += self.places[local]
                waiting += self.local_names.get(local, [])
        return found

    def recompiled(self, path: str) -> list[str]:
        """Return the modules whose compiled functions may contain code of a module."""
        found = []
        for module in sorted(self.compiling):
            waiting, seen = [module], set()
            while waiting:
                if (current := waiting.pop()) not in seen:
                    seen.add(current)
                    waiting += self.imports[current]
            if path in seen:
                found.append(module)
        return found


class Reach:
    """Selects the tests that reach a fault, the cheapest and most specific first."""

    def __init__(self, root: Path, readers: Readers, records: list[Record]) -> None:
        self.readers, self.records = readers, records
        self.texts = {r.file: (root / r.file).read_text(encoding="utf-8") for r in records}

    def tests(self, site: Site) -> list[tuple[Record, list[int]]]:
        """Return the test files that reach a fault, with the indices of their tests.

        The module's own test file comes first, then the others by the total duration of the
        selected tests; tests of a file are ordered by duration.
        """
        found: dict[str, set[int]] = defaultdict(set)
        if site.names:
            for name in site.names:
                self._through(site.path, name, found, set())
        else:
            self._executing(site.path, site.span, found)
        if not any(found.values()):
            self._by_name(site, found)
        selected = []
        for record in self.records:
            tests = [t for t in found[record.file] if record.tests[t] not in record.failed]
            if tests:
                selected.append((record, sorted(tests, key=lambda t: (record.seconds[t], t))))
        return sorted(selected, key=lambda item: (not own(site, item[0]), expected(*item)))

    def _executing(self, path: str, span: tuple[int, int], found: dict[str, set[int]]) -> None:
        for record in self.records:
            found[record.file] |= record.executing(path, *span)

    def _through(self, path: str, name: str, found: dict[str, set[int]], seen: set[Name]) -> None:
        """Add the tests that reach where a name is read, and those that mention it."""
        if (path, name) in seen or not name:
            return
        seen.add((path, name))
        if name.isupper() or path in self.readers.compiling:
            self._mentioning(path, name, found)
        for reader, place in self.readers.of(path, name):
            if not place.names:
                self._executing(reader, place.span, found)
            for other in place.names:
                self._through(reader, other, found, seen)

    def _mentioning(self, path: str, name: str, found: dict[str, set[int]]) -> None:
        stem = Path(path).stem
        for record in self.records:
            text = self.texts[record.file]
            if stem in text and re.search(rf"\b{re.escape(name)}\b", text):
                found[record.file] |= set(range(1, len(record.tests)))

    def _by_name(self, site: Site, found: dict[str, set[int]]) -> None:
        """Add the module's own test file, and those that import the module by name."""
        module = site.path.removesuffix(".py").replace("/", ".")
        package, _, stem = module.rpartition(".")
        for record in self.records:
            text = self.texts[record.file]
            by_name = module in text or f"from {package} import {stem}" in text
            if by_name or own(site, record):
                found[record.file] |= set(range(1, len(record.tests)))


def own(site: Site, record: Record) -> bool:
    """Return whether a test file is named after a fault's module, or after its folder."""
    module, test = Path(site.path), Path(record.file).stem.removeprefix("test_")
    return test == module.stem or (len(module.parts) > 2 and test == module.parts[-2])


def expected(record: Record, tests: list[int]) -> float:
    """Return the total duration of some tests of a file, s."""
    return sum(record.seconds[test] for test in tests)
