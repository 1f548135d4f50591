"""Arrays as the page reads them: what decode.js does, in NumPy, gives them back."""

from __future__ import annotations

import numpy as np
import pytest
from page_decoding import decoded, unpacked

from priorfill.report.encode import encode_positions, encode_runs, encode_sparse


@pytest.mark.parametrize("frames", [1, 2, 3, 7, 64, 129])
def test_positions_come_back(frames: int) -> None:
    rng = np.random.default_rng(frames)
    positions = rng.normal(0.0, 5.0, (frames, 4, 3)).cumsum(axis=0) + rng.normal(0, 900, (4, 3))
    coded = encode_positions(positions, block=16)
    assert (coded["coding"], coded["frames"], coded["markers"]) == ("delta2", frames, 4)
    assert len(coded["data"]) == -(-frames // 16)
    assert np.abs(decoded(coded) / 10.0 - positions).max() <= 0.05 + 1e-9


def test_missing_positions_are_held_across_blocks() -> None:
    positions = np.arange(40.0)[:, None, None] + np.zeros((40, 2, 3))
    positions[10:30, 0] = np.nan
    positions[:5, 1] = np.nan
    values = decoded(encode_positions(positions, block=16)) / 10.0
    assert (values[10:30, 0] == 9.0).all()
    assert (values[30:, 0, 0] == np.arange(30, 40)).all()
    assert (values[:5, 1] == 0.0).all()


def test_positions_beyond_the_range_are_at_its_end() -> None:
    positions = np.zeros((5, 1, 3))
    positions[1], positions[3] = 1e300, -1e12
    values = decoded(encode_positions(positions))
    assert values[1, 0, 0] == 2**31 - 1
    assert values[3, 0, 0] == -(2**31 - 1)
    assert (values[[0, 2, 4]] == 0).all()


def test_slow_noisy_motion_takes_less_than_a_byte_for_a_coordinate() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(1000)[:, None, None] / 120.0
    positions = 300.0 * np.sin(3.0 * time + rng.uniform(0, 6, (1, 10, 3)))
    positions = positions + rng.normal(0.0, 0.1, positions.shape)
    size = sum(len(text) for text in encode_positions(positions)["data"])
    assert size < 0.8 * 4 / 3 * positions.size


def test_runs() -> None:
    values = np.array([[0, 1], [0, 1], [2, 1]])
    assert encode_runs(values)["values"] == [[0, 2, 2, 1], [1, 3]]
    assert encode_runs(values > 0)["values"] == [[0, 2, 1, 1], [1, 3]]
    assert encode_runs(np.zeros((1, 1), dtype=np.int8))["values"] == [[0, 1]]


def test_errors_of_chosen_samples() -> None:
    values = np.array([[1.0, np.nan], [2.04, 7000.0], [np.nan, 3.0]])
    chosen = np.array([[True, False], [True, True], [True, True]])
    coded = encode_sparse(values, chosen)
    assert unpacked(coded["data"], 2).tolist() == [10, 20, 65535, 65534, 30]
    assert unpacked(encode_sparse(values, np.zeros_like(chosen))["data"], 2).tolist() == []
