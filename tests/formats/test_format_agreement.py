"""Unusual content has the same outcome in every format; fills are written to the right column."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import text_files
from c3d_bytes import C3DFile
from scipy.io import savemat
from text_files import LABELS, standing

from priorfill import formats
from priorfill.errors import ClipError, MultipleSubjectsError, OptionError, PriorfillError

FIRST_FRAME = 31

SUFFIXES = (".c3d", ".trc", ".npz", ".mat")

TWINS = ("LTOE", "RTOE", "LKNE", "LKNE", "C7", "LFHD")


@dataclass
class Content:
    """Content to write in any format; `rate` or `unit` None: the file states none."""

    positions: np.ndarray
    labels: tuple[str, ...] = LABELS
    rate: float | None = 100.0
    unit: str | None = "mm"
    options: dict[str, Any] = field(default_factory=dict)


def write_c3d(path: Path, content: Content) -> None:
    missing = np.isnan(content.positions).all(axis=2)
    records = np.concatenate([content.positions, np.where(missing, -1.0, 0.0)[..., None]], axis=2)
    records[missing, :3] = 0.0
    file = C3DFile(
        records,
        list(content.labels),
        rate=content.rate or 0.0,
        units=content.unit,
        first_frame=FIRST_FRAME,
    )
    path.write_bytes(file.bytes())


def write_trc(path: Path, content: Content) -> None:
    path.write_bytes(
        text_files.trc(
            content.positions,
            content.labels,
            rate=content.rate or np.inf,  # an invalid rate, and equal times
            unit=content.unit or "",
            first=FIRST_FRAME,
            decimals=9,
        )
    )


def arrays_of(content: Content) -> dict[str, Any]:
    arrays: dict[str, Any] = {"positions": content.positions, "first_frame": FIRST_FRAME}
    if content.rate is not None:
        arrays["rate"] = content.rate
    if content.unit is not None:
        arrays["unit"] = content.unit
    return arrays


def write_npz(path: Path, content: Content) -> None:
    np.savez(path, labels=np.array(content.labels), **arrays_of(content))


def write_mat(path: Path, content: Content) -> None:
    savemat(path, arrays_of(content) | {"labels": np.array(content.labels, dtype=object)})


WRITERS: dict[str, Callable[[Path, Content], None]] = {
    ".c3d": write_c3d,
    ".trc": write_trc,
    ".npz": write_npz,
    ".mat": write_mat,
}


def with_values(*changes: tuple[Any, Any], labels: tuple[str, ...] = LABELS) -> Content:
    """The standing body with some samples replaced."""
    positions = standing()
    for where, value in changes:
        positions[where] = value
    return Content(positions, labels)


def options(content: Content, **given: Any) -> Content:
    content.options = given
    return content


TWO_SUBJECTS = tuple(f"{'Ann' if k < 4 else 'Bob'}:{label}" for k, label in enumerate(LABELS))

CASES: dict[str, Callable[[], Content]] = {
    "two of a label": lambda: with_values(labels=TWINS),
    "three of a label": lambda: with_values(labels=("A", "A", "A#2", "A", "C7", "LFHD")),
    "a twin without samples": lambda: with_values((np.s_[:, 2], np.nan), labels=TWINS),
    "a twin of zeros": lambda: with_values((np.s_[:, 3], 0.0), labels=TWINS),
    "twins without samples": lambda: with_values((np.s_[:, 2:4], np.nan), labels=TWINS),
    "a marker without samples": lambda: with_values((np.s_[:, 2], np.nan)),
    "points other than markers": lambda: with_values(
        labels=("LTOE", "*12", "LKNE", "LHipAngles", "C7", "LFHD")
    ),
    "no marker at all": lambda: with_values(labels=("*1", "*2", "*3", "*4", "*5", "*6")),
    "infinite": lambda: with_values((np.s_[4, 3, 1], np.inf)),
    "minus infinity": lambda: with_values((np.s_[4, 3, 1], -np.inf)),
    "absurd": lambda: with_values((np.s_[4, 3, 1], 2e20)),
    "an infinite model output": lambda: with_values(
        (np.s_[4, 3, 1], np.inf), labels=(*LABELS[:3], "LHipAngles", *LABELS[4:])
    ),
    "zeros": lambda: with_values((np.s_[2:4, 1], 0.0)),
    "zeros kept": lambda: options(with_values((np.s_[2:4, 1], 0.0)), zeros_missing=False),
    "one coordinate missing": lambda: with_values((np.s_[5, 1, 2], np.nan)),
    "no rate": lambda: Content(standing(), rate=None),
    "no rate, but an option": lambda: options(Content(standing(), rate=None), rate=50.0),
    "a negative rate": lambda: options(Content(standing()), rate=-1.0),
    "no unit": lambda: Content(standing() / 1000, unit=None),
    "an unknown unit": lambda: Content(standing() / 10, unit="ell"),
    "metres as mm": lambda: Content(standing() / 1000),
    "metres as mm, but an option": lambda: options(Content(standing() / 1000), unit="m"),
    "an unknown unit option": lambda: options(Content(standing()), unit="ell"),
    "an unknown up axis": lambda: options(Content(standing()), up="W"),
    "two subjects": lambda: with_values(labels=TWO_SUBJECTS),
    "one of two subjects": lambda: options(with_values(labels=TWO_SUBJECTS), subject="Bob"),
    "an unknown subject": lambda: options(with_values(labels=TWO_SUBJECTS), subject="Carl"),
}

ERRORS = {
    "no marker at all": (ClipError, "none of its 6 points is a labelled marker"),
    "infinite": (ClipError, "RKNE has an infinite coordinate in frame 35; mark the sample"),
    "minus infinity": (ClipError, "RKNE has an infinite coordinate in frame 35"),
    "absurd": (ClipError, r"RKNE has a coordinate of 2e\+20 in frame 35; mark the sample"),
    "no rate": (ClipError, r"no frame rate; give the frames per second \(`rate`\)"),
    "a negative rate": (OptionError, "`rate` is"),
    "metres as mm": (ClipError, "`unit` m"),
    "an unknown unit option": (OptionError, "unit 'ell' is unknown"),
    "an unknown up axis": (OptionError, "'W' is unknown"),
    "two subjects": (MultipleSubjectsError, r"2 subjects \(Ann, Bob\)"),
    "an unknown subject": (OptionError, "no subject 'Carl'; use one of Ann, Bob"),
}
"""The cases that are errors in every format; all others are clips in every format."""


def outcome(path: Path, content: Content) -> dict[str, Any]:
    """The properties of the clip read, or the error raised."""
    WRITERS[path.suffix](path, content)
    try:
        clip = formats.read(path, **content.options)
    except PriorfillError as error:
        assert str(error).startswith(path.name) or isinstance(error, OptionError)
        return {"error": type(error), "message": str(error).removeprefix(path.name)}
    assert clip.source is not None
    return {
        "labels": clip.labels,
        "missing": clip.missing.tolist(),
        "positions": clip.positions,
        "rate": clip.rate,
        "up": clip.up,
        "subject": clip.subject,
        "first_frame": clip.first_frame,
        "name": clip.name,
        "points": clip.source.points,
        "point_labels": clip.source.point_labels,
        "mm_per_unit": clip.source.mm_per_unit,
        "up_found_from": clip.source.up_found_from,
        "zero_samples": clip.source.zero_samples,
        "left_out": clip.source.left_out,
        "notes": clip.source.notes,
    }


@pytest.mark.parametrize("name", CASES)
def test_every_format_agrees(tmp_path, name):
    outcomes = {suffix: outcome(tmp_path / f"odd{suffix}", CASES[name]()) for suffix in SUFFIXES}
    expected = outcomes.pop(".c3d")
    assert ("error" in expected) == (name in ERRORS)
    positions = expected.pop("positions", None)
    for suffix, found in outcomes.items():
        if positions is not None:
            np.testing.assert_allclose(found.pop("positions"), positions, atol=1e-3)
        assert found == expected, suffix


@pytest.mark.parametrize("name", ERRORS)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_errors_name_the_place(tmp_path, name, suffix):
    content = CASES[name]()
    error, message = ERRORS[name]
    WRITERS[suffix](tmp_path / f"odd{suffix}", content)
    with pytest.raises(error, match=message):
        formats.read(tmp_path / f"odd{suffix}", **content.options)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_no_frames(tmp_path, suffix):
    path = tmp_path / f"odd{suffix}"
    WRITERS[suffix](path, Content(standing()[:0]))
    with pytest.raises(ClipError, match="has no frames"):
        formats.read(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_two_markers_with_one_label_are_both_read(tmp_path, suffix):
    path = tmp_path / f"odd{suffix}"
    WRITERS[suffix](path, with_values(labels=TWINS))
    clip = formats.read(path)
    assert clip.labels == ("LTOE", "RTOE", "LKNE", "LKNE#4", "C7", "LFHD")
    np.testing.assert_allclose(clip.positions, standing(), atol=1e-3)
    assert clip.source.notes == (
        "Points 3 and 4 are both labelled LKNE; the second is called LKNE#4 here. "
        "Rename one of them if it is another marker.",
    )


TEXT_WRITERS = {
    "trc": (text_files.trc, ".trc", 1.0, {}),
    "nexus": (text_files.nexus, ".csv", 1.0, {}),
    "qualisys": (text_files.qualisys, ".tsv", 1.0, {}),
    "motive": (text_files.motive, ".csv", 1.0, {"unit": "Millimeters"}),
}


@pytest.mark.parametrize("name", TEXT_WRITERS)
@pytest.mark.parametrize("marker", [2, 3])
def test_the_gap_of_a_twin_is_filled_in_its_own_column(tmp_path, name, marker):
    write, suffix, scale, more = TEXT_WRITERS[name]
    positions = standing()
    positions[4:7, marker] = np.nan
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(write(positions * scale, TWINS, **more))
    clip = formats.read(path)
    assert clip.labels[2:4] == ("LKNE", "LKNE#4")
    assert np.argwhere(clip.missing).tolist() == [[frame, marker] for frame in (4, 5, 6)]
    full = np.where(np.isnan(positions), 7.25, positions)
    filled = np.where(np.isnan(clip.positions), 7.25, clip.positions)
    formats.write(tmp_path / f"out{suffix}", clip.with_positions(filled), clip.missing)
    assert (tmp_path / f"out{suffix}").read_bytes() == write(full * scale, TWINS, **more)


@pytest.mark.parametrize("name", TEXT_WRITERS)
def test_a_gap_after_columns_left_out_is_filled_in_its_own_column(tmp_path, name):
    write, suffix, scale, more = TEXT_WRITERS[name]
    labels = ("*1", "LHipAngles", *LABELS[2:])
    positions = standing()
    positions[4:7, 4] = np.nan
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(write(positions * scale, labels, **more))
    clip = formats.read(path)
    assert clip.labels == LABELS[2:]
    full = np.where(np.isnan(positions), 7.25, positions)
    filled = np.where(np.isnan(clip.positions), 7.25, clip.positions)
    formats.write(tmp_path / f"out{suffix}", clip.with_positions(filled), clip.missing)
    assert (tmp_path / f"out{suffix}").read_bytes() == write(full * scale, labels, **more)


def test_the_gap_of_a_twin_is_filled_in_its_own_record(tmp_path):
    content = with_values((np.s_[4:7, 3], np.nan), labels=TWINS)
    write_c3d(tmp_path / "walk.c3d", content)
    clip = formats.read(tmp_path / "walk.c3d")
    filled = np.where(np.isnan(clip.positions), 7.25, clip.positions)
    formats.write(tmp_path / "out.c3d", clip.with_positions(filled), clip.missing)
    write_c3d(tmp_path / "expected.c3d", Content(filled, TWINS))
    assert (tmp_path / "out.c3d").read_bytes() == (tmp_path / "expected.c3d").read_bytes()


@pytest.mark.parametrize(("others", "limit"), [(0, 1.35), (3, 1.1)])
def test_reading_c3d_holds_positions_in_memory_once(tmp_path, others, limit):
    """File contents, positions and residuals; and the selected positions if points are left out.

    The detection of the up axis, which takes more memory for so few markers, is skipped.
    """
    labels = (*LABELS[: 6 - others], *("LHipAngles", "LKneeAngles", "LAnkleAngles")[:others])
    content = Content(np.tile(standing(1000), (10, 1, 1)), labels)
    write_c3d(tmp_path / "long.c3d", content)
    samples = content.positions.shape[0] * 6
    needed = (16 + 24 + 8) * samples
    if others:
        needed += 24 * samples * (6 - others) // 6
    tracemalloc.start()
    try:
        clip = formats.read_c3d(tmp_path / "long.c3d", up="+Z")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert clip.positions.shape == (10_000, 6 - others, 3)
    assert peak < limit * needed
