"""The database of a study grows in rounds, and an interruption changes nothing."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gappy import FOOT, person, with_gaps

import priorfill as pf
from priorfill.database import PriorDatabase
from priorfill.database.manifest import read_manifest
from priorfill.errors import DatabaseError
from priorfill.filling.gap_filter import GapFilter
from priorfill.study import growth, run_study, study_rounds
from priorfill.study.add_outcomes import (
    MAX_ADDED_ERROR,
    MAX_TRUSTED_ERROR,
    add_outcome,
    reason_not_to_add,
)
from priorfill.study.fill_job import fill_job
from priorfill.study.growth_plan import MIN_FILES, ROUNDS, GrowthPlan, Round, rounds_of
from priorfill.study.job import JobLimits, JobOutcome, StudyJob
from priorfill.study.run_study import Study
from priorfill.study.settings import FillSettings
from priorfill.study.survey import Survey, SurveyedSubject, survey_file

METHOD = "neighbours"
"""Learns from the database, too, and takes a moment."""


def survey(name: str, missing: int = 0) -> Survey:
    subject = SurveyedSubject("", "", ("A",), (), 100, 100.0, missing)
    return Survey(name, f"/in/{name}", f"hash of {name}", (subject,))


def outcome(**facts: Any) -> JobOutcome:
    gap = {"marker": "A", "filled": 3, "expected_mean_error_mm": 5.0, "unfilled": []}
    given = {"gaps": [gap | facts.pop("gap", {})], "artefacts": []} | facts
    return JobOutcome("a.c3d", "/in/a.c3d", "/out/a.c3d", "filled", facts=given)


# --- rounds ---


def test_rounds_begin_with_the_easiest_files() -> None:
    surveys = [survey(f"{n:02}.c3d", missing=(7 * n) % 20) for n in range(20)]
    unreadable = Survey("00_bad.c3d", "/in/00_bad.c3d", "", reason="damaged")
    found = rounds_of([*surveys, unreadable])
    assert len(found) == ROUNDS
    assert {len(one) for one in found} == {5, 6}
    missing = {one.name: one.missing for one in surveys}
    order = [missing[name] for one in found for name in one if name in missing]
    assert order == sorted(order)
    assert found[-1][-1] == "00_bad.c3d"
    assert rounds_of(reversed([*surveys, unreadable])) == found
    assert len(rounds_of(surveys[: 2 * MIN_FILES - 1])) == 1
    assert rounds_of([]) == ()


def test_a_plan_is_kept_and_files_that_come_later_are_rounds_of_their_own(tmp_path: Path) -> None:
    plan = GrowthPlan(tmp_path / "growth.json", {"method": "gpr"})
    plan.include([survey("a.c3d"), survey("b.c3d")])
    plan.rounds[0].state = "1:5"
    plan.save()
    again = GrowthPlan(tmp_path / "growth.json", {"method": "gpr"})
    changed = replace(survey("b.c3d"), content="changed")
    again.include([survey("a.c3d"), changed, survey("c.c3d")])
    assert [(sorted(one.contents), one.state) for one in again.rounds] == [
        (["a.c3d"], "1:5"),
        (["b.c3d", "c.c3d"], ""),
    ]
    assert GrowthPlan(tmp_path / "growth.json", {"method": "linear"}).rounds == []
    for damage in (
        {"contents": None},
        {"contents": {"a.c3d": 1}},
        {"handled": []},
        {"clips": [[]]},
    ):
        again.rounds[0] = Round({}, "1:5")
        vars(again.rounds[0]).update(damage)
        again.save()
        assert GrowthPlan(tmp_path / "growth.json", {"method": "gpr"}).rounds == []
    (tmp_path / "growth.json").write_text("{")
    assert GrowthPlan(tmp_path / "growth.json", {"method": "gpr"}).rounds == []


# --- what is added ---


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (outcome(), ""),
        (outcome(gap={"filled": 0, "expected_mean_error_mm": None}), ""),
        (outcome(artefacts=[{"kind": "spike", "markers": ["A"]}]), ""),
        (outcome(artefacts=[{"kind": "label swap", "markers": ["A", "B"]}]), "A and B seem"),
        (outcome(gap={"expected_mean_error_mm": None}), ""),
        (outcome(gap={"expected_mean_error_mm": MAX_ADDED_ERROR + 1}), "expected error of 101 mm"),
        (outcome(gap={"unfilled": [{"reason": "not believed: below the floor"}]}), "does not fit"),
        (replace(outcome(), status="failed"), "not filled"),
    ],
)
def test_what_is_filled_well_enough(one: JobOutcome, words: str) -> None:
    assert words in reason_not_to_add(one)
    assert bool(words) == bool(reason_not_to_add(one))


def test_filled_samples_that_are_learnt_from_must_be_better() -> None:
    one = outcome(gap={"expected_mean_error_mm": MAX_TRUSTED_ERROR + 1})
    assert reason_not_to_add(one) == ""
    assert "expected error" in reason_not_to_add(one, trust_filled=True)
    unknown = outcome(gap={"expected_mean_error_mm": None})
    assert "unknown" in reason_not_to_add(unknown, trust_filled=True)


def filled(folder: Path, **changes: Any) -> JobOutcome:
    """The outcome of a job with a gap, and one that is left alone."""
    clip = with_gaps(person(), (60, 80, FOOT), (100, 180, ("LKNE",)))
    pf.write(folder / "in.npz", clip)
    settings = FillSettings("linear", GapFilter(max_gap="40f"))
    paths = [str(folder / name) for name in ("in.npz", "out.npz", "record.json")]
    done = fill_job(StudyJob("P01/in.npz", *paths, settings.to_json()))
    return replace(done, **changes)


def test_filled_samples_are_marked_in_the_database(tmp_path: Path) -> None:
    done = filled(tmp_path)
    with PriorDatabase.create(tmp_path / "lab") as database:
        reason, (content,) = add_outcome(database, done, {}, "P01")
        assert reason == ""
        (record,) = database.clips()
        assert (record.content, record.session, record.filled_by) == (content, "P01", "linear")
        mask = database.filled(record)
        assert mask is not None
        assert {record.labels[i] for i in np.flatnonzero(mask.any(axis=0))} == set(FOOT)
        assert add_outcome(database, done, {}) == ("", (content,))  # after an interruption
        assert len(database.clips()) == 1


def test_a_file_that_was_changed_is_not_added(tmp_path: Path) -> None:
    done = filled(tmp_path)
    pf.write(tmp_path / "out.npz", person(seed=8), overwrite=True)
    with PriorDatabase.create(tmp_path / "lab") as database:
        reason, clips = add_outcome(database, done, {})
        assert "changed after the fill" in reason
        (tmp_path / "out.npz").unlink()
        assert "out.npz" in add_outcome(database, done, {})[0]
        assert (clips, database.clips()) == ((), ())


def test_subjects_that_the_output_lacks_are_not_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = filled(tmp_path)
    pair = (replace(person(seed=1), subject="A"), replace(person(seed=2), subject="B"))
    found = iter([pair, pair[:1]])
    monkeypatch.setattr("priorfill.study.add_outcomes.read_subjects", lambda *_, **__: next(found))
    with PriorDatabase.create(tmp_path / "lab") as database:
        reason, clips = add_outcome(database, done, {})
        assert "holds another number of subjects than its source" in reason
        assert (clips, database.clips()) == ((), ())


# --- a study ---


class InThisProcess:
    """An executor that fills in this process, and is interrupted after some jobs."""

    def __init__(self, backwards: bool = False, jobs: int | None = None) -> None:
        self._backwards = backwards
        self._left = jobs

    def __enter__(self) -> InThisProcess:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def run(self, jobs: Sequence[StudyJob]) -> Iterator[JobOutcome]:
        for job in reversed(jobs) if self._backwards else jobs:
            if self._left is not None:
                self._left -= 1
                if self._left < 0:
                    raise KeyboardInterrupt
            yield fill_job(job)


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Files with gaps, and no child processes."""

    def survey_here(
        files: Sequence[tuple[str, str]], reading: Any, kept: Any, limits: JobLimits, **_: Any
    ) -> list[Survey]:
        return [survey_file(name, Path(path), reading) for name, path in files]

    monkeypatch.setattr(study_rounds, "survey_files", survey_here)
    folder = tmp_path / "in"
    long = person(seconds=12.0)
    parts = np.array_split(long.positions, 2 * MIN_FILES)
    for number, positions in enumerate(parts):
        clip = replace(long, positions=positions, name=f"walk {number}")
        pf.write(folder / f"{number}.npz", with_gaps(clip, (30, 35 + 4 * number, ("LKNE",))))
    return folder


def run(
    sources: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    executor: InThisProcess,
    method: str = METHOD,
    **options: Any,
) -> Study:
    monkeypatch.setattr(run_study, "_executor", lambda *_: executor)
    return pf.batch(
        sources,
        folder / "out",
        database=folder / "lab",
        study=pf.StudyOptions(workers=1, grow=True, same_session=False, **options),
        method=method,
    )


def written(folder: Path) -> dict[str, str]:
    """Hashes of the filled files, and what the database holds."""
    found = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in (folder / "out").glob("*.npz")
    }
    with PriorDatabase.open(folder / "lab") as database:
        return found | {record.content: record.name for record in database.clips()}


def test_an_interruption_changes_nothing(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    study = run(sources, whole, monkeypatch, InThisProcess())
    expected = written(whole)
    states = [one.facts["provenance"]["database"]["clips"] for one in study.outcomes]
    assert sorted(map(bool, states)) == [False] * MIN_FILES + [True] * MIN_FILES
    assert len(expected) == 4 * MIN_FILES - len(study.notes)

    adding = growth.add_outcome
    for jobs in (0, MIN_FILES - 1):
        with pytest.raises(KeyboardInterrupt):
            run(sources, parts, monkeypatch, InThisProcess(backwards=True, jobs=jobs))
    with monkeypatch.context() as patch:  # while the outcomes of the first round are added
        calls = iter(range(100))

        def killed(*arguments: Any) -> Any:
            if next(calls) == 2:
                raise KeyboardInterrupt
            return adding(*arguments)

        patch.setattr(growth, "add_outcome", killed)
        with pytest.raises(KeyboardInterrupt):
            run(sources, parts, monkeypatch, InThisProcess())
    with pytest.raises(KeyboardInterrupt):  # in the second round
        run(sources, parts, monkeypatch, InThisProcess(jobs=2))
    run(sources, parts, monkeypatch, InThisProcess(backwards=True))
    assert written(parts) == expected
    for check_only in (True, False):  # nothing is left
        nothing = InThisProcess(jobs=0)
        again = run(sources, parts, monkeypatch, nothing, check_only=check_only)
        assert again.done_before == 2 * MIN_FILES
    assert written(parts) == expected


def test_clips_of_others_and_lost_states_are_noted(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Crowded(InThisProcess):
        def run(self, jobs: Sequence[StudyJob]) -> Iterator[JobOutcome]:
            yield from super().run(jobs)
            with PriorDatabase.open(tmp_path / "lab", write=True) as database:
                database.add(
                    person().with_positions(person().positions + 10.0 * len(database.clips()))
                )

    study = run(sources, tmp_path, monkeypatch, Crowded(), "linear")
    assert any("1 clips were added by others" in note for note in study.notes)
    identity = read_manifest(tmp_path / "lab").identity
    with PriorDatabase.open(tmp_path / "lab", write=True) as database:
        database.remove(database.clips()[:1])
        database.compact()
    assert read_manifest(tmp_path / "lab").identity == identity
    study = run(sources, tmp_path, monkeypatch, InThisProcess(), "linear")
    assert any("begins anew" in note for note in study.notes)
    assert study.status == "all"


def test_a_check_makes_no_database(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = run(sources, tmp_path, monkeypatch, InThisProcess(jobs=0), check_only=True)
    assert len(study.waiting) == 2 * MIN_FILES
    assert not (tmp_path / "lab").exists()
    assert not (tmp_path / "out").exists()


def test_another_writer_is_waited_for(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Locked(InThisProcess):
        def run(self, jobs: Sequence[StudyJob]) -> Iterator[JobOutcome]:
            yield from super().run(jobs)
            held.append(PriorDatabase.open(tmp_path / "lab", write=True))

    held: list[PriorDatabase] = []
    monkeypatch.setattr(growth.time, "sleep", lambda _: held[-1].close())
    study = run(sources, tmp_path, monkeypatch, Locked(), "linear")
    assert study.notes == ()
    assert len(held) == 2
    monkeypatch.setattr(growth, "MAX_WAIT_SECONDS", 0.0)
    monkeypatch.setattr(growth.time, "sleep", lambda _: None)
    (tmp_path / "other").mkdir()
    with PriorDatabase.create(tmp_path / "other" / "lab"):
        pass

    class Kept(InThisProcess):
        def run(self, jobs: Sequence[StudyJob]) -> Iterator[JobOutcome]:
            yield from super().run(jobs)
            held.append(PriorDatabase.open(tmp_path / "other" / "lab", write=True))

    with pytest.raises(DatabaseError, match="same command continues"):
        run(sources, tmp_path / "other", monkeypatch, Kept(), "linear")
    held[-1].close()
