from __future__ import annotations

import errno
import mmap
import os
import warnings
from dataclasses import replace
from pathlib import Path

import c3d as second_reader
import ezc3d
import numpy as np
import pytest
from c3d_bytes import DEC, INTEL, LABELS, MIPS, C3DFile, read_float, read_short, standing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from platforms import on_wine

from priorfill import formats
from priorfill.clip import Clip
from priorfill.errors import FormatError, OptionError, OutputError
from priorfill.formats import (
    WriteReport,
    create_c3d,
    read_c3d,
    write_c3d,
)
from priorfill.formats.c3d import patch as c3d_patch
from priorfill.formats.c3d.layout import parse_layout, read_points

STEP = 0.1
FEW = 2
"""Recordings per folder used by a test."""


@pytest.fixture
def source(tmp_path):
    """A clip read from a file with a gap, and that file's content."""

    def make(name: str = "in.c3d", **options):
        options = {"is_float": True, "scale": STEP, **options}
        records = options.pop("records", None)
        if records is None:
            records = standing(step=None if options["is_float"] else STEP)
            records[4:7, 2, 3] = -1
        file = C3DFile(records, LABELS, **options)
        path = tmp_path / name
        path.write_bytes(file.bytes())
        return read_c3d(path), file

    return make


def fill(clip: Clip, at: list[tuple[int, int]], values) -> tuple[Clip, np.ndarray]:
    """The clip with values at some (frame, marker), and their mask."""
    filled = np.zeros_like(clip.missing)
    positions = clip.positions.copy()
    for (frame, marker), value in zip(at, values, strict=True):
        filled[frame, marker] = True
        positions[frame, marker] = value
    return clip.with_positions(positions), filled


GAP = [(4, 2), (5, 2), (6, 2)]
VALUES = [(10.25, -20.5, 1430.0), (0.0, 0.0, 0.0), (-3.0, 7.0, 1e3 / 3)]


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("is_float", [True, False])
def test_only_the_filled_words_change(tmp_path, source, processor, is_float):
    analog = np.arange(12 * 2 * 3).reshape(12, 2, 3)
    clip, file = source(processor=processor, is_float=is_float, analog=analog)
    clip, filled = fill(clip, GAP, VALUES)
    report = write_c3d(tmp_path / "out.c3d", clip, filled)
    assert report.samples == 3
    before, after = file.bytes(), (tmp_path / "out.c3d").read_bytes()
    expected = bytearray(before)
    size = 4 if is_float else 2
    read = read_float if is_float else read_short
    worst = 0.0
    for (frame, marker), value in zip(GAP, VALUES, strict=True):
        start = file.offset(frame, marker)
        words = [
            read(after[start + i * size : start + (i + 1) * size], processor) for i in range(4)
        ]
        position = np.array(words[:3]) * (1 if is_float else STEP)
        np.testing.assert_allclose(position, value, atol=1e-4 if is_float else STEP)
        worst = max(worst, np.abs(position - value).max())
        assert words[3] == 0
        expected[start : start + 4 * size] = after[start : start + 4 * size]
    assert after == bytes(expected)
    assert report.rounding_mm == pytest.approx(worst, abs=1e-6)
    back = read_c3d(tmp_path / "out.c3d")
    assert not back.missing.any()


@pytest.mark.parametrize("is_float", [True, False])
def test_units_are_converted_back(tmp_path, source, is_float):
    records = standing(step=None if is_float else STEP)
    records[4, 2, 3] = -1
    scale = STEP / 1000
    if is_float:
        records[:, :, :3] /= 1000
    clip, _ = source(records=records, is_float=is_float, scale=scale, units="m")
    clip, filled = fill(clip, GAP[:1], VALUES[:1])
    report = write_c3d(tmp_path / "out.c3d", clip, filled)
    back = read_c3d(tmp_path / "out.c3d")
    np.testing.assert_allclose(back.positions[4, 2], VALUES[0], atol=1e-3 if is_float else STEP)
    assert report.rounding_mm <= (1e-3 if is_float else 0.5 * STEP * 1.001)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    processor=st.sampled_from([INTEL, DEC, MIPS]),
    is_float=st.booleans(),
    channels=st.integers(0, 3),
    at=st.sets(st.tuples(st.integers(0, 11), st.integers(0, 9)), max_size=30),
    seed=st.integers(0, 2**16),
)
def test_any_set_of_samples(tmp_path, source, processor, is_float, channels, at, seed):
    analog = np.arange(12 * 2 * channels).reshape(12, 2, channels) if channels else None
    clip, file = source(processor=processor, is_float=is_float, analog=analog)
    places = sorted(at)
    values = np.random.default_rng(seed).uniform(-3000, 3000, (len(places), 3))
    clip, filled = fill(clip, places, values)
    write_c3d(tmp_path / "out.c3d", clip, filled, overwrite=True)
    after = bytearray((tmp_path / "out.c3d").read_bytes())
    before = bytearray(file.bytes())
    for frame, marker in places:
        start = file.offset(frame, marker)
        for content in (before, after):
            content[start : start + (16 if is_float else 8)] = b""  # blank the record in both
            content[start:start] = bytes(16 if is_float else 8)
    assert before == after
    back = read_c3d(tmp_path / "out.c3d")
    for (frame, marker), value in zip(places, values, strict=True):
        atol = 1e-3 if is_float else 0.5 * STEP * 1.001
        np.testing.assert_allclose(back.positions[frame, marker], value, atol=atol)


def test_a_point_beyond_the_integers(tmp_path, source):
    clip, _ = source(is_float=False, first_frame=101)
    clip, filled = fill(clip, GAP[:1], [(0, 0, 4000.0)])
    with pytest.raises(OutputError, match=r"position of C7 in frame 105 is 4000 .* end at 3277"):
        write_c3d(tmp_path / "out.c3d", clip, filled)
    assert not (tmp_path / "out.c3d").exists()


def test_a_filled_sample_without_position(tmp_path, source):
    clip, _ = source(first_frame=101)
    with pytest.raises(OutputError, match=r"marker C7 .* in frame 105 but has no position"):
        write_c3d(tmp_path / "out.c3d", clip, clip.missing)


def test_mask_of_another_shape(tmp_path, source):
    clip, _ = source()
    with pytest.raises(OutputError, match="has shape"):
        write_c3d(tmp_path / "out.c3d", clip, clip.missing[1:])


def test_the_source_is_never_written(tmp_path, source):
    clip, file = source()
    clip, filled = fill(clip, GAP, VALUES)
    os.link(tmp_path / "in.c3d", tmp_path / "hard.c3d")
    names = ["in.c3d", "hard.c3d"]
    if not on_wine():  # which follows no symbolic link
        (tmp_path / "link.c3d").symlink_to("in.c3d")
        names.append("link.c3d")
    for name in names:
        with pytest.raises(OutputError, match="is the file that the clip was read from"):
            write_c3d(tmp_path / name, clip, filled, overwrite=True)
    assert (tmp_path / "in.c3d").read_bytes() == file.bytes()


def test_existing_file_and_new_folder(tmp_path, source):
    clip, _ = source()
    clip, filled = fill(clip, GAP, VALUES)
    write_c3d(tmp_path / "out.c3d", clip, filled)
    with pytest.raises(OutputError, match="exists already"):
        write_c3d(tmp_path / "out.c3d", clip, filled)
    write_c3d(tmp_path / "out.c3d", clip, filled, overwrite=True)
    write_c3d(tmp_path / "new" / "out.c3d", clip, filled)
    assert (tmp_path / "new" / "out.c3d").read_bytes() == (tmp_path / "out.c3d").read_bytes()


def test_changed_source(tmp_path, source):
    clip, file = source()
    clip, filled = fill(clip, GAP, VALUES)
    (tmp_path / "in.c3d").write_bytes(file.bytes() + b"x")
    with pytest.raises(OutputError, match="has changed since it was read"):
        write_c3d(tmp_path / "out.c3d", clip, filled)
    (tmp_path / "in.c3d").unlink()
    with pytest.raises(FormatError, match="no such file"):
        write_c3d(tmp_path / "out.c3d", clip, filled)


@pytest.mark.parametrize("now", ["other", "shorter", "empty", "gone"])
@pytest.mark.parametrize("late", [False, True], ids=["before it is copied", "after"])
def test_a_source_that_changes_while_it_is_copied(tmp_path, source, monkeypatch, now, late):
    clip, file = source()
    clip, filled = fill(clip, GAP, VALUES)
    write, content = c3d_patch._write, file.bytes()
    given = {"other": content[:-1] + b"x", "shorter": content[:-1], "empty": b""}

    def change():
        (tmp_path / "in.c3d").unlink()
        if now in given:
            (tmp_path / "in.c3d").write_bytes(given[now])

    def disturbed(path, ready):
        if late:
            write(path, ready)
        change()
        if not late:
            write(path, ready)

    monkeypatch.setattr(c3d_patch, "_write", disturbed)
    with pytest.raises((OutputError, FormatError), match=r"has changed since|no such file"):
        write_c3d(tmp_path / "out.c3d", clip, filled)
    assert [path.name for path in tmp_path.iterdir()] == ["in.c3d"] * (now != "gone")


def test_a_source_where_files_cannot_be_mapped(tmp_path, source, monkeypatch):
    """Some network and virtual file systems do not support it."""

    def refuse(*given, **more):
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    clip, file = source()
    clip, filled = fill(clip, GAP, VALUES)
    monkeypatch.setattr(mmap, "mmap", refuse)
    write_c3d(tmp_path / "out.c3d", clip, filled)
    assert len((tmp_path / "out.c3d").read_bytes()) == len(file.bytes())


@pytest.mark.parametrize("fault", ["other byte", "other value", "shorter"])
def test_a_copy_that_reads_back_wrong_is_removed(tmp_path, source, monkeypatch, fault):
    clip, file = source()
    clip, filled = fill(clip, GAP, VALUES)
    write = c3d_patch._write

    def spoil(path, ready):
        write(path, ready)
        content = bytearray(path.read_bytes())
        at = 100 if fault == "other byte" else file.offset(4, 2) + 2
        content[at] ^= 0x40
        if fault == "shorter":
            del content[-1]
        path.write_bytes(content)

    monkeypatch.setattr(c3d_patch, "_write", spoil)
    with pytest.raises(OutputError, match="does not read back as intended"):
        write_c3d(tmp_path / "out.c3d", clip, filled)
    assert [path.name for path in tmp_path.iterdir()] == ["in.c3d"]


# --- new files -------------------------------------------------------------------------


def made(**options) -> Clip:
    positions = standing()[:, :, :3].copy()
    positions[4:7, 2] = np.nan
    settings = {"rate": 120.0, "subject": "Anna", "first_frame": 31, "up": "+Z", **options}
    return Clip(positions=positions, labels=tuple(LABELS), **settings)


@pytest.mark.parametrize("first", [-5, 0, 1, 65524, 65530, 70000])
def test_frame_numbers_that_a_new_file_cannot_hold_are_reported(tmp_path, first):
    report = create_c3d(tmp_path / "new.c3d", made(first_frame=first))
    held = 1 <= first <= 65524  # 12 frames
    assert read_c3d(tmp_path / "new.c3d").first_frame == (first if held else 1)
    assert [change[: change.index(",")] for change in report.changes] == (
        [] if held else [f"frame {first} becomes frame 1"]
    )


@pytest.mark.parametrize("name", ["new.c3d", "NEW.C3D"])
def test_a_new_file(tmp_path, name):
    clip = made()
    report = create_c3d(tmp_path / name, clip)
    assert report == WriteReport(samples=0, rounding_mm=0.0)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    back = read_c3d(tmp_path / name)
    np.testing.assert_allclose(back.positions, clip.positions, rtol=1e-6)
    np.testing.assert_array_equal(back.missing, clip.missing)
    for what in ("labels", "rate", "up", "subject", "first_frame"):
        assert getattr(back, what) == getattr(clip, what), what
    assert back.source.notes == ()
    residuals = ezc3d.c3d(str(tmp_path / name))["data"]["meta_points"]["residuals"][0].T
    assert (residuals[clip.missing] == -1).all()
    assert (residuals[~clip.missing] == 0).all()


@pytest.mark.parametrize("up", ["+X", "-Y", "+Y"])
def test_up_axis_of_a_new_file(tmp_path, up):
    clip = Clip(np.zeros((3, 1, 3)) + 500.0, ("A",), 100, up=up)
    create_c3d(tmp_path / "new.c3d", clip)
    back = read_c3d(tmp_path / "new.c3d")
    assert (back.up, back.source.up_found_from) == (up, "file")


def test_more_than_255_markers_in_a_new_file(tmp_path):
    labels = tuple(f"M{i:03d}" for i in range(300))
    positions = np.random.default_rng(0).uniform(0, 1700, (3, 300, 3))
    create_c3d(tmp_path / "new.c3d", Clip(positions, labels, 100))
    assert read_c3d(tmp_path / "new.c3d").labels == labels


def test_new_file_refusals(tmp_path):
    clip = made()
    with pytest.raises(OutputError, match=r"marker C7 .* in frame 35 but has no position"):
        create_c3d(tmp_path / "new.c3d", clip, filled=clip.missing)
    long = Clip(np.ones((65536, 1, 3)), ("A",), 100)
    with pytest.raises(OutputError, match="C3D holds 65535"):
        create_c3d(tmp_path / "new.c3d", long)
    named = Clip(clip.positions, ("L" * 256, *clip.labels[1:]), 100)
    with pytest.raises(OutputError, match=r"the name L{40}\.\.\. is longer than the 255 bytes"):
        create_c3d(tmp_path / "new.c3d", named)
    create_c3d(tmp_path / "new.c3d", clip)
    with pytest.raises(OutputError, match="exists already"):
        create_c3d(tmp_path / "new.c3d", clip)
    create_c3d(tmp_path / "new.c3d", clip, overwrite=True)


# --- by suffix -------------------------------------------------------------------------


def test_write_chooses_copy_or_new_file(tmp_path, source):
    clip, file = source()
    clip, filled = fill(clip, GAP, VALUES)
    assert formats.write(tmp_path / "out.c3d", clip, filled).samples == 3
    assert len((tmp_path / "out.c3d").read_bytes()) == len(file.bytes())
    with pytest.raises(
        OptionError, match="needs the mask of filled samples; give `filled`, or, for a new file"
    ):
        formats.write(tmp_path / "out2.c3d", clip)
    with pytest.raises(OptionError, match=r"is unknown; known are \.c3d"):
        formats.write(tmp_path / "out.xyz", clip, filled)
    in_memory = replace(clip, source=None)
    assert formats.write(tmp_path / "new.c3d", in_memory, filled).samples == 3
    with pytest.raises(OutputError, match="comes from no file"):
        write_c3d(tmp_path / "out3.c3d", in_memory, filled)


# --- real recordings -------------------------------------------------------------------


def pretend(clip: Clip) -> tuple[Clip, np.ndarray]:
    """Some samples, measured or missing, filled with other positions."""
    rng = np.random.default_rng(len(clip.labels) * clip.frames)
    filled = np.zeros_like(clip.missing)
    for marker in rng.integers(0, len(clip.labels), 4):
        start = rng.integers(0, clip.frames - 20)
        filled[start : start + rng.integers(1, 20), marker] = True
    positions = clip.positions.copy()
    positions[filled] = rng.uniform(-1500, 1500, (int(filled.sum()), 3))
    return clip.with_positions(positions), filled


def some_of_each_folder(data: Path) -> list[Path]:
    """A few recordings of each folder; scripts/checks/survey.py uses all."""
    folders: dict[Path, list[Path]] = {}
    for path in sorted(data.rglob("*.c3d")):
        folders.setdefault(path.parent, []).append(path)
    return [path for paths in folders.values() for path in paths[:: -(-len(paths) // FEW)]]


@pytest.mark.realdata
def test_recordings_byte_for_byte_and_read_back(data, tmp_path):
    for path in some_of_each_folder(data):
        clip, filled = pretend(read_c3d(path))
        output = tmp_path / path.name
        report = write_c3d(output, clip, filled)
        assert report.samples == filled.sum()
        before, after = path.read_bytes(), output.read_bytes()
        assert len(before) == len(after), path.name
        changed = np.frombuffer(before, np.uint8) != np.frombuffer(after, np.uint8)
        layout = parse_layout(before, path.name)
        frames, markers = np.nonzero(filled)
        points = np.array(clip.source.points)[markers]
        allowed = layout.record_offsets(frames, points)[:, None] + np.arange(layout.record_bytes)
        changed[allowed] = False
        assert not changed.any(), path.name

        content = ezc3d.c3d(str(output))["data"]
        theirs = content["points"][:3].transpose(2, 1, 0)
        ours, residual = read_points(after, layout)
        ours[residual < 0] = np.nan
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, err_msg=path.name)
        atol = 1e-3 if layout.is_float else 0.5 * layout.scale * 1.001
        np.testing.assert_allclose(
            theirs[frames, points], clip.positions[filled], atol=atol, err_msg=path.name
        )
        assert report.rounding_mm <= atol
        assert (content["meta_points"]["residuals"][0].T[frames, points] == 0).all(), path.name
        assert not content["meta_points"]["camera_masks"][:, points, frames].any(), path.name
        output.unlink()


def groups(path: Path) -> dict[str, dict[str, tuple[object, ...]]]:
    """Contents of each parameter group according to another reader."""
    return {
        name: {
            key: (
                parameter["type"],
                parameter["description"],
                np.array(parameter["value"]).tolist(),
            )
            for key, parameter in group.items()
            if not key.startswith("__")
        }
        for name, group in ezc3d.c3d(str(path))["parameters"].items()
    }


@pytest.mark.realdata
@pytest.mark.parametrize("name", ["gait/HC055A09.c3d", "real_gaps/HC040A14_raw.c3d"])
def test_groups_of_nexus_are_intact(data, tmp_path, name):
    clip, filled = pretend(read_c3d(data / name))
    formats.write(tmp_path / "out.c3d", clip, filled)
    before, after = groups(data / name), groups(tmp_path / "out.c3d")
    assert {"SUBJECTS", "PROCESSING", "ANALYSIS", "EVENT", "TRIAL"} <= set(before)
    assert list(before) == list(after)  # in the same order, too
    for group, parameters in before.items():
        assert parameters == after[group], group


def with_second_reader(path: Path) -> np.ndarray:
    """(frames, points, 5): position, residual, number of cameras."""
    with warnings.catch_warnings():
        # py-c3d warns about every such file
        warnings.filterwarnings("ignore", "No analog data|missing parameter POINT:DESCRIPTIONS")
        with path.open("rb") as file:
            reader = second_reader.Reader(file)
            return np.array([points for _, points, _ in reader.read_frames(copy=True)])


@pytest.mark.realdata
@pytest.mark.parametrize(
    "name",
    [
        "hdm05/HDM_dg_06-03_03_120.c3d",
        "cmu/127_07.c3d",
        "gait/HC055A09.c3d",
        "real_gaps/sample26_Capture0002.c3d",
    ],
)
def test_a_second_reader_agrees(data, tmp_path, name):
    clip, filled = pretend(read_c3d(data / name))
    write_c3d(tmp_path / "out.c3d", clip, filled)
    theirs = with_second_reader(tmp_path / "out.c3d")[:, list(clip.source.points)]
    layout = parse_layout((tmp_path / "out.c3d").read_bytes(), name)
    atol = 1e-3 if layout.is_float else 0.5 * layout.scale * 1.001
    np.testing.assert_allclose(theirs[filled][:, :3], clip.positions[filled], atol=atol)
    assert (theirs[filled][:, 3] == 0).all()


def test_a_second_reader_agrees_on_mips(tmp_path, source):
    clip, _ = source(processor=MIPS)
    clip, filled = fill(clip, GAP, VALUES)
    write_c3d(tmp_path / "out.c3d", clip, filled)
    theirs = with_second_reader(tmp_path / "out.c3d")
    np.testing.assert_allclose(theirs[filled][:, :3], VALUES, atol=1e-3)
