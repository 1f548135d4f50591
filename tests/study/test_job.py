"""Jobs and outcomes as JSON."""

from __future__ import annotations

import json
import math

import pytest

from priorfill.study.job import JobOutcome, StudyJob


def test_a_job_survives_json() -> None:
    job = StudyJob(
        "a/b.c3d",
        "/in/a/b.c3d",
        "/out/a/b.c3d",
        "/out/b.json",
        {"method": "auto", "max_gap": None},
        same_subject=("/in/a/static.c3d",),
    )
    text = json.dumps(job.to_json() | {"of_a_later_version": 1})
    assert StudyJob.from_json(json.loads(text)) == job


def test_an_outcome_survives_json() -> None:
    outcome = JobOutcome(
        "a.c3d",
        "/in/a.c3d",
        "/out/a.c3d",
        "incomplete",
        facts={"gaps": []},
        warnings=("look",),
        written={"/out/a.c3d": "00"},
    )
    text = json.dumps(outcome.to_json() | {"of_a_later_version": 1})
    assert JobOutcome.from_json(json.loads(text)) == outcome


def test_a_reason_is_one_line_without_control_characters() -> None:
    job = StudyJob("a.c3d", "/in/a.c3d", "/out/a.c3d", "/out/a.json")
    reason = "x\x1b[31m\udcff\n  is gone"
    assert JobOutcome.of_failure(job, reason).reason == "x\\x1b[31m\\udcff is gone"


@pytest.mark.parametrize(
    "damage",
    [
        {"name": None},
        {"status": []},
        {"status": "done"},
        {"output": 3},
        {"report": {}},
        {"warnings": [None]},
        {"written": {"/out/a.c3d": None}},
        {"written": ["/out/a.c3d"]},
        {"facts": "none"},
        {"seconds": math.nan},
        {"peak_memory": 10**400},
    ],
)
def test_values_that_are_no_outcome_are_refused(damage: dict[str, object]) -> None:
    outcome = JobOutcome("a.c3d", "/in/a.c3d", "/out/a.c3d", "filled")
    with pytest.raises((ValueError, TypeError, AttributeError)):
        JobOutcome.from_json(outcome.to_json() | damage)
