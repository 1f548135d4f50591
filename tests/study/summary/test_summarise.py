"""The summary of a study: which trials need a hand, and its files."""

from __future__ import annotations

import csv
import errno
import json
from pathlib import Path

import pytest
from study_outcomes import FRAMES, failure, gap, outcome

from priorfill.errors import OutputError
from priorfill.study.job import JobOutcome
from priorfill.study.summary import summary_files
from priorfill.study.summary.limits import SummaryLimits
from priorfill.study.summary.summarise import StudyContents, summarise_study
from priorfill.study.summary.summary_files import check_summary, write_summary


def groups_of(*outcomes: JobOutcome, **limits: float) -> dict[str, str]:
    summary = summarise_study(outcomes, SummaryLimits(**limits))
    return {one.figures.outcome.name: one.attention.group for one in summary.trials}


def test_groups_follow_the_rule() -> None:
    outcomes = [
        outcome("short.c3d", gap("C7", 0.5)),
        outcome("none.c3d"),
        outcome("long.c3d", gap("C7", 1.5)),
        outcome("uncertain.c3d", gap("C7", 0.5, 15.0)),
        outcome("unknown.c3d", gap("C7", 0.5, None)),
        outcome("left.c3d", gap("C7", 0.5, left=10)),
        outcome("long_left.c3d", gap("C7", 1.5, left=50)),
        outcome("lost.c3d", gap("C7", 1.5, 15.0)),
        outcome("long_lost.c3d", gap("C7", 3.0, left=150)),
        failure("failed.c3d", "no markers"),
    ]
    assert groups_of(*outcomes) == {
        "failed.c3d": "failed",
        "long_lost.c3d": "record again",
        "lost.c3d": "record again",
        "long_left.c3d": "look at",
        "left.c3d": "look at",
        "uncertain.c3d": "look at",
        "unknown.c3d": "look at",
        "long.c3d": "good",
        "short.c3d": "good",
        "none.c3d": "good",
    }
    assert next(iter(groups_of(*outcomes))) == "failed.c3d"
    assert groups_of(outcomes[2], gap=1.0) == {"long.c3d": "look at"}
    assert groups_of(outcomes[2], gap=2.0) == {"long.c3d": "good"}
    assert groups_of(outcomes[3], gap=0.2) == {"uncertain.c3d": "record again"}
    assert groups_of(outcomes[3], error=20.0) == {"uncertain.c3d": "good"}


def test_many_lost_gaps_do_not_hide_the_worst_one() -> None:
    lost = [gap(marker, 1.5, 15.0 + at) for at, marker in enumerate(("C7", "T10", "CLAV", "STRN"))]
    one = outcome("raw.c3d", *lost, gap("RHLX", 0.5, 400.0))
    (trial,) = summarise_study([one], SummaryLimits()).trials
    found = [reason.split(":")[0].split(",")[0] for reason in trial.attention.reasons]
    assert found == ["STRN", "CLAV", "and 2 more such gaps", "RHLX"]


def test_a_marker_that_no_trial_of_a_folder_shows_counts_for_none() -> None:
    never = gap("LFRM", FRAMES / 100, left=FRAMES, reason="never measured")
    summary = summarise_study(
        [
            outcome("P1/a.c3d", never, gap("C7", 0.2)),
            outcome("P1/b.c3d", never),
            failure("P1/c.c3d", "no markers"),
            outcome("P2/a.c3d", never),  # alone, it cannot tell
            outcome("P3/a.c3d", never),
            outcome("P3/b.c3d", gap("LFRM", 0.5)),
        ]
    )
    groups = {one.figures.outcome.name: one.attention.group for one in summary.trials}
    assert groups == {
        "P1/a.c3d": "good",
        "P1/b.c3d": "good",
        "P1/c.c3d": "failed",
        "P2/a.c3d": "record again",
        "P3/a.c3d": "record again",
        "P3/b.c3d": "good",
    }
    assert [folder.absent for folder in summary.folders] == [("LFRM",), (), ()]
    assert [folder.worst_marker for folder in summary.folders] == ["C7", "LFRM", "LFRM"]
    marker = summary.markers[0]
    assert (marker.label, marker.trials, marker.throughout_trials) == ("LFRM", 5, 4)
    assert marker.absent == ("P1",)


def test_what_is_left_alone_does_not_count() -> None:
    alone = gap("C7", 3.0, left=300, requested=False, reason="longer than wanted")
    limits = SummaryLimits(gap=0.5)
    summary = summarise_study([outcome("a.c3d", alone, gap("LASI", 0.1))], limits)
    (trial,) = summary.trials
    assert trial.attention.group == "good"
    assert trial.figures.kept == 300
    assert trial.figures.longest is not None
    assert trial.figures.longest.marker == "LASI"
    assert [marker.label for marker in summary.markers] == ["LASI", "C7"]


def test_warnings_of_the_worst_gap_come_first(tmp_path: Path) -> None:
    warnings = ("C7, frames 101-110: slow.", "LASI, frames 101-150: jumps.", "of the file")
    one = outcome("a.c3d", gap("C7", 0.1, 1.0), gap("LASI", 0.5, 9.0), warnings=warnings)
    _, files = write_summary([one], tmp_path / "summary.html")
    (trial,) = json.loads(files.json.read_text("ascii"))["trials"]
    assert trial["warnings"] == [warnings[1], warnings[0], warnings[2]]


@pytest.mark.windows
def test_files_hold_the_same(tmp_path: Path) -> None:
    outcomes = [outcome("P10/a.c3d", gap("C7", 0.5)), failure("P9/=b.c3d", '=HYPERLINK("x")')]
    contents = StudyContents("gait", waiting=("P9/c.c3d",))
    summary, files = write_summary(outcomes, tmp_path / "summary.html", contents=contents)
    assert summary.sentence == "3 trials: 1 filled completely, 1 failed, 1 not done yet."
    assert summary.to_do == "1 needs a hand: 1 failed."
    values = json.loads(files.json.read_text("ascii"))
    assert [one["folder"] for one in values["folders"]] == ["P9", "P10"]
    with files.trials.open(encoding="utf-8-sig", newline="") as table:
        rows = list(csv.DictReader(table))
    assert [row["trial"] for row in rows] == [one["name"] for one in values["trials"]]
    assert rows[0]["reasons"] == '\'=HYPERLINK("x")'
    assert rows[1]["missing_share"] == str(50 / (40 * FRAMES))
    with files.markers.open(encoding="utf-8-sig", newline="") as table:
        assert [row["marker"] for row in csv.DictReader(table)] == ["C7"]
    assert "gait" in files.page.read_text("utf-8")


def test_damaged_records_and_odd_names_do_not_cost_the_summary(tmp_path: Path) -> None:
    odd = [
        outcome("a.c3d", facts={"gaps": [{"marker": "C7"}]}),
        outcome("b.c3d", facts={"gaps": 3}),
        outcome("c\udcff.c3d", gap("\udcff", 0.2)),  # no UTF-8
    ]
    summary, files = write_summary(odd, tmp_path / "summary.html")
    assert [one.attention.group for one in summary.trials] == ["failed", "failed", "good"]
    assert summary.trials[0].attention.reasons[0].startswith("the record of its fill is damaged")
    assert files.problems == ()
    assert "c\\udcff.c3d" in files.trials.read_text("utf-8")


def test_a_summary_replaces_a_summary_only(tmp_path: Path) -> None:
    page = tmp_path / "summary.html"
    write_summary([], page)
    check_summary(page)
    write_summary([outcome("a.c3d")], page)
    assert "1 trial:" in page.read_text("utf-8")
    page.write_text("my notes\n", encoding="utf-8")
    with pytest.raises(OutputError, match=r"summary\.html"):
        check_summary(page)
    write_summary([], page, overwrite=True)
    (tmp_path / "summary.csv").write_text("Frame,LASI\n", encoding="utf-8")  # a recording
    for overwrite in (False, True):
        with pytest.raises(OutputError, match=r"summary\.csv: exists already, and is not of a"):
            write_summary([outcome("a.c3d")], page, overwrite=overwrite)
    assert (tmp_path / "summary.csv").read_text("utf-8") == "Frame,LASI\n"
    assert "0 trials" in page.read_text("utf-8")


def test_a_table_that_cannot_be_written_does_not_keep_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(summary_files, "write_marker_table", full)
    _, files = write_summary([outcome("a.c3d")], tmp_path / "summary.html")
    assert [file.exists() for file in files.all] == [True, True, False, True]
    (problem,) = files.problems
    assert "summary_markers.csv: cannot be written (No space left on device)" in problem
    monkeypatch.setattr(summary_files, "summary_page", full)
    with pytest.raises(OutputError, match=r"summary\.html"):
        write_summary([], tmp_path / "summary.html")
    assert "1 trial:" in files.page.read_text("utf-8")
