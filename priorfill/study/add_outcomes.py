"""Add filled files of a study to its database, if they are filled well enough."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from priorfill.artefacts import without_artefacts
from priorfill.artefacts.artefact import LABEL_SWAP
from priorfill.database import ClipOrigin, PriorDatabase
from priorfill.database.content_hash import content_hash
from priorfill.errors import ClipError, DuplicateClipError, FormatError
from priorfill.filling.multi_subject import read_subjects
from priorfill.filling.plausibility import CRITERIA
from priorfill.formats import format_of
from priorfill.study.job import FAILED, JobOutcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from priorfill.clip import Clip

__all__ = ["MAX_ADDED_ERROR", "add_outcome", "reason_not_to_add"]

MAX_ADDED_ERROR = 100.0
"""mm. Largest expected mean error of a gap of a file that is added. That of a whole limb is up to
50 mm in walks, and 100 mm in sports; more than that indicates that something is wrong with the
recording. Filled samples are marked, and are not learnt from."""

MAX_TRUSTED_ERROR = 20.0
"""mm. The same where filled samples are learnt from (`FillOptions.trust_filled`)."""


def reason_not_to_add(outcome: JobOutcome, *, trust_filled: bool = False) -> str:
    """Return why a file is not added to the database; empty if it is filled well enough.

    Samples that stay missing do no harm; measured ones that are wrong do.

    Parameters
    ----------
    outcome : JobOutcome
        What became of its job.
    trust_filled : bool
        Whether filled samples are learnt from.
    """
    if outcome.status == FAILED:
        return "was not filled"
    for artefact in outcome.facts.get("artefacts", ()):
        if artefact["kind"] == LABEL_SWAP:
            return f"labels of {' and '.join(artefact['markers'])} seem to be exchanged"
    limit = MAX_TRUSTED_ERROR if trust_filled else MAX_ADDED_ERROR
    for gap in outcome.facts.get("gaps", ()):
        if any(span["reason"] in CRITERIA.values() for span in gap["unfilled"]):
            return f"what would fill {gap['marker']} does not fit the measured motion"
        error = gap["expected_mean_error_mm"]
        if gap["filled"] and trust_filled and error is None:
            return f"the expected error of {gap['marker']} is unknown"
        if gap["filled"] and error is not None and error > limit:
            return f"{gap['marker']} has an expected error of {error:.0f} mm"
    return ""


def add_outcome(
    database: PriorDatabase, outcome: JobOutcome, reading: Mapping[str, Any], session: str = ""
) -> tuple[str, tuple[str, ...]]:
    """Add a filled file to a database; samples that were filled are marked as such.

    Samples of artefacts are left out.

    Parameters
    ----------
    database : PriorDatabase
        Open for writing.
    outcome : JobOutcome
        Of the file's job.
    reading : mapping of str to object
        Keyword arguments of `priorfill.read` for the original file.
    session : str
        Name of the session.

    Returns
    -------
    reason : str
        Why a subject of it was not added; empty if all are in the database.
    clips : tuple of str
        Content hashes of those that are.

    Raises
    ------
    DatabaseError
        If the database cannot be written.
    """
    try:
        originals = read_subjects(outcome.source, **reading)
        other_format = format_of(outcome.output) != format_of(outcome.source)
        own = dict.fromkeys(("up", "unit", "rate")) if other_format else {}  # it states them itself
        clips = read_subjects(outcome.output, **{**reading, **own})
    except (FormatError, ClipError, OSError) as error:
        return str(error), ()
    if len(clips) != len(originals):
        return f"{outcome.output} holds another number of subjects than its source", ()
    reasons: list[str] = []
    added: list[str] = []
    for clip, original in zip(clips, originals, strict=True):
        source = clip.source
        if source is None or source.sha256 != outcome.written.get(outcome.output):
            return f"{outcome.output} was changed after the fill", tuple(added)
        if outcome.facts["artefacts"]:
            clip, _ = without_artefacts(clip)
        if set(clip.labels) != set(original.labels):
            return f"{outcome.output} has other labels than its source", tuple(added)
        filled = _not_measured(clip, original, outcome)
        origin = ClipOrigin(session=session)
        try:
            if filled.any():
                method = str(outcome.facts["method"])
                database.accept(clip, filled, filled_by=method, origin=origin)
            else:
                database.add(clip, origin)
        except (DuplicateClipError, ClipError) as error:
            if content_hash(clip) not in {record.content for record in database.versions(clip)}:
                reasons.append(str(error))
                continue  # else a run that was interrupted has added it
        added.append(content_hash(clip))
    return "; ".join(reasons), tuple(added)


def _not_measured(clip: Clip, original: Clip, outcome: JobOutcome) -> NDArray[np.bool_]:
    """Return which samples of a filled clip were filled, or interpolated in the original file."""
    filled = np.zeros_like(clip.missing)
    for gap in outcome.facts["gaps"]:
        if gap["subject"] == original.subject:
            marker = clip.labels.index(gap["marker"])
            filled[_frames(gap, clip), marker] = True
            for span in gap["unfilled"]:
                filled[_frames(span, clip), marker] = False
    source = original.source
    if source is not None and source.interpolated is not None:
        order = [original.labels.index(label) for label in clip.labels]
        filled |= source.interpolated[:, order]
    return filled & ~clip.missing


def _frames(span: Mapping[str, Any], clip: Clip) -> slice:
    """Return the frames of a clip that a span of the facts names as the file numbers them."""
    return slice(span["first_frame"] - clip.first_frame, span["last_frame"] + 1 - clip.first_frame)
