"""Which other recordings of a study a file is filled from."""

from __future__ import annotations

from dataclasses import replace

from priorfill.study.same_session import MAX_SAMPLES, MAX_SOURCES, same_session_sources
from priorfill.study.survey import Survey, SurveyedSubject

LABELS = tuple(f"M{number}" for number in range(8))
BODY = {f"M{number}\nM{number + 1}": 200.0 + number for number in range(7)}


def shown(subject: str = "anna", **changes: object) -> SurveyedSubject:
    one = SurveyedSubject(subject, subject, LABELS, (), 300, 100.0, 10, speed=900.0, body=BODY)
    return replace(one, **changes)  # type: ignore[arg-type]


def survey(name: str, *subjects: SurveyedSubject) -> Survey:
    found = tuple(one if one.clip else replace(one, clip=name) for one in subjects or (shown(),))
    return Survey(name, f"/in/{name}", f"hash of {name}", found)


def sources(*surveys: Survey) -> dict[str, tuple[str, ...]]:
    """Names of the sources of each file."""
    found = same_session_sources(surveys)
    return {name: tuple(path.removeprefix("/in/") for path in found[name]) for name in found}


def test_recordings_of_one_folder_and_subject_are_sources() -> None:
    found = sources(
        survey("day1/walk.c3d"),
        survey("day1/run.c3d"),
        survey("day2/walk.c3d"),
        survey("day1/bert.c3d", shown("bert")),
        survey("day1/unnamed.c3d", shown("")),
    )
    assert found["day1/walk.c3d"] == ("day1/run.c3d", "day1/unnamed.c3d")
    assert found["day2/walk.c3d"] == ()
    assert found["day1/bert.c3d"] == ("day1/unnamed.c3d",)


def test_another_body_is_no_source() -> None:
    taller = shown("", body={name: length + 12.0 for name, length in BODY.items()})
    found = sources(survey("walk.c3d", shown("")), survey("run.c3d", taller))
    assert found == {"walk.c3d": (), "run.c3d": ()}


def test_too_few_measures_need_a_name() -> None:
    few = {"body": dict(list(BODY.items())[:2])}
    for name, expected in (("anna", ("run.c3d",)), ("", ())):
        found = sources(survey("walk.c3d", shown(name)), survey("run.c3d", shown(name, **few)))
        assert found["walk.c3d"] == expected


def test_other_markers_are_no_source() -> None:
    other = shown(labels=("A", "B", "C"), body={})
    assert sources(survey("walk.c3d"), survey("run.c3d", other))["walk.c3d"] == ()


def test_the_same_recording_is_no_source() -> None:
    copy = survey("copy.c3d", shown(clip="walk.c3d"))
    same_bytes = replace(survey("bytes.c3d"), content="hash of walk.c3d")
    assert sources(survey("walk.c3d"), survey("walk.trc"), copy, same_bytes)["walk.c3d"] == ()


def test_files_without_gaps_have_no_sources_and_unreadable_ones_are_left_out() -> None:
    broken = Survey("broken.c3d", "/in/broken.c3d", "", reason="damaged")
    whole = survey("whole.c3d", shown(missing=0))
    assert sources(survey("walk.c3d"), whole, broken) == {
        "walk.c3d": ("whole.c3d",),
        "whole.c3d": (),
    }


def test_the_static_trial_comes_first_and_markers_before_speed() -> None:
    target = survey("a.c3d", shown(labels=LABELS[1:], absent=LABELS[:1], speed=1000.0))
    others = [survey(f"b{n}.c3d", shown(labels=LABELS[1:], speed=1000.0 + n)) for n in range(9)]
    has_marker = survey("z.c3d", shown(speed=4000.0))
    still = [survey(f"y{n}.c3d", shown(speed=5.0)) for n in range(2)]
    static = survey("z_static.c3d", shown(speed=6.0))
    found = sources(target, *others, has_marker, *still, static)["a.c3d"]
    assert found[:2] == ("z_static.c3d", "z.c3d")
    assert len(found) == MAX_SOURCES + 1
    assert sources(*reversed([target, *others, has_marker, *still, static]))["a.c3d"] == found


def test_recordings_that_are_too_long_together_are_passed_over() -> None:
    half = MAX_SAMPLES // len(LABELS) // 2
    long = [survey(f"b{number}.c3d", shown(frames=half)) for number in range(4)]
    short = survey("c.c3d", shown(frames=1))
    assert sources(survey("a.c3d"), *long, short)["a.c3d"] == ("b0.c3d", "b1.c3d")
    whole = survey("a.c3d", shown(frames=2 * half))
    assert sources(survey("z.c3d"), whole, short)["z.c3d"] == ("a.c3d",)


def test_each_of_two_subjects_must_be_the_same() -> None:
    two = (shown("anna"), shown("bert"))
    other = (shown("anna"), shown("bert", body=dict.fromkeys(BODY, 300.0)))
    found = sources(
        survey("a.c3d", *two),
        survey("b.c3d", *two),
        survey("c.c3d", *other),
        survey("d.c3d", shown("anna")),
        survey("e.c3d", shown("carl")),
    )
    assert found["a.c3d"] == ("b.c3d", "d.c3d")
    assert found["d.c3d"] == ()  # a file of two subjects is not read for one
