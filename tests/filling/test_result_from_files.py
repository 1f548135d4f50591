"""Results rebuilt from files: gaps, changed samples, expected errors; and their pages."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import priorfill as pf
from priorfill.errors import ClipError, FormatError, OptionError, OutputError
from priorfill.filling.read_uncertainty import read_uncertainty
from priorfill.filling.result_from_files import result_from_clips
from priorfill.synthetic.demo import make_demo_clip


@pytest.fixture(scope="module")
def demo() -> tuple[pf.Clip, pf.Clip, pf.Result]:
    """The truth, the clip with gaps, and its fill by straight lines."""
    truth, clip = make_demo_clip()
    return truth, clip, pf.fill(clip, method="linear")


@pytest.fixture(scope="module")
def folder(
    demo: tuple[pf.Clip, pf.Clip, pf.Result], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The same as files of several formats."""
    truth, clip, result = demo
    folder = tmp_path_factory.mktemp("files")
    pf.write(folder / "truth.npz", truth)
    pf.write(folder / "before.c3d", clip)
    for suffix in (".c3d", ".trc", ".npz"):
        pf.write(folder / f"after{suffix}", result.clip, result.filled)
    for suffix in (".csv", ".npz"):
        pf.write_uncertainty(folder / f"errors{suffix}", result)
    return folder


def data_of(page: Path) -> dict[str, Any]:
    """The data of a page."""
    text = page.read_text(encoding="utf-8")
    found = re.search(r'id="priorfill-data">(.*?)</script>', text, re.DOTALL)
    assert found
    return json.loads(found[1])


@pytest.mark.parametrize("suffix", [".c3d", ".trc", ".npz"])
@pytest.mark.parametrize("errors", [None, ".csv", ".npz"])
def test_a_fill_is_rebuilt(
    folder: Path, demo: tuple[pf.Clip, pf.Clip, pf.Result], suffix: str, errors: str | None
) -> None:
    _, _, result = demo
    found = pf.result_from_files(
        folder / "before.c3d",
        folder / f"after{suffix}",
        uncertainty=None if errors is None else folder / f"errors{errors}",
    )
    assert (found.filled == result.filled).all()
    assert not found.rejected.any()
    assert np.nanmax(np.abs(found.clip.positions - result.clip.positions)) < 0.01
    assert [(gap.label, gap.start, gap.stop, gap.filled) for gap in found.gaps] == [
        (gap.label, gap.start, gap.stop, gap.filled) for gap in result.gaps
    ]
    assert found.complete == result.complete
    assert found.method == ("linear" if errors == ".npz" else "unknown")
    if errors is None:
        assert np.isnan(found.error_bound_90_mm).all()
    else:
        bound = result.error_bound_90_mm
        assert np.allclose(found.error_bound_90_mm, bound, atol=6e-4, equal_nan=True)
        assert found.gaps[0].error_bound_90_mm == pytest.approx(
            result.gaps[0].error_bound_90_mm, abs=0.01
        )
    assert bool(found.gaps[0].sources) == (errors == ".csv")


def test_up_axis_and_unit_of_the_filled_file_may_be_others(
    demo: tuple[pf.Clip, pf.Clip, pf.Result],
) -> None:
    _, clip, result = demo
    turned = result.clip.positions[..., [0, 2, 1]] * [1.0, 1.0, -1.0]
    other = replace(result.clip, positions=turned, up="+Y")
    found = result_from_clips([clip], [other])
    assert found.clip.up == clip.up
    assert np.nanmax(np.abs(found.clip.positions - result.clip.positions)) < 1e-9
    assert found.notes == ()
    before = replace(clip, positions=clip.positions[..., [0, 2, 1]] * [1.0, 1.0, -1.0], up="+Y")
    found = result_from_clips([before], [result.clip])
    assert found.clip.up == "+Y"
    assert np.nanmax(np.abs(found.clip.positions - turned)) < 1e-9
    assert found.notes == ()


def test_changed_and_removed_samples_are_counted(
    demo: tuple[pf.Clip, pf.Clip, pf.Result],
) -> None:
    truth, _, _ = demo
    positions = truth.positions.copy()
    positions[10:15, 2] += [0.0, 30.0, 40.0]
    positions[50:53, 4] = np.nan
    found = result_from_clips([truth], [truth.with_positions(positions)])
    assert found.filled.sum() == found.rejected.sum() == 5
    assert found.notes == (
        f"5 of {truth.frames * len(truth.labels)} measured samples differ in the filled file, by "
        "50.0 mm (median) and at most 50.0 mm",
        "3 measured samples are missing in the filled file",
    )
    changed, removed = found.gaps
    assert (changed.start, changed.stop, changed.filled) == (10, 15, 5)
    assert (removed.start, removed.stop, removed.filled) == (50, 53, 0)
    assert not found.complete
    assert (found.clip.positions[10:15, 2] == positions[10:15, 2]).all()
    assert (found.clip.missing == truth.with_positions(positions).missing).all()


def test_what_is_missing_has_no_expected_error(
    folder: Path, demo: tuple[pf.Clip, pf.Clip, pf.Result]
) -> None:
    _, clip, _ = demo
    errors = read_uncertainty(folder / "errors.npz")
    found = result_from_clips([clip], [clip], errors)
    assert not found.filled.any()
    assert np.isnan(found.expected_rms_mm).all() and np.isnan(found.error_bound_90_mm).all()


def test_a_filtered_file_is_no_list_of_gaps(demo: tuple[pf.Clip, pf.Clip, pf.Result]) -> None:
    _, clip, result = demo
    moved = result.clip.with_positions(result.clip.positions + 0.3)
    found = result_from_clips([clip], [moved])
    assert (found.filled == result.filled).all()
    assert "it appears to be filtered or moved" in found.notes[0]
    assert len(found.gaps) == len(result.gaps)
    shown = result_from_clips([clip], [result.clip.with_positions(result.clip.positions + 0.04)])
    assert shown.notes == ("the filled file has measured samples rounded by up to 0.069 mm",)


def test_subjects(demo: tuple[pf.Clip, pf.Clip, pf.Result]) -> None:
    _, clip, _ = demo
    clips = [replace(clip, subject=name) for name in ("Anna", "Ben")]
    result = pf.fill(clips, method="linear")
    after = [one.clip for one in result.subjects]
    found = result_from_clips(clips, after[::-1])
    assert found.clip.labels == result.clip.labels
    assert (found.filled == result.filled).all()
    with pytest.raises(ClipError, match="has no subject Ben, but Anna"):
        result_from_clips(clips, after[:1])


def test_files_that_do_not_fit_are_refused(
    folder: Path, demo: tuple[pf.Clip, pf.Clip, pf.Result], tmp_path: Path
) -> None:
    truth, _, _ = demo
    before = folder / "before.c3d"
    cut = truth.with_positions(truth.positions[:50])
    pf.write(tmp_path / "cut.npz", cut)
    pf.write(tmp_path / "few.npz", pf.Clip(truth.positions[:, :3], truth.labels[:3], truth.rate))
    with pytest.raises(ClipError, match="has 50 frames"):
        pf.result_from_files(before, tmp_path / "cut.npz")
    with pytest.raises(ClipError, match="has no marker"):
        pf.result_from_files(before, tmp_path / "few.npz")
    for name, error, message in (
        ("errors.txt", OptionError, "uncertainty is not read from .txt"),
        ("none.npz", FormatError, "no such file"),
    ):
        with pytest.raises(error, match=message):
            pf.result_from_files(before, folder / "after.c3d", uncertainty=tmp_path / name)
    table = (folder / "errors.csv").read_text(encoding="utf-8")
    for content, message in (
        ("a,b\n", "has not the columns"),
        (table + "LKNE,1,x,1,1,\n", "is no row of the table"),
        (table + "LKNE,1,99999,1,1,\n", "beyond the end of before"),
        (table + "LKNE,1,1,-1,1,\n", "is no row of the table"),
        (table + "LKNE,1,1,1,inf,\n", "is no row of the table"),
    ):
        (tmp_path / "errors.csv").write_text(content, encoding="utf-8")
        with pytest.raises(FormatError, match=message):
            pf.result_from_files(before, folder / "after.c3d", uncertainty=tmp_path / "errors.csv")
    with pytest.raises(FormatError, match="has no array"):
        pf.result_from_files(before, folder / "after.c3d", uncertainty=folder / "truth.npz")
    other = pf.fill(cut, method="linear")
    pf.write_uncertainty(tmp_path / "other.npz", other)
    with pytest.raises(FormatError, match="is on 50 frames"):
        pf.result_from_files(before, folder / "after.c3d", uncertainty=tmp_path / "other.npz")


def test_a_damaged_archive_of_errors(
    folder: Path, demo: tuple[pf.Clip, pf.Clip, pf.Result], tmp_path: Path
) -> None:
    _, clip, _ = demo
    with np.load(folder / "errors.npz") as archive:
        arrays = dict(archive)
    for text in ("[" * 100_000, "9" * 5000, "[]", '{"versions": null}'):
        np.savez(tmp_path / "errors.npz", **{**arrays, "provenance": np.array(text)})
        errors = read_uncertainty(tmp_path / "errors.npz").like(clip, clip.labels)
        assert errors.provenance is None
    for value in (-1.0, np.inf):
        np.savez(tmp_path / "errors.npz", **{**arrays, "expected_rms_mm": np.full_like(
            arrays["expected_rms_mm"], value)})  # fmt: skip
        with pytest.raises(FormatError, match="negative or infinite"):
            read_uncertainty(tmp_path / "errors.npz").like(clip, clip.labels)


def test_versions_are_compared(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "after.c3d").write_bytes((folder / "after.c3d").read_bytes())
    after = [folder / "after.trc", folder / "after.c3d", tmp_path / "x" / "after.c3d"]
    page = tmp_path / "page.html"
    result = pf.report_from_files(page, folder / "before.c3d", after, truth=folder / "truth.npz")
    data = data_of(page)
    names = [(one["kind"], one["name"]) for one in data["versions"]]
    assert names == [
        ("filled", "after.trc"),
        ("truth", "truth"),
        ("other", f"{folder.name}/after.c3d"),
        ("other", "x/after.c3d"),
    ]
    assert data["title"] == "before.c3d"
    assert all(gap["true_mean"] is not None for gap in data["gaps"] if gap["filled"])
    assert str(folder) not in page.read_text(encoding="utf-8")
    assert len(data["gaps"]) == len(result.gaps)


def test_pages_replace_nothing_unasked(folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("mine", encoding="utf-8")
    files = folder / "before.c3d", [folder / "after.c3d"]
    with pytest.raises(OutputError, match="exists already"):
        pf.report_from_files(page, *files)
    assert page.read_text(encoding="utf-8") == "mine"
    pf.report_from_files(page, *files, overwrite=True)
    assert data_of(page)["title"] == "before.c3d"
    with pytest.raises(OptionError, match="there is no filled file"):
        pf.report_from_files(tmp_path / "b.html", folder / "before.c3d", [])
    with pytest.raises(OptionError, match=r"with suffix '\.c3d'"):
        pf.report_from_files(tmp_path / "b.c3d", *files)
    assert [one.name for one in tmp_path.iterdir()] == ["page.html"]
