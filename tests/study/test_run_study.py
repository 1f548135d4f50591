"""Studies: what is filled, what is not filled twice, and what is never replaced.

The fills themselves are replaced by a function that writes a file, as fast as can be, and files
are surveyed in this process.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from priorfill import formats
from priorfill.database import PriorDatabase
from priorfill.errors import OptionError, OutputError, StudyError
from priorfill.filling.gap_filter import GapFilter
from priorfill.study import local_executor, run_study, survey_files
from priorfill.study.job import JobOutcome, StudyJob
from priorfill.study.records import file_hash, write_record
from priorfill.study.run_study import Study, batch, sum_up_study
from priorfill.study.study_options import StudyOptions, StudyProgress
from priorfill.study.survey import Survey
from priorfill.synthetic import synthesise

Fills = list[str]


@pytest.fixture
def fills(here: Path, monkeypatch: pytest.MonkeyPatch) -> Fills:
    """The names of the jobs that were run, in a folder with three files."""
    for name in ("P01/a", "P01/b", "P02/a"):
        write(f"in/{name}.c3d", name)
    done: Fills = []

    def run(job: StudyJob, **_: Any) -> JobOutcome:
        done.append(job.name)
        text = Path(job.source).read_text(encoding="utf-8")
        if text.startswith("bad"):
            outcome = JobOutcome.of_failure(job, text, try_again="again" in text)
            outcome = replace(outcome, exceeded="seconds" if "slow" in text else "", seconds=60.0)
        else:
            write(job.output, f"filled {text}")
            written = {job.output: file_hash(job.output)}
            outcome = JobOutcome(
                job.name, job.source, job.output, "filled", written=written, key=job.key
            )
        write_record(job.record, outcome)
        return outcome

    monkeypatch.setattr(local_executor, "run_child", run)
    monkeypatch.setattr(survey_files, "_survey_part", survey_here)
    return done


def survey_here(
    files: list[tuple[str, str]], reading: dict[str, Any], kept: Path | None, *_: Any
) -> Iterator[Survey]:
    """Survey files without a child, which takes half a second to start."""
    request = {"files": files, "reading": reading, "kept": kept and str(kept)}
    return survey_files.surveys_of(request)


def write(path: str, text: str) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text, encoding="utf-8", newline="\n")


def run(fills: Fills, *, output: str = "out", **arguments: Any) -> tuple[Study, Fills]:
    """The study, and the jobs that were run for it."""
    fills.clear()
    options = {name: arguments.pop(name) for name in list(arguments) if hasattr(StudyOptions, name)}
    arguments.setdefault("method", "linear")  # which needs no survey
    study = batch("in", output, study=StudyOptions(**{"workers": 1} | options), **arguments)
    return study, sorted(fills)


ALL = ["P01/a.c3d", "P01/b.c3d", "P02/a.c3d"]


def test_nothing_is_done_twice(fills: Fills) -> None:
    study, done = run(fills)
    assert done == ALL
    assert study.status == "all"
    assert Path("out/P02/a.c3d").read_text(encoding="utf-8") == "filled P02/a"
    assert study.summary == Path("out/summary.html").absolute()
    study, done = run(fills)
    assert (done, study.done_before, study.status) == ([], 3, "all")
    shutil.move("out", "elsewhere")
    shutil.move("in", "sources")
    shutil.copytree("sources", "in")
    assert run(fills, output="elsewhere")[1] == []


def test_what_decides_the_outcome_is_part_of_the_key(fills: Fills) -> None:
    run(fills)
    write("in/P01/b.c3d", "another")
    assert run(fills)[1] == ["P01/b.c3d"]
    assert run(fills, gap_filter=GapFilter(max_gap=0.5))[1] == ALL
    assert run(fills, gap_filter=GapFilter(max_gap=0.5), workers=2, time_limit=7.0)[1] == []
    with PriorDatabase.create("lab") as database:
        database.add(synthesise("walking", seconds=2.0, rate=60.0))
    assert run(fills, database="lab")[1] == ALL
    assert run(fills, database="lab")[1] == []
    with PriorDatabase.open("lab", write=True) as database:
        database.add(synthesise("walking", seconds=2.0, rate=60.0, seed=9))
    assert run(fills, database="lab")[1] == ALL


def test_files_that_are_gone_are_written_again(fills: Fills) -> None:
    run(fills)
    Path("out/P01/a.c3d").unlink()
    Path("out/.priorfill/records/P01/b.c3d.json").write_bytes(b"{")
    Path("out/P01/b.c3d").unlink()
    assert run(fills)[1] == ["P01/a.c3d", "P01/b.c3d"]


def test_a_file_changed_by_hand_stays(fills: Fills) -> None:
    run(fills)
    write("out/P01/a.c3d", "by hand")
    study, done = run(fills)
    assert done == []
    assert study.status == "all"
    assert study.outcomes[0].warnings[0].startswith("a.c3d was changed after the fill")
    write("in/P01/a.c3d", "another")
    study, done = run(fills)
    assert done == []
    assert study.status == "some"
    assert (
        "was changed after the fill; move it away, or use `overwrite`" in study.outcomes[0].reason
    )
    assert Path("out/P01/a.c3d").read_text(encoding="utf-8") == "by hand"
    study, done = run(fills, overwrite=True)
    assert done == ["P01/a.c3d"]
    assert run(fills)[1] == []


def test_a_file_of_somebody_else_stays(fills: Fills) -> None:
    write("out/P02/a.c3d", "not ours")
    study, done = run(fills)
    assert done == ["P01/a.c3d", "P01/b.c3d"]
    assert "exists already, and this study has no record of it" in study.outcomes[2].reason
    assert Path("out/P02/a.c3d").read_text(encoding="utf-8") == "not ours"
    assert run(fills, overwrite=True)[1] == ["P02/a.c3d"]


@pytest.mark.parametrize(
    ("text", "retried"),
    [
        ("bad file", {"retry": True}),
        ("bad file, slow", {"time_limit": 61.0}),
        ("bad file, again", {}),
    ],
)
def test_failures_are_kept(fills: Fills, text: str, retried: dict[str, Any]) -> None:
    write("in/P01/b.c3d", text)
    study, _ = run(fills, time_limit=60.0)
    assert (study.status, study.outcomes[1].reason) == ("some", text)
    if retried:
        study, done = run(fills, time_limit=60.0)
        assert (done, study.status, study.done_before) == ([], "some", 2)
    assert run(fills, **{"time_limit": 60.0} | retried)[1] == ["P01/b.c3d"]


def test_an_interrupted_study_is_summed_up_and_continued(
    fills: Fills, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(at: StudyProgress) -> None:
        if at.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="interrupted with 2 of 3 files done"):
        run(fills, progress=interrupt)
    summary = json.loads(Path("out/summary.json").read_text(encoding="utf-8"))
    assert len(summary["trials"]) == 2
    with monkeypatch.context() as patched:
        patched.setattr(run_study.JobKeys, "with_keys", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt, match="interrupted; the same command continues"):
            run(fills)
    assert json.loads(Path("out/summary.json").read_text(encoding="utf-8")) == summary
    assert len(run(fills)[1]) == 1


def test_tasks_of_an_array_do_all_of_it(fills: Fills) -> None:
    assert run(fills, index=1, of=2)[1] == ["P01/a.c3d", "P02/a.c3d"]
    study, done = run(fills, index=2, of=2)
    assert done == ["P01/b.c3d"]
    assert study.summary is None
    study, done = run(fills)
    assert (done, len(study.outcomes), study.summary is None) == ([], 3, False)
    study, done = run(fills, index=4, of=4)  # more tasks than files
    assert (done, study.outcomes, study.status) == ([], (), "all")


def test_a_check_writes_nothing(fills: Fills) -> None:
    study, done = run(fills, check_only=True)
    assert (done, study.waiting, study.outcomes) == ([], tuple(ALL), ())
    assert not Path("out").exists()


def test_the_summary_is_written_again(fills: Fills) -> None:
    run(fills)
    Path("out/summary.html").unlink()
    records = Path("out/.priorfill/records")
    (records / "foreign.c3d.json").write_bytes((records / f"{ALL[0]}.json").read_bytes())
    study = sum_up_study("out", StudyOptions(summary="other.html"))
    assert [one.name for one in study.outcomes] == ALL
    assert Path("other.html").exists()
    with pytest.raises(OptionError, match="holds no filled files of a study"):
        sum_up_study("in", StudyOptions())


def test_all_problems_are_named_before_the_first_fill(fills: Fills) -> None:
    write("file", "")
    with pytest.raises(StudyError, match="and 2 more problems") as caught:
        batch(["in", "nowhere"], "file", database="nothing", study=StudyOptions())
    texts = [str(problem) for problem in caught.value.problems]
    for name, reason in (
        ("nowhere", "there is no such file or folder"),
        ("file", "is a file; give a folder"),
        ("nothing", "make one with"),
    ):
        assert any(f"{name}: " in text and reason in text for text in texts), texts
    assert fills == []


@pytest.mark.parametrize(
    "options",
    [
        {"workers": 0},
        {"time_limit": 0.0},
        {"memory_limit": 0},
        {"index": 1},
        {"index": 3, "of": 2},
        {"index": 1, "of": 2, "grow": True},
        {"cluster": "local", "scheduler": "tcp://127.0.0.1:8786"},
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        StudyOptions(**options)


def test_two_sources_cannot_have_one_output(fills: Fills, monkeypatch: pytest.MonkeyPatch) -> None:
    write("in/P01/A.c3d", "capital")
    if len(list(Path("in/P01").iterdir())) == 2:
        pytest.skip("the file system does not tell upper from lower case")
    monkeypatch.setattr("priorfill.study.study_plan.is_same_file", lambda path, other: True)
    with pytest.raises(StudyError, match="would have one output"):
        run(fills)


def test_an_output_is_no_other_file_of_the_study(fills: Fills) -> None:
    page = "out/P01/a.c3d.html"
    run(fills, check_only=True, summary=page)
    with pytest.raises(StudyError, match="would be a file of the summary; give"):
        run(fills, summary=page, report=True)
    formats.write("in/P01/a.c3d.uncertainty.npz", synthesise("walking", seconds=0.1))
    run(fills, check_only=True)
    with pytest.raises(StudyError, match=r"would have one output, .*a\.c3d\.uncertainty\.npz"):
        run(fills, uncertainty=True)


@pytest.mark.skipif(os.name == "nt", reason="names may be longer there than on most other drives")
def test_a_name_that_is_too_long_costs_itself(fills: Fills) -> None:
    write(f"in/{'l' * 240}.c3d", "long")
    study, done = run(fills, uncertainty=True)
    assert done == ALL
    assert study.outcomes[3].reason.endswith("File name too long; choose a shorter name")


def test_an_output_that_cannot_be_written_is_known_before_the_first_fill(fills: Fills) -> None:
    Path("out/P01/b.c3d").mkdir(parents=True)
    study, _ = run(fills, check_only=True, overwrite=True)
    assert "is a folder; give the name of a file" in study.outcomes[0].reason
    assert run(fills, overwrite=True)[1] == ["P01/a.c3d", "P02/a.c3d"]


def test_what_ends_a_study_leaves_a_summary(fills: Fills, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: object, outcomes: object) -> None:
        raise OutputError("lab: is full; free some space")

    monkeypatch.setattr("priorfill.study.study_rounds.StudyRounds.learn", fail)
    with pytest.raises(OutputError, match="lab: is full"):
        run(fills)
    assert Path("out/summary.html").exists()
