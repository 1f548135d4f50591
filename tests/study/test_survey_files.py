"""Files are surveyed in child processes, and what was found is kept."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from gappy import person

from priorfill import formats
from priorfill.study import survey_files as module
from priorfill.study.job import JobLimits
from priorfill.study.survey import Survey
from priorfill.study.survey_files import survey_files, surveys_of

LIMITS = JobLimits(60.0, 1 << 32, 1)

CHILD = """
import os, sys, time
from priorfill.study.child.parent_connection import ParentConnection
parent = ParentConnection()
for name, source in parent.request["files"]:
    if name == "kills.c3d" or (name == "killed.c3d" and not os.path.exists(source)):
        open(source, "w").close()
        os._exit(9)
    if name == "hangs.c3d":
        time.sleep(60)
    parent.answer({"name": name, "source": source, "content": "x", "subjects": [], "reason": ""})
"""
"""A child whose reader hangs at one file, and is ended by another one, and once at a third."""


@pytest.mark.windows
def test_a_file_that_hangs_or_kills_its_reader_costs_itself_only(tmp_path: Path) -> None:
    names = ["a.c3d", "kills.c3d", "killed.c3d", "hangs.c3d", "b.c3d"]
    files = [(name, str(tmp_path / name)) for name in names]
    # the start of the child counts, and takes seconds on a busy Windows
    seconds = 10.0 if sys.platform == "win32" else 3.0
    limits = replace(LIMITS, seconds=seconds)
    command = [sys.executable, "-c", CHILD]
    found = survey_files(files, {}, tmp_path / "survey.json", limits, command=command)
    assert [one.name for one in found] == names
    assert [bool(one.content) for one in found] == [True, False, True, False, True]
    assert f"was not done after {seconds:g} s" in found[3].reason
    assert not (tmp_path / "survey.json").exists()  # there is nothing to keep


def test_what_was_found_is_kept_by_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    formats.write(tmp_path / "a.npz", person())
    kept = tmp_path / "state" / "survey.json"
    request = {"files": [("a.npz", str(tmp_path / "a.npz"))], "reading": {}, "kept": str(kept)}
    (first,) = surveys_of(request)
    module._keep([first], {}, kept)
    monkeypatch.setattr("priorfill.filling.multi_subject.read", None)  # the file is only hashed
    (again,) = surveys_of(request)
    assert again == first
    assert next(surveys_of(request | {"kept": None})).subjects == ()
    assert next(surveys_of(request | {"reading": {"unit": "m"}})).subjects == ()
    values = json.loads(kept.read_text())
    (content,) = values["files"]
    facts = values["files"][content][0]
    for damaged in ({"subject": "only"}, facts | {"rate": None}, facts | {"labels": [3]}):
        values["files"][content] = [damaged]  # so the file is read
        kept.write_text(json.dumps(values))
        assert next(surveys_of(request)).subjects == ()
    assert isinstance(again, Survey)
