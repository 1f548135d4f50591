"""NumPy and MATLAB files."""

from __future__ import annotations

import io
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat
from text_files import LABELS, standing

from priorfill import formats
from priorfill.clip import Clip
from priorfill.errors import (
    ClipError,
    FormatError,
    OutputError,
    PriorfillError,
)
from priorfill.formats import file_bytes
from priorfill.formats.arrays import mat


def clip_with_gap() -> Clip:
    positions = standing() + 1 / 3
    positions[4:7, 2] = np.nan
    return Clip(positions, LABELS, 119.88, "+Z", "walk", "Ann", 31)


def save(path, **arrays) -> None:
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    else:
        savemat(
            path, {k: np.array(v, dtype=object) if k == "labels" else v for k, v in arrays.items()}
        )


@pytest.fixture(params=[".npz", ".mat"])
def path(request, tmp_path):
    return tmp_path / f"walk{request.param}"


def test_round_trip_is_exact(path):
    clip = clip_with_gap()
    assert formats.write(path, clip).samples == 0
    again = formats.read(path)
    assert np.array_equal(again.positions, clip.positions, equal_nan=True)
    for name in ("labels", "rate", "up", "subject", "first_frame"):
        assert getattr(again, name) == getattr(clip, name)
    assert again.source.up_found_from == "file"
    assert again.source.unit == "mm"
    assert formats.is_recording(path)


def test_filled_samples_are_distinguished_from_measured_ones(path, tmp_path):
    formats.write(path, clip_with_gap())
    clip = formats.read(path)
    full = clip.with_positions(np.nan_to_num(clip.positions, nan=5.0))
    out = tmp_path / f"out{path.suffix}"
    assert formats.write(out, full, clip.missing).samples == 3
    again = formats.read(out)
    assert np.array_equal(again.source.interpolated, clip.missing)
    assert np.array_equal(again.positions, full.positions)
    # a second fill adds to the first
    second = tmp_path / f"second{path.suffix}"
    formats.write(second, again, np.arange(12)[:, None] == np.full(6, 0))
    assert formats.read(second).source.interpolated.sum() == 3 + 6
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        formats.write(path, full, clip.missing, overwrite=True)


def test_missing_samples_are_not_declared_as_filled(path):
    positions = standing()
    positions[4:7, 2] = np.nan
    filled = np.zeros((12, 6), dtype=bool)
    filled[6:9, 2] = True
    save(path, positions=positions, labels=list(LABELS), rate=100.0, filled=filled)
    interpolated = formats.read(path).source.interpolated
    assert np.argwhere(interpolated).tolist() == [[7, 2], [8, 2]]


def test_layouts_of_other_programs(path):
    positions = standing() / 1000
    positions[2, 3] = np.nan
    names = {"labels": list(LABELS), "rate": 100.0}
    for arrays in (
        {"markers": positions, **names},
        {"Data": positions.reshape(12, 18), "unit": "m", **names},
        {"something": positions.astype(np.float32), "units": "m", "more": np.arange(5), **names},
    ):
        save(path, **arrays)
        clip = formats.read(path)
        assert clip.labels == LABELS
        assert np.allclose(clip.positions, positions * 1000, atol=1e-3, equal_nan=True)


WRONG = {
    "no labels": ({"positions": standing(), "rate": 100.0},
                  r"no variable with the markers' names; .* there are positions \(12, 6, 3\)"),
    "no positions": ({"labels": list(LABELS), "a": np.zeros((12, 5)), "b": np.zeros(3)},
                     r"clearly holds the positions of 6 markers; name one 'positions', of shape "
                     r"\(frames, 6, 3\) or \(frames, 18\); there are .*a \(12, 5\)"),
    "two of a shape": ({"labels": list(LABELS), "a": standing(), "b": standing()},
                       "no variable clearly"),
    "turned": ({"labels": list(LABELS), "positions": standing().T, "rate": 1.0},
               "no variable clearly"),
    "infinite": ({"labels": list(LABELS), "positions": np.full((12, 6, 3), np.inf), "rate": 1.0},
                 "marker LTOE has an infinite coordinate in frame 1; mark the sample"),
    "no rate": ({"labels": list(LABELS), "positions": standing()}, r"no frame rate; .*\(`rate`\)"),
    "rates": ({"labels": list(LABELS), "positions": standing(), "fs": [1.0, 2.0]},
              "variable fs should be one number"),
    "up": ({"labels": list(LABELS), "positions": standing(), "rate": 1.0, "up": "sky"},
           "variable up is 'sky'; one of"),
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG)
def test_unusable_contents_are_reported_in_one_line(path, fault):
    arrays, message = WRONG[fault]
    save(path, **arrays)
    with pytest.raises((FormatError, ClipError), match=message) as caught:
        formats.read(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(path.name)


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")
def test_damaged_files_raise_only_priorfill_errors(path):
    formats.write(path, clip_with_gap())
    data = path.read_bytes()
    rng = np.random.default_rng(7)
    for trial in range(300):
        spoilt = bytearray(data)
        if trial % 3 == 0:
            spoilt = spoilt[: int(rng.integers(1, len(data)))]
        for _ in range(trial % 3 * 2):
            spoilt[int(rng.integers(len(data)))] = rng.integers(256)
        path.write_bytes(bytes(spoilt))
        try:
            formats.read(path)
        except PriorfillError as error:
            assert "\n" not in str(error)
        formats.is_recording(path)


def test_other_files_are_not_recordings(path):
    save(path, weights=np.zeros(5))
    assert not formats.is_recording(path)
    path.write_bytes(b"nothing")
    assert not formats.is_recording(path)
    with pytest.raises(
        FormatError, match=r"is not a NumPy archive|cannot be read as a MATLAB file"
    ):
        formats.read(path)


def test_arrays_that_need_pickle_are_ignored(tmp_path):
    path = tmp_path / "a.npz"
    odd = np.array([{"a": 1}], dtype=object)
    np.savez(path, positions=standing(), labels=list(LABELS), rate=100, note=odd)
    assert formats.read(path).labels == LABELS


def test_archives_that_expand_beyond_the_limit_are_refused(path, monkeypatch):
    save(path, labels=list(LABELS), positions=np.zeros((2000, 18)), rate=1.0)
    if path.suffix == ".npz":
        np.savez_compressed(path, labels=list(LABELS), positions=np.zeros((2000, 18)), rate=1.0)
    monkeypatch.setattr(file_bytes, "MAX_BYTES", 100_000)
    with pytest.raises(FormatError, match=r"holds .* GiB; at most"):
        formats.read(path)


def test_expanded_size_of_a_structure_is_counted(tmp_path, monkeypatch):
    path = tmp_path / "a.mat"
    savemat(path, {"s": {"positions": np.zeros((2000, 18))}}, do_compression=True)
    data = path.read_bytes()
    assert len(data) < 5000
    kind, size = struct.unpack_from("<II", data, 128)
    assert kind == 15
    assert mat._inflated(data) == len(zlib.decompress(data[136 : 136 + size])) > 288_000
    monkeypatch.setattr(file_bytes, "MAX_BYTES", 100_000)
    with pytest.raises(FormatError, match=r"holds .* GiB; at most"):
        formats.read(path)


def test_matlab_structure_and_character_matrix(tmp_path):
    path = tmp_path / "a.mat"
    cells = np.array(LABELS, dtype=object)
    savemat(path, {"trial": {"positions": standing(), "labels": cells, "fs": 50}})
    assert formats.read(path).rate == 50
    assert formats.is_recording(path)
    savemat(path, {"positions": standing(), "labels": np.array(LABELS), "fs": 50})
    assert formats.read(path).labels == LABELS


def qualisys(positions: np.ndarray, labels=LABELS) -> dict:
    data = np.concatenate([positions, np.ones((*positions.shape[:2], 1))], axis=2)
    cells = np.array(labels, dtype=object)[None]
    labelled = {"Count": len(labels), "Labels": cells, "Data": data.transpose(1, 2, 0)}
    return {
        "File": "C:\\walk.qtm",
        "StartFrame": 11.0,
        "Frames": float(len(positions)),
        "FrameRate": 200.0,
        "Trajectories": {"Labeled": labelled, "Unidentified": {"Count": 0}},
    }


def test_matlab_files_of_qualisys(tmp_path):
    path = tmp_path / "a.mat"
    positions = standing()
    positions[3, 1] = np.nan
    savemat(path, {"walk0001": qualisys(positions)})
    clip = formats.read(path)
    assert np.array_equal(clip.positions, positions, equal_nan=True)
    assert (clip.labels, clip.rate, clip.first_frame) == (LABELS, 200.0, 11)
    assert formats.is_recording(path)
    savemat(path, {"walk0001": {"Trajectories": {"Unidentified": 1}, "FrameRate": 1.0}})
    with pytest.raises(FormatError, match="no labelled trajectories as exported by Qualisys"):
        formats.read(path)


def test_version_7_3_is_refused(tmp_path):
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n" + bytes(99))
    with pytest.raises(FormatError, match=r"version 7.3; save it as version 7 \(save ... -v7\)"):
        formats.read(path)


def test_one_marker_and_one_frame(path):
    for frames in (1, 3):
        clip = Clip(np.full((frames, 1, 3), 5.5), ("a",), 100, "+Z", "walk")
        formats.write(path, clip, overwrite=True)
        assert np.array_equal(formats.read(path).positions, clip.positions)


def test_output_of_db_export_can_be_read(tmp_path):
    from db_cli import run, write_clip

    write_clip(tmp_path / "walk.c3d", 1)
    run("db", "add", "-d", str(tmp_path / "db"), str(tmp_path / "walk.c3d"))
    out = tmp_path / "out"
    run("db", "export", "-d", str(tmp_path / "db"), "-o", str(out), "--format", "npz")
    (file,) = out.iterdir()
    clip = formats.read(file)
    before = formats.read(tmp_path / "walk.c3d")
    assert set(clip.labels) == set(before.labels)
    assert clip.duration == pytest.approx(before.duration)  # a database resamples


def test_output_is_reproducible(path):
    formats.write(path, clip_with_gap())
    first = path.read_bytes()
    formats.write(path, replace(clip_with_gap()), overwrite=True)
    if path.suffix == ".npz":
        assert path.read_bytes() == first
    assert io.BytesIO(first).read(4) in (b"PK\x03\x04", b"MATL")
