"""Several subjects in one file: each is filled as a clip of its own, and one file is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts import Artefact
from priorfill.clip import Clip, Source
from priorfill.errors import ClipError, MultipleSubjectsError, OptionError
from priorfill.filling.provenance import merge_provenance
from priorfill.filling.result import FilledGap, Result
from priorfill.formats import read
from priorfill.runtime.argument_types import check_path

__all__ = ["assign_same_subject", "merge_artefacts", "merge_results", "read_subjects"]


def read_subjects(
    path: Path | str,
    *,
    zeros_missing: bool = True,
    up: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    ignore_residuals: bool = False,
) -> tuple[Clip, ...]:
    """Read a motion-capture file, one clip for each subject.

    Parameters
    ----------
    path : Path or str
        The file; its suffix determines the format.
    zeros_missing : bool
        Treat samples at exactly (0, 0, 0) as missing.
    up : str or None
        The axis that points up; found if None.
    rate : float or None
        Frame rate (Hz) that replaces the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) that replaces the file's.
    subject : str or None
        Read this subject only.
    ignore_residuals : bool
        Take samples as measured whose residual in the file marks them as missing.

    Returns
    -------
    tuple of Clip
        One clip if the file does not distinguish subjects.

    Raises
    ------
    FormatError
        If the file does not exist, is of unknown format, damaged or truncated.
    ClipError
        If its contents are unusable.
    OptionError
        If an option is out of range.

    See Also
    --------
    priorfill.read : Read one clip.
    priorfill.fill : Fill one clip, or those of all subjects.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pf.write(f"{folder}/walk.npz", make_demo_clip()[1])
    ...     [clip.name for clip in pf.read_subjects(f"{folder}/walk.npz")]
    ['walk']
    """
    check_path("path", path)
    options: dict[str, Any] = {
        "zeros_missing": zeros_missing,
        "up": up,
        "rate": rate,
        "unit": unit,
        "ignore_residuals": ignore_residuals,
    }
    try:
        return (read(path, subject=subject, **options),)
    except MultipleSubjectsError as error:
        return tuple(read(path, subject=name, **options) for name in error.subjects)


def assign_same_subject(
    clips: Sequence[Clip], same_subject: Sequence[Clip]
) -> list[tuple[Clip, ...]]:
    """Return the other recordings of the subject of each clip.

    Parameters
    ----------
    clips : sequence of Clip
        One for each subject of a file.
    same_subject : sequence of Clip
        Other recordings. Those of a single clip need not name the subject.

    Raises
    ------
    OptionError
        Where a recording is of none of several subjects.
    """
    if len(clips) == 1:
        return [tuple(same_subject)]
    subjects = [clip.subject for clip in clips]
    for other in same_subject:
        if other.subject not in subjects:
            name = other.name if other.source is None else str(other.source.path)
            raise OptionError(
                f"{name}: does not state whether it is of {', '.join(subjects)}; fill one of them "
                "at a time (`subject`)"
            )
    return [tuple(o for o in same_subject if o.subject == subject) for subject in subjects]


def merge_results(results: Sequence[Result]) -> Result:
    """Make one result of those of all subjects of a file.

    Parameters
    ----------
    results : sequence of Result
        One for each subject, of clips read from the same file.

    Returns
    -------
    Result
        Its markers and gaps are called ``subject:label``; the marker set is that of the first
        subject. A single result is returned unchanged.

    Raises
    ------
    ClipError
        Where the clips differ in their unit or up axis.
    """
    first = results[0]
    if len(results) == 1:
        return first
    clips = [result.clip for result in results]
    return replace(
        first,
        clip=_merge_clips(clips),
        filled=np.concatenate([result.filled for result in results], axis=1),
        expected_rms_mm=np.concatenate([result.expected_rms_mm for result in results], axis=1),
        error_bound_90_mm=np.concatenate([result.error_bound_90_mm for result in results], axis=1),
        rejected=np.concatenate([result.rejected for result in results], axis=1),
        doubtful=_merge_masks([result.doubtful for result in results], clips),
        swapped=_merge_masks([result.swapped for result in results], clips),
        artefacts=merge_artefacts(
            [clip.subject for clip in clips], [result.artefacts for result in results]
        ),
        gaps=tuple(
            sorted(
                (_named(gap, result.clip.subject) for result in results for gap in result.gaps),
                key=lambda gap: gap.start,
            )
        ),
        method=" and ".join(
            dict.fromkeys(name for result in results for name in result.method.split(" and "))
        ),
        notes=tuple(
            dict.fromkeys(
                f"{result.clip.subject}: {note}" for result in results for note in result.notes
            )
        ),
        provenance=merge_provenance([result.provenance for result in results]),
        subjects=tuple(results),
    )


def merge_artefacts(
    subjects: Sequence[str], artefacts: Sequence[Sequence[Artefact]]
) -> tuple[Artefact, ...]:
    """Return the artefacts of all subjects of a file, in order of time.

    Parameters
    ----------
    subjects : sequence of str
        Their names.
    artefacts : sequence of sequence of Artefact
        Of each subject.

    Returns
    -------
    tuple of Artefact
        Their markers are called ``subject:label``; those of a single subject keep their labels.
    """
    if len(subjects) == 1:
        return tuple(artefacts[0])
    return tuple(
        sorted(
            (
                replace(
                    one,
                    markers=tuple(f"{subject}:{label}" for label in one.markers),
                    reference_marker=(
                        f"{subject}:{one.reference_marker}" if one.reference_marker else ""
                    ),
                )
                for subject, own in zip(subjects, artefacts, strict=True)
                for one in own
            ),
            key=lambda one: (one.start, one.stop, one.markers),
        )
    )


def _merge_masks(
    masks: Sequence[NDArray[np.bool_] | None], clips: Sequence[Clip]
) -> NDArray[np.bool_] | None:
    """Return a mask of samples of all subjects; None where no subject has one."""
    if all(mask is None for mask in masks):
        return None
    return np.concatenate(
        [
            np.zeros_like(clip.missing) if mask is None else mask
            for mask, clip in zip(masks, clips, strict=True)
        ],
        axis=1,
    )


def _named(gap: FilledGap, subject: str) -> FilledGap:
    """Return a gap whose label is ``subject:label``."""
    return replace(gap, label=f"{subject}:{gap.label}")


def _merge_clips(clips: Sequence[Clip]) -> Clip:
    """Make one clip of those of all subjects of a file."""
    first = clips[0]
    sources = [clip.source for clip in clips if clip.source is not None]
    for clip in clips:
        if clip.up != first.up:
            raise ClipError(
                f"{first.name}: the up axis is {first.up} for {first.subject} and {clip.up} for "
                f"{clip.subject}; give the right one (`up`)"
            )
    if len({source.mm_per_unit for source in sources}) > 1:
        raise ClipError(
            f"{first.name}: its subjects differ in their unit of length; "
            "give the right one (`unit`)"
        )
    return replace(
        first,
        positions=np.concatenate([clip.positions for clip in clips], axis=1),
        labels=tuple(f"{clip.subject}:{label}" for clip in clips for label in clip.labels),
        subject="",
        source=_merge_sources(sources) if sources else None,
    )


def _merge_sources(sources: Sequence[Source]) -> Source:
    """Return where the samples of all subjects are in their file."""
    interpolated = [source.interpolated for source in sources if source.interpolated is not None]
    known = len(interpolated) == len(sources)
    return replace(
        sources[0],
        points=tuple(point for source in sources for point in source.points),
        point_labels=tuple(label for source in sources for label in source.point_labels),
        zero_samples=sum(source.zero_samples for source in sources),
        left_out={
            label: reason
            for label, reason in sources[0].left_out.items()
            if all(label in source.left_out for source in sources)
        },
        notes=tuple(dict.fromkeys(note for source in sources for note in source.notes)),
        interpolated=np.concatenate(interpolated, axis=1) if known else None,
        taken_from=_merge_taken_from(sources),
    )


def _merge_taken_from(sources: Sequence[Source]) -> NDArray[np.intp] | None:
    """Return the points that the samples of all subjects are from; None: each from its own."""
    frames = [len(one.taken_from) for one in sources if one.taken_from is not None]
    if not frames:
        return None
    return np.concatenate([one.point_of_sample(frames[0]) for one in sources], axis=1)
