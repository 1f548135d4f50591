"""Derivative datasets of BIDS: names, side files, mask and errors next to a filled recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from bids_files import NAME, columns_of, gappy, other_columns, write_dataset
from click.testing import CliRunner
from text_files import LABELS

import priorfill as pf
from priorfill.cli import main
from priorfill.errors import OptionError, OutputError
from priorfill.formats.bids.names import dataset_root, filled_name
from priorfill.formats.bids.side_files import read_side_files

FILLED = f"{NAME}_desc-filled"


def shuffled_dataset(root: Path) -> Path:
    columns = columns_of(gappy() / 1000, unit="m") + other_columns(12)
    order = np.random.default_rng(2).permutation(len(columns))
    return write_dataset(root, [columns[k] for k in order])


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.windows
def test_a_folder_becomes_a_derivative_dataset(tmp_path):
    source = shuffled_dataset(tmp_path)
    root = tmp_path / "derivatives" / "priorfill"
    done = pf.fill_file(source, root, method="linear")
    motion = root / "sub-01" / "motion"
    assert done.output == motion / f"{FILLED}_motion.tsv"
    companions = [
        f"{FILLED}_{end}" for end in ("channels.tsv", "error.tsv", "mask.tsv", "motion.json")
    ]
    assert sorted(path.name for path in done.companions) == companions
    assert sorted(contents(motion)) == sorted([*companions, done.output.name])
    assert sorted(path.name for path in root.iterdir() if path.is_file()) == [
        ".bidsignore", "README", "dataset_description.json", "desc-filled_error.json",
        "desc-filled_mask.json", "descriptions.tsv",
    ]  # fmt: skip
    again = pf.read(done.output)
    assert not again.missing.any()
    assert (again.labels, again.subject) == (done.result.clip.labels, "sub-01")
    mask = np.loadtxt(motion / f"{FILLED}_mask.tsv", dtype=int)
    recorded = source.read_text().splitlines()
    assert (mask == [[cell == "n/a" for cell in row.split("\t")] for row in recorded]).all()
    fields = json.loads((motion / f"{FILLED}_motion.json").read_text())
    assert fields["SamplingFrequency"] == 100
    assert fields["Sources"] == [f"bids:raw:sub-01/motion/{NAME}_motion.tsv"]
    described = json.loads((root / "dataset_description.json").read_text())
    assert described["DatasetType"] == "derivative"
    assert described["DatasetLinks"] == {"raw": "../.."}


def test_filled_samples_of_a_derivative_do_not_count_as_measured(tmp_path):
    done = pf.fill_file(shuffled_dataset(tmp_path), tmp_path / "out", method="linear")
    again = pf.read(done.output)
    assert again.source.interpolated is not None
    assert (again.source.interpolated == done.result.filled).all()
    mask = done.output.with_name(f"{FILLED}_mask.tsv")
    mask.write_bytes(mask.read_bytes().replace(b"\n", b"\r\n").rstrip())
    assert (pf.read(done.output).source.interpolated == done.result.filled).all()
    for damaged in (b"", b"0\t1\n", mask.read_bytes().replace(b"1", b"2", 1)):
        mask.write_bytes(damaged)
        source = pf.read(done.output).source
        assert source.interpolated is None
        assert bool(damaged) == any(note.startswith("Its mask does not") for note in source.notes)


def test_errors_have_a_row_for_each_sample(tmp_path):
    done = pf.fill_file(shuffled_dataset(tmp_path), tmp_path / "out", method="linear")
    table = done.output.with_name(f"{FILLED}_error.tsv").read_text().splitlines()
    titles, *rows = [line.split("\t") for line in table]
    assert len(rows) == 12
    assert titles[:2] == [
        f"{done.result.clip.labels[0]}_expected_mean_error_mm",
        f"{done.result.clip.labels[0]}_error_bound_90_mm",
    ]
    column = titles.index("LKNE_error_bound_90_mm")
    filled = [row[column] for row in rows if row[column] != "n/a"]
    marker = done.result.clip.labels.index("LKNE")
    np.testing.assert_allclose(
        np.array(filled, float), done.result.error_bound_90_mm[3:6, marker], atol=6e-4
    )
    assert sum(cell != "n/a" for row in rows for cell in row) == 6


def test_another_format_becomes_a_recording_with_side_files(tmp_path):
    clip = pf.Clip(gappy(), LABELS, 100.0, up="+Z")
    pf.write(tmp_path / "walk.c3d", clip)
    output = tmp_path / "set" / "sub-9" / "ses-a" / "motion" / (
        "sub-9_ses-a_task-walk_tracksys-omc_desc-filled_motion.tsv"
    )  # fmt: skip
    done = pf.fill_file(tmp_path / "walk.c3d", output, method="linear")
    assert len(done.companions) == 5
    assert len(list(output.parent.iterdir())) == 6
    again = pf.read(output)
    np.testing.assert_allclose(again.positions, done.result.clip.positions, atol=2e-6)
    assert (again.labels, again.rate, again.up) == (LABELS, 100.0, "+Z")
    assert read_side_files(output).motion["TaskName"] == "walk"
    described = json.loads((tmp_path / "set" / "dataset_description.json").read_text())
    assert "SourceDatasets" not in described
    assert "walk.c3d" not in str(contents(tmp_path / "set"))  # it may name a person


def test_a_new_recording_without_desc_has_side_files_only(tmp_path):
    clip = pf.Clip(gappy(), LABELS, 100.0, up="+Y")
    path = tmp_path / "sub-9_task-walk_tracksys-omc_run-2_motion.tsv"
    pf.write(path, clip)
    assert len(list(tmp_path.iterdir())) == 4
    again = pf.read(path)
    np.testing.assert_allclose(again.positions, clip.positions, atol=1e-6)
    assert read_side_files(path).up_axis("lab") == "+Y"
    with pytest.raises(OutputError, match="exists already"):
        pf.write(path, clip)


@pytest.mark.parametrize("label", ["", "n/a", "A\tB", '"A"', "A\0"])
def test_labels_that_cannot_be_written_are_refused(tmp_path, label):
    clip = pf.Clip(gappy(), (label or "A", *LABELS[1:]), 100.0)
    if not label:
        object.__setattr__(clip, "labels", ("", *LABELS[1:]))
    with pytest.raises(OutputError, match="cannot hold the label"):
        pf.write(tmp_path / "sub-9_task-w_tracksys-o_motion.tsv", clip)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name",
    ["walk.tsv", "walk_motion.tsv", "sub-1_task-a_motion.tsv", "task-a_sub-1_tracksys-b_motion.tsv",
     "sub-1_task-a-b_tracksys-c_motion.tsv"],
)  # fmt: skip
def test_a_new_recording_needs_a_name_of_bids(tmp_path, name):
    with pytest.raises(OptionError, match=r"a new \.tsv file is of Motion-BIDS, with a name"):
        pf.write(tmp_path / name, pf.Clip(gappy(), LABELS, 100.0))


def test_a_derivative_is_checked_before_the_fill(tmp_path, monkeypatch):
    source = shuffled_dataset(tmp_path)
    monkeypatch.setattr("priorfill.filling.fill_file.fill", lambda *_, **__: pytest.fail("filled"))
    with pytest.raises(OptionError, match="is a dataset of the type raw"):
        pf.fill_file(source, source.with_name(f"{FILLED}_motion.tsv"), method="linear")
    mask = tmp_path / "out" / "sub-01" / "motion" / f"{FILLED}_mask.tsv"
    mask.parent.mkdir(parents=True)
    mask.write_text("mine")
    with pytest.raises(OutputError, match=r"_mask\.tsv: exists already"):
        pf.fill_file(source, tmp_path / "out", method="linear")
    assert mask.read_text() == "mine"


def test_a_name_with_an_unknown_suffix_is_no_folder(tmp_path):
    source = shuffled_dataset(tmp_path)
    with pytest.raises(OptionError, match=r"the suffix '\.c3dd' is unknown"):
        pf.fill_file(source, tmp_path / "out.c3dd", method="linear")


def test_nothing_is_written_if_one_file_cannot_be(tmp_path, monkeypatch):
    source = shuffled_dataset(tmp_path)

    def fail(*_: object, **__: object) -> None:
        raise OutputError("no space")

    monkeypatch.setattr("priorfill.formats.bids.motion_tsv.write_table", fail)
    with pytest.raises(OutputError, match="no space"):
        pf.fill_file(source, tmp_path / "out", method="linear")
    assert not contents(tmp_path / "out")


def test_files_at_the_root_are_left_as_they_are(tmp_path):
    source = shuffled_dataset(tmp_path)
    root = tmp_path / "out"
    root.mkdir()
    (root / "README").write_text("mine")
    (root / "dataset_description.json").write_text('{"DatasetType": "derivative"}')
    done = pf.fill_file(source, root, method="linear")
    assert (root / "README").read_text() == "mine"
    fields = json.loads(done.output.with_name(f"{FILLED}_motion.json").read_text())
    assert "Sources" not in fields  # the dataset does not say what raw means


def test_a_second_fill_is_of_the_same_bytes(tmp_path):
    source = shuffled_dataset(tmp_path)
    pf.fill_file(source, tmp_path / "out", method="linear")
    before = contents(tmp_path / "out")
    pf.fill_file(source, tmp_path / "out", method="linear", files=pf.FileOptions(overwrite=True))
    assert contents(tmp_path / "out") == before


def test_the_command_names_the_files(tmp_path):
    source = shuffled_dataset(tmp_path)
    run = CliRunner().invoke(
        main, ["fill", str(source), "-o", str(tmp_path / "out"), "-m", "linear"]
    )
    assert run.exit_code == 0, run.output
    assert f"with {FILLED}_motion.json" in run.output.replace("\n", " ")


def test_names_of_filled_recordings():
    assert filled_name("sub-1_task-a_tracksys-b_desc-low_motion.tsv") == (
        "sub-1_task-a_tracksys-b_desc-lowFilled_motion.tsv"
    )
    assert filled_name("walk.c3d") == "walk.c3d"


def test_the_root_of_a_dataset(tmp_path):
    source = shuffled_dataset(tmp_path)
    for place in (source, source.parent, tmp_path):
        assert dataset_root(place) == tmp_path
    (tmp_path / "derivatives").mkdir()
    assert dataset_root(tmp_path / "derivatives") is None
