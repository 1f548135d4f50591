"""Plots of a result: the gaps of a marker, or the worst gaps of all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.errors import OptionError, OutputError
from priorfill.report.figures import check_plots, plain, save_figures
from priorfill.report.file_names import file_names
from priorfill.report.gap_figure import Panel, draw_panels
from priorfill.report.result_summary import worst_first
from priorfill.runtime.atomic_file import check_target, check_writable, replace_file
from priorfill.runtime.option_texts import parse_frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from priorfill.clip import Clip
    from priorfill.filling.result import FilledGap, Result

__all__ = ["DEFAULT_GAPS", "MAX_GAPS", "PLOT_SUFFIXES", "check_plot", "plot_files", "plot_result"]

PLOT_SUFFIXES = (".png", ".svg", ".pdf")
"""Suffixes of the files that can be written, lower case."""

DEFAULT_GAPS = 6
"""Gaps of a plot: as many as a screen or a page shows legibly."""

MAX_GAPS = 60
"""Most gaps of a picture, which would be higher than programs open. A .pdf has pages instead."""

MARGIN_SHARE = 0.5
"""Frames shown before and after a gap, as a share of its length."""

MIN_MARGIN, MAX_MARGIN = 0.3, 2.0
"""s. Least and greatest duration shown before and after a gap."""

Frames = str | tuple[int | None, int | None]
"""A range of frames, as the file numbers them: ``92-116``, or first and last."""


def plot_result(
    result: Result,
    marker: str | None = None,
    *,
    frames: Frames | None = None,
    gaps: int = DEFAULT_GAPS,
    truth: Clip | None = None,
) -> Figure:
    """Draw gaps of a result; see `priorfill.Result.plot`.

    Parameters
    ----------
    result : Result
        Of a fill.
    marker, frames, gaps, truth
        As for `priorfill.Result.plot`.
    """
    check_plots()
    _check_gaps(gaps)
    clip = result.clip
    recorded = None
    if truth is not None:
        if truth.labels != clip.labels or truth.frames != clip.frames:
            raise OptionError(
                f"{truth.name}: has other markers or frames than {clip.name}; `truth` is the same "
                "recording without gaps"
            )
        recorded = truth.positions
    index = None if marker is None else clip.index(marker)
    own = [gap for gap in result.gaps if marker is None or gap.label == marker]
    if frames is None:
        if index is not None and not own:
            panels = [Panel(index, 0, clip.frames, ())]
        else:
            panels = [_around(result, gap) for gap in worst_first(own)[:gaps]]
    else:
        start, stop = _range(clip, frames)
        own = [gap for gap in own if gap.start < stop and gap.stop > start]
        labels = dict.fromkeys(gap.label for gap in worst_first(own))
        chosen = [marker] if marker is not None else list(labels)[:gaps]
        panels = [
            Panel(clip.index(label), start, stop, tuple(g for g in own if g.label == label))
            for label in chosen
        ]
    shown = len(panels) if frames is None else sum(len(panel.gaps) for panel in panels)
    return draw_panels(result, panels, _title(result, shown, own, marker), recorded)


def check_plot(
    path: Path | str, *, gaps: int = DEFAULT_GAPS, source: Path | None = None, overwrite: bool
) -> None:
    """Check before a fill whether its plots can be drawn and written.

    Parameters
    ----------
    path : Path or str
        The file to write, or a folder: a name without a suffix.
    gaps : int
        Number of gaps of a plot.
    source : Path or None
        The file that is read, if any; `path` must be another.
    overwrite : bool
        Whether existing files may be replaced.

    Raises
    ------
    OptionError
        If the format is unknown, there are too many gaps, or matplotlib is not installed.
    OutputError
        If the folder takes no files, or the file exists already or is the one that is read.
    """
    path = Path(str(path))  # as in `check_target`
    folder = _is_folder(path)
    _check_gaps(gaps, path)
    check_plots()
    if not folder:
        check_target(path, overwrite=overwrite, source=source)
        check_writable(path, 0)
        return
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path}: is a file; a name without a suffix is that of a folder")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise OutputError(
            f"{path}: exists already and is not empty; choose another folder or use `overwrite`"
        )
    check_target(path / "marker.png", overwrite=True)
    check_writable(path / "marker.png", 0)


@contextmanager
def plot_files(
    path: Path | str, result: Result, *, gaps: int = DEFAULT_GAPS, overwrite: bool = False
) -> Iterator[tuple[Path, ...]]:
    """Write plots of a result; the files appear when the block ends without an error.

    Parameters
    ----------
    path : Path or str
        A .png or .svg of the worst gaps; a .pdf with as many pages as they need; or a folder, a
        name without a suffix: a .png for each marker with gaps.
    result : Result
        Of a fill.
    gaps : int
        Number of gaps, the worst first; in a folder of each marker.
    overwrite : bool
        Replace existing files.

    Yields
    ------
    tuple of Path
        The files.

    Raises
    ------
    OptionError, OutputError
        As in `check_plot`.
    """
    path = Path(str(path))
    if not _is_folder(path):
        with replace_file(path, overwrite=overwrite) as temporary:
            save_figures(_pages(result, gaps, path.suffix.lower() == ".pdf"), temporary)
            yield (path,)
        return
    labels = list(dict.fromkeys(gap.label for gap in worst_first(result.gaps)))
    files = [path / f"{name}.png" for name in file_names(labels)]
    with ExitStack() as stack:
        for label, file in zip(labels, files, strict=True):
            temporary = stack.enter_context(replace_file(file, overwrite=overwrite))
            save_figures([plot_result(result, label, gaps=gaps)], temporary)
        yield tuple(files)


def _pages(result: Result, gaps: int, several: bool) -> Iterator[Figure]:
    """Yield figures of the worst gaps: one, or as many as the pages of a document."""
    if not several:
        yield plot_result(result, gaps=gaps)
        return
    chosen = worst_first(result.gaps)[:gaps]
    for start in range(0, max(len(chosen), 1), DEFAULT_GAPS):
        page = [_around(result, gap) for gap in chosen[start : start + DEFAULT_GAPS]]
        title = _title(result, len(chosen), result.gaps, None)
        if len(chosen) > DEFAULT_GAPS:
            title += f"; {start + 1} to {start + len(page)}"
        yield draw_panels(result, page, title)


def _is_folder(path: Path) -> bool:
    """Return whether a path is that of a folder of plots; raise OptionError if it is of no plot."""
    if path.is_dir() or not path.suffix:
        return True
    if path.suffix.lower() in PLOT_SUFFIXES:
        return False
    raise OptionError(
        f"{path}: plots cannot be written with suffix {path.suffix!r}; use "
        f"{' or '.join(PLOT_SUFFIXES)}, or the name of a folder for a picture of each marker"
    )


def _check_gaps(gaps: int, path: Path | None = None) -> None:
    """Raise OptionError unless a number of gaps can be drawn."""
    if gaps < 1:
        raise OptionError(f"{gaps} gaps cannot be plotted; the number (`gaps`) is at least 1")
    if gaps > MAX_GAPS and (path is None or path.suffix.lower() != ".pdf"):
        raise OptionError(
            f"{gaps} gaps are too many for a picture; plot {MAX_GAPS} at most, or write a .pdf"
        )


def _around(result: Result, gap: FilledGap) -> Panel:
    """Return a gap with what surrounds it."""
    clip = result.clip
    seconds = min(max(MARGIN_SHARE * gap.frames / clip.rate, MIN_MARGIN), MAX_MARGIN)
    margin = math.ceil(seconds * clip.rate)
    return Panel(
        clip.index(gap.label),
        max(0, gap.start - margin),
        min(clip.frames, gap.stop + margin),
        (gap,),
    )


def _range(clip: Clip, frames: Frames) -> tuple[int, int]:
    """Return start and stop of a range of frames that the file numbers."""
    first, last = parse_frames(frames) if isinstance(frames, str) else frames
    end = clip.first_frame + clip.frames - 1
    start = 0 if first is None else first - clip.first_frame
    stop = clip.frames if last is None else last - clip.first_frame + 1
    start, stop = max(start, 0), min(stop, clip.frames)
    if start >= stop:
        raise OptionError(
            f"frames {frames!r}: {clip.name} has none of them; its frames are "
            f"{clip.first_frame}-{end}"
        )
    return start, stop


def _title(result: Result, shown: int, gaps: Sequence[FilledGap], marker: str | None) -> str:
    """Return the title of a figure."""
    name = plain(result.clip.name)
    if not gaps:
        return f"{name}: no gaps" if marker is None else name
    if shown < len(gaps) and marker is None:
        return f"{name}: the worst {shown} of {len(gaps)} gaps"
    if shown < len(gaps):
        return f"{name}: the worst {shown} of {len(gaps)} gaps of {plain(marker or '')}"
    return f"{name}: {len(gaps)} gap{'s' if len(gaps) > 1 else ''}"
