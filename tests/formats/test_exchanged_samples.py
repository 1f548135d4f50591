"""Copies of files in which samples of two markers are exchanged: their bytes, and no others."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import text_files as files
from c3d_bytes import DEC, INTEL, LABELS, MIPS, C3DFile, standing
from text_cases import CASES, with_gap

from priorfill import formats
from priorfill.clip import Clip
from priorfill.filling.swaps import exchange

FRAMES = slice(3, 7)
"""Frames in which markers are exchanged; in some of them the first is missing."""


def exchanged(clip: Clip, *pairs: tuple[int, int]) -> Clip:
    """The clip with pairs of markers exchanged, one after the other."""
    place = np.tile(np.arange(len(clip.labels)), (clip.frames, 1))
    for one, two in pairs:
        place[FRAMES, [one, two]] = place[FRAMES, [two, one]]
    return exchange(clip, place)


def untouched(clip: Clip) -> np.ndarray:
    return np.zeros_like(clip.missing)


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("is_float", [True, False])
def test_whole_records_of_a_c3d_file_are_exchanged(tmp_path, processor, is_float):
    records = standing(step=None if is_float else 0.1)
    records[5:7, 2, 3] = -1
    records[:, :, 3] = np.where(records[:, :, 3] < 0, -1, 256 * np.arange(10) + 3)  # cameras
    analog = np.arange(12 * 2 * 3).reshape(12, 2, 3)
    file = C3DFile(records, LABELS, processor, is_float, analog=analog)
    (tmp_path / "in.c3d").write_bytes(file.bytes())
    clip = exchanged(formats.read(tmp_path / "in.c3d"), (2, 6), (6, 9))
    formats.write(tmp_path / "out.c3d", clip, untouched(clip))
    records[FRAMES, [2, 6, 9]] = records[FRAMES, [6, 9, 2]]
    assert (tmp_path / "out.c3d").read_bytes() == C3DFile(
        records, LABELS, processor, is_float, analog=analog
    ).bytes()
    again = formats.read(tmp_path / "out.c3d")
    np.testing.assert_array_equal(again.positions, clip.positions)
    assert again.missing[5:7, 9].all()
    assert not again.missing[:, :9].any()


def test_a_gap_that_has_moved_is_filled(tmp_path):
    records = standing()
    records[5:7, 2, 3] = -1
    (tmp_path / "in.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    clip = exchanged(formats.read(tmp_path / "in.c3d"), (2, 6))
    filled = clip.missing
    assert filled[5:7, 6].all()
    clip = clip.with_positions(np.where(filled[..., None], 12.5, clip.positions))
    formats.write(tmp_path / "out.c3d", clip, filled)
    records[FRAMES, [2, 6]] = records[FRAMES, [6, 2]]
    records[5:7, 6] = [12.5, 12.5, 12.5, 0]
    assert (tmp_path / "out.c3d").read_bytes() == C3DFile(records, LABELS).bytes()


@pytest.mark.parametrize("is_float", [True, False])
def test_samples_of_a_rewritten_c3d_file(tmp_path, is_float):
    records = standing(step=None if is_float else 0.1)
    # cameras and residual of each point
    records[:, :, 3] = 256 * (12 * np.arange(10) + 7) + np.arange(10) + 3
    records[5, 2] = records[5, 4] = [0, 0, 0, -1]
    if is_float:
        records[6, 4, 0] = np.nan  # missing, with cameras
    (tmp_path / "in.c3d").write_bytes(C3DFile(records, LABELS, is_float=is_float).bytes())
    clip = exchanged(formats.read(tmp_path / "in.c3d"), (2, 6))
    filled = clip.missing
    filled[5, 6] = False
    assert filled.sum() == 1 + is_float
    clip = clip.with_positions(np.where(filled[..., None], 100.0, clip.positions))
    report = formats.write(tmp_path / "out.c3d", clip, filled, rewrite=True)
    again = formats.read(tmp_path / "out.c3d")
    np.testing.assert_allclose(again.positions, clip.positions, rtol=1e-6)
    assert again.missing[5, 6]
    assert not any("measured samples differ" in change for change in report.changes)
    records[FRAMES, [2, 6]] = records[FRAMES, [6, 2]]
    records[filled, 3] = 0
    data = (tmp_path / "out.c3d").read_bytes()
    start = 512 * (struct.unpack("<H", data[16:18])[0] - 1)
    stored = np.frombuffer(data, "<f4", records.size, start).reshape(records.shape)
    np.testing.assert_array_equal(stored[..., 3], records[..., 3])


@pytest.mark.parametrize("name", CASES)
def test_cells_of_a_table_are_exchanged(tmp_path, name):
    write, suffix, up, scale, options = CASES[name]
    positions = with_gap(up) * scale
    (tmp_path / f"in{suffix}").write_bytes(write(positions, **options))
    clip = exchanged(formats.read(tmp_path / f"in{suffix}"), (0, 4), (4, 5))
    formats.write(tmp_path / f"out{suffix}", clip, untouched(clip))
    positions[FRAMES, [0, 4, 5]] = positions[FRAMES, [4, 5, 0]]
    assert (tmp_path / f"out{suffix}").read_bytes() == write(positions, **options)
    again = formats.read(tmp_path / f"out{suffix}")
    np.testing.assert_array_equal(again.positions, clip.positions)


def test_cells_are_exchanged_as_they_are_written(tmp_path):
    lines = files.nexus(standing_table()).split(b"\n")
    cells = lines[5 + FRAMES.start].split(b",")
    cells[2:5], cells[8:11] = [b'"1.50"', b" 2.5", b"3."], [b"-4e2", b"5", b"+6.00"]
    lines[5 + FRAMES.start] = b",".join(cells)
    (tmp_path / "in.csv").write_bytes(b"\n".join(lines))
    clip = exchanged(formats.read(tmp_path / "in.csv"), (0, 2))
    formats.write(tmp_path / "out.csv", clip, untouched(clip))
    cells[2:5], cells[8:11] = cells[8:11], cells[2:5]
    row = (tmp_path / "out.csv").read_bytes().split(b"\n")[5 + FRAMES.start]
    assert row == b",".join(cells)


def standing_table() -> np.ndarray:
    return files.standing(12)


def test_rows_that_end_early(tmp_path):
    positions = files.standing(12, 1)
    positions[4:6, 5] = np.nan
    positions[5:7, 0] = np.nan

    def trc(some: np.ndarray) -> bytes:
        return b"\r\n".join(line.rstrip(b"\t") for line in files.trc(some).split(b"\r\n"))

    (tmp_path / "in.trc").write_bytes(trc(positions))
    clip = exchanged(formats.read(tmp_path / "in.trc"), (0, 5))
    formats.write(tmp_path / "out.trc", clip, untouched(clip))
    positions[FRAMES, [0, 5]] = positions[FRAMES, [5, 0]]
    assert (tmp_path / "out.trc").read_bytes() == trc(positions)


def test_cells_separated_by_blanks(tmp_path):
    positions = files.standing(12, 1)
    positions[4, 2] = np.nan

    def trc(some: np.ndarray) -> bytes:
        return files.trc(some, missing="NaN", newline="\n").replace(b"\t", b"  ")

    (tmp_path / "in.trc").write_bytes(trc(positions))
    clip = exchanged(formats.read(tmp_path / "in.trc"), (2, 3))
    formats.write(tmp_path / "out.trc", clip, untouched(clip))
    positions[FRAMES, [2, 3]] = positions[FRAMES, [3, 2]]
    assert (tmp_path / "out.trc").read_bytes() == trc(positions)


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".trc"])
def test_new_files_hold_the_exchanged_samples(tmp_path, suffix):
    records = standing()
    records[:, :, 3] = 3.0
    records[5:7, 2, 3] = 0  # interpolated
    (tmp_path / "in.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    clip = exchanged(formats.read(tmp_path / "in.c3d"), (2, 6))
    formats.write(tmp_path / f"out{suffix}", clip, untouched(clip))
    again = formats.read(tmp_path / f"out{suffix}", up=clip.up)
    np.testing.assert_allclose(again.positions, clip.positions, rtol=0, atol=1e-4)
    if again.source.interpolated is not None:
        assert np.argwhere(again.source.interpolated).tolist() == [[5, 6], [6, 6]]
