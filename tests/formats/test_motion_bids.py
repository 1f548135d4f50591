"""Recordings of Motion-BIDS: columns by their side files, inheritance, copies, damaged files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import text_files
from bids_files import (
    NAME,
    Column,
    channels_text,
    columns_of,
    gappy,
    motion_text,
    other_columns,
    write_dataset,
)
from platforms import on_wine
from text_files import LABELS, standing

import priorfill as pf
from priorfill import formats
from priorfill.errors import ClipError, FormatError, OptionError, OutputError
from priorfill.formats.bids.names import BidsName, side_files


def filled_in(clip: pf.Clip) -> tuple[pf.Clip, np.ndarray]:
    """A clip with the missing samples at made-up places, and which these are."""
    positions = clip.positions.copy()
    positions[clip.missing] = (12.3456789, -0.25, 900.5)
    return replace(clip, positions=positions), clip.missing


@pytest.mark.windows
def test_channels_in_any_order_among_others_are_read_and_patched(tmp_path):
    positions = gappy()
    columns = columns_of(positions / 1000, unit="m") + other_columns(len(positions))
    order = np.random.default_rng(1).permutation(len(columns))
    path = write_dataset(tmp_path, [columns[k] for k in order])
    clip = formats.read(path)
    expected = positions[:, [LABELS.index(label) for label in clip.labels]]
    np.testing.assert_allclose(clip.positions, expected, atol=1e-3)
    assert (clip.rate, clip.subject, clip.source.unit) == (100.0, "sub-01", "m")
    assert clip.source.notes == (
        "Channels that are no positions stay as they are: 1 ACCEL, 1 LATENCY, 1 ORNT.",
    )
    full, mask = filled_in(clip)
    out = tmp_path / "out" / path.name
    report = formats.write(out, full, mask)
    assert report.samples == 3
    was, now = (file.read_text().replace("\n", "\t\n\t").split("\t") for file in (path, out))
    changed = [(a, b) for a, b in zip(was, now, strict=True) if a != b]
    assert sorted(changed) == sorted(
        3 * [("n/a", "0.012346"), ("n/a", "-0.000250"), ("n/a", "0.900500")]
    )


def test_each_channel_has_its_own_unit(tmp_path):
    positions = gappy()
    columns = columns_of(positions)
    for k in (7, 8, 15):  # two axes of the marker with the gap, one of another
        columns[k] = replace(columns[k], units="m", values=columns[k].values / 1000)
    path = write_dataset(tmp_path, columns)
    clip = formats.read(path)
    np.testing.assert_allclose(clip.positions, positions, atol=1e-3)
    full, mask = filled_in(clip)
    out = tmp_path / path.name
    assert formats.write(out, full, mask).rounding_mm < 1e-3
    assert out.read_text().split("\n")[3].split("\t")[6:9] == ["12.345679", "-0.000250", "0.900500"]


def test_units_that_cannot_be_converted_are_refused(tmp_path):
    columns = columns_of(standing())
    columns[4] = replace(columns[4], units="vm")
    with pytest.raises(FormatError, match="units mm and vm, which cannot be converted"):
        formats.read(write_dataset(tmp_path, columns))


def test_side_files_are_inherited(tmp_path):
    path = write_dataset(tmp_path, columns_of(gappy()))
    path.with_suffix(".json").unlink()
    channels = path.with_name(f"{NAME}_channels.tsv")
    channels.rename(tmp_path / "task-walk_channels.tsv")
    (tmp_path / "task-run_channels.tsv").write_text("x")  # of another task
    (tmp_path / "task-walk_motion.json").write_text('{"SamplingFrequency": 50, "TaskName": "w"}')
    (tmp_path / "motion.json").write_text('{"SamplingFrequency": 60}')
    (tmp_path / "sub-01" / "sub-01_motion.json").write_text('{"SamplingFrequencyEffective": 49.5}')
    described = {"reference_frame": {"Levels": {"lab": {"SpatialAxes": "ASR"}}}}
    (tmp_path / "channels.json").write_text(json.dumps(described))
    clip = formats.read(path)
    assert clip.rate == 49.5
    assert clip.source.notes[0].startswith("SamplingFrequencyEffective, 49.5 Hz, is used instead")
    found = side_files(path, "motion", ".json")
    assert [one.name for one in found] == [
        "motion.json", "task-walk_motion.json", "sub-01_motion.json",
    ]  # fmt: skip
    assert formats.bids.side_files.read_side_files(path).up_axis("lab") == "+Y"


def test_axes_may_be_stated_as_in_drafts_of_motion_bids(tmp_path):
    fields = {"SamplingFrequency": 100, "SpatialAxes": "FRU"}
    path = write_dataset(tmp_path, columns_of(standing()), fields)
    clip = formats.read(path)
    assert (clip.up, clip.source.up_found_from) == ("+Z", "file")


def test_a_unit_that_the_markers_contradict_is_an_error(tmp_path):
    path = write_dataset(tmp_path, columns_of(standing() * 10, unit="m"))  # mm, farther apart
    with pytest.raises(ClipError, match="which looks like millimetres; give the right unit"):
        formats.read(path)
    clip = formats.read(path, unit="mm")
    np.testing.assert_allclose(clip.positions, standing() * 10, atol=1e-5)


def test_side_files_above_the_root_do_not_count(tmp_path):
    path = write_dataset(tmp_path / "motion", columns_of(standing()), fields={})
    (tmp_path / "motion.json").write_text('{"SamplingFrequency": 50}')
    with pytest.raises(ClipError, match="has no frame rate"):
        formats.read(path)
    assert formats.read(path, rate=80).rate == 80


@pytest.mark.skipif(on_wine(), reason="wine shows no symbolic link as one")
def test_a_link_to_the_contents_has_the_side_files_of_its_own_folder(tmp_path):
    path = write_dataset(tmp_path, columns_of(standing()))
    contents = tmp_path / "annex" / "MD5E-s17"
    contents.parent.mkdir()
    path.rename(contents)
    try:
        path.symlink_to(contents)
    except OSError:
        pytest.skip("no right to make links")
    assert formats.read(path).rate == 100
    contents.unlink()
    with pytest.raises(FormatError, match="is a link to a file that is not there; get that first"):
        formats.read(path)


def test_points_that_are_no_markers_are_left_out_with_the_reason(tmp_path):
    positions = standing()
    columns = columns_of(positions)
    values = positions[:, 0, 0]
    columns += [Column(axis, "POS", "BAD", "mm", values, status="bad") for axis in "xyz"]
    columns += [Column(axis, "POS", "HAND", "mm", values, frame="local") for axis in "xyz"]
    columns += [Column("x", "POS", "FLAT", "mm", values), Column("x", "POS", "n/a", "mm", values)]
    clip = formats.read(write_dataset(tmp_path, columns))
    assert clip.labels == LABELS
    assert clip.source.left_out == {
        "BAD": "has the status bad",
        "HAND": "in the reference frame local, not lab",
    }
    assert clip.source.notes == (
        "1 channels of positions have no tracked point; they are left out.",
        "Left out, because they lack an axis: FLAT.",
    )


def test_a_tracked_point_with_two_of_each_axis_is_two_markers(tmp_path):
    columns = columns_of(standing(), ("A", "A", "B", "C", "D", "E"))
    clip = formats.read(write_dataset(tmp_path, columns))
    assert clip.labels[:2] == ("A", "A#2")


@pytest.mark.parametrize("missing", ["-9999", "0", "NaN", -9999, -9999.5])
def test_the_stated_mark_of_missing_samples_counts(tmp_path, missing):
    columns = columns_of(gappy())
    path = write_dataset(tmp_path, columns, {"SamplingFrequency": 100, "MissingValues": missing})
    path.write_text(motion_text(columns, missing=str(missing)))
    clip = formats.read(path)
    assert clip.missing.sum() == 3
    out = tmp_path / path.name
    formats.write(out, *filled_in(clip))
    assert not np.isnan(np.loadtxt(out)).any()


def test_a_sample_with_one_missing_coordinate_keeps_the_others(tmp_path):
    columns = columns_of(standing())
    path = write_dataset(tmp_path, columns, {"SamplingFrequency": 100, "MissingValues": "-9999"})
    rows = [line.split("\t") for line in motion_text(columns).splitlines()]
    before = rows[1][:3]
    rows[1][1] = "-9999"
    path.write_text("".join("\t".join(row) + "\n" for row in rows))
    clip = formats.read(path)
    assert clip.missing.sum() == 1
    out = tmp_path / path.name
    formats.write(out, *filled_in(clip))
    after = out.read_text().splitlines()[1].split("\t")[:3]
    assert after[::2] == before[::2]
    assert float(after[1]) == -0.25


def test_a_line_of_names_is_passed_over(tmp_path):
    columns = columns_of(gappy())
    path = write_dataset(tmp_path, columns)
    names = "\t".join(column.line().split("\t")[0] for column in columns)
    path.write_text(names + "\n" + path.read_text())
    clip = formats.read(path)
    assert clip.frames == 12
    assert "The first line has the names of the channels" in clip.source.notes[0]
    out = tmp_path / path.name
    formats.write(out, *filled_in(clip))
    assert out.read_text().startswith(names + "\n")


def test_the_name_decides_only_where_the_contents_do_not(tmp_path):
    path = tmp_path / "walk_motion.tsv"
    path.write_bytes(text_files.qualisys(standing()))
    assert formats.format_of(path) == "qualisys"
    recording = write_dataset(tmp_path / "set", columns_of(standing()))
    assert formats.format_of(recording) == "bids"
    assert [formats.is_recording(file) for file in sorted(recording.parent.iterdir())] == [
        False, False, True,
    ]  # fmt: skip


def test_recordings_of_inertial_sensors_are_none_of_markers(tmp_path):
    path = write_dataset(tmp_path, other_columns(12))
    assert not formats.is_recording(path)
    with pytest.raises(FormatError, match="priorfill fills positions only"):
        formats.read(path)
    path.with_name(f"{NAME}_channels.tsv").unlink()
    assert formats.is_recording(path)  # the reason is reported


def test_a_copy_needs_the_name_of_a_recording_and_unchanged_channels(tmp_path):
    path = write_dataset(tmp_path, columns_of(gappy()))
    clip = formats.read(path)
    with pytest.raises(OptionError, match="name that ends with _motion"):
        formats.check_output(tmp_path / "filled.tsv", source=path)
    with pytest.raises(OptionError, match="name that ends with _motion"):
        formats.write(tmp_path / "filled.tsv", *filled_in(clip))
    channels = path.with_name(f"{NAME}_channels.tsv")
    channels.write_text(channels.read_text().replace("LTOE", "LFOO"))
    with pytest.raises(OutputError, match="has changed since the recording was read"):
        formats.write(tmp_path / path.name, *filled_in(clip))


def damaged_rows(text: str) -> dict[str, tuple[str, str]]:
    lines = text.splitlines(keepends=True)
    return {
        "a row too short": ("".join([*lines[:5], lines[5].rpartition("\t")[0] + "\n", *lines[6:]]),
                            "line 6 has 17 columns, and .* names 18 channels"),
        "a row too long": ("".join([*lines[:5], lines[5][:-1] + "\t1\n", *lines[6:]]),
                           "line 6 has 19 columns"),
        "no row": ("\n\n", "is empty"),
        "an empty line": ("".join([*lines[:5], "\n", *lines[5:]]), "empty line between"),
        "a word": (text.replace("n/a", "lost", 1), "'lost', which is not a number"),
        "infinite": (text.replace("n/a", "inf", 1), "is infinite"),
        "zero bytes": (text + "\0", "is not text"),
    }  # fmt: skip


@pytest.mark.parametrize("damage", damaged_rows("1\t2\n" * 9))
def test_damaged_recordings_are_refused(tmp_path, damage):
    path = write_dataset(tmp_path, columns_of(gappy()))
    text, message = damaged_rows(path.read_text())[damage]
    path.write_bytes(text.encode())
    with pytest.raises((FormatError, ClipError), match=message) as found:
        formats.read(path)
    assert "\n" not in str(found.value)


BAD_CHANNELS = {
    "": "is empty",
    "name\ttype\ttracked_point\n": "has no column component",
    "name\tcomponent\ttype\ttracked_point\n": "names no channels",
    "component\ttype\ttracked_point\nx\tPOS\tA\tB\n": "line 2 has 4 cells",
    "component\ttype\ttracked_point\nx\tACCEL\tA\n": "no tracked point has channels of type POS",
    "\xff\xfe": "is text in UTF-16",
}


@pytest.mark.parametrize("text", BAD_CHANNELS)
def test_damaged_channels_are_refused(tmp_path, text):
    path = write_dataset(tmp_path, columns_of(standing()))
    path.with_name(f"{NAME}_channels.tsv").write_bytes(text.encode("latin-1"))
    with pytest.raises(FormatError, match=BAD_CHANNELS[text]) as found:
        formats.read(path)
    assert "\n" not in str(found.value)


def test_a_recording_without_channels_is_refused(tmp_path):
    path = write_dataset(tmp_path, columns_of(standing()))
    path.with_name(f"{NAME}_channels.tsv").unlink()
    with pytest.raises(FormatError, match=f"has no {NAME}_channels.tsv, which names its columns"):
        formats.read(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[]", "is not a JSON object"),
        ("[" * 100_000, "is nested too deep"),
        ('{"SamplingFrequency": 1' + "0" * 5000 + "}", "is not JSON .a number of 5001 digits"),
        ('{"SamplingFrequency": 100, "TaskName": "\\ud800"}', "has text that is not Unicode"),
        ('{"SamplingFrequency": 1' + "0" * 400 + "}", "has no frame rate"),
        ('{"SamplingFrequency": true}', "has no frame rate"),
        ('{"SamplingFrequency": [100]}', "has no frame rate"),
        ('{"SamplingFrequency": NaN}', "has no frame rate"),
        ('{"SamplingFrequency": -5}', "has no frame rate"),
        ("\xff", "is not JSON"),
    ],
)
def test_damaged_json_is_refused(tmp_path, text, message):
    path = write_dataset(tmp_path, columns_of(standing()))
    path.with_suffix(".json").write_bytes(text.encode("latin-1"))
    with pytest.raises((FormatError, ClipError), match=message) as found:
        formats.read(path)
    assert "\n" not in str(found.value)


def test_odd_but_valid_side_files_are_read(tmp_path):
    path = write_dataset(tmp_path, columns_of(standing()))
    fields = '{"SamplingFrequency": "120", "SamplingFrequencyEffective": "n/a"}'
    path.with_suffix(".json").write_bytes(b"\xef\xbb\xbf" + fields.encode())
    text = channels_text(columns_of(standing())).replace("\tPOS\t", "\tpos\t")
    path.with_name(f"{NAME}_channels.tsv").write_bytes(
        b"\xef\xbb\xbf" + text.replace("\tx\t", "\tX\t").replace("\n", "\r\n").encode()
    )
    assert formats.read(path).rate == 120


def test_labels_of_names():
    name = BidsName.parse("sub-01_ses-a_task-walk_desc-filled_motion.tsv")
    assert [name.label(key) for key in ("ses", "desc", "run")] == ["a", "filled", ""]
    assert (name.suffix, name.extension) == ("motion", ".tsv")
    assert BidsName.parse(Path("walk").name) == BidsName((), "walk", "")
