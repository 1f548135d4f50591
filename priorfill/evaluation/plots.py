"""Plots of an evaluation: errors by method, by length of gap, by marker.

matplotlib is an optional dependency and imported when a plot is drawn. A method has the same place,
colour and symbol in every plot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from priorfill.evaluation.evaluation_results import Evaluation
from priorfill.evaluation.summary_tables import LENGTHS, GapRow, length_class
from priorfill.report.figures import COLOURS, default_style, new_figure, plain, save_figures
from priorfill.runtime.atomic_file import replace_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_plots"]

SYMBOLS = "osD^vP"
LINES = ("-", "--", ":", "-.")
"""Line styles. With more methods than colours, symbols and lines distinguish them."""

LOG_RATIO = 10.0
"""Ratio of the largest to the smallest value above which an axis is logarithmic."""

MIN_ERROR = 1e-3
"""mm. Smaller errors are drawn as this one, because an axis may be logarithmic."""

STEPS = (1.0, 2.0, 5.0)
"""Ticks in each decade of a logarithmic axis."""

MAX_WIDE_COLUMNS = 12
"""Number of columns of a heat map up to which its cells have room for the larger font."""

DARK = 0.55
"""Position on the colour scale up to which numbers are white."""


def draw_plots(folder: Path, evaluation: Evaluation) -> list[Path]:
    """Draw all plots of an evaluation.

    Parameters
    ----------
    folder : Path
        An existing folder.
    evaluation : Evaluation
        What to draw.

    Returns
    -------
    list of Path
        The files; none where no gap was filled.
    """
    rows = [row for row in evaluation.gaps if row.errors.filled]
    if not rows:
        return []
    plots: list[tuple[str, Callable[[], Figure]]] = [
        ("errors_by_method.png", lambda: _by_method(evaluation, rows)),
        ("error_by_length.png", lambda: _by_length(evaluation, rows)),
    ]
    sets = list(dict.fromkeys(name for name, _, _ in evaluation.markers))
    for name in sets:
        end = f"_{re.sub('[^A-Za-z0-9._-]', '_', name)}" if len(sets) > 1 else ""
        plots.append(
            (f"error_by_marker{end}.png", lambda name=name: _by_marker(evaluation, name))  # type: ignore[misc]
        )
    files = []
    for file, draw in plots:
        with replace_file(folder / file, overwrite=True) as temporary, default_style():
            save_figures([draw()], temporary)
        files.append(folder / file)
    return files


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    """Return a figure and its axes."""
    figure = new_figure(width, height)
    return figure, figure.subplots()


def _what(evaluation: Evaluation) -> str:
    """Return the clips and the protocol, for a title."""
    clips = list(evaluation.clips)
    named = plain(clips[0]) if len(clips) == 1 else f"{len(clips)} clips"
    return f"{named}, protocol {evaluation.settings['protocol']['name']}"


def _scale(axes: Axes, values: Sequence[float], axis: str) -> None:
    """Make an axis logarithmic if the values span a wide range, with plain numbers at its ticks."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    one = axes.xaxis if axis == "x" else axes.yaxis
    if max(values) < LOG_RATIO * min(values):
        (axes.set_xlim if axis == "x" else axes.set_ylim)(0, None)
        return
    (axes.set_xscale if axis == "x" else axes.set_yscale)("log")
    one.set_major_locator(LogLocator(10, subs=STEPS, numticks=30))
    one.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    one.set_minor_formatter(NullFormatter())


def _error(row: GapRow) -> float:
    return max(row.errors.mean, MIN_ERROR)


def _by_method(evaluation: Evaluation, rows: Sequence[GapRow]) -> Figure:
    """Draw a box plot of the mean errors of the gaps, by method."""
    methods = list(evaluation.methods)
    figure, axes = _figure(8.5, 1.6 + 0.42 * len(methods))
    for place, method in enumerate(methods):
        of_method = [_error(row) for row in rows if row.method == method]
        if not of_method:
            continue
        colour = COLOURS[place % len(COLOURS)]
        axes.boxplot(
            of_method,
            positions=[place],
            orientation="horizontal",
            widths=0.6,
            whis=(5, 95),
            patch_artist=True,
            boxprops={"facecolor": colour, "alpha": 0.45, "edgecolor": "black"},
            medianprops={"color": "black", "linewidth": 2},
            flierprops={"marker": ".", "markersize": 3, "markeredgecolor": colour, "alpha": 0.6},
        )
        axes.plot(np.mean(of_method), place, "D", color="white", markeredgecolor="black", ms=5)
    axes.set_yticks(range(len(methods)), [_with_filled(evaluation, m) for m in methods])
    axes.set_ylim(len(methods) - 0.5, -0.5)
    _scale(axes, [_error(row) for row in rows], "x")
    axes.grid(axis="x", color="0.88")
    axes.set_axisbelow(True)
    axes.set_xlabel("mean error of a gap (mm)")
    axes.set_title(
        f"{_what(evaluation)}\nbox: half of the gaps, line: median, diamond: mean, "
        "whiskers: 5 and 95 %",
        fontsize=10,
    )
    return figure


def _with_filled(evaluation: Evaluation, method: str) -> str:
    """Return the name of a method, with the share filled if that is not 100 %."""
    share = evaluation.methods[method].errors.share
    if share == 1:
        return method
    return f"{method} ({math.floor(100 * share)} % filled)"


def _by_length(evaluation: Evaluation, rows: Sequence[GapRow]) -> Figure:
    """Draw the median error of the gaps by class of length, one line per method."""
    classes = [length_class(high) for high in LENGTHS[1:]] + [length_class(math.inf)]
    counts = {
        n: len({_key(row) for row in rows if length_class(row.seconds) == n}) for n in classes
    }
    there = [name for name in classes if counts[name]]
    methods = list(evaluation.methods)
    figure, axes = _figure(9.5, 5.2 + 0.12 * max(len(methods) - 12, 0))
    barred = len(methods) <= len(COLOURS)  # with more methods, bars would hide the lines
    medians: list[float] = []
    wide = 0.6 / max(len(methods), 1)
    for place, method in enumerate(methods):
        points = []
        for x, name in enumerate(there):
            errors = [
                _error(row)
                for row in rows
                if row.method == method and length_class(row.seconds) == name
            ]
            if errors:
                points.append((x + (place - (len(methods) - 1) / 2) * wide,
                               *np.percentile(errors, [50, 25, 75])))  # fmt: skip
        if not points:
            continue
        x_at, middle, low, high = np.array(points).T
        medians += [*middle, *low, *high] if barred else [*middle]
        style = _style(place)
        axes.plot(x_at, middle, label=_with_filled(evaluation, method), **style)
        if barred:
            axes.vlines(x_at, low, high, color=style["color"], alpha=0.35, linewidth=2)
    axes.set_xticks(range(len(there)), [f"{name}\n{_gaps(counts[name])}" for name in there])
    axes.set_xlim(-0.6, len(there) - 0.4)
    _scale(axes, medians, "y")
    axes.grid(axis="y", color="0.88")
    axes.set_axisbelow(True)
    axes.set_xlabel("length of the gap")
    axes.set_ylabel("mean error of a gap (mm)")
    bars = ", bar: half of the gaps" if barred else ""
    axes.set_title(f"{_what(evaluation)}\nsymbol: median gap{bars}", fontsize=10)
    figure.legend(loc="outside right upper", fontsize=9)
    return figure


def _gaps(count: int) -> str:
    return f"{count} gap" if count == 1 else f"{count} gaps"


def _key(row: GapRow) -> tuple[str, str, int, str, int]:
    return row.clip, row.case, row.copy, row.marker, row.first_frame


def _style(place: int) -> dict[str, Any]:
    """Return the colour, symbol and line of a method, by its place in the order."""
    again = place // len(COLOURS)
    return {
        "color": COLOURS[place % len(COLOURS)],
        "marker": SYMBOLS[(place + again) % len(SYMBOLS)],
        "linestyle": LINES[again % len(LINES)],
        "markersize": 6,
        "linewidth": 1.4,
    }


def _by_marker(evaluation: Evaluation, marker_set: str) -> Figure:
    """Draw a heat map of the mean errors by marker and method."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    methods = list(evaluation.methods)
    markers = list(dict.fromkeys(m for name, m, _ in evaluation.markers if name == marker_set))
    table = np.full((len(markers), len(methods)), np.nan)
    for (name, marker, method), (_, errors) in evaluation.markers.items():
        if name == marker_set:
            table[markers.index(marker), methods.index(method)] = errors.mean
    known = np.maximum(table[np.isfinite(table)], MIN_ERROR)
    figure, axes = _figure(2.6 + 0.62 * len(methods), 1.9 + 0.2 * len(markers))
    low, high = (float(known.min()), float(known.max())) if known.size else (MIN_ERROR, 1.0)
    norm = LogNorm(low, high) if high > LOG_RATIO * low else Normalize(0.0, high)
    image = axes.imshow(np.maximum(table, MIN_ERROR), aspect="auto", cmap="cividis", norm=norm)
    axes.set_facecolor("0.85")
    axes.set_yticks(range(len(markers)), [plain(name) for name in markers], fontsize=8)
    axes.set_xticks(range(len(methods)), methods, rotation=45, ha="right", rotation_mode="anchor")
    size = 7 if len(methods) <= MAX_WIDE_COLUMNS else 6
    for i, j in np.argwhere(np.isfinite(table)):
        value = table[i, j]
        text = f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"
        colour = "white" if norm(max(value, MIN_ERROR)) < DARK else "black"
        axes.text(j, i, text, ha="center", va="center", fontsize=size, color=colour)
    bar = figure.colorbar(image, ax=axes, shrink=0.6, pad=0.02, label="mean error (mm)")
    if isinstance(norm, LogNorm):
        bar.ax.yaxis.set_major_locator(LogLocator(10, subs=STEPS, numticks=30))
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title(f"{_what(evaluation)}\nmarker set {plain(marker_set)}; grey: nothing filled",
                   fontsize=10)  # fmt: skip
    return figure
