"""How many threads a fill may use."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from priorfill.cli import main
from priorfill.formats import write
from priorfill.runtime.threads import VARIABLE, limit_threads, thread_count
from priorfill.synthetic.demo import make_demo_clip


@pytest.mark.parametrize(
    ("value", "threads"), [("1", 1), ("0", 1), ("3", 3), ("400", 8), ("many", 8), ("", 8)]
)
def test_count(value: str, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setenv(VARIABLE, value)
    assert thread_count() == threads


def test_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "5")  # restored after the test
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    limit_threads(2)
    assert thread_count() == 2


def test_the_filled_file_is_the_same_for_any_number_of_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "")
    whole = make_demo_clip()[1]
    clip = replace(whole, positions=whole.positions[:300])  # three gaps, an arm among them
    write(tmp_path / "in.c3d", clip)
    made = []
    for threads in ("1", "3"):
        output = tmp_path / f"out{threads}.c3d"
        arguments = ["fill", str(tmp_path / "in.c3d"), "-o", str(output), "--threads", threads]
        assert CliRunner().invoke(main, arguments).exit_code in (0, 3)
        made.append(output.read_bytes())
    assert made[0] == made[1]
    assert CliRunner().invoke(main, [*arguments[:-1], "0"]).exit_code == 2
