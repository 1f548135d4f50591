"""A result rebuilt from two files: the recording with gaps, and a filled version of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError
from priorfill.filling.assemble import expected_errors
from priorfill.filling.multi_subject import merge_results, read_subjects
from priorfill.filling.provenance import Provenance, identify
from priorfill.filling.read_uncertainty import Uncertainty, UncertaintyFile, read_uncertainty
from priorfill.filling.result import FilledGap, Result, UnfilledSpan
from priorfill.gaps import Gap, find_gaps, runs
from priorfill.geometry.axes import from_upright
from priorfill.markers.describe import describe
from priorfill.report.compared import SAME_MM, file_or_name, notes_on_fit, positions_like

__all__ = ["UNKNOWN_METHOD", "result_from_clips", "result_from_files"]

UNKNOWN_METHOD = "unknown"
"""Method of a fill whose positions alone are known."""

MAX_CHANGED = 0.5
"""Share of the measured samples above which a file is a processed version, such as a filtered one:
its samples are not listed as gaps then."""


def result_from_files(
    before: Path | str,
    after: Path | str,
    *,
    uncertainty: Path | str | None = None,
    **reading: Any,
) -> Result:
    """Rebuild the result of a fill from the files before and after it, by any program.

    Parameters
    ----------
    before : Path or str
        The recording with gaps.
    after : Path or str
        The same recording, filled; its format, unit and up axis may be others.
    uncertainty : Path or str, optional
        The expected error of each filled sample, as `priorfill.write_uncertainty` writes it.
    **reading
        As for `priorfill.read_subjects`, for both files.

    Returns
    -------
    Result
        Samples that only `after` has are filled. Measured samples that differ are filled as well,
        and rejected; `Result.notes` counts them.

    Raises
    ------
    FormatError, OptionError
        Where a file cannot be read.
    ClipError
        Where frames, rate or markers do not fit.

    See Also
    --------
    priorfill.write_report : Write a page that shows a result.
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> truth, clip = make_demo_clip()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pf.write(f"{folder}/walk.c3d", clip)
    ...     _ = pf.write(f"{folder}/filled.trc", truth)
    ...     result = result_from_files(f"{folder}/walk.c3d", f"{folder}/filled.trc")
    >>> result.complete, bool((result.filled == clip.missing).all())
    (True, True)
    """
    measured = read_subjects(before, **reading)
    found = None if uncertainty is None else read_uncertainty(uncertainty)
    return result_from_clips(measured, read_subjects(after, **reading), found)


def result_from_clips(
    before: Sequence[Clip], after: Sequence[Clip], uncertainty: UncertaintyFile | None = None
) -> Result:
    """Rebuild the result of a fill from the clips before and after it.

    Parameters
    ----------
    before, after : sequence of Clip
        One for each subject.
    uncertainty : UncertaintyFile, optional
        The expected error of each filled sample.

    Returns
    -------
    Result
        As of `result_from_files`.

    Raises
    ------
    ClipError
        Where frames, rate or markers do not fit.
    """
    several = len(before) > 1
    results = []
    for clip in before:
        own = _of_subject(clip, after, several)
        positions = from_upright(positions_like(own, clip, all_markers=True), clip.up)
        errors = None
        if uncertainty is not None:
            names = [f"{clip.subject}:{label}" if several else label for label in clip.labels]
            errors = uncertainty.like(clip, names)
        results.append(_rebuilt(clip, positions, own, errors))
    return merge_results(results)


@dataclass(frozen=True, eq=False)
class _Difference:
    """How a filled clip differs from the measured one, masks [shape=(frames, markers)].

    Attributes
    ----------
    filled, removed, changed : ndarray of bool
        Samples that are only in the filled clip, only in the measured one, or in another place.
    distance : ndarray [shape=(changed samples,), mm]
        How far those are from the measured place.
    rounded_mm : float
        Greatest difference of the other measured samples.
    measured : int
        Number of measured samples.
    """

    filled: NDArray[np.bool_]
    removed: NDArray[np.bool_]
    changed: NDArray[np.bool_]
    distance: NDArray[np.float64]
    rounded_mm: float
    measured: int

    @property
    def is_processed(self) -> bool:
        """Whether more samples differ than a fill replaces."""
        return int(self.changed.sum()) > MAX_CHANGED * self.measured

    def notes(self) -> Iterator[str]:
        """Yield what differs but for the gaps."""
        count = int(self.changed.sum())
        if count:
            yield (
                f"{count} of {self.measured} measured samples differ in the filled file, by "
                f"{float(np.median(self.distance)):.1f} mm (median) and at most "
                f"{float(self.distance.max()):.1f} mm"
                + ("; it appears to be filtered or moved" if self.is_processed else "")
            )
        if self.removed.any():
            yield f"{int(self.removed.sum())} measured samples are missing in the filled file"
        if self.rounded_mm > SAME_MM / 100.0:
            yield f"the filled file has measured samples rounded by up to {self.rounded_mm:.3f} mm"


def _of_subject(clip: Clip, after: Sequence[Clip], several: bool) -> Clip:
    """Return the filled clip of a subject."""
    if not several and len(after) == 1:
        return after[0]
    for one in after:
        if one.subject == clip.subject:
            return one
    names = ", ".join(one.subject or "one without a name" for one in after)
    raise ClipError(
        f"{file_or_name(after[0])}: has no subject {clip.subject or 'without a name'}, but "
        f"{names}; give another version of the same recording"
    )


def _rebuilt(
    clip: Clip,
    positions: NDArray[np.float64],
    after: Clip,
    uncertainty: Uncertainty | None,
) -> Result:
    """Return the result of one subject."""
    found = _difference(clip, positions)
    replaced = np.zeros_like(found.changed) if found.is_processed else found.changed
    filled = found.filled | replaced
    rms = np.full(filled.shape, np.nan)
    bound = rms.copy()
    if uncertainty is not None:
        rms = np.where(filled, uncertainty.expected_rms_mm, np.nan)
        bound = np.where(filled, uncertainty.error_bound_90_mm, np.nan)
    provenance = None if uncertainty is None else uncertainty.provenance
    if provenance is None:
        provenance = Provenance({}, UNKNOWN_METHOD, clips=(identify(clip),))
    mask = clip.missing | replaced | found.removed
    kept = np.where((filled | found.changed)[..., None], positions, clip.positions)
    kept[found.removed] = np.nan
    notes = [*found.notes(), *notes_on_fit(after, [clip])]
    sources = {} if uncertainty is None else uncertainty.sources
    return Result(
        replace(clip, positions=kept),
        filled,
        rms,
        bound,
        tuple(
            _gap(gap, clip, (filled, rms, bound), provenance.method, sources)
            for gap in find_gaps(mask)
        ),
        provenance.method,
        describe(clip),
        replaced,
        provenance,
        notes=tuple(notes),
    )


def _difference(clip: Clip, positions: NDArray[np.float64]) -> _Difference:
    """Compare the positions of a filled clip [shape=(frames, markers, 3), mm] with a clip."""
    missing, absent = clip.missing, np.isnan(positions[..., 0])
    both = ~missing & ~absent
    off = np.zeros(missing.shape)
    off[both] = np.sqrt(((positions[both] - clip.positions[both]) ** 2).sum(axis=1))
    changed = off > SAME_MM
    return _Difference(
        missing & ~absent,
        ~missing & absent,
        changed,
        off[changed],
        float(off[~changed].max(initial=0.0)),
        int((~missing).sum()),
    )


def _gap(
    gap: Gap,
    clip: Clip,
    samples: tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]],
    method: str,
    sources: Mapping[tuple[str, int], str],
) -> FilledGap:
    """Describe one gap from the masks and errors of all samples."""
    inside = slice(gap.start, gap.stop), gap.marker
    filled, rms, bound = samples[0][inside], samples[1][inside], samples[2][inside]
    mean_rms, mean, common = expected_errors(rms, bound)
    label = clip.labels[gap.marker]
    given = (sources.get((label, gap.start + int(frame))) for frame in np.flatnonzero(filled))
    return FilledGap(
        label=label,
        start=gap.start,
        stop=gap.stop,
        filled=int(filled.sum()),
        expected_rms_mm=mean_rms,
        expected_mean_error_mm=mean,
        error_bound_90_mm=common,
        method=method,
        sources=tuple(dict.fromkeys(text for text in given if text)),
        training_poses=0,
        unfilled=tuple(
            UnfilledSpan(gap.start + start, gap.start + stop, "missing in the filled file")
            for start, stop in runs(~filled)
        ),
        source_clips=(),
    )
