"""The table of what was estimated in a file for OpenSim."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from text_files import LABELS, standing

import priorfill as pf
from priorfill.cli import main
from priorfill.errors import OptionError, OutputError
from priorfill.filling.companion_files import companion_files
from priorfill.filling.opensim_estimates import estimates_table
from priorfill.study.fill_job import fill_job
from priorfill.study.job import FILLED, StudyJob
from priorfill.study.settings import FillSettings
from priorfill.study.study_folder import StudyFolder

FOR_OPENSIM = pf.FileOptions(program="opensim")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    positions = standing(40)
    positions[3:6, 2] = positions[8, 2] = np.nan
    labels = ("=LTOE", *LABELS[1:])
    path = tmp_path / "walk.npz"
    pf.write(path, pf.Clip(positions, labels, 100.0, up="+Z", first_frame=31))
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.windows
def test_markers_frames_and_errors_are_listed(tmp_path, source):
    done = pf.fill_file(source, tmp_path / "o" / "walk.trc", files=FOR_OPENSIM, method="linear")
    table = tmp_path / "o" / "walk_estimates.csv"
    assert done.companions == (table,)
    (row,) = rows(table)
    assert row["marker"] == row["marker_in_file"] == "LKNE"
    assert (row["filled"], row["filled_frames"], row["missing"]) == ("4", "34-36 39", "0")
    mean = np.average([gap.expected_mean_error_mm for gap in done.result.gaps], weights=[3, 1])
    assert float(row["expected_mean_error_mm"]) == pytest.approx(mean, abs=0.006)


def test_weights_count_the_expected_errors(source):
    result = pf.fill(pf.read(source), method="linear")

    def weight(rms: float) -> str:
        known = np.where(result.filled, rms, np.nan)
        table = estimates_table(replace(result, expected_rms_mm=known)).decode()
        return next(csv.DictReader(table.splitlines()))["ik_weight"]

    assert weight(20.0) == f"{1 / (1 + 4 * 20**2 / 40 / 10**2):.2f}"
    assert weight(0.0) == "1.00"
    assert weight(np.nan) == ""


def test_what_stays_missing_is_listed_and_cells_are_escaped(tmp_path, source):
    clip = pf.read(source)
    positions = clip.positions.copy()
    positions[38:, 0] = np.nan
    pf.write(source, pf.Clip(positions, clip.labels, 100.0, first_frame=1), overwrite=True)
    output = tmp_path / "walk.trc"
    pf.fill_file(
        source, output, files=FOR_OPENSIM, method="linear", gap_filter=pf.GapFilter(max_gap="1f")
    )
    first, second = rows(tmp_path / "walk_estimates.csv")
    assert (first["marker"], first["filled"], first["missing_frames"]) == ("'=LTOE", "0", "39-40")
    assert (second["filled_frames"], second["missing_frames"]) == ("9", "4-6")


def test_targets_are_checked_before_the_fill(tmp_path, source, monkeypatch):
    monkeypatch.setattr("priorfill.filling.fill_file.fill", lambda *_, **__: pytest.fail("filled"))
    with pytest.raises(OptionError, match="`program` is for a file to write"):
        pf.fill_file(source, files=FOR_OPENSIM)
    for name in ("walk.mat", "walk.tsv", "walk"):
        with pytest.raises(OptionError, match="has the suffix"):
            pf.fill_file(source, tmp_path / name, files=FOR_OPENSIM)
    (tmp_path / "walk_estimates.csv").write_text("mine")
    with pytest.raises(OutputError, match=r"walk_estimates\.csv: exists already"):
        pf.fill_file(source, tmp_path / "walk.trc", files=FOR_OPENSIM)


def test_the_command(tmp_path, source):
    arguments = ["fill", str(source), "-o", str(tmp_path / "w.trc"), "--for", "OpenSim"]
    run = CliRunner().invoke(main, [*arguments, "--method", "linear"])
    assert run.exit_code == 0, run.output
    assert "with w_estimates.csv" in run.output
    assert "note: Turned for OpenSim, so that +Z of the recording is +Y." in run.output


def test_a_job_of_a_study_writes_the_table(tmp_path, source):
    folder = StudyFolder.at(tmp_path / "out", ".trc")
    job = StudyJob(
        "P01/walk.npz",
        str(source),
        str(folder.output("P01/walk.npz")),
        str(folder.record("P01/walk.npz")),
        FillSettings(method="linear", files=FOR_OPENSIM).to_json(),
    )
    outcome = fill_job(job)
    assert (outcome.status, outcome.reason) == (FILLED, "")
    output = Path(job.output)
    assert output.name == "walk.trc"
    companions = companion_files(output, source, "opensim")
    assert sorted(outcome.written) == sorted(map(str, (output, *companions)))
    assert all(path.exists() for path in companions)
