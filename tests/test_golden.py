"""Fills of fixed gaps reproduce the stored results of `scripts/golden.py`."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from scripted import SCRIPTS, load_script

golden = load_script("golden")

STORED = golden.stored_rows()
run = golden.run  # which a test replaces

ROWS = pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.realdata if case.recorded else ())
        for name, case in golden.CASES.items()
    ],
)


@cache
def result_of(name: str, folder: Path | None) -> Any:
    """The result of a row, computed once for all tests."""
    return run(golden.CASES[name], folder)


def stored_and_found(name: str, request: pytest.FixtureRequest) -> tuple[Any, Any]:
    """The stored and the new result of a row; skips rows whose recordings are absent."""
    folder = request.getfixturevalue("data") if golden.CASES[name].recorded else None
    assert name in STORED, golden.message(name, ["not stored"])
    return STORED[name], result_of(name, folder)


@ROWS
def test_results_are_reproduced(name: str, request: pytest.FixtureRequest) -> None:
    stored, found = stored_and_found(name, request)
    worse = golden.regressions(stored, found)
    assert not worse, golden.message(name, worse)
    differences = golden.differing(stored, found)
    assert not differences, golden.message(name, differences)


def test_stored_rows_are_those_of_the_table() -> None:
    assert list(STORED) == list(golden.CASES)
    for name, row in STORED.items():
        assert row.filled > 0, name
        assert row.error > 0, name
        assert len(row.samples) == min(golden.SAMPLES, 3 * row.filled), name


# the guard itself


STORED_ROW = golden.Row(100, 10.0, 12.0, 20.0, 0.9, tuple(float(i) for i in range(40)))


def test_equal_rows_do_not_differ() -> None:
    assert golden.regressions(STORED_ROW, STORED_ROW) == []
    assert golden.differing(STORED_ROW, STORED_ROW) == []
    without = replace(STORED_ROW, expected_rms=None, bound=None, coverage=None)
    assert golden.differing(without, without) == []


@pytest.mark.parametrize(
    "change",
    [{"error": 10.21}, {"error": float("nan")}, {"filled": 99}],
    ids=["error", "no number", "filled"],
)
def test_a_worse_row_is_a_regression(change: dict[str, Any]) -> None:
    assert golden.regressions(STORED_ROW, replace(STORED_ROW, **change))


def test_a_better_row_is_no_regression() -> None:
    assert golden.regressions(STORED_ROW, replace(STORED_ROW, error=9.0, filled=101)) == []
    assert golden.regressions(STORED_ROW, replace(STORED_ROW, error=10.19)) == []


@pytest.mark.parametrize(
    "change",
    [
        {"filled": 101},
        {"error": 9.98},
        {"expected_rms": 12.02},
        {"expected_rms": None},
        {"bound": 19.97},
        {"bound": float("nan")},
        {"coverage": 0.91},
        {"coverage": None},
        {"samples": (*STORED_ROW.samples[:-1], 39.02)},
        {"samples": (*STORED_ROW.samples[:-1], float("nan"))},
        {"samples": STORED_ROW.samples[:-1]},
    ],
    ids=str,
)
def test_an_altered_row_differs(change: dict[str, Any]) -> None:
    assert golden.differing(STORED_ROW, replace(STORED_ROW, **change))


def test_an_altered_stored_row_fails(request: pytest.FixtureRequest) -> None:
    name = "dropout_database"
    stored, found = stored_and_found(name, request)
    lower = replace(stored, error=stored.error / 1.03)
    worse = golden.regressions(lower, found)
    assert len(worse) == 1
    assert name in golden.message(name, worse)
    assert f"golden.py --write --only {name}" in golden.message(name, worse)
    moved = replace(stored, samples=(stored.samples[0] + 0.02, *stored.samples[1:]))
    assert len(golden.differing(moved, found)) == 1


def test_recordings_store_errors_alone(request: pytest.FixtureRequest) -> None:
    for name, case in golden.CASES.items():
        if case.recorded:  # coordinates lie metres from the origin, and below it
            assert min(STORED[name].samples) >= 0.0
            assert max(STORED[name].samples) < 40 * STORED[name].error


def test_written_rows_are_read_again(tmp_path: Path) -> None:
    file = tmp_path / "golden" / "accuracy.json"
    assert golden.stored_rows(file) == {}
    golden.write_rows(STORED, file)
    assert golden.stored_rows(file) == STORED
    assert file.read_text("utf-8") == golden.STORED.read_text("utf-8")


def run_script(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str
) -> str:
    """Run the script in this process, and return what it prints."""
    monkeypatch.setattr(sys, "argv", ["golden.py", *arguments])
    monkeypatch.setattr(golden, "run", lambda case, folder: result_of(case.name, folder))
    assert golden.main() == 0
    return capsys.readouterr().out


def test_the_script_prints_a_row(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    printed = run_script(capsys, monkeypatch, "--only", "dropout_database")
    (line,) = [x for x in printed.splitlines() if x.startswith("dropout_database")]
    stored = STORED["dropout_database"]
    assert line.split()[1:3] == [str(stored.filled)] * 2
    assert f"{stored.error:.3f}" in line
    assert "same" in line


def test_the_script_skips_recordings_that_are_absent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ["--only", "cmu_single", "--data", str(tmp_path / "absent")]
    printed = run_script(capsys, monkeypatch, *options)
    assert "skipped, because there is no folder" in printed
    assert "cmu_single" in printed.splitlines()[-1]


def test_the_script_names_the_rows_it_does_not_have() -> None:
    here = {**os.environ, "PYTHONPATH": str(SCRIPTS.parent)}
    command = [sys.executable, str(SCRIPTS / "golden.py"), "--only", "nonsense"]
    done = subprocess.run(command, env=here, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "there is no row nonsense" in done.stderr
