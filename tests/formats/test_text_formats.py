"""TRC, Nexus, Qualisys and Motive files: read, and filled by replacing cells."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import text_files as files
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from text_cases import CASES, with_gap
from text_files import LABELS, standing

from priorfill import formats
from priorfill.errors import (
    ClipError,
    FormatError,
    OptionError,
    OutputError,
    PriorfillError,
)
from priorfill.formats import file_bytes
from priorfill.formats.tables import text_table


def filled_in(clip, values):
    """The clip with values for its missing samples, and their mask."""
    return clip.with_positions(
        np.where(np.isnan(clip.positions), values, clip.positions)
    ), clip.missing


@pytest.fixture(params=CASES)
def case(request, tmp_path):
    write, suffix, up, scale, options = CASES[request.param]
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(write(with_gap(up) * scale, **options))
    return request.param, path


def decimals_of(name: str) -> int:
    write, *_, options = CASES[name]
    usual = {files.trc: 5, files.nexus: 4, files.qualisys: 3, files.motive: 6}
    return options.get("decimals", usual[write])


def test_reads_what_was_written(case):
    name, path = case
    write, _, up, scale, options = CASES[name]
    clip = formats.read(path)
    assert clip.labels == LABELS
    expected = with_gap(up)
    assert np.array_equal(clip.missing, np.isnan(expected[..., 0]))
    tolerance = 0.51 * 10.0 ** -decimals_of(name) / scale
    assert np.nanmax(np.abs(clip.positions - expected)) < tolerance
    assert clip.rate == pytest.approx(120 if write is files.motive else 100, rel=1e-3)
    assert clip.first_frame == options.get("first", 0 if write is files.motive else 1)
    assert clip.up == "+" + "XYZ"[up]
    assert clip.subject == ("Ann" if write in (files.nexus, files.motive) else "")


def test_fill_changes_the_filled_cells_and_nothing_else(case, tmp_path):
    name, path = case
    write, suffix, up, scale, options = CASES[name]
    decimals = decimals_of(name)
    truth = np.where(np.isnan(with_gap(up)), standing(12, up) + 1 / 3, with_gap(up))
    clip, filled = filled_in(formats.read(path), truth)
    report = formats.write(tmp_path / f"out{suffix}", clip, filled)
    # exactly the file that the program would have written
    assert (tmp_path / f"out{suffix}").read_bytes() == write(truth * scale, **options)
    assert report.samples == 4
    assert 0 < report.rounding_mm <= 0.5001 * 10.0**-decimals / scale
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"out{suffix}", f"walk{suffix}"]


def test_without_gaps_the_copy_is_identical(case, tmp_path):
    _, path = case
    clip = formats.read(path)
    out = tmp_path / f"out{path.suffix}"
    assert formats.write(out, clip, np.zeros_like(clip.missing)).samples == 0
    assert out.read_bytes() == path.read_bytes()


def test_written_as_other_formats(case, tmp_path):
    _, path = case
    clip, filled = filled_in(formats.read(path), 7.25)
    for suffix in (".c3d", ".trc", ".npz", ".mat"):
        out = tmp_path / f"out{suffix}"
        formats.write(out, clip, filled)
        again = formats.read(out, up=clip.up)
        assert again.labels == clip.labels
        assert np.allclose(again.positions, clip.positions, rtol=1e-6, atol=1e-6)
        assert again.rate == pytest.approx(clip.rate)


def test_a_filled_sample_at_the_origin_does_not_read_as_missing(tmp_path):
    path = tmp_path / "walk.trc"
    path.write_bytes(files.trc(with_gap(1), missing="0.00000"))
    clip, filled = filled_in(formats.read(path), -0.0)
    formats.write(tmp_path / "out.trc", clip, filled)
    assert not formats.read(tmp_path / "out.trc").missing.any()
    assert b"\t0.00000\t0.00000\t0.00001" in (tmp_path / "out.trc").read_bytes()


def test_a_filled_sample_at_the_origin_of_a_new_file(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_bytes(files.nexus(with_gap()))
    clip, filled = filled_in(formats.read(path), -1e-9)
    formats.write(tmp_path / "out.trc", clip, filled)
    assert not formats.read(tmp_path / "out.trc").missing.any()


def test_zeros_are_kept_on_request(tmp_path):
    path = tmp_path / "walk.tsv"
    path.write_bytes(files.qualisys(with_gap()))
    assert not formats.read(path, zeros_missing=False).missing.any()
    assert formats.read(path).source.zero_samples == 4


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.integers(0, 2**32 - 1), st.sampled_from([files.trc, files.nexus, files.motive]),
    st.integers(0, 8), st.floats(0.05, 0.9),
)  # fmt: skip
def test_any_gaps_and_digits(tmp_path_factory, seed, write, decimals, share):
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("any")
    unit = {"unit": "Millimeters"} if write is files.motive else {}
    truth = np.round(standing(9) + rng.normal(0, 30, (9, 6, 3)), decimals) + 0.0  # no -0
    gaps = np.where(rng.random((9, 6, 1)) < share, np.nan, truth)
    suffix = ".trc" if write is files.trc else ".csv"
    (folder / f"a{suffix}").write_bytes(write(gaps, decimals=decimals, **unit))
    clip = formats.read(folder / f"a{suffix}", unit="mm", up="+Z")
    assert np.array_equal(clip.missing, np.isnan(gaps[..., 0]))
    filled = clip.missing & (rng.random(clip.missing.shape) < 0.7)
    after = np.where(filled[..., None], truth, gaps)
    formats.write(folder / f"b{suffix}", clip.with_positions(after), filled)
    # a table without a number does not define decimals
    if not np.isnan(gaps).all():
        expected = write(after, decimals=decimals, **unit)
        assert (folder / f"b{suffix}").read_bytes() == expected


# --- contents other than positions ----------------------------------------------------------


def read_bytes(tmp_path, data: bytes, suffix: str, **options):
    path = tmp_path / f"odd{suffix}"
    path.write_bytes(data)
    return formats.read(path, **options)


def test_trc_separated_by_blanks(tmp_path):
    data = files.trc(with_gap(1), missing="NaN", newline="\n").replace(b"\t", b"  ")
    clip = read_bytes(tmp_path, data, ".trc")
    assert np.array_equal(clip.missing, np.isnan(with_gap(1)[..., 0]))
    truth = np.where(np.isnan(with_gap(1)), 5.5, with_gap(1))
    formats.write(tmp_path / "out.trc", *filled_in(clip, truth))
    expected = files.trc(truth, newline="\n").replace(b"\t", b"  ")
    assert (tmp_path / "out.trc").read_bytes() == expected


def test_trc_with_rows_that_end_early(tmp_path):
    data = files.trc(with_gap(1))
    lines = [line.rstrip(b"\t") for line in data.split(b"\r\n")]
    clip = read_bytes(tmp_path, b"\r\n".join(lines), ".trc")
    assert clip.missing[-1, 5]
    truth = np.where(np.isnan(with_gap(1)), 5.5, with_gap(1))
    formats.write(tmp_path / "out.trc", *filled_in(clip, truth))
    assert formats.read(tmp_path / "out.trc").positions[-1, 5] == pytest.approx([5.5] * 3)


def test_trc_names_without_gaps_between_them(tmp_path):
    data = files.trc(standing(up=1)).replace(b"\t\t\t", b"\t")
    assert read_bytes(tmp_path, data, ".trc").labels == LABELS


def test_trc_header_that_is_wrong(tmp_path):
    data = files.trc(standing(up=1)).replace(b"\t12\t6\tmm", b"\t13\t5\tmm")
    notes = read_bytes(tmp_path, data, ".trc").source.notes
    assert "The header states 13 frames; there are 12." in notes
    assert "The header states 5 markers; there are 6." in notes
    data = files.trc(standing(up=1)).replace(b"100.00", b"60.00", 1)
    assert any(
        "the time column 100 Hz" in n for n in read_bytes(tmp_path, data, ".trc").source.notes
    )


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (
            "19",
            r"after frame 8 \(line 14\) comes frame 19 \(line 15\); insert rows .* for frames 9-18",
        ),
        (
            "10",
            r"after frame 8 \(line 14\) comes frame 10 \(line 15\); "
            r"insert rows .* for frame 9, or cut",
        ),
        ("8", r"frame 8 is there twice \(lines 14 and 15\); delete one"),
        ("3", r"after frame 8 \(line 14\) comes frame 3 \(line 15\); sort the rows"),
    ],
)
def test_frame_numbers_that_do_not_rise_by_1_are_refused(tmp_path, number, message):
    data = files.trc(standing(up=1)).replace(b"\n9\t", b"\n" + number.encode() + b"\t")
    with pytest.raises(FormatError, match=message):
        read_bytes(tmp_path, data, ".trc")


@pytest.mark.parametrize("write", [files.nexus, files.motive, files.qualisys])
def test_a_jump_of_frame_numbers_is_refused_in_every_format(tmp_path, write):
    suffix, end = (".tsv", b"\t") if write is files.qualisys else (".csv", b",")
    data = write(standing() / 1000 if write is files.motive else standing())
    with pytest.raises(FormatError, match=r"after frame 8 \(line \d+\) comes frame 19 "):
        read_bytes(tmp_path, data.replace(b"\n9" + end, b"\n19" + end), suffix)


@pytest.mark.parametrize("write", [files.trc, files.motive])
def test_y_is_up_by_default(tmp_path, write):
    labels = ("a", "b", "c", "d", "e", "f")
    still = np.tile(standing(1)[:, :, :] * 0.2, (12, 1, 1))[:, :, [0, 1, 1]]
    suffix = ".trc" if write is files.trc else ".csv"
    unit = {"unit": "mm" if write is files.trc else "Millimeters"}
    clip = read_bytes(tmp_path, write(still, labels, **unit), suffix)
    assert (clip.up, clip.source.up_found_from) == ("+Y", "default")


def test_qualisys_virtual_and_unlabelled_trajectories_are_left_out(tmp_path):
    labels = (*LABELS[:4], "Unidentified 7", "LFHD")
    types = ["Measured", "Mixed", "Gap-filled", "Measured", "Measured", "Virtual"]
    clip = read_bytes(tmp_path, files.qualisys(standing(), labels, types=types), ".tsv")
    assert clip.labels == LABELS[:4]
    left = {"Unidentified 7": "unlabelled", "LFHD": "virtual trajectory"}
    assert clip.source.left_out == left


def test_qualisys_with_an_external_clock_needs_a_rate(tmp_path):
    data = files.qualisys(standing(), rate="EXT", numbers=False)
    with pytest.raises(ClipError, match=r"no frame rate; give the frames per second \(`rate`\)"):
        read_bytes(tmp_path, data, ".tsv")
    assert read_bytes(tmp_path, data, ".tsv", rate=50).rate == 50


def test_nexus_subjects(tmp_path):
    labels = ("LTOE", "RTOE", "LKNE", "RKNE", "C7", "LFHD")
    data = files.nexus(standing(), labels).replace(b"Ann:C7", b"Bob:C7")
    with pytest.raises(ClipError, match=r"2 subjects \(Ann, Bob\)"):
        read_bytes(tmp_path, data, ".csv")
    clip = read_bytes(tmp_path, data, ".csv", subject="Bob")
    assert clip.labels == ("C7",)
    assert clip.source.points == (4,)


def test_motive_solved_markers_are_left_out(tmp_path):
    clip = read_bytes(tmp_path, files.motive(standing(up=1) / 1000, extra_solved=True), ".csv")
    assert clip.labels == LABELS
    assert any(note.startswith("1 solved markers") for note in clip.source.notes)


def test_labels_in_latin_1_and_utf_8(tmp_path):
    for coding in ("latin-1", "utf-8", "utf-8-sig"):
        text = files.nexus(standing(), ("Fuß", *LABELS[1:])).decode()
        clip = read_bytes(tmp_path, text.encode(coding), ".csv")
        assert clip.labels[0] == "Fuß"


def test_quotes():
    assert text_table.texts_of(b'a,"b, c" ,"d ""e""",f"\r\n', b",") == ["a", "b, c", 'd "e"', 'f"']
    assert text_table.texts_of(b"a\tb c\t\n", b"\t") == ["a", "b c", ""]


# --- files that cannot be read------------------------------------------------------------------

WRONG = {
    "letters": (files.trc, lambda d: d.replace(b"\t30.00000\t", b"\t3o.0\t", 1), ".trc",
                r"odd.trc: line 7, cell 4 \(LTOE Y\) is '3o.0', which is not a number; correct"),
    "thousands": (files.trc, lambda d: d.replace(b"\t30.00000\t", b"\t1_000\t", 1), ".trc",
                  r"line 7, cell 4 \(LTOE Y\) is '1_000'"),
    "infinite": (files.trc, lambda d: d.replace(b"\t30.00000\t", b"\tinf\t", 1), ".trc",
                 "marker LTOE has an infinite coordinate in frame 1; mark the sample as missing"),
    "no header": (files.trc, lambda d: d[d.index(b"\r\n1\t"):], ".trc", "no line 'Frame# Time"),
    "no frames": (files.trc, lambda d: d[: d.index(b"\r\n1\t")], ".trc",
                  "has no frames after line 4"),
    "half a line": (files.trc, lambda d: d[:-90], ".trc",
                    r"line 18 is cut short: \d+ of 20 cells; export or copy"),
    "more cells": (files.trc, lambda d: d.replace(b"LFHD\t\t\t", b""), ".trc",
                   "line 7 has 20 cells, but line 4 names 5 markers, which take 17"),
    "no number": (files.trc, lambda d: d.replace(b"\n3\t", b"\nthree\t"), ".trc",
                  "line 9 begins with 'three' instead of a frame number"),
    "empty": (files.trc, lambda d: b"", ".trc", "is empty"),
    "binary": (files.trc, lambda d: d[:300] + b"\0" + d[300:], ".trc", r"line \d is not text"),
    "utf-16": (files.trc, lambda d: d.decode().encode("utf-16"), ".trc",
               "UTF-16; save it as UTF-8"),
    "blanks": (files.trc, lambda d: d.replace(b"\t", b" ").replace(b" 30.00000", b"", 1), ".trc",
               "line 7 has 19 of 20 cells, and blanks do not show which"),
    "no trajectories": (files.nexus, lambda d: d.replace(b"Trajectories", b"Devices"), ".csv",
                        "has no section Trajectories; tick Trajectories"),
    "cut section": (files.nexus, lambda d: d[:30], ".csv", "line 1 is cut short"),
    "units": (files.nexus, lambda d: d.replace(b",,mm,mm,mm,mm", b",,mm,mm,mm,mm/s"), ".csv",
              "line 5 has several units"),
    "6D": (files.qualisys, lambda d: d.replace(b"\t3D", b"\t6D"), ".tsv",
           "holds 6D data; export 3D"),
    "no names": (files.qualisys, lambda d: d.replace(b"MARKER_NAMES", b"OTHER_NAMES"), ".tsv",
                 "no MARKER_NAMES; export with the TSV header"),
    "fewer cells": (files.qualisys, lambda d: d.replace(b"NAMES\t", b"NAMES\tA\tB\t")
                    .replace(b"LTOE X\t", b"A X\tA Y\tA Z\tB X\tB Y\tB Z\tLTOE X\t"), ".tsv",
                    "line 14 has 20 cells; 8 markers take 24"),
    "bodies only": (files.motive, lambda d: d.replace(b",Marker", b",Bone"), ".csv",
                    "has no columns of markers, only Bone, Rigid Body; tick Markers"),
    "local": (files.motive, lambda d: d.replace(b"Global", b"Local"), ".csv", "local coordinates"),
    "no titles": (files.motive, lambda d: d.replace(b"Type", b"Sort"), ".csv",
                  "lacks the rows Type"),
    "other csv": (files.motive, lambda d: b"a,b,c\n1,2,3\n", ".csv",
                  "is none of the known .csv files: text of Vicon Nexus"),
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_file_gives_one_line(tmp_path, fault):
    write, spoil, suffix, message = WRONG[fault]
    positions = standing(up=1 if write in (files.trc, files.motive) else 2)
    scale = 0.001 if write is files.motive else 1
    with pytest.raises((FormatError, ClipError), match=message) as caught:
        read_bytes(tmp_path, spoil(write(positions * scale)), suffix)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(file_bytes, "MAX_BYTES", 1000)
    with pytest.raises(FormatError, match=r"odd.trc: holds .* at most"):
        read_bytes(tmp_path, files.trc(standing()), ".trc")


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.sampled_from(sorted(CASES)), st.integers(0, 2**32 - 1), st.integers(1, 6))
@example(name="motive", seed=292584, changes=6)  # the file becomes empty
def test_damaged_files_raise_only_priorfill_errors(tmp_path_factory, name, seed, changes):
    write, suffix, up, scale, options = CASES[name]
    data = bytearray(write(with_gap(up) * scale, **options))
    rng = np.random.default_rng(seed)
    for _ in range(changes):
        if not data:
            break
        at = int(rng.integers(len(data)))
        kind = rng.integers(4)
        if kind == 0:
            data[at] = rng.integers(256)
        elif kind == 1:
            del data[at : at + int(rng.integers(1, 60))]
        elif kind == 2:
            data[at:at] = bytes(rng.choice(list(b'\t,;\n\r "-.eE0179nN\xff'), 4).tolist())
        else:
            data = data[: max(at, 1)]
    folder = tmp_path_factory.mktemp("spoilt")
    (folder / f"a{suffix}").write_bytes(bytes(data))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            clip = formats.read(folder / f"a{suffix}")
            full, filled = filled_in(clip, 3.5)
            formats.write(folder / f"b{suffix}", full, filled)
        except PriorfillError as error:
            assert "\n" not in str(error)
            assert "does not read back" not in str(error)
            assert not (folder / f"b{suffix}").exists()
        else:
            assert not formats.read(folder / f"b{suffix}").missing[filled].any()
    assert not list(folder.glob("*.part*"))


# --- writes that are refused -----------------------------------------------------------------


def test_a_source_that_has_changed_is_refused(tmp_path):
    path = tmp_path / "walk.trc"
    path.write_bytes(files.trc(with_gap(1)))
    clip, filled = filled_in(formats.read(path), 1.0)
    path.write_bytes(files.trc(with_gap(1)) + b"\r\n")
    with pytest.raises(OutputError, match=r"walk.trc: has changed since it was read"):
        formats.write(tmp_path / "out.trc", clip, filled)
    assert not (tmp_path / "out.trc").exists()


@pytest.mark.parametrize("suffix", [".trc", ".c3d"])
def test_neither_source_nor_existing_files_are_overwritten(tmp_path, suffix):
    path = tmp_path / "walk.trc"
    path.write_bytes(files.trc(with_gap(1)))
    clip, filled = filled_in(formats.read(path), 1.0)
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        formats.write(path, clip, filled, overwrite=True)
    (tmp_path / f"out{suffix}").write_bytes(b"old")
    with pytest.raises(OutputError, match="exists already"):
        formats.write(tmp_path / f"out{suffix}", clip, filled)
    assert (tmp_path / f"out{suffix}").read_bytes() == b"old"


def test_csv_cannot_be_a_new_file(tmp_path):
    path = tmp_path / "walk.trc"
    path.write_bytes(files.trc(with_gap(1)))
    clip, filled = filled_in(formats.read(path), 1.0)
    message = r"out.csv: .csv is written only as a copy of a .csv file .* .c3d, .trc, .npz, .mat"
    with pytest.raises(OptionError, match=message):
        formats.write(tmp_path / "out.csv", clip, filled)
    with pytest.raises(OptionError, match=message):
        formats.check_output(tmp_path / "out.csv", source=path)


def test_a_failed_write_leaves_no_file(tmp_path, monkeypatch):
    path = tmp_path / "walk.trc"
    path.write_bytes(files.trc(with_gap(1)))
    clip, filled = filled_in(formats.read(path), 1.0)
    whole = text_table._with_cells
    monkeypatch.setattr(text_table, "_with_cells", lambda *a: whole(*a).replace(b"\t30.", b"\t31."))
    with pytest.raises(OutputError, match="does not read back as intended"):
        formats.write(tmp_path / "out.trc", clip, filled)
    monkeypatch.setattr(
        text_table, "_with_cells", lambda *a: whole(*a).replace(b"\t0.04", b"\t9.04")
    )
    with pytest.raises(OutputError, match="does not read back as intended"):
        formats.write(tmp_path / "out.trc", clip, filled)
    assert [p.name for p in tmp_path.iterdir()] == ["walk.trc"]


@pytest.mark.parametrize("cell", [b"inf", b"-inf", b"1e300"])
def test_a_coordinate_beyond_all_bounds_beside_a_blank_one_is_refused(tmp_path, cell):
    """The cell would stay in the copy, which could not be read."""
    path = tmp_path / "walk.trc"
    text = files.trc(standing()).split(b"\r\n")
    cells = text[8].split(b"\t")
    cells[2:5] = [b"", cell, b"5.0"]
    path.write_bytes(b"\r\n".join([*text[:8], b"\t".join(cells), *text[9:]]))
    with pytest.raises(FormatError, match=r"walk\.trc: line 9.*LTOE.*farther than any marker"):
        formats.read(path)
