"""NumPy and MATLAB files."""

from __future__ import annotations

import io
import math
import struct
import tracemalloc
import warnings
import zipfile
import zlib
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat, savemat
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
from priorfill.formats.arrays import unpacked_size
from priorfill.formats.arrays.array_files import Unread
from priorfill.formats.arrays.mat_elements import MAX_DEPTH, variable_names, variables
from priorfill.synthetic import synthesise


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


def test_equal_clips_give_equal_bytes_on_every_system(path, monkeypatch):
    """Without the system and the time, which zipfile and SciPy write."""
    with monkeypatch.context() as other_system:
        other_system.setattr("sys.platform", "win32")
        formats.write(path, clip_with_gap())
    if path.suffix == ".mat":
        assert path.read_bytes()[:116].rstrip() == b"MATLAB 5.0 MAT-file, written by priorfill"
        return
    with zipfile.ZipFile(path) as archive:
        made = {(entry.create_system, *entry.date_time) for entry in archive.infolist()}
    assert made == {(3, 1980, 1, 1, 0, 0, 0)}


def test_blanks_at_the_ends_of_labels_are_dropped(path):
    clip = replace(clip_with_gap(), labels=(*LABELS[:4], " a\x85", "b\0"))
    formats.write(path, clip)
    assert formats.read(path).labels[4:] == ("a", "b")


def test_text_that_is_not_unicode_is_written(path):
    """Names of files that are not UTF-8 have lone surrogates."""
    labels = (*LABELS[:4], "x\udcff", "y\0z")
    formats.write(path, replace(clip_with_gap(), labels=labels, name="\udcff", subject="a\udcff"))
    again = formats.read(path)
    assert (*again.labels[4:], again.subject) == ("x?", "y?z", "a?")


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
    "truth values": ({"labels": list(LABELS), "positions": standing() > 0},
                     r"positions \(12, 6, 3\) (bool|uint8)|no frame rate"),
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
    assert path.stat().st_size < 5000
    monkeypatch.setattr(file_bytes, "MAX_BYTES", 100_000)
    with pytest.raises(FormatError, match=r"holds .* GiB; at most"):
        formats.read(path)


def test_constant_data_beyond_those_of_a_recording_are_refused(path, monkeypatch):
    """A small file must not take much memory."""
    monkeypatch.setattr(unpacked_size, "FREE_BYTES", 1 << 20)
    zeros = {"positions": np.zeros((200_000, 18)), "labels": list(LABELS), "rate": 1.0}
    if path.suffix == ".npz":
        np.savez_compressed(path, **zeros)
    else:
        savemat(path, zeros | {"labels": np.array(LABELS, dtype=object)}, do_compression=True)
    tracemalloc.start()
    with pytest.raises(FormatError, match="more than a recording does; save it again, uncomp"):
        formats.read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 25e6  # of 28.8 MB


def test_short_integers_count_as_what_they_become(path, monkeypatch):
    monkeypatch.setattr(unpacked_size, "FREE_BYTES", 1 << 20)
    ones = {"positions": np.ones((20_000, 18), dtype="u1"), "rate": 1.0}  # 2.9 MB as coordinates
    if path.suffix == ".npz":
        np.savez_compressed(path, labels=list(LABELS), **ones)
    else:
        savemat(path, ones | {"labels": np.array(LABELS, dtype=object)}, do_compression=True)
    with pytest.raises(FormatError, match="more than a recording does"):
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


def mocap_toolbox(positions: np.ndarray, **more) -> dict:
    """The structure that the MoCap Toolbox keeps a recording in."""
    return {
        "type": "MoCap data",
        "nFrames": float(len(positions)),
        "freq": 100.0,
        "timederOrder": 0.0,
        "markerName": np.array(LABELS, dtype=object)[:, None],
        "data": positions.reshape(len(positions), -1),
        "other": {"descr": "x"},
        **more,
    }


def test_matlab_files_of_the_mocap_toolbox(tmp_path):
    path = tmp_path / "a.mat"
    positions = standing()
    positions[3, 1] = np.nan
    for others in ({}, {"k": 3.0, "settings": {"a": 1.0}}):
        savemat(path, {"d": mocap_toolbox(positions), **others})
        clip = formats.read(path)
        assert np.array_equal(clip.positions, positions, equal_nan=True)
        assert (clip.labels, clip.rate) == (LABELS, 100.0)
        assert formats.is_recording(path)
    savemat(path, {"d": mocap_toolbox(positions), "e": mocap_toolbox(positions)})
    with pytest.raises(FormatError, match=r"holds 2 recordings \(d, e\); save each in a file"):
        formats.read(path)
    savemat(path, {"d": mocap_toolbox(positions, timederOrder=1.0)})
    with pytest.raises(FormatError, match="holds time derivatives of positions"):
        formats.read(path)


VALUES = {
    "numbers": np.arange(60.0).reshape(3, 4, 5),
    "short": np.arange(6, dtype=np.int16).reshape(2, 3),
    "none": np.zeros((0, 3)),
    "text": "Knöchel 膝",
    "rows": np.array(["ab", "c  ", "def"]),
    "truth": np.array([True, False]),
}


@pytest.mark.parametrize("compressed", [False, True])
def test_values_are_those_that_scipy_reads(compressed):
    file = io.BytesIO()
    savemat(file, VALUES | {"inner": VALUES}, do_compression=compressed)
    ours, theirs = variables(file.getvalue(), "a.mat"), loadmat(io.BytesIO(file.getvalue()))
    assert variable_names(file.getvalue(), "a.mat") == tuple(ours)
    for key in VALUES:
        assert np.array_equal(np.char.strip(ours[key]) if ours[key].dtype.kind == "U" else
                              ours[key], np.char.strip(theirs[key]) if ours[key].dtype.kind == "U"
                              else theirs[key])  # fmt: skip
        assert np.array_equal(ours["inner"][key], ours[key])


def test_version_4_in_both_byte_orders(tmp_path):
    plain = {k: v for k, v in VALUES.items() if k in ("short", "rows", "truth")}
    file = io.BytesIO()
    savemat(file, plain | {"x": np.float32([[1, 2], [3, 4]])}, format="4")
    ours = variables(file.getvalue(), "a.mat")
    for key, value in loadmat(io.BytesIO(file.getvalue())).items():
        if not key.startswith("__"):
            assert np.array_equal(np.ravel(ours[key]), np.ravel(np.char.strip(value) if
                                  value.dtype.kind == "U" else value))  # fmt: skip
    big = struct.pack(">5i", 1020, 1, 3, 0, 2) + b"y\0" + struct.pack(">3i", 1, 2, 3)
    assert variables(big, "a.mat")["y"].tolist() == [[1, 2, 3]]


def element(kind: int, content: bytes) -> bytes:
    """A data element of a MATLAB file."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(flags: int, shape, *parts: bytes, name: bytes = b"x") -> bytes:
    """A variable of a MATLAB file."""
    head = element(6, struct.pack("<II", flags, 0))
    sizes = element(5, struct.pack(f"<{len(shape)}i", *shape)) if flags != 17 else b""
    return element(14, head + sizes + element(1, name) + b"".join(parts))


def mat_file(*elements: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM" + b"".join(elements)


def nested(depth: int) -> bytes:
    inner = matrix(6, (1, 1), element(9, bytes(8)))
    for _ in range(depth):
        inner = matrix(1, (1, 1), inner)
    return mat_file(inner)


FIELD = (element(5, struct.pack("<i", 8)), element(1, b"f".ljust(8, b"\0")))

CRAFTED = {
    "cells of nothing": mat_file(matrix(1, (30_000, 30_000))),
    "structures of nothing": mat_file(matrix(2, (30_000, 30_000), *FIELD)),
    "structures without fields": mat_file(matrix(2, (9999, 9999), FIELD[0], element(1, b""))),
    "fields of no width": mat_file(matrix(2, (1, 1), element(5, bytes(4)), FIELD[1])),
    "numbers of nothing": mat_file(matrix(6, (2**31 - 1, 2**31 - 1), element(9, b""))),
    "negative": mat_file(matrix(6, (-1, -8), element(9, bytes(64)))),
    "many dimensions": mat_file(matrix(6, (1,) * 40, element(9, bytes(8)))),
    "one dimension": mat_file(matrix(6, (1,), element(9, bytes(8)))),
    "huge and empty": mat_file(matrix(6, (2**31 - 1,) * 7 + (0,), element(9, b""))),
    "characters of a type": mat_file(matrix(4, (1, 2), element(9, bytes(16)))),
    "characters of nothing": mat_file(matrix(4, (2**30, 4), element(16, b"abc"))),
    "half a character": mat_file(matrix(4, (1, 1), element(17, b"a"))),
    "no type": mat_file(matrix(6, (1, 1), element(99, bytes(8)))),
    "deep": nested(MAX_DEPTH + 1),
    "very deep": nested(5000),
    "an element beyond": mat_file(matrix(6, (1, 1), struct.pack("<II", 9, 2**32 - 1))),
    "no bytes": mat_file(struct.pack("<II", 15, 0)),
    "not packed": mat_file(element(15, b"abcdefgh")),
    "half packed": mat_file(element(15, zlib.compress(bytes(1000))[:-6])),
    "packed nothing": mat_file(element(15, zlib.compress(b""))),
    "version 4, huge": struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"x\0",
    "version 4, negative": struct.pack("<5i", 0, -1, -1, 0, 2) + b"x\0" + bytes(8),
    "version 4, text": struct.pack("<5i", 1, 1, 1, 0, 2) + b"x\0" + struct.pack("<d", 1e300),
    "empty": b"",
    "header": mat_file(),
}


@pytest.mark.parametrize("fault", CRAFTED)
def test_crafted_matlab_files_take_no_memory(tmp_path, fault):
    path = tmp_path / "a.mat"
    path.write_bytes(CRAFTED[fault])
    tracemalloc.start()
    with pytest.raises(FormatError) as caught:
        formats.read(path)
    assert not formats.is_recording(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6 + 20 * len(CRAFTED[fault])
    assert "\n" not in str(caught.value)


def test_shapes_and_names_of_other_programs():
    head = element(6, struct.pack("<II", 6, 0)) + element(6, struct.pack("<2I", 1, 1))
    data = mat_file(element(14, head + element(16, "é".encode()) + element(9, bytes(8))))
    assert variables(data, "a.mat") == {"é": np.zeros((1, 1))}


def test_nesting_to_the_limit_and_other_classes(tmp_path):
    assert "x" in variables(nested(MAX_DEPTH), "a.mat")
    string = matrix(17, (), element(1, b"MCOS"), element(1, b"string"), name=b"labels")
    data = mat_file(string, matrix(0x0806, (1, 1), element(9, bytes(8)), element(9, bytes(8))))
    assert variables(data, "a.mat")["x"] == Unread("complex")
    path = tmp_path / "a.mat"
    path.write_bytes(data)
    with pytest.raises(FormatError, match=r"there are labels \(object; make strings char"):
        formats.read(path)


def npy(header: str, content: bytes = b"", version: int = 1) -> bytes:
    """An array of a NumPy archive."""
    raw = header.encode("latin-1") + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<HI"[: version + 1 : version],
                                                          len(raw)) + raw + content  # fmt: skip


def described(descr: str, shape: str, order: bool = False) -> str:
    return f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}"


HEADERS = {
    "huge": npy(described("'<f8'", "(10000000000, 18)")),
    "negative": npy(described("'<f8'", "(-1, -18)"), bytes(144)),
    "no width": npy(described("'<U0'", "(10000000000,)")),
    "wide": npy(described("'<U999999999'", "(1,)")),
    "too many bytes": npy(described("'<f8'", "(1, 18)"), bytes(9999)),
    "too few bytes": npy(described("'<f8'", "(9, 18)"), bytes(17)),
    "not ASCII": npy(described("'<f8'", "(1, 18)").replace("descr", "d\xe9scr"), bytes(144)),
    "no dictionary": npy("[" * 5000),
    "no type": npy(described("'nothing'", "(1, 18)"), bytes(144)),
    "no version": b"\x93NUMPY\x09\x00" + bytes(200),
    "nothing": b"",
}


@pytest.mark.parametrize("fault", HEADERS)
def test_arrays_whose_headers_are_wrong(tmp_path, fault):
    path = tmp_path / "a.npz"
    np.savez(path, labels=list(LABELS), rate=1.0)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("positions.npy", HEADERS[fault])
    tracemalloc.start()
    with warnings.catch_warnings(), pytest.raises(FormatError, match=r"a\.npz: is damaged") as e:
        warnings.simplefilter("error")
        formats.read(path)
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()
    assert "\n" not in str(e.value)


def test_archives_of_other_compression_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("positions.npy", HEADERS["huge"])
    with pytest.raises(FormatError, match="is compressed by a method that NumPy does not use"):
        formats.read(path)


SOUND = {"labels": list(LABELS), "positions": standing(), "rate": 100.0}

UNUSABLE = {
    "complex": ({"positions": standing() + 0j}, "no variable clearly holds"),
    "dates": ({"positions": standing().astype("M8[D]")}, r"positions \(datetime64"),
    "texts": ({"positions": standing().astype(str)}, "no variable clearly holds"),
    "scalar": ({"positions": np.float64(3)}, "no variable clearly holds"),
    "no frames": ({"positions": np.zeros((0, 6, 3))}, "no frames|holds no"),
    "negative rate": ({"rate": -5.0}, "variable rate is -5; give the frames per second"),
    "no rate": ({"rate": 0}, "variable rate is 0; give the frames per second"),
    "absurd rate": ({"rate": 1e300}, r"variable rate is 1e\+300"),
    "rate not a number": ({"rate": math.nan}, "variable rate should be one number"),
    "late": ({"first_frame": 1e300}, r"variable first_frame is 1e\+300; give the whole number"),
    "between": ({"first_frame": 1.5}, "variable first_frame is 1.5; give the whole number"),
    "far apart": ({"positions": np.linspace(-1e300, 1e300, 216).reshape(12, 18)},
                  "has a coordinate of|look"),
    "mask": ({"filled": np.zeros((6, 12))}, r"variable filled has the shape \(6, 12\)"),
    "mask of other size": ({"filled": np.zeros(5)}, r"variable filled has the shape \(5,\)"),
    "bytes": ({"labels": [b"a", b"\xff", b"c", b"d", b"e", b"f"]}, "text that is not Unicode"),
}  # fmt: skip


@pytest.mark.parametrize("fault", UNUSABLE)
def test_unusable_values_are_reported_in_one_line(tmp_path, fault):
    changed, message = UNUSABLE[fault]
    path = tmp_path / "a.npz"
    np.savez(path, **SOUND | changed)
    with pytest.raises((FormatError, ClipError), match=message) as caught:
        formats.read(path)
    assert "\n" not in str(caught.value)


def test_missing_samples_show_the_order_of_columns(tmp_path):
    """Places of markers on a ball around the origin do not."""
    positions = np.random.default_rng(0).normal(size=(12, 6, 3))
    positions -= positions.mean(axis=(0, 1))
    np.savez(tmp_path / "a.npz", **SOUND | {"positions": positions.reshape(12, 18), "unit": "m"})
    formats.read(tmp_path / "a.npz")
    positions[3, 2] = np.nan
    np.savez(tmp_path / "a.npz", **SOUND | {"positions": positions.reshape(12, 18), "unit": "m"})
    assert formats.read(tmp_path / "a.npz").missing.sum() == 1
    turned = positions.transpose(0, 2, 1).reshape(12, 18)
    np.savez(tmp_path / "a.npz", **SOUND | {"positions": turned, "unit": "m"})
    with pytest.raises(FormatError, match="hold X of all markers before Y and Z"):
        formats.read(tmp_path / "a.npz")


def test_places_show_the_order_of_columns(tmp_path):
    walk = synthesise("walking", seconds=0.5, rate=50.0)
    for turned in (False, True):
        positions = walk.positions.transpose(0, 2, 1) if turned else walk.positions
        columns = positions.reshape(len(positions), -1)
        np.savez(tmp_path / "a.npz", positions=columns, labels=walk.labels, rate=50.0)
        with pytest.raises(FormatError, match="put X, Y, Z") if turned else nullcontext():
            formats.read(tmp_path / "a.npz")


def test_times_replace_a_rate_that_they_contradict(tmp_path):
    path = tmp_path / "a.npz"
    for times, rate, note in (
        (np.arange(12) / 50, 50.0, "the rate of the time column is used"),
        (np.arange(12)[:, None] / 100, 100.0, None),
        (np.arange(12), 100.0, "counts rows"),
        (np.delete(np.arange(13), 5) / 100, 100.0, "are uneven"),
        (np.arange(3) / 50, 100.0, None),
    ):
        np.savez(path, **SOUND | {"time": times, "unit": "mm"})
        clip = formats.read(path)
        assert clip.rate == rate
        assert [one for one in clip.source.notes if note and note in one] == [
            one for one in clip.source.notes if "time" in one
        ]


def test_unusual_values_are_read(tmp_path):
    path = tmp_path / "a.npz"
    for changed in (
        {"positions": np.asfortranarray(standing())},
        {"positions": standing().astype(">f8")},
        {"labels": [label.encode() for label in LABELS]},
        {"filled": np.array("nothing")},
    ):
        np.savez(path, **SOUND | changed)
        clip = formats.read(path)
        assert clip.labels == LABELS
        assert np.array_equal(clip.positions, standing())
    codes = np.array([*LABELS[:5], "a\udc80b"]).view(np.uint32)  # no writer can encode it
    np.savez(path, **SOUND | {"labels": codes.view(f"<U{len(codes) // 6}")})
    assert formats.read(path).labels[5] == "a?b"


def test_structures_of_other_shapes(tmp_path):
    """Structures in structures, and those with a field for each marker."""
    path = tmp_path / "a.mat"
    cells, positions = np.array(LABELS, dtype=object), standing()
    trial = {"markers": positions, "labels": cells, "rate": 100.0}
    by_marker = {label: positions[:, i] for i, label in enumerate(LABELS)}
    for variables_ in (
        {"s": {"trial": trial, "notes": "x"}, "k": 3.0},
        {"markers": by_marker, "rate": 100.0},
        {"s": {"Markers": by_marker, "fs": 100.0}},
    ):
        savemat(path, variables_)
        clip = formats.read(path)
        assert clip.labels == LABELS
        assert np.array_equal(clip.positions, positions)
        assert formats.is_recording(path)
    two = np.empty(2, dtype=object)
    two[:] = [trial, trial]
    savemat(path, {"d": two})
    with pytest.raises(FormatError, match=r"holds 2 recordings \(d\(1\), d\(2\)\); save each"):
        formats.read(path)


def test_names_that_differ_in_case_only(path):
    save(path, labels=list(LABELS), positions=standing(), rate=1.0, Positions=standing())
    with pytest.raises(FormatError, match=r"has variables .ositions and .ositions; delete"):
        formats.read(path)


@pytest.mark.parametrize(
    ("name", "value", "same"),
    [
        ("fs", 50.0, False),
        ("fs", np.float32(119.88), True),
        ("units", "m", False),
        ("markernames", list(reversed(LABELS)), False),
        ("markernames", list(LABELS), True),
        ("data", standing() + 5.0, False),
        ("data", np.zeros((3, 2)), True),
        ("frequency", "high", True),
    ],
)
def test_variables_that_contradict_each_other_are_noted(path, name, value, same):
    save(path, positions=standing(), labels=list(LABELS), rate=119.88, unit="mm", **{name: value})
    clip = formats.read(path)
    assert clip.rate == pytest.approx(119.88)
    noted = [note for note in clip.source.notes if name in note]
    assert bool(noted) != same
    assert all("with different contents" in note and "is used" in note for note in noted)
