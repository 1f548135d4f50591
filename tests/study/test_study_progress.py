"""How far a study is."""

from __future__ import annotations

import pytest

from priorfill.study import study_progress
from priorfill.study.job import JobOutcome, Status
from priorfill.study.study_options import StudyProgress
from priorfill.study.study_progress import ProgressOfJobs, estimated_work
from priorfill.study.survey import Survey, SurveyedSubject


def outcome(name: str, status: Status = "filled") -> JobOutcome:
    return JobOutcome(name, f"/in/{name}", f"/out/{name}", status)


def test_time_left_follows_from_the_work_of_this_run(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(study_progress.time, "monotonic", lambda: now[0])
    seen: list[StudyProgress] = []
    progress = ProgressOfJobs({"a": 60.0, "b": 10.0, "c": 20.0, "d": 10.0}, seen.append)
    progress.settled([outcome("a")])
    now[0] += 5.0
    progress.filled(outcome("b", "failed"))
    now[0] += 10.0
    progress.filled(outcome("c"))
    progress.filled(outcome("d"))
    assert [(one.done, one.failed, one.total) for one in seen] == [
        (1, 0, 4),
        (2, 1, 4),
        (3, 1, 4),
        (4, 1, 4),
    ]
    assert [one.share for one in seen] == [0.6, 0.7, 0.9, 1.0]
    assert [one.seconds_left for one in seen] == [None, 15.0, 5.0, 0.0]


def test_files_without_gaps_are_little_work() -> None:
    def survey(missing: int) -> Survey:
        one = SurveyedSubject("", "", ("a", "b"), (), 500, 100.0, missing, 1.0, 0.0, 0.0, {}, "")
        return Survey("a.c3d", "/in/a.c3d", "", (one,))

    assert estimated_work(survey(0)) == 50.0
    assert estimated_work(survey(100)) == 1500.0
    assert estimated_work(Survey("a.c3d", "/in/a.c3d", "", reason="bad")) == 1.0
