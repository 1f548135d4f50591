"""A study of a BIDS dataset writes a derivative dataset."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from bids_files import NAME, columns_of, gappy, write_dataset
from text_files import LABELS

from priorfill.clip import Clip
from priorfill.errors import StudyError
from priorfill.filling.fill_file import FileOptions
from priorfill.formats import write
from priorfill.study.fill_job import fill_job
from priorfill.study.find_sources import find_sources
from priorfill.study.job import FILLED, StudyJob
from priorfill.study.job_keys import JobKeys
from priorfill.study.records import file_states, record_of_job
from priorfill.study.settings import FillSettings
from priorfill.study.study_folder import StudyFolder
from priorfill.study.study_options import StudyOptions
from priorfill.study.study_plan import plan_study

SOURCE = f"sub-01/motion/{NAME}_motion.tsv"


def job_in(root: Path) -> StudyJob:
    folder = StudyFolder(root / "derivatives" / "priorfill")
    return StudyJob(
        SOURCE,
        str(root / SOURCE),
        str(folder.output(SOURCE)),
        str(folder.record(SOURCE)),
        FillSettings(method="linear").to_json(),
    )


def test_names_are_paths_below_the_root_of_the_dataset(tmp_path):
    write_dataset(tmp_path, columns_of(gappy()))
    for other in ("derivatives/x/sub-01/motion", "sourcedata"):
        shutil.copytree(tmp_path / "sub-01" / "motion", tmp_path / other)
    for path in (tmp_path, tmp_path / "sub-01", tmp_path / SOURCE):
        found = find_sources([path], tmp_path / "derivatives" / "priorfill")
        assert [one.name for one in found.sources] == [SOURCE]
    assert find_sources([tmp_path / "sourcedata"], tmp_path / "out").sources


def test_a_job_writes_all_files_of_a_derivative_and_knows_them(tmp_path):
    write_dataset(tmp_path / "a", columns_of(gappy()))
    job = job_in(tmp_path / "a")
    outcome = fill_job(job)
    assert (outcome.status, outcome.reason) == (FILLED, "")
    output = Path(job.output)
    assert output.name == f"{NAME}_desc-filled_motion.tsv"
    assert sorted(outcome.written) == sorted(str(path) for path in output.parent.iterdir())
    assert len(outcome.written) == 5
    assert (output.parents[2] / "dataset_description.json").exists()
    assert "bids:raw:sub-01" in output.with_suffix(".json").read_text()
    (tmp_path / "a").rename(tmp_path / "b")
    moved = record_of_job(job_in(tmp_path / "b"))
    assert set(file_states(moved).values()) == {"written"}


def test_a_foreign_mask_is_not_replaced(tmp_path):
    write_dataset(tmp_path, columns_of(gappy()))
    job = job_in(tmp_path)
    mask = Path(job.output).with_name(f"{NAME}_desc-filled_mask.tsv")
    mask.parent.mkdir(parents=True)
    mask.write_text("mine")
    assert "_mask.tsv: exists already" in fill_job(job).reason
    assert mask.read_text() == "mine"
    assert fill_job(replace(job, overwrite=True)).status == FILLED


def test_a_study_for_a_program_does_not_grow_a_database(tmp_path):
    write_dataset(tmp_path / "in", columns_of(gappy()))
    settings = FillSettings(method="linear", files=FileOptions(program="opensim"))
    options = StudyOptions(grow=True)
    with pytest.raises(StudyError, match="use `grow` without `program`"):
        plan_study([tmp_path / "in"], tmp_path / "out", settings, tmp_path / "db", options)


def test_two_sources_of_one_output_are_refused(tmp_path):
    clip = Clip(gappy(), LABELS, 100.0)
    for name in ("WALK.npz", "walk.npz", "walk.mat"):
        write(tmp_path / "in" / name, clip)
    settings = FillSettings(method="linear", files=FileOptions(program="opensim"))
    with pytest.raises(StudyError, match=r"(?i)would have one output, .*walk\.trc"):
        plan_study([tmp_path / "in"], tmp_path / "out", settings, None, StudyOptions())


def test_the_key_depends_on_side_files(tmp_path):
    path = write_dataset(tmp_path, columns_of(gappy()))
    keys = [JobKeys().with_keys([job_in(tmp_path)], None).jobs[0].key]
    for name in (f"{NAME}_channels.tsv", f"{NAME}_motion.json"):
        side = path.with_name(name)
        side.write_text(side.read_text() + "\n")
        keys.append(JobKeys().with_keys([job_in(tmp_path)], None).jobs[0].key)
    assert len(set(keys)) == 3
