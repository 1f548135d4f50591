"""What a fill returns: the filled clip and a record of every gap."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts import Artefact
from priorfill.clip import Clip
from priorfill.filling.provenance import Provenance
from priorfill.interop import optional_package, result_to_dataframe, result_to_xarray
from priorfill.markers.marker_set import MarkerSet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from priorfill.report.notebook_page import NotebookPage

__all__ = ["FilledGap", "Result", "UnfilledSpan"]


@dataclass(frozen=True)
class UnfilledSpan:
    """Frames ``start <= frame < stop`` of a gap that were not filled.

    Attributes
    ----------
    start, stop : int
        Frames, counted from the clip's first as 0.
    reason : str
        Why they were not filled.
    requested : bool
        Whether they were to be filled; False where the gap filter or an override leaves them
        alone.
    expected_mean_error_mm : float or None
        Greatest expected mean error (mm) of the positions that were not believed or exceeded the
        limit; None where there were none, or the error is unknown.

    See Also
    --------
    FilledGap : The gap that the span belongs to.

    Examples
    --------
    >>> UnfilledSpan(10, 20, "longer than 0.5 s", requested=False).requested
    False
    """

    start: int
    stop: int
    reason: str
    requested: bool = True
    expected_mean_error_mm: float | None = None


@dataclass(frozen=True)
class FilledGap:
    """What became of one gap.

    Attributes
    ----------
    label : str
        The marker.
    start, stop : int
        Frames ``start <= frame < stop``, counted from the clip's first as 0.
    filled : int
        Number of frames that were filled.
    expected_rms_mm : float
        Expected rms Euclidean error (mm) over the filled frames; NaN where unknown.
    expected_mean_error_mm : float
        Expected mean Euclidean error (mm) over the filled frames; NaN where unknown.
    error_bound_90_mm : float
        Distance (mm) below which 90 % of the errors of the filled frames are expected to lie; NaN
        where unknown.
    method : str
        The method used.
    sources : tuple of str
        What the gap was filled from.
    training_poses : int
        Number of poses learnt from, the maximum over the parts of the gap; in a blackout the
        number of windows. 0 for interpolation over time.
    unfilled : tuple of UnfilledSpan
        Frames that were left missing; empty where all were filled.
    source_clips : tuple of str
        Recordings learnt from, the most used first.
    expected_mean_error_without_database_mm : float
        What `expected_mean_error_mm` would be without the database; NaN where unknown.

    See Also
    --------
    Result : The result that the gap belongs to.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> gap = pf.fill(make_demo_clip()[1], method="linear").gaps[0]
    >>> gap.label, gap.frames, gap.complete
    ('LKNE', 30, True)
    """

    label: str
    start: int
    stop: int
    filled: int
    expected_rms_mm: float
    expected_mean_error_mm: float
    error_bound_90_mm: float
    method: str
    sources: tuple[str, ...]
    training_poses: int
    unfilled: tuple[UnfilledSpan, ...]
    source_clips: tuple[str, ...]
    expected_mean_error_without_database_mm: float = float("nan")

    @property
    def frames(self) -> int:
        """Length of the gap in frames."""
        return self.stop - self.start

    @property
    def requested(self) -> bool:
        """Whether any frame of the gap was to be filled."""
        return bool(self.filled) or not self.complete

    @property
    def complete(self) -> bool:
        """Whether every requested frame of the gap was filled."""
        return not any(span.requested for span in self.unfilled)


@dataclass(frozen=True, eq=False)
class Result:
    """A filled clip, what is known about each gap, and how it was computed.

    Attributes
    ----------
    clip : Clip
        The clip with its gaps filled; measured samples keep their bits.
    filled : ndarray of bool [shape=(frames, markers)]
        Which samples were filled.
    expected_rms_mm : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error of each filled sample; NaN elsewhere and where unknown.
    error_bound_90_mm : ndarray [shape=(frames, markers), mm]
        Distance below which 90 % of the errors are expected to lie, of each filled sample; NaN
        elsewhere and where unknown.
    gaps : tuple of FilledGap
        Every gap, in order of time.
    method : str
        The method used; several joined by " and ".
    marker_set : MarkerSet
        The marker set; of several subjects that of the first.
    rejected : ndarray of bool [shape=(frames, markers)]
        Which measured samples were treated as missing because of artefacts. Those that were not
        filled keep their measured position in `clip`.
    provenance : Provenance
        What the result was computed from, and how.
    artefacts : tuple of Artefact
        Why samples were rejected or are in doubt.
    doubtful : ndarray of bool [shape=(frames, markers)] or None
        Which measured samples are in doubt, or were left out when a fill that was not believed was
        repeated: nothing was learnt from them, and no fill joins them.
        They are in `clip` as measured. None: none.
    swapped : ndarray of bool [shape=(frames, markers)] or None
        Which samples in `clip` are measured samples of another marker of the file, because
        overrides exchange them. None: none.
    database : Path or None
        The prior database, if one was used.
    notes : tuple of str
        What was left out of the database and why, and what overrides did, a sentence each.
    subjects : tuple of Result
        The result of each subject, for several subjects of one file; empty for a single clip.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.
    priorfill.write : Write the filled clip.
    priorfill.write_uncertainty : Write the expected error of each sample.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> short = pf.GapFilter(max_gap=0.3)
    >>> result = pf.fill(make_demo_clip()[1], method="linear", gap_filter=short)
    >>> result.complete, int(result.filled.sum())
    (True, 42)
    """

    clip: Clip
    filled: NDArray[np.bool_]
    expected_rms_mm: NDArray[np.float64]
    error_bound_90_mm: NDArray[np.float64]
    gaps: tuple[FilledGap, ...]
    method: str
    marker_set: MarkerSet
    rejected: NDArray[np.bool_]
    provenance: Provenance
    artefacts: tuple[Artefact, ...] = ()
    doubtful: NDArray[np.bool_] | None = None
    swapped: NDArray[np.bool_] | None = None
    database: Path | None = None
    notes: tuple[str, ...] = ()
    subjects: tuple[Result, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether everything requested was filled."""
        return all(gap.complete for gap in self.gaps)

    @property
    def by_subject(self) -> tuple[Result, ...]:
        """The result of each subject: `subjects`, or this result alone."""
        return self.subjects or (self,)

    def plot(
        self,
        marker: str | None = None,
        *,
        frames: str | tuple[int | None, int | None] | None = None,
        gaps: int = 6,
        truth: Clip | None = None,
    ) -> Figure:
        """Draw gaps with what surrounds them: measured, filled, and how far off it may be.

        For each gap x, y and z over time, with the band that is expected to hold 50 % and 90 % of
        the errors of a coordinate.

        Parameters
        ----------
        marker : str, optional
            Label of the marker; None: the worst gaps of all markers.
        frames : str or tuple of int, optional
            Draw these frames, as the file numbers them (``"92-116"``, or first and last), instead
            of single gaps.
        gaps : int
            Number of gaps, the worst first; with `frames` and without `marker` of markers.
        truth : Clip, optional
            The same recording without gaps, to be drawn with its distance from the filled samples.

        Returns
        -------
        matplotlib.figure.Figure
            A figure that pyplot does not know: notebooks show it, ``savefig`` writes it.

        Raises
        ------
        MarkerNotFoundError
            If there is no such marker.
        OptionError
            If matplotlib is not installed, or frames or number of gaps are out of range.

        Examples
        --------
        >>> import priorfill as pf
        >>> from priorfill.synthetic.demo import make_demo_clip
        >>> result = pf.fill(make_demo_clip()[1], method="linear")
        >>> result.plot("LKNE").savefig("LKNE.png")  # doctest: +SKIP
        """
        from priorfill.report.plots import plot_result  # few fills need it

        return plot_result(self, marker, frames=frames, gaps=gaps, truth=truth)

    def show(
        self,
        *,
        before: Clip | Sequence[Clip] | None = None,
        truth: Clip | Sequence[Clip] | None = None,
        height: int = 800,
    ) -> NotebookPage:
        """Return the page that `priorfill.write_report` writes, for a notebook to show.

        Parameters
        ----------
        before, truth : Clip or sequence of Clip, optional
            As for `priorfill.write_report`.
        height : int
            Height of the frame in the notebook (pixels).

        Returns
        -------
        NotebookPage
            Shown where it is the last value of a cell. Elsewhere nothing is opened;
            ``.save("walk.html")`` writes a file for the browser.

        Raises
        ------
        OptionError
            If the clips do not fit the result, or the height is out of range.

        Examples
        --------
        >>> import priorfill as pf
        >>> from priorfill.synthetic.demo import make_demo_clip
        >>> truth, clip = make_demo_clip()
        >>> pf.fill(clip, method="linear").show(truth=truth)
        <page of synthetic_demo, ... MB; notebooks show it, .save("FILE.html") writes it>
        """
        from priorfill.report.notebook_page import NotebookPage
        from priorfill.report.page import page_text
        from priorfill.report.report_data import PageContents, page_data
        from priorfill.report.shown_text import MAX_LABEL, shown

        page = page_text(page_data(self, PageContents(before=before, truth=truth)))
        return NotebookPage(shown(self.clip.name, MAX_LABEL), page, height)

    def to_xarray(self) -> Any:
        """Return positions, what was filled and the expected errors as an ``xarray.Dataset``.

        Returns
        -------
        xarray.Dataset
            As of `priorfill.interop.result_to_xarray`: variables ``position``, ``filled``,
            ``expected_rms`` and ``error_bound_90`` over ``frame``, ``marker`` and ``axis``.

        Raises
        ------
        OptionError
            If xarray is not installed.

        Examples
        --------
        >>> result.to_xarray().position.sel(marker="LKNE", frame=slice(92, 116))  # doctest: +SKIP
        """
        return result_to_xarray(self, optional_package("xarray").Dataset)

    def to_dataframe(self) -> Any:
        """Return positions, what was filled and the expected errors as a ``pandas.DataFrame``.

        Returns
        -------
        pandas.DataFrame
            As of `priorfill.interop.result_to_dataframe`: a row for each marker and frame.

        Raises
        ------
        OptionError
            If pandas is not installed.

        Examples
        --------
        >>> result.to_dataframe().query("filled and error_bound_90_mm > 20")  # doctest: +SKIP
        """
        return result_to_dataframe(self, optional_package("pandas").DataFrame)

    def __repr__(self) -> str:
        from priorfill.report.result_text import result_line

        return result_line(self)

    def _repr_html_(self) -> str:
        """Return the result as a notebook shows it: what was done, and the worst gaps."""
        from priorfill.report.result_text import result_html

        return result_html(self)
