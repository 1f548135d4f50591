"""Several people in one file: each is filled as a clip of its own, and one file is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from priorfill.artefacts import Artefact
from priorfill.clip import Clip, Source
from priorfill.errors import ClipError
from priorfill.filling.result import FilledGap, Result

__all__ = ["merge_artefacts", "merge_results"]


def merge_results(results: Sequence[Result]) -> Result:
    """Make one result of those of all people of a file.

    Parameters
    ----------
    results : sequence of Result
        One for each, of clips read from the same file.

    Returns
    -------
    Result
        Its markers and gaps are called ``subject:label``; the marker set is that of the first. A
        single result is returned as it is.

    Raises
    ------
    ClipError
        Where the people were not understood alike: in other units, or with another axis up.
    """
    first = results[0]
    if len(results) == 1:
        return first
    clips = [result.clip for result in results]
    return replace(
        first,
        clip=_joined_clip(clips),
        filled=np.concatenate([result.filled for result in results], axis=1),
        expected_rms=np.concatenate([result.expected_rms for result in results], axis=1),
        error_bound_90=np.concatenate([result.error_bound_90 for result in results], axis=1),
        rejected=np.concatenate([result.rejected for result in results], axis=1),
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
    )


def merge_artefacts(
    subjects: Sequence[str], artefacts: Sequence[Sequence[Artefact]]
) -> tuple[Artefact, ...]:
    """Return the trouble of all people of a file, in order of time, with their names.

    Parameters
    ----------
    subjects : sequence of str
        The people.
    trouble : sequence of sequence of Trouble
        Of each. That of a single person is returned as it is.
    """
    if len(subjects) == 1:
        return tuple(artefacts[0])
    return tuple(
        sorted(
            (
                replace(
                    one,
                    markers=tuple(f"{subject}:{label}" for label in one.markers),
                    partner=f"{subject}:{one.partner}" if one.partner else "",
                )
                for subject, own in zip(subjects, artefacts, strict=True)
                for one in own
            ),
            key=lambda one: (one.start, one.stop, one.markers),
        )
    )


def _named(gap: FilledGap, subject: str) -> FilledGap:
    """Return a gap with the name of whose it is."""
    return replace(gap, label=f"{subject}:{gap.label}")


def _joined_clip(clips: Sequence[Clip]) -> Clip:
    """Make one clip of the people of a file."""
    first = clips[0]
    sources = [clip.source for clip in clips if clip.source is not None]
    for clip in clips:
        if clip.up != first.up:
            raise ClipError(
                f"{first.name}: {first.up} seems to be up for {first.subject}, and {clip.up} for "
                f"{clip.subject}; say which (--up)"
            )
    if len({source.mm_per_unit for source in sources}) > 1:
        raise ClipError(
            f"{first.name}: its subjects do not seem to be in the same unit of length; "
            "say which it is (--unit)"
        )
    return replace(
        first,
        positions=np.concatenate([clip.positions for clip in clips], axis=1),
        labels=tuple(f"{clip.subject}:{label}" for clip in clips for label in clip.labels),
        subject="",
        source=_joined_source(sources) if sources else None,
    )


def _joined_source(sources: Sequence[Source]) -> Source:
    """Say where the samples of all people are in their file."""
    told = [source.interpolated for source in sources if source.interpolated is not None]
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
        interpolated=np.concatenate(told, axis=1) if len(told) == len(sources) else None,
    )
