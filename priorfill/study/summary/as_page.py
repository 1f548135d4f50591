"""The page of a summary: one file of markup, style, scripts and data that needs no network."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from priorfill.report.page import REPORT_FOLDER, PageFiles, page_text
from priorfill.report.shown_text import MAX_LABEL, message_text, shown
from priorfill.study.summary.rule import GROUPS

__all__ = [
    "MAX_MARKERS",
    "PAGE_MARK",
    "SHARED_SCRIPTS",
    "STUDY_FOLDER",
    "STUDY_SCRIPTS",
    "summary_page",
]

STUDY_FOLDER = Path(__file__).parent / "page"
"""Markup, style and scripts of the page of a summary."""

SHARED_SCRIPTS = ("dom.js", "theme.js")
"""Scripts of a report that the page of a summary uses, too."""

STUDY_SCRIPTS = (
    "study_store.js", "list_table.js", "study_headline.js", "attention_lists.js",
    "trial_columns.js", "trial_table.js", "trial_detail.js", "marker_columns.js",
    "marker_map_input.js", "marker_map.js", "part_columns.js", "study_main.js",
)  # fmt: skip
"""Scripts of the page of a summary, in their order; only the last one does anything at once."""

PAGE_MARK = '<meta name="generator" content="priorfill study summary">'
"""By which the page of a summary is recognised."""

MAX_NAME = 200
"""Characters of a path that the page shows."""

MAX_MARKERS = 400
"""Markers that the page shows; files without labels number thousands of them."""

MAX_WARNINGS = 12
"""Warnings of a trial that the page shows; its report has all."""


def summary_page(values: Mapping[str, Any]) -> str:
    """Return the page of a summary, as one HTML document.

    Parameters
    ----------
    values : mapping
        As from `summary_json`.
    """
    labels = [one["marker"] for one in values["markers"][:MAX_MARKERS]]
    index = {label: number for number, label in enumerate(labels)}
    parts = {
        name: {one[key]: number for number, one in enumerate(values[name])}
        for name, key in (("folders", "folder"), ("subjects", "subject"))
    }
    data = {
        "format": 1,
        "title": f"{shown(values['study'], MAX_LABEL)} - summary",
        "study": shown(values["study"], MAX_LABEL),
        "sentence": values["sentence"],
        "to_do": values["to_do"],
        "groups": [
            {"name": name, "count": values["groups"][name], "rule": values["rule"][name]}
            for name in GROUPS
        ],
        "waiting": [shown(name, MAX_NAME) for name in values["waiting"]],
        "seconds": values["seconds"],
        "facts": [[shown(name, MAX_LABEL), shown(text)] for name, text in values["facts"].items()],
        "limits": values["limits"],
        "folders": [_part(one, one["folder"], one["subjects"]) for one in values["folders"]],
        "subjects": [_part(one, one["subject"], one["folders"]) for one in values["subjects"]],
        "markers": [
            {**one, "marker": shown(one["marker"], MAX_LABEL), "absent_in": len(one["absent_in"])}
            for one in values["markers"][:MAX_MARKERS]
        ],
        "more_markers": max(0, len(values["markers"]) - MAX_MARKERS),
        "trials": [_trial(one, parts, index) for one in values["trials"]],
    }
    return page_text(data, _page_files())


@lru_cache(maxsize=1)
def _page_files() -> PageFiles:
    return PageFiles(
        template=STUDY_FOLDER / "study.html",
        sheets=(REPORT_FOLDER / "page.css", STUDY_FOLDER / "study.css"),
        scripts=(
            *(REPORT_FOLDER / name for name in SHARED_SCRIPTS),
            *(STUDY_FOLDER / name for name in STUDY_SCRIPTS),
        ),
    )


def _part(one: Mapping[str, Any], name: str, others: Sequence[str]) -> dict[str, Any]:
    """Return what the page needs of a folder with its subjects, or the other way round."""
    kept = (
        "trials",
        "groups",
        "missing_share",
        "left_samples",
        "expected_mean_error_mm",
        "seconds",
    )
    return {
        "name": shown(name, MAX_NAME),
        "others": [shown(other, MAX_NAME) for other in others],
        "worst_marker": shown(one["worst_marker"] or "", MAX_LABEL),
        "absent_markers": [shown(label, MAX_LABEL) for label in one["absent_markers"]],
        **{key: one[key] for key in kept},
    }


def _trial(
    one: Mapping[str, Any], parts: Mapping[str, Mapping[str, int]], index: Mapping[str, int]
) -> dict[str, Any]:
    """Return what the page needs of a trial, under short names: there can be ten thousand."""
    return {
        "name": shown(one["name"], MAX_NAME),
        "folder": parts["folders"][one["folder"]],
        "subjects": [parts["subjects"][name] for name in dict.fromkeys(one["subjects"])],
        "group": GROUPS.index(one["group"]),
        "status": one["status"],
        "again": one["try_again"],
        "reasons": [message_text(text) for text in one["reasons"]],
        "gaps": one["gaps"],
        "missing": one["missing_samples"],
        "share": one["missing_share"],
        "filled": one["filled_samples"],
        "left": one["left_samples"],
        "kept": one["kept_samples"],
        "error": one["expected_mean_error_mm"],
        "bound": one["error_bound_90_mm"],
        "longest": _gap(one["longest_gap"]),
        "worst": _gap(one["least_certain_gap"]),
        "alone": [
            [left["samples"], message_text(left["reason"])]
            for left in one["left"]
            if not left["requested"]
        ],
        "artefacts": sum(one["artefacts"].values()),
        "warnings": len(one["warnings"]),
        "warned": [message_text(text) for text in one["warnings"][:MAX_WARNINGS]],
        "notes": [message_text(text) for text in one["notes"]],
        "method": shown(one["method"] or "", MAX_LABEL),
        "seconds": one["seconds"],
        "memory": one["peak_memory"],
        "links": {
            name: link(one[name])
            for name in ("report", "output", "uncertainty", "source")
            if one[name]
        },
        # numbers of the marker, its frames, and hundredths of a percent of the frames; whether some
        # stay missing
        "markers": [
            number
            for marker in one["markers"]
            if marker["marker"] in index
            for number in (
                index[marker["marker"]],
                marker["missing_frames"],
                round(1e4 * (marker["missing_share"] or 0.0)),
                int(marker["left_frames"] > 0),
            )
        ],
    }


def _gap(gap: Mapping[str, Any] | None) -> list[Any] | None:
    """Return marker, first and last frame, length (s) and expected error (mm) of a gap."""
    if gap is None:
        return None
    return [
        shown(gap["marker"], MAX_LABEL),
        gap["first_frame"],
        gap["last_frame"],
        gap["seconds"],
        gap["expected_mean_error_mm"],
    ]


def link(path: str) -> str:
    """Return a path as an address that a browser opens from the page, and that is no script.

    Parameters
    ----------
    path : str
        With ``/``, relative to the page or absolute.

    Examples
    --------
    >>> link("P01/my walk#2.html"), link("javascript:alert(1)")
    ('./P01/my%20walk%232.html', './javascript%3Aalert%281%29')
    >>> link("D:/out/a.html")
    'file:///D:/out/a.html'
    """
    quoted = quote(os.fsencode(path), safe="/")
    if path.startswith("//"):  # a share of Windows
        return f"file:{quoted}"
    if path.startswith("/"):
        return f"file://{quoted}"
    if path[1:3] == ":/":
        return f"file:///{path[0]}:{quoted[4:]}"
    return quoted if path.startswith("../") else f"./{quoted}"
