"""Survey of a study: the facts of each recording that decide how it is filled, and in which order.

A survey reads files but fills nothing. It is JSON, so that a child process can find it and a study
can keep it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from priorfill.clip import Clip

__all__ = ["Survey", "SurveyedSubject", "session_of", "survey_clips", "survey_file"]

STEP_SECONDS = 0.1
"""s. Time over which a marker's motion is measured: jitter of a standing marker hardly counts."""

MIN_SEEN_SHARE = 0.05
"""Share of the frames that must show a marker for the recording to count as having it."""

_NUMBERS = ("frames", "rate", "missing", "longest_gap", "all_missing", "speed")


@dataclass(frozen=True)
class SurveyedSubject:
    """What a recording shows of one subject.

    Attributes
    ----------
    subject : str
        Name of the subject according to the file; empty if it is no name.
    name_in_file : str
        The same as the file has it.
    labels : tuple of str
        Markers that are seen in the recording.
    absent : tuple of str
        Markers that are hardly seen, or not at all.
    frames : int
        Number of frames.
    rate : float
        Frames per second (Hz).
    missing : int
        Number of missing samples.
    longest_gap : float
        Longest gap of a marker (s).
    all_missing : float
        Time (s) in which no marker is seen.
    speed : float
        Median speed of the markers (mm/s); 0 where nothing is seen to move.
    body : mapping of str to float
        Body measures (`priorfill.markers.body_measures`).
    clip : str
        Hash of labels, rate and positions, which two files with the same motion share.
    """

    subject: str
    name_in_file: str
    labels: tuple[str, ...]
    absent: tuple[str, ...] = ()
    frames: int = 0
    rate: float = 0.0
    missing: int = 0
    longest_gap: float = 0.0
    all_missing: float = 0.0
    speed: float = 0.0
    body: Mapping[str, float] = field(default_factory=dict)
    clip: str = ""

    @property
    def samples(self) -> int:
        """Number of samples, missing ones included."""
        return self.frames * (len(self.labels) + len(self.absent))

    @property
    def seconds(self) -> float:
        """Length of the recording (s)."""
        return self.frames / self.rate if self.rate > 0.0 else 0.0


@dataclass(frozen=True)
class Survey:
    """The facts of one file of a study.

    Attributes
    ----------
    name : str
        Name of its job: the path within the study, with ``/``.
    source : str
        Absolute path of the file.
    content : str
        SHA-256 of its bytes; empty if they cannot be read.
    subjects : tuple of SurveyedSubject
        What it shows; empty if it cannot be read.
    reason : str
        Why it cannot be read, in one line; else empty.

    Examples
    --------
    >>> survey = Survey("P01/walk.c3d", "/in/P01/walk.c3d", "", reason="no markers")
    >>> survey.session, Survey.from_json(survey.to_json()) == survey
    ('P01', True)
    """

    name: str
    source: str
    content: str
    subjects: tuple[SurveyedSubject, ...] = ()
    reason: str = ""

    @property
    def session(self) -> str:
        """The folder within the study; recordings of one session are in one folder."""
        return session_of(self.name)

    @property
    def missing(self) -> int:
        """Number of missing samples of all subjects."""
        return sum(one.missing for one in self.subjects)

    @property
    def missing_share(self) -> float:
        """Share of the samples that is missing."""
        return self.missing / max(sum(one.samples for one in self.subjects), 1)

    def to_json(self) -> dict[str, Any]:
        """Return the survey as JSON values."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Survey:
        """Return the survey of `to_json`."""
        subjects = tuple(map(_subject_of, values["subjects"]))
        return cls(values["name"], values["source"], values["content"], subjects, values["reason"])


def _subject_of(values: Mapping[str, Any]) -> SurveyedSubject:
    """Return the subject of JSON values; TypeError if they are damaged."""
    tuples = {name: tuple(values[name]) for name in ("labels", "absent")}
    subject = SurveyedSubject(**{**values, **tuples})
    texts = (subject.subject, subject.name_in_file, subject.clip, *subject.labels, *subject.absent)
    numbers = [getattr(subject, name) for name in _NUMBERS] + [*dict(subject.body).values()]
    if not all(isinstance(one, str) for one in texts):
        raise TypeError("labels and names are texts")
    if not all(isinstance(one, int | float) for one in numbers):
        raise TypeError("counts, times and measures are numbers")
    return subject


def session_of(name: str) -> str:
    """Return the session of a job: the folder that its name has; empty where it has none.

    Parameters
    ----------
    name : str
        The name.
    """
    parent = str(PurePosixPath(name).parent)
    return "" if parent == "." else parent


def survey_file(
    name: str,
    source: Path,
    reading: Mapping[str, Any],
    known: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
) -> Survey:
    """Return the facts of a file; one that cannot be read has the reason.

    Parameters
    ----------
    name : str
        Name of its job.
    source : Path
        The file.
    reading : mapping of str to object
        Keyword arguments of `priorfill.read`.
    known : mapping of str to object, optional
        Facts of the subjects of files, as JSON values by content. Such a file is only hashed.
    """
    from priorfill.filling.multi_subject import read_subjects
    from priorfill.runtime.error_line import error_line
    from priorfill.study.records import contents_hash

    content = ""
    try:
        content = contents_hash(source)
        with suppress(LookupError, TypeError):  # what is kept may be damaged
            subjects = (known or {})[content]
            return Survey(name, str(source), content, tuple(map(_subject_of, subjects)))
        clips = read_subjects(source, **reading)
        return Survey(name, str(source), content, survey_clips(clips))
    except Exception as error:  # a file that triggers a bug of a parser costs itself only
        return Survey(name, str(source), content, reason=error_line(error))


def survey_clips(clips: tuple[Clip, ...]) -> tuple[SurveyedSubject, ...]:
    """Return the facts of the clips of a file, one for each subject.

    Parameters
    ----------
    clips : tuple of Clip
        As `priorfill.read_subjects` returns them.
    """
    return tuple(_survey_clip(clip) for clip in clips)


def _survey_clip(clip: Clip) -> SurveyedSubject:
    """Return the facts of a clip."""
    from priorfill.database.content_hash import content_hash
    from priorfill.database.subject_names import subject_name
    from priorfill.gaps import find_gaps
    from priorfill.markers.body_measures import body_measures

    missing = clip.missing
    seen = (~missing).sum(axis=0) > MIN_SEEN_SHARE * clip.frames
    gaps = find_gaps(missing)
    return SurveyedSubject(
        subject=subject_name(clip.subject),
        name_in_file=clip.subject,
        labels=tuple(label for label, is_seen in zip(clip.labels, seen, strict=True) if is_seen),
        absent=tuple(
            label for label, is_seen in zip(clip.labels, seen, strict=True) if not is_seen
        ),
        frames=clip.frames,
        rate=clip.rate,
        missing=int(missing.sum()),
        longest_gap=max((gap.frames for gap in gaps), default=0) / clip.rate,
        all_missing=int(missing.all(axis=1).sum()) / clip.rate,
        speed=round(_median_speed(clip), 1),
        body=body_measures(clip.positions, clip.labels),
        clip=content_hash(clip),
    )


def _median_speed(clip: Clip) -> float:
    """Return the median speed of the markers over short steps (mm/s)."""
    step = max(1, round(STEP_SECONDS * clip.rate))
    moved = np.linalg.norm(clip.positions[step::step] - clip.positions[:-step:step], axis=2)
    known = moved[~np.isnan(moved)]
    return float(np.median(known)) * clip.rate / step if len(known) else 0.0
