"""Draw markers around their gaps: each coordinate over time, measured and filled, with bands."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import runs
from priorfill.report.bands import BAND_50, BAND_90
from priorfill.report.figures import default_style, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from priorfill.filling.result import FilledGap, Result

__all__ = ["Panel", "draw_panels"]

Values = NDArray[np.float64]

MAX_COLUMNS = 2
"""Panels next to each other."""

WIDTH, HEIGHT = 6.4, 4.2
"""Inches. Size of a panel of three coordinates; the axes of each are a third as high."""

ONE_WIDTH = 8.0
"""Inches. Width of a figure of one panel."""

MARGINS = 0.8
"""Inches. Height of the title and the legend."""

MIN_RANGE = 10.0
"""mm. Least range of an axis, so that a marker at rest does not look restless."""

MAX_POINTS = 4000
"""Number of frames above which a curve is drawn by its least and greatest values in short
stretches of time; no screen or page has as many columns."""

TITLE_CHARACTERS = 70
"""Length of a line of a title; longer ones are wrapped."""

TITLE_LINES, LINE_HEIGHT = 2, 0.17
"""Lines of a title for which a panel has room; inches that each further line takes."""

MAX_REASONS = 2
"""Reasons of unfilled frames in the title of a panel; the table of gaps has all."""

STYLES: dict[str, dict[str, Any]] = {
    "measured": {"color": "black", "linewidth": 1.4},
    "filled": {"color": "#D55E00", "linewidth": 1.8},
    "recorded": {"color": "#0072B2", "linewidth": 1.4, "linestyle": (0, (4, 2))},
    "90 % band": {"color": "#E69F00", "alpha": 0.28, "linewidth": 0.0},
    "50 % band": {"color": "#E69F00", "alpha": 0.5, "linewidth": 0.0},
    "gap": {"color": "0.93", "linewidth": 0.0},
    "not filled": {"facecolor": "none", "edgecolor": "0.6", "hatch": "///", "linewidth": 0.0},
    "measured, in doubt": {"color": "#CC79A7", "linestyle": "", "marker": "x", "markersize": 4},
}
"""How each kind of data is drawn; its name is in the legend."""


@dataclass(frozen=True)
class Panel:
    """A marker over a range of frames.

    Attributes
    ----------
    marker : int
        Index of the marker.
    start, stop : int
        Frames ``start <= frame < stop``, counted from the clip's first as 0.
    gaps : tuple of FilledGap
        Its gaps there that the title describes.
    """

    marker: int
    start: int
    stop: int
    gaps: tuple[FilledGap, ...]


def draw_panels(
    result: Result, panels: Sequence[Panel], title: str, truth: Values | None = None
) -> Figure:
    """Draw panels side by side and one below the other.

    Parameters
    ----------
    result : Result
        Of a fill.
    panels : sequence of Panel
        What to draw; may be empty.
    title : str
        Above all panels, plain text.
    truth : ndarray [shape=(frames, markers, 3), mm], optional
        Recorded positions, to be drawn with their distance from the filled ones.
    """
    columns = min(MAX_COLUMNS, max(len(panels), 1))
    width = WIDTH * columns if columns > 1 else ONE_WIDTH
    drawings = [_Drawing(result, panel, truth) for panel in panels]
    rows = [drawings[start : start + columns] for start in range(0, len(drawings), columns)]
    heights = [max(drawing.height for drawing in row) for row in rows]
    drawn: set[str] = set()
    with default_style():
        figure = new_figure(width, sum(heights, MARGINS))
        figure.suptitle(title, fontsize=12)
        if rows:
            parts = figure.subfigures(len(rows), columns, height_ratios=heights, squeeze=False)
            for drawing, part in zip(drawings, parts.ravel(), strict=False):
                drawn |= drawing.draw(part)
        if drawn:
            order = [name for name in STYLES if name in drawn]
            figure.legend(
                [_sample(name) for name in order],
                order,
                loc="outside lower center",
                ncols=min(len(order), 6 if columns == 1 else 8),
                frameon=False,
            )
    return figure


class _Drawing:
    """Draws one panel.

    Parameters
    ----------
    result : Result
        Of a fill.
    panel : Panel
        What to draw.
    truth : ndarray [shape=(frames, markers, 3), mm] or None
        Recorded positions.
    """

    def __init__(self, result: Result, panel: Panel, truth: Values | None) -> None:
        clip, shown = result.clip, slice(panel.start, panel.stop)
        self.result, self.panel = result, panel
        self.drawn: set[str] = set()
        self.frames = clip.first_frame + np.arange(panel.start, panel.stop)
        self.positions = clip.positions[shown, panel.marker]
        self.filled = result.filled[shown, panel.marker]
        self.bound = result.error_bound_90_mm[shown, panel.marker]
        self.truth = None if truth is None else truth[shown, panel.marker]
        doubtful = result.rejected & ~result.filled
        if result.doubtful is not None:
            doubtful = doubtful | result.doubtful
        self.doubtful = doubtful[shown, panel.marker]
        self.rows = 3 if truth is None else 4
        self.title = self._title()

    @property
    def height(self) -> float:
        """Inches."""
        further = max(0, self.title.count("\n") + 1 - TITLE_LINES)
        return HEIGHT * self.rows / 3 + LINE_HEIGHT * further

    def draw(self, part: Any) -> set[str]:
        """Draw into a part of a figure; return the kinds of data, for the legend."""
        axes = part.subplots(self.rows, 1, sharex=True)
        clip = self.result.clip
        for k, one in enumerate(axes[:3]):
            self._shade(one)
            self._bands(one, self.positions[:, k])
            self._curves(one, k)
            up = ", up" if clip.up[1] == "XYZ"[k] else ""
            one.set_ylabel(f"{'xyz'[k]} (mm){up}")
            _widen(one)
        if self.truth is not None:
            self._shade(axes[3])
            self._distances(axes[3])
        for one in axes:
            one.grid(color="0.85", linewidth=0.6)
            one.set_axisbelow(True)
            one.margins(x=0.01)
        axes[-1].set_xlabel("frame")
        axes[-1].xaxis.get_major_locator().set_params(integer=True)
        axes[0].set_title(self.title, fontsize=10, loc="left")
        first, rate = clip.first_frame, clip.rate
        seconds = axes[0].secondary_xaxis(
            "top",
            functions=(lambda frame: (frame - first) / rate, lambda time: time * rate + first),
        )
        seconds.set_xlabel("time (s)", fontsize=9)
        seconds.tick_params(labelsize=8)
        return self.drawn

    def _title(self) -> str:
        """Return what the panel shows, and what is expected of it."""
        clip, panel = self.result.clip, self.panel
        first = clip.first_frame
        name = plain(clip.labels[panel.marker])
        if len(panel.gaps) == 1:
            gap = panel.gaps[0]
            span = _span(first, gap.start, gap.stop)
            lines = [f"{name}, {span} ({gap.frames / clip.rate:.2f} s)"]
        else:
            count = "no gaps" if not panel.gaps else f"{len(panel.gaps)} gaps"
            lines = [f"{name}, {_span(first, panel.start, panel.stop)}: {count}"]
        lines += _expected(panel.gaps)
        spans = [span for gap in panel.gaps for span in gap.unfilled]
        for one in spans[:MAX_REASONS]:
            what = "not filled" if one.requested else "left alone"
            reason = plain(one.reason, 200).replace("`", "")
            lines.append(f"{what}, {_span(first, one.start, one.stop)}: {reason}")
        if len(spans) > MAX_REASONS:
            more = len(spans) - MAX_REASONS
            lines.append(f"... and {more} further part{'s' if more > 1 else ''} not filled")
        return "\n".join(piece for line in lines for piece in textwrap.wrap(line, TITLE_CHARACTERS))

    def _shade(self, axes: Axes) -> None:
        """Shade the gaps, and hatch what was not filled."""
        missing = np.isnan(self.positions[:, 0])
        for name, where in (("gap", self.filled | missing), ("not filled", missing)):
            # a frame is as wide as the distance to its neighbours
            spans = [(self.frames[start] - 0.5, stop - start) for start, stop in runs(where)]
            if spans:
                self.drawn.add(name)
                all_heights = axes.get_xaxis_transform()
                axes.broken_barh(spans, (0, 1), transform=all_heights, zorder=0.5, **STYLES[name])

    def _bands(self, axes: Axes, values: Values) -> None:
        """Draw the bands around filled samples."""
        for name, share in (("90 % band", BAND_90), ("50 % band", BAND_50)):
            half = share * self.bound
            self._area(axes, name, values - half, values + half)

    def _area(self, axes: Axes, name: str, low: Values, high: Values) -> None:
        """Draw an area of filled samples, where it is known."""
        from matplotlib.collections import PolyCollection

        areas = []
        for start, stop in runs(self.filled & np.isfinite(low) & np.isfinite(high)):
            run = slice(start, stop, math.ceil((stop - start) / MAX_POINTS))
            frames, bottom, top = self.frames[run], low[run], high[run]
            if len(frames) == 1:  # an area needs two frames
                frames = frames[0] + np.array([-0.5, 0.5])
                bottom, top = np.repeat(bottom, 2), np.repeat(top, 2)
            there, back = np.column_stack([frames, top]), np.column_stack([frames, bottom])
            areas.append(np.concatenate([there, back[::-1]]))
        if areas:
            self.drawn.add(name)
            axes.add_collection(PolyCollection(areas, **STYLES[name]))
            axes.update_datalim(np.concatenate(areas))
            axes.autoscale_view()

    def _curves(self, axes: Axes, k: int) -> None:
        """Draw measured and filled samples of a coordinate."""
        values = self.positions[:, k]
        measured = np.where(self.filled, np.nan, values)
        beside = self.filled.copy()  # a fill is drawn from one measured sample to the other
        beside[1:] |= self.filled[:-1]
        beside[:-1] |= self.filled[1:]
        curves = [("measured", measured), ("filled", np.where(beside, values, np.nan))]
        if self.truth is not None:
            hidden = self.filled | np.isnan(values)
            curves.insert(0, ("recorded", np.where(hidden, self.truth[:, k], np.nan)))
        curves.append(("measured, in doubt", np.where(self.doubtful, values, np.nan)))
        for name, curve in curves:
            if np.isfinite(curve).any():
                self._curve(axes, name, curve)

    def _curve(self, axes: Axes, name: str, curve: Values) -> None:
        """Draw a curve, and dots where a sample has no neighbours."""
        style = STYLES[name]
        axes.plot(*_thinned(self.frames, curve), **style)
        self.drawn.add(name)
        known = np.isfinite(curve)
        alone = known.copy()
        alone[1:] &= ~known[:-1]
        alone[:-1] &= ~known[1:]
        if alone.any() and "marker" not in style:
            axes.plot(self.frames[alone], curve[alone], ".", color=style["color"], markersize=4)

    def _distances(self, axes: Axes) -> None:
        """Draw the distance of filled from recorded samples, and the bound."""
        assert self.truth is not None
        away = np.linalg.norm(self.positions - self.truth, axis=1)
        self._area(axes, "90 % band", np.zeros_like(self.bound), self.bound)
        self._curve(axes, "filled", np.where(self.filled, away, np.nan))
        axes.set_ylim(0.0, None)
        axes.set_ylabel("distance from\nrecorded (mm)")


def _sample(name: str) -> Any:
    """Return what the legend shows of a kind of data."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    style = STYLES[name]
    lines = {"marker", "linestyle"} & style.keys() or name in ("measured", "filled")
    return Line2D([], [], **style) if lines else Patch(**style)


def _expected(gaps: Sequence[FilledGap]) -> list[str]:
    """Return the method and the expected errors of gaps in a line; none where nothing is filled."""
    filled = [gap for gap in gaps if gap.filled]
    if not filled:
        return []
    methods = " and ".join(dict.fromkeys(gap.method for gap in filled))
    means = [gap.expected_mean_error_mm for gap in filled]
    bounds = [gap.error_bound_90_mm for gap in filled]
    if not all(map(math.isfinite, (*means, *bounds))):
        return [f"filled with {methods}; expected error unknown"]
    most = "at most " if len(filled) > 1 else ""
    return [
        f"filled with {methods}; expected mean error {most}{max(means):.1f} mm, "
        f"90 % bound {most}{max(bounds):.1f} mm"
    ]


def _span(first: int, start: int, stop: int) -> str:
    """Return frames as the file numbers them."""
    if stop - start == 1:
        return f"frame {first + start}"
    return f"frames {first + start}\u2013{first + stop - 1}"


def _thinned(frames: NDArray[np.int_], curve: Values) -> tuple[NDArray[np.int_], Values]:
    """Return the least and greatest values of short stretches of a long curve, in order of time."""
    if len(curve) <= MAX_POINTS:
        return frames, curve
    step = math.ceil(2 * len(curve) / MAX_POINTS)
    kept: list[int] = []
    for start in range(0, len(curve), step):
        part = curve[start : start + step]
        known = np.flatnonzero(np.isfinite(part))
        if not len(known):
            kept.append(start)
        elif len(known) < len(part):
            kept += range(start, start + len(part))  # ends of gaps stay where they are
        else:
            kept += sorted({start + int(part.argmin()), start + int(part.argmax())})
    return frames[kept], curve[kept]


def _widen(axes: Axes) -> None:
    """Give an axis a least range."""
    if not axes.has_data() or not np.isfinite(axes.dataLim.height):
        axes.set_yticks([])  # nothing is known; the numbers would mean nothing
    low, high = axes.get_ylim()
    short = MIN_RANGE - (high - low)
    if short > 0:
        axes.set_ylim(low - short / 2, high + short / 2)
