"""The pytest plugin of ``scripts/mutation_sample.py``.

Two environment variables control it:

MUTATION_RECORD   file to write: the tests, their durations, and the lines that each executes
MUTATION_ORDER    file to read: the node ids to run, in order, and the file to which the node id of
                  the first failure is written
"""

from __future__ import annotations

import json
import os
import sys
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

SHARED = "*"
"""Context of lines that no single test executes: imports, fixtures of a module or a session."""


def clear_caches(root: Path) -> None:
    """Empty the function caches of the modules below a folder.

    Otherwise only the first test that needs a cached value would be recorded as depending on it.
    """
    for module in list(sys.modules.values()):
        if str(getattr(module, "__file__", None) or "").startswith(f"{root}{os.sep}"):
            for value in list(vars(module).values()):
                if callable(clear := getattr(value, "cache_clear", None)):
                    clear()


class Recorder:
    """Records which lines of the package each test executes."""

    def __init__(self, root: Path, package: str, output: Path) -> None:
        from coverage import Coverage

        self.root, self.output = root, output
        self.current = SHARED
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()
        self.coverage = Coverage(
            data_file=None, config_file=False, include=[f"{root / package}/*"], messages=False
        )
        self.coverage.set_option(
            "run:disable_warnings", ["no-data-collected", "module-not-measured"]
        )
        self.coverage.start()
        self.coverage.switch_context(SHARED)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Record a test under its node id."""
        clear_caches(self.root)
        self.current = item.nodeid
        self.coverage.switch_context(item.nodeid)
        try:
            return (yield)
        finally:
            self.current = SHARED
            self.coverage.switch_context(SHARED)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Any, Any]:
        """Record a fixture of several tests as shared."""
        if fixturedef.scope == "function":
            return (yield)
        self.coverage.switch_context(SHARED)
        try:
            return (yield)
        finally:
            self.coverage.switch_context(self.current)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add up the duration of a test and record a failure."""
        self.seconds[report.nodeid] += report.duration
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Write the record."""
        self.coverage.stop()
        data = self.coverage.get_data()
        tests = [SHARED, *self.seconds]
        number = {node: place for place, node in enumerate(tests)}
        lines = {
            Path(file).relative_to(self.root).as_posix(): {
                line: [number[context] for context in contexts if context in number]
                for line, contexts in data.contexts_by_lineno(file).items()
            }
            for file in sorted(data.measured_files())
        }
        record = {
            "tests": tests,
            "seconds": [0.0, *self.seconds.values()],
            "failed": sorted(self.failed),
            "lines": lines,
        }
        self.output.write_text(json.dumps(record), encoding="utf-8")


class Selector:
    """Runs the selected tests in the given order and records the first that fails."""

    def __init__(self, order: Path) -> None:
        selected = json.loads(order.read_text(encoding="utf-8"))
        self.place = {node: place for place, node in enumerate(selected["tests"])}
        self.output = Path(selected["failure"])

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """Keep the selected tests."""
        others = [item for item in items if item.nodeid not in self.place]
        items[:] = [item for item in items if item.nodeid in self.place]
        items.sort(key=lambda item: self.place[item.nodeid])
        config.hook.pytest_deselected(items=others)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Record a test file that cannot be imported."""
        if report.failed:
            self.record(report.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Record a test that fails."""
        if report.failed:
            self.record(report.nodeid)

    def record(self, node: str) -> None:
        """Write the node id of the first failure."""
        if not self.output.exists():
            self.output.write_text(node, encoding="utf-8")


def pytest_configure(config: pytest.Config) -> None:
    """Register what the environment variables request."""
    if output := os.environ.get("MUTATION_RECORD"):
        package = os.environ["MUTATION_PACKAGE"]
        config.pluginmanager.register(Recorder(config.rootpath, package, Path(output)))
    if order := os.environ.get("MUTATION_ORDER"):
        config.pluginmanager.register(Selector(Path(order)))
