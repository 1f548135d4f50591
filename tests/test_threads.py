"""How many threads a fill may use."""

from __future__ import annotations

import os

import pytest

from priorfill.threads import NUMBA, VARIABLE, one_thread, thread_count


@pytest.mark.parametrize(
    ("said", "threads"), [("1", 1), ("0", 1), ("3", 3), ("400", 8), ("many", 8), ("", 8)]
)
def test_count(said: str, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setenv(VARIABLE, said)
    assert thread_count() == threads


def test_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (VARIABLE, NUMBA):
        monkeypatch.setenv(name, "5")  # put back after the test
    one_thread()
    assert thread_count() == 1
    assert os.environ[NUMBA] == "1"
