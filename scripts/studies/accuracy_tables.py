"""The tables of the accuracy study."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from accuracy_rows import Row
from fill_quality import MOTION_HZ

DATABASES = ("none", "full", "no-subject")
"""Databases used in addition to the clip."""

LENGTHS = (0.0, 0.5, 1.0, 2.0, 3.0, 6.5)
"""s. Limits of the length classes; longer gaps are dropouts."""

MAX_JITTER_RATIO = 2.0
"""Largest acceptable power of a fill above 10 Hz, relative to the truth, ..."""

MAX_JITTER = 0.3
"""mm. ... and rms displacement that is always acceptable: filtered recordings have no jitter."""

MAX_PENETRATION = 5.0
"""mm. Depth of a foot marker below its lowest measured height that is not visible."""

ALL = "all cases"
"""Name of the last line of a table, in which each case has equal weight."""

WORST_CASES = 20
"""Number of worst cases listed."""

MIN_RATIO = 1.02
"""Ratio of errors above which a database counts as harmful."""


def geometric(values: Iterable[float]) -> float:
    """Geometric mean of the finite positive values; NaN without any."""
    known = [v for v in values if np.isfinite(v) and v > 0]
    return float(np.exp(np.log(known).mean())) if known else float("nan")


def share(flags: Iterable[bool]) -> str:
    """Return the share of true flags as text; a dash without any."""
    listed = list(flags)
    return f"{np.mean(listed):.0%}" if listed else "-"


def print_lines(title: str, columns: Sequence[str], lines: Iterable[Sequence[object]]) -> None:
    """Print a table: the first column left-aligned, the others right-aligned."""
    cells = [[_cell(value) for value in line] for line in lines]
    if not cells:
        return
    widths = [max(len(c), *(len(line[i]) for line in cells)) for i, c in enumerate(columns)]
    print(f"\n{title}")
    for line in (list(columns), *cells):
        print("  ".join(
            text.ljust(w) if isinstance(text, str) and i < 1 else text.rjust(w)
            for i, (text, w) in enumerate(zip(line, widths, strict=True))
        ).rstrip())  # fmt: skip


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.2f}"


def _by(rows: Sequence[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    """Group rows by attributes, in the order of first appearance."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(getattr(row, name) for name in names), []).append(row)
    return groups


def _with_all(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Group rows by kind, followed by one row per case.

    A blackout has a gap in every marker and would outweigh all other gaps.
    """
    by_kind = [(str(k[0]), v) for k, v in _by(rows, "kind").items()]
    return [*by_kind, (ALL, [_as_one(v) for v in _by(rows, "case", "method", "database").values()])]


def _as_one(rows: Sequence[Row]) -> Row:
    """Combine the gaps of a case, filled with one database by one method, into one row."""
    filled = [row for row in rows if row.filled]

    def mean(name: str) -> float:
        weights = [row.filled for row in filled]
        values = [getattr(row, name) for row in filled]
        return float(np.average(values, weights=weights)) if filled else float("nan")

    return replace(
        rows[0],
        marker="",
        start=min(row.start for row in rows),
        frames=sum(row.frames for row in rows),
        filled=sum(row.filled for row in rows),
        error=mean("error"),
        linear=mean("linear"),
        expected_mean=mean("expected_mean"),
        below=sum(row.below for row in rows),
        below_gap=sum(row.below_gap for row in rows),
    )


def _length_class(row: Row) -> str:
    for low, high in pairwise(LENGTHS):
        if row.seconds <= high and row.kind != "dropout":
            return f"{low:g}-{high:g} s"
    return "whole clip" if row.kind == "dropout" else f"> {LENGTHS[-1]:g} s"


def _errors(rows: Sequence[Row]) -> list[object]:
    """Return the cells of a line of the table of errors."""
    some = [row for row in rows if row.filled]
    errors = np.array([row.error for row in some])
    left = sum(row.filled < row.frames for row in rows)
    if not some:
        return [len(rows), left, *[float("nan")] * 6]
    return [
        len(rows),
        left,
        geometric(errors),
        float(np.median(errors)),
        float(errors.mean()),
        float(np.percentile(errors, 95)),
        float(errors.max()),
        geometric(row.error / row.linear for row in some if row.linear > 0),
    ]


def print_errors(rows: Sequence[Row]) -> None:
    """Print errors by kind and by length, for each method and database."""
    columns = ("gaps", "left", "geo mm", "median", "mean", "95 %", "worst", "/ linear")
    for method, of_method in _by(rows, "method").items():
        lines = [
            (kind, database[0], *_errors(some))
            for kind, of_kind in _with_all(of_method)
            for database, some in _by(of_kind, "database").items()
        ]
        print_lines(
            f"Mean error of each gap, by {method[0]}", ("kind", "database", *columns), lines
        )
    by_length: dict[tuple[float, str], list[Row]] = {}
    for row in rows:
        order = row.seconds if row.kind != "dropout" else np.inf
        key = (float(np.searchsorted(LENGTHS, order)), _length_class(row))
        by_length.setdefault(key, []).append(row)
    lines = [
        (name, method, database, *_errors(some))
        for (_, name), of_length in sorted(by_length.items())
        for (method, database), some in _by(of_length, "method", "database").items()
    ]
    print_lines("By length of the gap", ("length", "method", "database", *columns), lines)


def print_ratios(rows: Sequence[Row]) -> None:
    """Print the ratio of errors with and without a database, gap by gap."""
    lines = []
    for kind, some in _with_all(rows):
        gaps = _by(some, "method", "case", "marker", "start").values()
        by_database = [{row.database: row for row in gap if row.error > 0} for gap in gaps]
        for method in dict.fromkeys(row.method for row in some):
            for database in DATABASES[1:]:
                ratio = [
                    gap[database].error / gap["none"].error
                    for gap in by_database
                    if {database, "none"} <= set(gap) and gap["none"].method == method
                ]
                if ratio:
                    hurts = share(r > MIN_RATIO for r in ratio)
                    names = (kind, method, f"{database} / none")
                    lines.append((*names, len(ratio), geometric(ratio), max(ratio), hurts))
    columns = ("kind", "method", "databases", "gaps", "geo", "worst", "harmful")
    print_lines("Ratio of errors with and without a database", columns, lines)


def print_uncertainty(rows: Sequence[Row]) -> None:
    """Print the coverage of the bounds, and how expected errors compare with true ones."""
    lines = []
    for (method, database), some in _by(rows, "method", "database").items():
        for kind, known in _with_all([r for r in some if r.filled and np.isfinite(r.bound)]):
            if not known:
                continue
            samples = sum(r.filled for r in known)
            # equal weight for each sample of a kind, and for each case of all kinds
            weights = [1.0 if kind == ALL else r.filled for r in known]
            below, below_gap = (
                np.average([getattr(r, name) / r.filled for r in known], weights=weights)
                for name in ("below", "below_gap")
            )
            ratio = np.array([r.expected_mean / r.error for r in known if r.error > 0])
            lines.append(
                (kind, method, database, len(known), samples,
                 f"{below:.1%}", f"{below_gap:.1%}",
                 share(r.below_gap >= 0.9 * r.filled for r in known),
                 geometric(ratio), share((ratio > 0.5) & (ratio < 2.0)),
                 _rank_correlation(known))
            )  # fmt: skip
    columns = ("kind", "method", "database", "gaps", "samples", "below bound", "below gap's",
               "gaps kept", "exp / true", "within x2", "rank corr")  # fmt: skip
    print_lines("Coverage of the 90 % bounds, and expected against true mean error", columns, lines)


def _rank_correlation(rows: Sequence[Row]) -> float:
    """Return Spearman's rank correlation of expected and true errors."""
    if len(rows) < 3:
        return float("nan")
    ranks = [
        np.argsort(np.argsort([getattr(r, name) for r in rows]))
        for name in ("expected_mean", "error")
    ]
    return float(np.corrcoef(*ranks)[0, 1])


def print_quality(rows: Sequence[Row]) -> None:
    """Print the share of gaps whose edges, jitter and feet are as in measured motion."""
    lines = []
    for (method, database), some in _by(rows, "method", "database").items():
        whole = [r for r in some if r.filled == r.frames]
        by_kind = [(kind, of_kind) for (kind,), of_kind in _by(whole, "kind").items()]
        for kind, of_kind in [*by_kind, ("all gaps", whole)]:
            edges = [r for r in of_kind if np.isfinite(r.edge) and np.isfinite(r.edge_reference)]
            shaking = [r for r in of_kind if np.isfinite(r.jitter)]
            amplitudes = [[r.jitter_mm, r.jitter_truth_mm] for r in shaking] or [[np.nan, np.nan]]
            feet = [r for r in of_kind if np.isfinite(r.penetration)]
            lines.append(
                (kind, method, database, len(of_kind),
                 share(r.edge <= r.edge_reference for r in edges),
                 share(r.edge_truth <= r.edge_reference for r in edges),
                 max((r.edge / r.edge_reference for r in edges), default=float("nan")),
                 share(r.jitter <= MAX_JITTER_RATIO or r.jitter_mm <= MAX_JITTER for r in shaking),
                 geometric(r.jitter for r in shaking), *map(float, np.median(amplitudes, axis=0)),
                 len(feet), share(r.penetration <= MAX_PENETRATION for r in feet),
                 share(r.penetration_truth <= MAX_PENETRATION for r in feet),
                 max((r.penetration for r in feet), default=float("nan")))
            )  # fmt: skip
    columns = ("kind", "method", "database", "gaps",
               "edge ok", "truth", "worst /usual",
               "jitter ok", "/truth", "mm", "truth mm",
               "feet", "above floor", "truth", "deepest mm")  # fmt: skip
    print_lines(
        "Quality. Edges: second differences up to the marker's 99th percentile. "
        f"Jitter: power above {MOTION_HZ:g} Hz up to {MAX_JITTER_RATIO:g} times that of the truth, "
        f"or {MAX_JITTER:g} mm rms. Feet: up to {MAX_PENETRATION:g} mm below the lowest measured",
        columns,
        lines,
    )


def print_worst(rows: Sequence[Row]) -> list[list[Row]]:
    """Print the worst cases, each with its worst database, and return their rows."""
    by_case: dict[tuple[str, str], list[list[Row]]] = {}
    for some in _by([r for r in rows if r.filled], "case", "database", "method").values():
        by_case.setdefault((some[0].case, some[0].method), []).append(some)
    worst = [max(several, key=_mean) for several in by_case.values()]
    worst.sort(key=_mean, reverse=True)
    lines = []
    for some in worst[:WORST_CASES]:
        frames = sum(r.filled for r in some)
        straight = sum(r.linear * r.filled for r in some if np.isfinite(r.linear)) / frames
        expected = sum(r.expected_mean * r.filled for r in some) / frames
        lines.append(
            (some[0].case, some[0].clip, some[0].window + min(r.start for r in some), len(some),
             max(r.frames for r in some), some[0].method, some[0].database, _mean(some), expected,
             _mean(some) / straight if straight > 0 else float("nan"))
        )  # fmt: skip
    columns = ("case", "clip", "frame", "gaps", "frames", "method", "database", "mm", "expected",
               "/ linear")  # fmt: skip
    print_lines(f"The worst {len(lines)} cases", columns, lines)
    return worst


def _mean(rows: Sequence[Row]) -> float:
    """Mean error over the filled samples of some gaps."""
    return sum(r.error * r.filled for r in rows) / sum(r.filled for r in rows)
