"""How many threads a fill may use."""

from __future__ import annotations

import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from priorfill.cli import main
from priorfill.formats import write
from priorfill.runtime import threads as threads_module
from priorfill.runtime.threads import (
    VARIABLE,
    by_frames,
    limit_threads,
    map_in_threads,
    thread_count,
)
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


@pytest.fixture
def four_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "4")
    monkeypatch.setattr(os, "cpu_count", lambda: 4)


def test_one_thread_maps_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "1")
    with map_in_threads() as mapped:
        assert mapped is map


def test_results_are_in_order_and_each_call_is_made_once(four_threads: None) -> None:
    made = []

    def work(outer: int, inner: int) -> int:
        made.append((outer, inner))
        return 10 * outer + inner

    with map_in_threads() as mapped:
        rows = list(mapped(lambda row: list(mapped(work, [row] * 5, range(5))), range(30)))
        assert list(mapped(abs, [])) == []
    assert rows == [[10 * outer + inner for inner in range(5)] for outer in range(30)]
    assert sorted(made) == [(outer, inner) for outer in range(30) for inner in range(5)]


def test_all_threads_take_part_in_one_long_item(four_threads: None) -> None:
    together = threading.Barrier(4, timeout=20.0)
    with map_in_threads() as mapped:
        # nothing passes the barrier until four threads work on the inner items
        assert list(mapped(lambda _: len(list(mapped(lambda _: together.wait(), range(4)))), [0]))


def test_passes_over_small_arrays_are_not_shared(four_threads: None) -> None:
    with map_in_threads(2 * threads_module.MIN_SHARED - 1) as mapped:
        assert mapped is map
    with map_in_threads(2 * threads_module.MIN_SHARED) as mapped:
        assert mapped is not map


@pytest.mark.parametrize("frames", [0, 1, 7, 1000])
def test_blocks_of_frames_cover_all_frames_in_order(
    frames: int, four_threads: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threads_module, "MIN_SHARED", 10)
    monkeypatch.setattr(threads_module, "BLOCK_NUMBERS", 100)
    values, doubled = np.arange(3.0 * frames).reshape(frames, 3), np.zeros((frames, 3))

    def double(some: np.ndarray, into: np.ndarray) -> np.ndarray:
        into[:] = 2.0 * some
        return some

    blocks = by_frames(double, values, doubled)
    np.testing.assert_array_equal(np.concatenate(blocks), values)
    np.testing.assert_array_equal(doubled, 2.0 * values)
    assert max(block.size for block in blocks) <= 100


def test_an_error_is_raised_and_stops_the_rest(four_threads: None) -> None:
    made = []

    def work(number: int) -> int:
        made.append(number)
        if number == 3:
            raise ZeroDivisionError
        return number

    with pytest.raises(ZeroDivisionError), map_in_threads() as mapped:
        list(mapped(lambda row: list(mapped(work, row)), [range(2), range(2, 5), range(5, 500)]))
    assert len(made) < 100


def test_the_filled_file_is_the_same_for_any_number_of_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    monkeypatch.setattr(threads_module, "MIN_SHARED", 1)  # passes over small arrays, too
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
