"""Which other recordings of a study a file is filled from: those of its subject and session.

Markers stay where they are attached for a session, so its other recordings show where a marker is
on this very body, also one that the file lacks throughout. They are found by folder, by the name of
the subject, and by the measures of the body.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath

from priorfill.markers.body_measures import compare_measures
from priorfill.study.survey import Survey, SurveyedSubject

__all__ = ["is_static", "same_session_sources"]

MAX_SOURCES = 8
"""Recordings that a file is filled from besides a static trial. Of 1, 2, 4, 8 and 16 short ones,
dropouts profit from all, limbs from the first two, which are chosen alike in speed: limbs are then
filled with 23 mm instead of 29 mm by any one recording. Each takes 0.1 to 0.3 CPU seconds."""

MAX_SESSION_DIFFERENCE = 7.0
"""mm. Largest median difference of the body measures within a session. In 17 pairs of real
recordings of one session it is at most 4.3 mm; in 329 pairs of different people at least 9.4 mm.
Markers that are attached anew, after which a recording would mislead, differ by 10 to 14 mm."""

STATIC_SPEED = 25.0
"""mm/s. Largest median speed of the markers of a static trial. Quiet standing sways at about
10 mm/s; a slow movement of one arm leaves the other markers as quiet, and does no harm."""

STATIC_NAMES = ("static", "stand", "cal", "tpose", "t-pose", "t_pose", "apose", "a-pose", "neutral")
"""Parts of the names of static trials; they decide among several only."""

MAX_SAMPLES = 10_000_000
"""Samples of all sources of a file together, which take 0.3 GB: half an hour of 50 markers at
120 Hz. Longer recordings are passed over."""

MIN_COMMON_MARKERS = 3
"""Markers that two recordings must share: three define where a fourth is."""

MAX_CANDIDATES = 100
"""Recordings of a folder that are compared with a file: those next to it by name, which were
recorded at about the same time."""


def same_session_sources(surveys: Iterable[Survey]) -> dict[str, tuple[str, ...]]:
    """Return the recordings of the same subject and session that each file is to be filled from.

    Parameters
    ----------
    surveys : iterable of Survey
        Of all files of the study.

    Returns
    -------
    dict of str to tuple of str
        By the name of the job, the paths of its sources: a static trial first, if there is one. A
        file without gaps, or one that cannot be read, has none.
    """
    sessions: dict[str, list[Survey]] = {}
    for survey in sorted(surveys, key=lambda survey: survey.name):
        if survey.subjects:
            sessions.setdefault(survey.session, []).append(survey)
    return {
        target.name: _choose(target, place, session) if target.missing else ()
        for session in sessions.values()
        for place, target in enumerate(session)
    }


def is_static(survey: Survey) -> bool:
    """Return whether a recording shows subjects that stand still.

    Parameters
    ----------
    survey : Survey
        Its facts.
    """
    return bool(survey.subjects) and all(one.speed <= STATIC_SPEED for one in survey.subjects)


def _choose(target: Survey, place: int, session: Sequence[Survey]) -> tuple[str, ...]:
    """Return the sources of a file, which has a place in its session."""
    near = slice(max(0, place - MAX_CANDIDATES // 2), place + MAX_CANDIDATES // 2 + 1)
    nearby = {one.name: one for one in (*session[near], *filter(is_static, session))}
    statics = sorted((one for one in nearby.values() if is_static(one)), key=_static_rank)
    others = sorted(
        (one for one in nearby.values() if not is_static(one)),
        key=lambda other: (*_rank(target, other), other.name),
    )
    chosen: list[Survey] = []
    for candidates, count in ((statics[:MAX_CANDIDATES], 1), (others, MAX_SOURCES)):
        chosen += _first(target, candidates, count, MAX_SAMPLES - _samples(*chosen))
    return tuple(one.source for one in chosen)


def _first(target: Survey, candidates: Iterable[Survey], count: int, samples: int) -> list[Survey]:
    """Return the first candidates that are of the target's session."""
    chosen: list[Survey] = []
    for other in candidates:
        if len(chosen) == count:
            break
        if _samples(other, *chosen) <= samples and _fits(target, other):
            chosen.append(other)
    return chosen


def _samples(*surveys: Survey) -> int:
    return sum(one.samples for survey in surveys for one in survey.subjects)


def _static_rank(survey: Survey) -> tuple[float, bool, float, str]:
    """Return what orders static trials: complete ones first, then those that are called so."""
    name = PurePosixPath(survey.name).stem.casefold()
    named = any(part in name for part in STATIC_NAMES)
    return round(survey.missing_share, 2), not named, -_seconds(survey), survey.name


def _rank(target: Survey, other: Survey) -> tuple[int, float]:
    """Return what orders other recordings: those with the absent markers, and alike in speed."""
    absent = {label for one in target.subjects for label in one.absent}
    there = {label for one in other.subjects for label in one.labels}
    speed, speed_there = (max(one.speed for one in s.subjects) for s in (target, other))
    apart = abs(math.log(max(speed_there, 1.0) / max(speed, 1.0)))
    return -len(absent & there), round(apart, 2)


def _seconds(survey: Survey) -> float:
    return max(one.seconds for one in survey.subjects)


def _fits(target: Survey, other: Survey) -> bool:
    """Return whether a file may learn from another as from one of its own subjects."""
    if other.name == target.name or other.content == target.content:
        return False
    if PurePosixPath(other.name).stem.casefold() == PurePosixPath(target.name).stem.casefold():
        return False  # the same recording in another format
    if len(target.subjects) == 1:
        return len(other.subjects) == 1 and _is_same(target.subjects[0], other.subjects[0])
    own = {one.name_in_file: one for one in target.subjects}
    pairs = [(own[one.name_in_file], one) for one in other.subjects if one.name_in_file in own]
    return bool(pairs) and all(_is_same(here, there) for here, there in pairs)


def _is_same(here: SurveyedSubject, there: SurveyedSubject) -> bool:
    """Return whether two recordings of a folder show one subject, with the same markers."""
    if here.clip == there.clip:  # a copy
        return False
    if here.subject and there.subject and here.subject.casefold() != there.subject.casefold():
        return False
    common = set(here.labels) & set(there.labels)
    if len(common) < MIN_COMMON_MARKERS:
        return False
    difference = compare_measures(here.body, there.body).difference
    if math.isnan(difference):  # too few measures to compare, so the name decides
        return bool(here.subject and there.subject)
    return difference <= MAX_SESSION_DIFFERENCE
