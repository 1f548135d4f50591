from __future__ import annotations

import os
import struct
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from c3d_bytes import DEC, INTEL, LABELS, MIPS, C3DFile, standing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from priorfill import formats
from priorfill.errors import (
    ClipError,
    FormatError,
    OptionError,
    PriorfillError,
)
from priorfill.formats.c3d.layout import parse_layout, read_points
from priorfill.formats.c3d.parameters import C3DParameters
from priorfill.formats.c3d.read import declared_model_outputs, read_c3d
from priorfill.formats.point_kinds import find_model_points, split_label
from priorfill.formats.units import find_unit
from priorfill.formats.up_axis import find_up_axis, up_from_floor, up_from_names

STEP = 0.1


@pytest.fixture
def save(tmp_path):
    def write(content: C3DFile | bytes, name: str = "trial.c3d") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.bytes())
        return path

    return write


def one_line(error) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


# --- numbers ---------------------------------------------------------------------------


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("is_float", [True, False])
@pytest.mark.parametrize("channels", [0, 3])
def test_every_number_format(save, processor, is_float, channels):
    records = standing(step=None if is_float else STEP)
    analog = np.arange(12 * 2 * channels).reshape(12, 2, channels) if channels else None
    file = C3DFile(
        records,
        LABELS,
        processor=processor,
        is_float=is_float,
        scale=STEP,
        analog=analog,
        first_frame=31,
    )
    clip = read_c3d(save(file))
    expected = records[:, :, :3] * (1 if is_float else STEP)
    np.testing.assert_allclose(clip.positions, expected, rtol=1e-6)
    assert clip.labels == tuple(LABELS)
    assert clip.rate == 100
    assert clip.first_frame == 31
    assert clip.up == "+Z"
    assert clip.name == "trial"
    assert clip.source is not None
    assert clip.source.notes == ()


@pytest.mark.parametrize("processor", [INTEL, DEC])
@pytest.mark.parametrize("is_float", [True, False])
def test_own_reader_agrees_with_ezc3d(save, processor, is_float):
    records = standing(step=None if is_float else STEP)
    records[3:5, 2, 3] = -1
    file = C3DFile(records, LABELS, processor=processor, is_float=is_float, scale=STEP)
    path = save(file)
    layout = parse_layout(path.read_bytes(), path.name)
    positions, residual = read_points(path.read_bytes(), layout)
    positions[residual < 0] = np.nan
    theirs = ezc3d.c3d(str(path))["data"]["points"][:3].transpose(2, 1, 0)
    np.testing.assert_allclose(positions, theirs, rtol=1e-6)


# --- missing samples -------------------------------------------------------------------


def test_three_codings_of_a_missing_sample(save):
    records = standing()
    records[1, 2, 3] = -1
    records[2, 3, 0] = np.nan
    records[3:6, 4, :3] = 0
    path = save(C3DFile(records, LABELS))
    clip = read_c3d(path)
    assert np.argwhere(clip.missing).tolist() == [[1, 2], [2, 3], [3, 4], [4, 4], [5, 4]]
    assert clip.source.zero_samples == 3
    clip = read_c3d(path, zeros_missing=False)
    assert np.argwhere(clip.missing).tolist() == [[1, 2], [2, 3]]
    assert clip.source.zero_samples == 0


def test_zeros_of_points_left_out_are_not_counted(save):
    records = standing()
    records[3:6, 4, :3] = 0
    records[:, 5, :3] = 0
    labels = ["LHipAngles" if point == 5 else label for point, label in enumerate(LABELS)]
    assert read_c3d(save(C3DFile(records, labels))).source.zero_samples == 3


def test_a_labelled_marker_without_samples_is_kept(save):
    records = standing()
    records[:, 4, 3] = -1
    clip = read_c3d(save(C3DFile(records, LABELS)))
    assert clip.labels == tuple(LABELS)
    assert clip.missing[:, 4].all()


def test_infinite_coordinate(save):
    records = standing()
    records[4, 2, 1] = np.inf
    with pytest.raises(ClipError) as error:
        read_c3d(save(C3DFile(records, LABELS, first_frame=101)))
    assert one_line(error) == (
        "trial.c3d: marker C7 has an infinite coordinate in frame 105; mark the sample as missing"
    )


def test_infinite_coordinates_of_model_outputs_are_ignored(save):
    records = standing()
    records[4, 2, 1] = np.inf
    labels = ["LHipAngles" if label == "C7" else label for label in LABELS]
    assert len(read_c3d(save(C3DFile(records, labels))).labels) == len(LABELS) - 1


# --- interpolated samples --------------------------------------------------------------

MEASURED = 0x0303
"""The fourth word of a sample with a residual of 3 steps that cameras 1 and 2 saw."""


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("is_float", [True, False])
def test_interpolated_samples(save, processor, is_float):
    records = standing(step=None if is_float else STEP)
    records[:, :, 3] = MEASURED
    records[4:7, 2, 3] = 0
    records[5, 2, 3] = -1
    clip = read_c3d(save(C3DFile(records, LABELS, processor=processor, is_float=is_float)))
    assert np.argwhere(clip.source.interpolated).tolist() == [[4, 2], [6, 2]]
    assert not clip.source.interpolated.flags.writeable


def test_missing_samples_are_not_interpolated(save):
    records = standing()
    records[:, :, 3] = MEASURED
    records[3, 1] = 0
    records[4, 1, :] = [np.nan, 1, 1, 0]
    path = save(C3DFile(records, LABELS))
    assert not read_c3d(path).source.interpolated.any()
    assert np.argwhere(read_c3d(path, zeros_missing=False).source.interpolated).tolist() == [[3, 1]]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_samples_without_one_coordinate_are_missing_and_not_interpolated(save, axis):
    records = standing()
    records[:, :, 3] = MEASURED
    records[4, 1, axis] = np.nan
    records[4:6, 1, 3] = 0
    clip = read_c3d(save(C3DFile(records, LABELS)))
    assert np.argwhere(clip.missing).tolist() == [[4, 1]]
    assert np.argwhere(clip.source.interpolated).tolist() == [[5, 1]]


@pytest.mark.parametrize("word", [0x0300, 0x0003, 0.4])
def test_any_camera_or_residual_means_measured(save, word):
    records = standing()
    records[:, :, 3] = word
    records[2:4, 5, 3] = 0
    clip = read_c3d(save(C3DFile(records, LABELS)))
    assert np.argwhere(clip.source.interpolated).tolist() == [[2, 5], [3, 5]]


def test_a_file_without_residuals_marks_nothing_as_interpolated(save):
    records = standing()
    assert read_c3d(save(C3DFile(records, LABELS))).source.interpolated is None
    records[:, 0, 3] = MEASURED  # a tenth of the samples
    assert read_c3d(save(C3DFile(records, LABELS))).source.interpolated.sum() == 12 * 9
    records[0, 0, 3] = 0
    assert read_c3d(save(C3DFile(records, LABELS))).source.interpolated is None
    records[:, :, 3] = -1
    assert read_c3d(save(C3DFile(records, LABELS))).source.interpolated is None


def test_residuals_of_other_points_do_not_count(save):
    records = standing()
    records[:, :, 3] = MEASURED
    records[:, 3, 3] = 0
    labels = ["LHipAngles" if label == "LASI" else label for label in LABELS]
    clip = read_c3d(save(C3DFile(records, labels)))
    assert clip.source.interpolated.shape == clip.missing.shape
    assert not clip.source.interpolated.any()


def test_filled_samples_are_marked_as_interpolated(save, tmp_path):
    records = standing()
    records[:, :, 3] = MEASURED
    records[4:7, 2, 3] = -1
    clip = read_c3d(save(C3DFile(records, LABELS)))
    assert not clip.source.interpolated.any()
    filled = clip.missing
    formats.write(tmp_path / "out.c3d", clip.with_positions(np.nan_to_num(clip.positions)), filled)
    again = read_c3d(tmp_path / "out.c3d")
    np.testing.assert_array_equal(again.source.interpolated, filled)


# --- invalid files ---------------------------------------------------------------------


def test_no_such_file(tmp_path):
    for reader in (read_c3d, formats.read):
        with pytest.raises(FormatError, match="there is no such file"):
            reader(tmp_path / "no.c3d")
        with pytest.raises(FormatError, match="is a folder"):
            reader(tmp_path)


def test_unknown_suffix(save):
    with pytest.raises(FormatError, match="is a skeleton file, which only a database can use"):
        formats.read(save(b"HIERARCHY", "walk.bvh"))
    with pytest.raises(FormatError, match=r"'.xyz' is unknown; known are .c3d"):
        formats.read(save(b"abc", "trial.xyz"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"no such thing" * 100, "is not a C3D file"),
        (b"\x02\x50" + bytes(100), "inside its header"),
        (b"\x02\x50" + bytes(1022), "processor type 0"),
    ],
)
def test_not_c3d(save, content, message):
    with pytest.raises(FormatError, match=message) as error:
        read_c3d(save(content))
    one_line(error)


@pytest.mark.parametrize("is_float", [True, False])
def test_cut_short(save, is_float):
    records = standing(frames=200, step=None if is_float else STEP)
    file = C3DFile(records, LABELS, is_float=is_float, scale=STEP, pad=False, truncate=1)
    with pytest.raises(FormatError) as error:
        read_c3d(save(file))
    assert one_line(error) == (
        "trial.c3d: is cut short: it holds 199 of its 200 frames; "
        "copy or export the recording again"
    )


@pytest.mark.parametrize("beyond", [3, 400, 30000])
def test_the_last_parameter_may_point_past_its_section(save, beyond):
    content = C3DFile(standing(), LABELS, parameters={"SUBJECTS": {"NAMES": ["P1"]}})
    whole = content.bytes()
    name = b"NAMES"
    at = whole.index(name) + len(name)
    data = bytearray(whole)
    data[at : at + 2] = struct.pack("<H", content.data_start() + beyond - at)
    clip = read_c3d(save(bytes(data)))
    np.testing.assert_array_equal(clip.positions, read_c3d(save(whole)).positions)
    assert clip.subject == "P1"
    assert clip.source.notes == read_c3d(save(whole)).source.notes


def test_parameters_hidden_by_a_wrong_offset_are_noted(save):
    whole = C3DFile(standing(), LABELS, parameters={"SUBJECTS": {"NAMES": ["P1"]}}).bytes()
    at = whole.index(b"UNITS") + 5
    data = bytearray(whole)
    data[at : at + 2] = struct.pack("<H", 30000)
    clip = read_c3d(save(bytes(data)))
    assert any("parameter UNITS points past" in note for note in clip.source.notes)


def test_cut_within_the_parameters(save):
    whole = C3DFile(standing(), LABELS).bytes()
    with pytest.raises(FormatError, match=r"damaged.*copy or export"):
        read_c3d(save(whole[:600]))


@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_damaged_file_gives_one_line_or_a_clip(save, data):
    whole = bytearray(C3DFile(standing(frames=4), LABELS).bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        whole[data.draw(st.integers(0, 1535))] = data.draw(st.integers(0, 255))
    content = bytes(whole[: data.draw(st.integers(0, len(whole)) | st.just(len(whole)))])
    try:
        clip = read_c3d(save(content))
        assert not np.isinf(clip.positions).any()
    except PriorfillError as error:
        assert "\n" not in str(error)


def test_residuals_that_mark_everything_as_missing(save):
    records = standing()
    records[:, :, 3] = -1
    path = save(C3DFile(records, LABELS))
    clip = read_c3d(path)
    assert clip.missing.all()
    assert any("read it with `ignore_residuals`" in note for note in clip.source.notes)
    measured = read_c3d(path, ignore_residuals=True)
    np.testing.assert_allclose(measured.positions, records[:, :, :3], rtol=1e-6)
    assert any("taken as measured" in note for note in measured.source.notes)
    records[:, :, :3] = 0  # nothing to read
    path = save(C3DFile(records, LABELS))
    assert not any("residual" in note for note in read_c3d(path).source.notes)
    assert read_c3d(path, ignore_residuals=True).missing.all()


def test_ignored_residuals_keep_what_has_no_coordinates(save):
    records = standing()
    records[3, 2, :3] = 0
    records[4, 2, :3] = np.nan
    records[3:6, 2, 3] = -1
    clip = read_c3d(save(C3DFile(records, LABELS)), ignore_residuals=True)
    assert np.argwhere(clip.missing).tolist() == [[3, 2], [4, 2]]


def test_no_frames(save):
    with pytest.raises(ClipError, match="has no frames"):
        read_c3d(save(C3DFile(standing()[:0], LABELS)))


def test_no_points(save):
    with pytest.raises(ClipError, match="has no points"):
        read_c3d(save(C3DFile(standing()[:, :0], [])))


def test_no_rate(save):
    path = save(C3DFile(standing(), LABELS, rate=0.0))
    with pytest.raises(ClipError, match=r"has no frame rate; .*\(`rate`\)"):
        read_c3d(path)
    assert read_c3d(path, rate=50).rate == 50
    with pytest.raises(OptionError, match="`rate` is"):
        read_c3d(path, rate=-1)


def test_rates_that_contradict_each_other(save):
    file = C3DFile(standing(), LABELS)
    for stated, believed in ((0.0, 100.0), (50.0, 50.0), (100.4, 100.4)):
        file.parameters = {"POINT": {"RATE": stated}}
        clip = read_c3d(save(file))
        assert clip.rate == pytest.approx(believed)
        noted = [
            note for note in clip.source.notes if "on its rate; 50 Hz of its parameters" in note
        ]
        assert len(noted) == (stated == 50.0)


@pytest.mark.parametrize("is_float", [True, False])
def test_scales_that_contradict_each_other(save, is_float):
    """Integer coordinates are proportional to it; of floats, only the sign has a meaning."""
    path = save(C3DFile(standing(), LABELS, scale=0.1, is_float=is_float))
    data, positions = bytearray(path.read_bytes()), read_c3d(path).positions
    for header, noted in ((0.1, False), (0.10005, False), (0.2, not is_float), (0.0, False)):
        data[12:16] = struct.pack("<f", -header if is_float else header)
        path.write_bytes(data)
        clip = read_c3d(path)
        np.testing.assert_array_equal(clip.positions, positions)
        notes = [note for note in clip.source.notes if "on its scale; 0.1 of its param" in note]
        assert len(notes) == noted


def test_duplicate_labels(save):
    labels = ["RKNE" if label == "LKNE" else label for label in LABELS]
    clip = read_c3d(save(C3DFile(standing(), labels)))
    assert clip.labels == (*LABELS[:5], "RKNE", "RKNE#7", *LABELS[7:])
    assert clip.source.point_labels == tuple(labels)
    np.testing.assert_array_equal(clip.positions, standing()[:, :, :3])
    (note,) = clip.source.notes
    assert note.startswith("Points 6 and 7 are both labelled RKNE; the second is called RKNE#7")


def test_duplicate_labels_one_without_samples(save):
    labels = ["RKNE" if label == "LKNE" else label for label in LABELS]
    for unseen, how in ((5, "residual"), (6, "zero")):
        records = standing()
        records[:, unseen] = (1, 1, 1, -1) if how == "residual" else 0
        clip = read_c3d(save(C3DFile(records, labels)))
        assert clip.labels == (*LABELS[:5], "RKNE", *LABELS[7:])
        assert clip.source.points == tuple(point for point in range(10) if point != unseen)
        other = 5 + 6 - unseen + 1
        assert clip.source.left_out == {
            "RKNE": f"never seen, and point {other} is labelled RKNE too"
        }
        assert clip.source.notes == ()


def test_names_of_duplicates_never_collide(save):
    labels = ["A", "A", "A#2", *LABELS[3:]]
    assert read_c3d(save(C3DFile(standing(), labels))).labels[:3] == ("A", "A#2#", "A#2")
    records = standing()
    records[:, :2, 3] = -1  # neither has samples: one is kept, to be filled
    assert read_c3d(save(C3DFile(records, labels))).labels[:2] == ("A", "A#2")


def test_no_labels_at_all(save):
    with pytest.raises(ClipError, match="none of its 10 points is a labelled marker"):
        read_c3d(save(C3DFile(standing(), [])))


def wrong_record(name: bytes, body: bytes) -> bytes:
    """A valid file with the first bytes of one parameter replaced."""
    whole = bytearray(C3DFile(standing(), LABELS).bytes())
    at = whole.index(name) + len(name) + 2
    whole[at : at + len(body)] = body
    return bytes(whole)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        # frames: a billion by two words of TRIAL, by a float, and 65534 of the header
        (
            C3DFile(
                standing(),
                LABELS,
                parameters={
                    "TRIAL": {"ACTUAL_START_FIELD": [1, 0], "ACTUAL_END_FIELD": [51712, 15258]},
                    "POINT": {"FRAMES": 65534},
                },
                header={"last": 65534},
            ),
            r"is cut short: it holds \d+ of its 1000000000 frames",
        ),
        (
            C3DFile(
                standing(),
                LABELS,
                parameters={"POINT": {"LONG_FRAMES": 1e30, "FRAMES": 65534}},
                header={"last": 65534},
            ),
            "is cut short",
        ),
        (
            C3DFile(
                standing(), LABELS, header={"last": 65534}, parameters={"POINT": {"FRAMES": 65534}}
            ),
            "is cut short: it holds 12 of its 65534 frames",
        ),
        # points and analog numbers
        (
            C3DFile(
                standing(), LABELS, header={"points": 65535}, parameters={"POINT": {"USED": -1}}
            ),
            "is cut short",
        ),
        (
            C3DFile(
                standing(), LABELS, header={"points": 65535}, parameters={"POINT": {"USED": 1e30}}
            ),
            "its size does not show which",
        ),
        (
            C3DFile(
                standing(),
                LABELS,
                parameters={"ANALOG": {"USED": -1, "RATE": 1e30}, "POINT": {"RATE": 1e-30}},
                header={"analog": 65535},
            ),
            "is cut short",
        ),
        # parameters: 255^7 values, and texts of no width
        (wrong_record(b"LABELS", bytes([255, 7, *[255] * 7])), "LABELS is damaged"),
        (wrong_record(b"LABELS", bytes([255, 7, 0, *[255] * 6])), "labelled marker|damaged"),
        (wrong_record(b"LABELS", bytes([255, 255, 0, *[255] * 90])), "labelled marker|damaged"),
        # data that begin beyond the file
        (
            C3DFile(
                standing(),
                LABELS,
                header={"data_block": 65535},
                parameters={"POINT": {"DATA_START": -1}},
            ),
            "is cut short",
        ),
    ],
)
def test_absurd_sizes_take_neither_time_nor_memory(save, content, message):
    path = save(content)
    tracemalloc.start()
    start = time.process_time()
    try:
        with pytest.raises(PriorfillError, match=message) as error:
            read_c3d(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    one_line(error)
    assert time.process_time() - start < 1
    assert peak < 10e6


def test_other_files_are_not_read(tmp_path):
    """A large file of another format, a large C3D file, and a pipe without a writer."""
    path = tmp_path / "large.c3d"
    for start, message in ((b"PK", "is not a C3D file"), (b"\x02\x50", "GB, and at most 4 are")):
        path.write_bytes(start)
        os.truncate(path, 5_000_000_000)  # takes no space on the disk
        with pytest.raises(FormatError, match=message) as error:
            read_c3d(path)
        one_line(error)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.c3d")
        with pytest.raises(FormatError, match="is not a regular file"):
            read_c3d(tmp_path / "pipe.c3d")


# --- unusual but valid files -----------------------------------------------------------


def test_header_contradicts_analog_used(save):
    analog = np.ones((12, 4, 5))
    file = C3DFile(standing(), LABELS, analog=analog, header={"analog": 7})
    clip = read_c3d(save(file))
    np.testing.assert_allclose(clip.positions, standing()[:, :, :3])
    assert any("the analog numbers per frame" in note for note in clip.source.notes)


def test_parameters_contradict_the_file_and_the_header_fits(save):
    analog = np.ones((200, 4, 5))
    records = standing(frames=200)
    file = C3DFile(records, LABELS, analog=analog, parameters={"ANALOG": {"USED": 0}})
    clip = read_c3d(save(file))
    np.testing.assert_allclose(clip.positions, records[:, :, :3])
    assert any("which fits its size" in note for note in clip.source.notes)


def test_wrong_frame_count_in_one_place(save):
    records = standing(frames=200)
    for file in (
        C3DFile(records, LABELS, parameters={"POINT": {"FRAMES": 150}}),
        C3DFile(records, LABELS, header={"last": 250}),
    ):
        clip = read_c3d(save(file))
        np.testing.assert_allclose(clip.positions, records[:, :, :3])


@pytest.mark.parametrize("counter", ["TRIAL", "LONG_FRAMES", "none"])
def test_more_than_65535_frames(save, counter):
    frames = 70_000
    records = np.zeros((frames, 2, 4))
    records[:, 0, 2], records[:, 1, 2] = 100 + np.arange(frames) % 7, 1700
    parameters = {
        "TRIAL": {
            "TRIAL": {
                "ACTUAL_START_FIELD": [5, 0],
                "ACTUAL_END_FIELD": [(frames + 4) & 0xFFFF, (frames + 4) >> 16],
            },
            "POINT": {"FRAMES": frames & 0xFFFF},
        },
        "LONG_FRAMES": {"POINT": {"FRAMES": 65535, "LONG_FRAMES": float(frames)}},
        "none": {"POINT": {"FRAMES": 65535}},
    }[counter]
    file = C3DFile(
        records,
        ["LANK", "LFHD"],
        is_float=False,
        scale=1.0,
        first_frame=5,
        parameters=parameters,
        header={"last": 65535},
    )
    clip = read_c3d(save(file))
    assert clip.frames == frames
    assert clip.first_frame == 5
    np.testing.assert_array_equal(clip.positions, records[:, :, :3])


def test_first_frame_beyond_16_bits(save):
    trial = {"ACTUAL_START_FIELD": [4464, 1], "ACTUAL_END_FIELD": [4475, 1]}
    file = C3DFile(standing(), LABELS, first_frame=4464, parameters={"TRIAL": trial})
    assert read_c3d(save(file)).first_frame == 70_000


def test_more_labels_than_points(save):
    clip = read_c3d(save(C3DFile(standing(), [*LABELS, "EXTRA1", "EXTRA2"])))
    assert clip.labels == tuple(LABELS)


def test_fewer_labels_than_points(save):
    clip = read_c3d(save(C3DFile(standing(), LABELS[:-1])))
    assert clip.labels == tuple(LABELS[:-1])
    assert clip.source.left_out == {"(point 10)": "has no label"}


def test_more_than_255_labels(save):
    labels = [*LABELS, *(f"M{i:03d}" for i in range(300))]
    records = np.concatenate([standing(), np.full((12, 300, 4), 500.0)], axis=1)
    clip = read_c3d(save(C3DFile(records, labels)))
    assert clip.labels == tuple(labels)


def test_latin_1_in_a_parameter(save):
    file = C3DFile(
        standing(),
        [*LABELS[:-1], b"Fu\xdf"],
        parameters={"PROCESSING": {"UNIT": b"kg/m\xb2"}},
    )
    clip = read_c3d(save(file))
    assert clip.labels[-1] == "Fuß"
    np.testing.assert_allclose(clip.positions, standing()[:, :, :3])


def test_trailing_blanks_and_upper_case_suffix(save):
    clip = formats.read(save(C3DFile(standing(), [f"{x}   " for x in LABELS]), "T.C3D"))
    assert clip.labels == tuple(LABELS)


def test_analog_channels_without_scale(save):
    # ezc3d crashes on such a file
    file = C3DFile(
        standing(),
        LABELS,
        analog=np.ones((12, 2, 3)),
        omit=(("ANALOG", "SCALE"), ("ANALOG", "OFFSET")),
    )
    np.testing.assert_allclose(read_c3d(save(file)).positions, standing()[:, :, :3])


def test_a_description_of_wrong_length(save):
    # ezc3d hangs for minutes on such a file
    whole = bytearray(C3DFile(standing(), LABELS).bytes())
    at = whole.index(b"POINT") + len(b"POINT") + 2
    assert whole[at] == 0
    whole[at] = 250
    clip = read_c3d(save(bytes(whole)))
    np.testing.assert_allclose(clip.positions, standing()[:, :, :3])


# --- subjects --------------------------------------------------------------------------


def test_prefix_of_the_only_subject(save):
    labels = ["*0", *(f"Anna:{label}" for label in LABELS[1:])]
    clip = read_c3d(save(C3DFile(standing(), labels)))
    assert clip.subject == "Anna"
    assert clip.labels == tuple(LABELS[1:])
    assert clip.source.point_labels[0] == "Anna:RFHD"
    assert clip.source.points[0] == 1
    assert clip.source.left_out == {"*0": "unlabelled"}


def test_subject_from_parameters(save):
    file = C3DFile(standing(), LABELS, parameters={"SUBJECTS": {"NAMES": ["Anna"]}})
    assert read_c3d(save(file)).subject == "Anna"


def test_prefix_without_colon(save):
    file = C3DFile(
        standing(),
        [f"Anna_{label}" for label in LABELS],
        parameters={"SUBJECTS": {"LABEL_PREFIXES": ["Anna_"]}},
    )
    clip = read_c3d(save(file))
    assert (clip.subject, clip.labels) == ("Anna", tuple(LABELS))


def test_two_subjects(save):
    records = np.concatenate([standing(seed=1), standing(seed=2)], axis=1)
    labels = [f"{who}:{label}" for who in ("Ben", "Anna") for label in LABELS]
    path = save(C3DFile(records, labels))
    with pytest.raises(ClipError, match=r"2 subjects \(Anna, Ben\); choose one \(`subject`\)"):
        read_c3d(path)
    clip = read_c3d(path, subject="Anna")
    assert clip.subject == "Anna"
    np.testing.assert_allclose(clip.positions, standing(seed=2)[:, :, :3])
    assert clip.source.left_out["Ben:C7"] == "belongs to Ben"
    with pytest.raises(OptionError, match="has no subject 'Carl'; use one of Anna, Ben"):
        read_c3d(path, subject="Carl")


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("LFHD", ("", "LFHD")),
        ("Anna:LFHD  ", ("Anna", "LFHD")),
        ("Unlabeled:1234", ("", "Unlabeled:1234")),
        ("", ("", "")),
    ],
)
def test_split_label(label, expected):
    assert split_label(label, []) == expected


# --- markers and other points-------------------------------------------------------------

# fmt: off
MARKERS = [
    "LFHD", "RBHD", "C7", "T2", "T10", "T12", "CLAV", "STRN", "RBAK", "RBAC", "RBAC-1", "LWRA",
    "LFIN", "SACR", "LASI", "LTHI", "LTIB", "LTUB", "LP1M", "LP5M", "LD5M", "RD1M", "MIHD", "LMT5",
    "LHLX", "LHEE", "LHEEL", "M01", "M37", "R_THIGH_1", "L_SHANK_4", "R_MT_5", "r_knjntln",
    "sacrum", "th12", "RIndex", "LIDX", "LTHI1", "LTHI2", "LTHI3", "head_top", "Marker0", "Marker1",
    "Marker2", "Marker3", "S1", "x12", "LJNT", "RFORCEPS1", "Hip_L", "NOSE", "U12", "TRIANGLE",
    "KNEEJOINT_MED", "COMB", "MD1", "LTO", "RTO",
]
# fmt: on

# fmt: off
OTHERS = [
    "*0", "*12", "uname*3", "Unlabeled_1", "LHipAngles", "RAbsAnkleAngle", "left_knee_angle",
    "LHIPANGLES", "LKneePower", "RHipMoment", "LGroundReactionForce", "LNormalisedGRF",
    "LArchHeight", "LArchHeightIndex", "CentreOfMass", "CentreOfMassFloor", "center_of_mass",
    "PelvisCOM", "CoM", "LCoP", "LHJC", "RAJC", "L_KJC", "RHipJC", "LeftHipJointCenter",
]
# fmt: on


def reasons(names, positions=None, parameters=None):
    if positions is None:
        positions = np.random.default_rng(0).normal(0, 500, (20, len(names), 3))
    declared = declared_model_outputs(C3DParameters(parameters or {}))
    return find_model_points(names, names, positions, declared)


def test_markers_are_kept():
    assert reasons(MARKERS) == {}


def test_other_points_are_left_out():
    assert [OTHERS[i] for i in range(len(OTHERS)) if i not in reasons(OTHERS)] == []


@pytest.mark.parametrize("suffixes", ["OALP", "0123"])
def test_families_without_samples(suffixes):
    names = [f"LTI{s}" for s in suffixes]
    left = reasons(names, np.full((20, 4, 3), np.nan))
    assert bool(left) == (suffixes == "OALP")


def test_type_groups_of_measured_points_are_no_model_outputs():
    names = ["LTOE", "MYPOINT", "RTOE"]
    parameters = {
        ("POINT", "TYPE_GROUPS"): ["MARKERS", "POINTS", "EXTRA"],
        ("POINT", "MARKERS"): ["LTOE"],
        ("POINT", "POINTS"): ["RTOE"],
        ("POINT", "EXTRA"): ["MYPOINT"],
    }
    assert reasons(names, parameters=parameters) == {1: "model output (POINT:EXTRA)"}


def test_declared_model_outputs_are_left_out():
    names = ["LFHD", "PELAng", "JUG"]
    found = reasons(
        names,
        parameters={
            ("POINT", "TYPE_GROUPS"): ["PLATES", "PLATE"],
            ("POINT", "ANGLES"): ["PELAng"],
            ("POINT", "PLATES"): ["JUG"],
        },
    )
    assert found == {1: "model output (POINT:ANGLES)", 2: "model output (POINT:PLATES)"}


@pytest.mark.parametrize("suffixes", ["OALP", "0123"])
def test_axes_of_a_computed_segment(suffixes):
    names = [f"LTI{s}" for s in suffixes] + ["LTIB"]
    rng = np.random.default_rng(1)
    positions = rng.normal(0, 500, (20, 5, 3))
    # four measured markers with such names remain markers
    assert reasons(names, positions) == {}
    turned = np.linalg.qr(rng.normal(size=(20, 3, 3)))[0] * 50
    positions[:, 1:4] = positions[:, :1] + turned
    assert set(reasons(names, positions)) == {0, 1, 2, 3}


def test_numbered_axes_with_an_origin_of_another_name():
    names = ["LTIB1", "LTIB2", "LTIB3", "LTIB", "LAJC"]
    rng = np.random.default_rng(1)
    positions = rng.normal(0, 500, (20, 5, 3))
    assert set(reasons(names, positions)) == {4}
    turned = np.linalg.qr(rng.normal(size=(20, 3, 3)))[0] * np.array([[50], [50], [400]])
    positions[:, :3] = positions[:, 4:] + turned
    assert set(reasons(names, positions)) == {0, 1, 2, 4}


def test_oxford_foot_points_only_with_its_axes():
    assert reasons(["LHE1", "LD1M0", "LPROXFF"]) == {}
    rng = np.random.default_rng(1)
    names = ["LFOF0", "LFOF1", "LFOF2", "LFOF3", "LHE1", "LD1M0", "LPROXFF"]
    positions = rng.normal(0, 500, (20, len(names), 3))
    turned = np.linalg.qr(rng.normal(size=(20, 3, 3)))[0] * 50
    positions[:, 1:4] = positions[:, :1] + turned
    assert len(reasons(names, positions)) == len(names)


def test_virtual_twin():
    assert reasons(["RSTL", "RSTLv"]) == {1: "virtual copy of RSTL"}
    assert reasons(["RSTLv"]) == {}


# --- unit and up axis ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spelled", "factor"),
    [("mm", 1), ("MM ", 1), ("cm", 10), ("m", 1000), ("mete", 1000), ("inches", 25.4)],
)
def test_units(spelled, factor):
    body = standing()[:, :, :3]
    _, found, notes = find_unit(body / factor, spelled, None, "t")
    assert (found, notes) == (factor, [])


@pytest.mark.parametrize("factor", [1, 10, 1000])
def test_missing_unit_is_found_from_the_spread(save, factor):
    records = standing()
    records[:, :, :3] /= factor
    clip = read_c3d(save(C3DFile(records, LABELS, units=None)))
    np.testing.assert_allclose(clip.positions, standing()[:, :, :3], rtol=1e-5)
    assert "is assumed from the spread of the markers" in clip.source.notes[0]


def test_metres_labelled_mm(save):
    records = standing()
    records[:, :, :3] /= 1000
    path = save(C3DFile(records, LABELS))
    with pytest.raises(ClipError, match=r"spread over 1\.6\d mm .* metres; .*`unit` m\)"):
        read_c3d(path)
    np.testing.assert_allclose(read_c3d(path, unit="m").positions, standing()[:, :, :3], rtol=1e-5)
    with pytest.raises(OptionError, match="unit 'furlong' is unknown"):
        read_c3d(path, unit="furlong")


def test_millimetres_labelled_metres(save):
    with pytest.raises(ClipError, match="`unit` mm"):
        read_c3d(save(C3DFile(standing(), LABELS, units="m")))


AXES = {
    "+X": ((2, 1), (1, 1), (0, 1)),
    "-X": ((2, -1), (1, 1), (0, 1)),
    "+Y": ((0, 1), (2, 1), (1, 1)),
    "-Y": ((0, 1), (2, -1), (1, 1)),
    "+Z": ((0, 1), (1, 1), (2, 1)),
    "-Z": ((0, 1), (1, 1), (2, -1)),
}


def turn(positions: np.ndarray, up: str) -> np.ndarray:
    """Turn positions with +Z up to another up axis."""
    return np.stack([sign * positions[..., axis] for axis, sign in AXES[up]], axis=-1)


@pytest.mark.parametrize("up", AXES)
def test_up_from_names(up):
    assert up_from_names(turn(standing()[:, :, :3], up), tuple(LABELS)) == up
    assert up_from_names(turn(standing()[:, :, :3], up), tuple("ABCDEFGHIJ")) is None


@pytest.mark.parametrize("up", AXES)
def test_up_from_the_floor(up):
    frames = 200
    body = standing(frames)[:, :, :3]
    bob = 60 * np.sin(np.arange(frames) / 10)
    body[:, :7, 2] += bob[:, None]
    body[:, -1, 2] = 30
    assert up_from_floor(turn(body, up)) == up


def walking_body() -> tuple[np.ndarray, tuple[str, ...]]:
    """Return a body that moves one metre along X."""
    body = standing()[:, :, :3]
    body[:, :, 0] += np.linspace(0, 1000, len(body))[:, None]
    return body, tuple(LABELS)


def test_a_body_that_moves_about_overrules_the_file():
    body, labels = walking_body()
    assert find_up_axis(body, labels, "+Z", None) == ("+Z", "file", [])
    assert find_up_axis(body, labels, "Z", None) == ("+Z", "file", [])
    up, found, notes = find_up_axis(body, labels, "+Y", None)
    assert (up, found, len(notes)) == ("+Z", "data", 1)
    assert find_up_axis(body, labels, "", None) == ("+Z", "data", [])
    assert find_up_axis(body, labels, "+Z", "-x") == ("-X", "option", [])
    with pytest.raises(OptionError, match="'W' is unknown"):
        find_up_axis(body, labels, "+Z", "W")


@pytest.mark.parametrize("along", ["+X", "-X", "+Y", "-Y"])
def test_a_lying_body_does_not_overrule_the_file(along):
    body, labels = turn(standing()[:, :, :3], along), tuple(LABELS)
    up, found, notes = find_up_axis(body, labels, "+Z", None)
    assert (up, found) == ("+Z", "file")
    assert notes == [f"The body lies along {along}; +Z of the file is used (see `up`)."]


def test_a_lying_body_in_a_file_without_axis():
    body, labels = turn(standing()[:, :, :3], "+X"), tuple(LABELS)
    up, found, notes = find_up_axis(body, labels, "", None)
    assert (up, found) == ("+Z", "default")
    assert notes == ["The body lies along +X; +Z is assumed to be up (see `up`)."]
    walks, _ = walking_body()
    assert find_up_axis(turn(walks, "+X"), labels, "", None)[:2] == ("+X", "data")
    # laboratories with Y up are common
    assert find_up_axis(turn(body, "+X"), labels, "", None)[:2] != ("+X", "data")


@pytest.mark.parametrize("labels", [tuple(LABELS), tuple("ABCDEFGHIJ")])
@pytest.mark.parametrize("maker", [{}, {"COMPANY": ["Qualisys"]}, {"SOFTWARE": ["QTM 2020.3"]}])
def test_a_file_with_minus_z_up(save, labels, maker):
    parameters = {"POINT": {"Y_SCREEN": ["-Z"]}}
    if maker:
        parameters["MANUFACTURER"] = maker
    clip = read_c3d(save(C3DFile(standing(), list(labels), parameters=parameters)))
    named = labels == tuple(LABELS)
    assert clip.up == ("+Z" if named or maker else "-Z")
    assert clip.source.up_found_from == ("data" if named or maker else "file")
    assert len([note for note in clip.source.notes if "states that -Z is up" in note]) == (
        1 if named or maker else 0
    )


def test_screens_of_qualisys_without_its_name(save):
    def up_of(maker: dict[str, list[str]]) -> str:
        screens = {"X_SCREEN": ["-X"], "Y_SCREEN": ["-Z"]}
        parameters = {"POINT": screens, **({"MANUFACTURER": maker} if maker else {})}
        return read_c3d(save(C3DFile(standing(), list("ABCDEFGHIJ"), parameters=parameters))).up

    assert up_of({}) == "+Z"
    assert up_of({"COMPANY": ["Another"]}) == "-Z"


def test_a_handstand_does_not_overrule_the_file():
    body, labels = turn(standing()[:, :, :3], "-Z"), tuple(LABELS)
    note = "The body is upside down; +Z of the file is used (see `up`)."
    assert find_up_axis(body, labels, "+Z", None) == ("+Z", "file", [note])
    walks, _ = walking_body()
    assert find_up_axis(turn(walks, "-Z"), labels, "+Z", None)[:2] == ("-Z", "data")


def test_a_floor_that_contradicts_the_file():
    """Markers without known names; a body that rests along an axis counts if it travels."""
    frames = 200
    body = standing(frames)[:, :, :3]
    body[:, :7, 2] += 60 * np.sin(np.arange(frames) / 10)[:, None]
    body[:, -1, 2] = 30
    stays, labels = turn(body, "+Y"), tuple("ABCDEFGHIJ")
    note = "The lowest markers rest along +Y; +Z of the file is used."
    assert find_up_axis(stays, labels, "+Z", None) == ("+Z", "file", [note])
    body[:, :, 0] += np.linspace(0, 2000, frames)[:, None]
    up, found, notes = find_up_axis(turn(body, "+Y"), labels, "+Z", None)
    assert (up, found, len(notes)) == ("+Y", "data", 1)
    assert find_up_axis(turn(body, "+Y"), labels, "+Y", None) == ("+Y", "file", [])


def test_names_of_the_cast_protocol_show_the_up_axis():
    labels = ("L_FCC", "R_FM1", "L_FLE", "R_IAS", "CV7")
    body = np.zeros((5, 5, 3))
    body[:, :, 1] = [50, 60, 450, 950, 1400]
    assert up_from_names(body, labels) == "+Y"


def test_default_up_axis():
    up, found, notes = find_up_axis(np.zeros((5, 2, 3)), ("A", "B"), "", None)
    assert (up, found) == ("+Z", "default")
    assert "`up`" in notes[0]


@pytest.mark.parametrize("is_float", [True, False])
@pytest.mark.parametrize("wrong", [9, 11])
def test_number_of_points_that_fits_the_size(save, is_float, wrong):
    records = standing(100, step=None if is_float else STEP)
    file = C3DFile(records, LABELS, is_float=is_float, scale=STEP)
    for odd in (
        replace(file, parameters={"POINT": {"USED": wrong}}),
        replace(file, header={"points": wrong}),
    ):
        clip = read_c3d(save(odd))
        expected = records[:, :, :3] * (1 if is_float else STEP)
        np.testing.assert_allclose(clip.positions, expected, rtol=1e-6)
        assert clip.labels == tuple(LABELS)
        assert any("number of points; 10 is used" in note for note in clip.source.notes)


def test_number_of_points_that_the_size_does_not_show(save):
    file = C3DFile(standing(2), LABELS, header={"points": 11})
    with pytest.raises(FormatError, match="10 points according to POINT:USED and 11"):
        read_c3d(save(file))


# --- real recordings -------------------------------------------------------------------

# fmt: off
GAIT_MARKERS = {
    "LFHD", "LBHD", "RFHD", "RBHD", "C7", "T2", "T6", "T10", "T12", "RBAK", "CLAV", "STRN", "LSHO",
    "LELB", "LWRA", "LWRB", "LFIN", "RSHO", "RELB", "RWRA", "RWRB", "RFIN", "SACR", "RASI", "LASI",
    "LTHI", "LKNE", "LHFB", "LTUB", "LTIB", "LSHN", "LANK", "LHEE", "LCPG", "LLCA", "LSTL", "LNAV",
    "LP1M", "LP5M", "LD5M", "LTOE", "LHLX", "RTHI", "RKNE", "RHFB", "RTUB", "RTIB", "RSHN", "RANK",
    "RHEE", "RCPG", "RLCA", "RSTL", "RNAV", "RP1M", "RP5M", "RD5M", "RTOE", "RHLX",
}
# fmt: on


def recordings(data: Path) -> list[Path]:
    return sorted(data.rglob("*.c3d"))


@pytest.mark.realdata
def test_exactly_the_markers_of_gait_files(data):
    for path in sorted((data / "gait").glob("*.c3d")):
        clip = read_c3d(path)
        assert set(clip.labels) == GAIT_MARKERS, path.name
        assert (clip.up, clip.source.up_found_from) == ("+Z", "file")
    raw = read_c3d(data / "real_gaps" / "HC040A14_raw.c3d")
    assert set(raw.labels) == GAIT_MARKERS | {"MIHD", "RD1M"}


@pytest.mark.realdata
def test_other_recordings(data):
    expected = {
        "hdm05/HDM_dg_06-03_03_120.c3d": (202, 41, 2925, "Daniel", 0),
        "cmu/01_01.c3d": (2751, 42, 40, "JustinFriday", 0),
        "cmu/132_32.c3d": (644, 39, 1, "132", 0),
        "walkl/WalkL.c3d": (4300, 37, 1, "walkl", 0),
        "real_gaps/sample26_Capture0002.c3d": (661, 18, 244, "", 818),
        "real_gaps/sample26_Walking_Hybrid_1_5.c3d": (646, 25, 243, "", 4075),
    }
    for name, (frames, markers, first, subject, zeros) in expected.items():
        clip = read_c3d(data / name)
        assert clip.positions.shape == (frames, markers, 3), name
        assert (clip.first_frame, clip.subject) == (first, subject), name
        assert clip.source.zero_samples == zeros, name
        assert clip.up == "+Z"
    hdm = read_c3d(data / "hdm05/HDM_dg_06-03_03_120.c3d")
    assert hdm.source.left_out == dict.fromkeys(["*0", "*1", "*2"], "unlabelled")


@pytest.mark.realdata
def test_interpolated_samples_of_recordings(data):
    cmu = read_c3d(data / "cmu/01_01.c3d")
    assert cmu.source.interpolated.sum() == 859
    assert not (cmu.source.interpolated & cmu.missing).any()
    for name in ("hdm05/HDM_dg_06-03_03_120.c3d", "gait/HC040A14.c3d"):
        assert read_c3d(data / name).source.interpolated is None


@pytest.mark.realdata
def test_up_axis(data):
    # every fifth is enough: most are similar
    assert {path.name for path in recordings(data)[::5] if read_c3d(path).up != "+Z"} == set()


@pytest.mark.realdata
def test_a_real_file_cut_short(data, save):
    whole = (data / "cmu" / "02_01.c3d").read_bytes()
    with pytest.raises(FormatError, match="cut short: it holds"):
        read_c3d(save(whole[: len(whole) // 2]))
