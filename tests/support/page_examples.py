"""Data of pages with every state of a sample, without a fill."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from priorfill.report.encode import encode_positions, encode_runs, encode_sparse
from priorfill.report.page import page_text

__all__ = ["HOSTILE", "crowded_data", "example_data", "write_page"]

FIRST_FRAME = 101
"""Number that the file gives its first frame."""

RATE = 100.0
"""Hz"""

HOSTILE = (
    "</script><img src=x onerror=alert(1)>",
    "<script>alert(2)</script>",
    "A" * 10_000,
    "\\u202eevil",
    "{{script}}",
    "\"'`&amp;<b>",
)
"""Labels that a page must show as text, as Python's `display` has made them."""

FILLED, REPLACED = 2, 4
SUBJECTS = ("Anna", "Ben")
LABELS = ("LKNE", "RKNE", "LANK", "RANK", "LTHI", "RTHI", "C7", "STRN")
"""Of both subjects together; the last two belong to the second one."""


def example_data(hostile: bool = False) -> dict[str, Any]:
    """Return data of eight markers and 600 frames: five gaps, all states, two subjects."""
    states = np.ones((600, len(LABELS)), dtype=np.int8)
    states[100:150, 0] = FILLED
    states[200:230, 1] = FILLED
    states[230:260, 1] = 0
    states[300:320, 2] = 3
    states[50:60, 3] = REPLACED
    states[400:450, 4] = 5
    states[500:540, 6] = FILLED
    states[120:160, 7] = FILLED
    spans = [(0, 100, 150), (1, 200, 260), (3, 50, 60), (6, 500, 540), (7, 120, 160)]
    errors = {0: 2.0, 1: 30.0, 3: 0.7, 6: 8.0, 7: 12.0}
    gaps = [_gap(states, marker, start, stop, errors[marker]) for marker, start, stop in spans]
    gaps[1]["warnings"] = [{"kind": "jump", "text": "The fill begins 24 mm from the path."}]
    gaps[1]["unfilled"] = [
        {"start": 230, "stop": 260, "reason": "nothing alike in the database", "requested": True}
    ]
    gaps[4]["warnings"] = [{"kind": "floor", "text": "The fill is 12 mm below the floor."}]
    labels = list(HOSTILE) + list(LABELS[len(HOSTILE) :]) if hostile else list(LABELS)
    data = _data(states, gaps, labels, errors)
    data["subjects"] = list(SUBJECTS)
    for marker in data["markers"][6:]:
        marker["subject"] = 1
    if hostile:
        data["title"] = "</title><script>alert(3)</script>.c3d"
        data["subjects"] = [HOSTILE[0], HOSTILE[1]]
        gaps[1]["warnings"] = [{"kind": HOSTILE[1], "text": HOSTILE[0]}]
        gaps[1]["sources"] = [HOSTILE[0]]
        data["facts"][0]["rows"].append([HOSTILE[0], HOSTILE[1]])
    return data


def crowded_data(markers: int, frames: int, count: int) -> dict[str, Any]:
    """Return data of many markers with `count` gaps in all."""
    rng = np.random.default_rng(7)
    states = np.ones((frames, markers), dtype=np.int8)
    each = count // markers
    spacing = frames // each
    gaps = []
    for marker in range(markers):
        for number in range(each):
            start = number * spacing + int(rng.integers(1, spacing // 2))
            stop = start + int(rng.integers(1, max(2, spacing // 3)))
            states[start:stop, marker] = FILLED
            gaps.append(_gap(states, marker, start, stop, float(rng.uniform(0.5, 40))))
    labels = [f"M{number:03d}" for number in range(markers)]
    return _data(states, gaps, labels, dict.fromkeys(range(markers), 5.0))


def write_page(data: dict[str, Any], path: Path) -> Path:
    """Write the page of the data, and return its path."""
    path.write_text(page_text(data), encoding="utf-8")
    return path


def _gap(states: np.ndarray, marker: int, start: int, stop: int, error: float) -> dict[str, Any]:
    filled = int(np.isin(states[start:stop, marker], (FILLED, REPLACED)).sum())
    return {
        "marker": marker,
        "start": start,
        "stop": stop,
        "filled": filled,
        "requested": True,
        "method": "gpr",
        "sources": ["the clip itself", "clips of other subjects"],
        "clips": ["walk 1", "walk 2"],
        "training_poses": 1200,
        "expected_mean": round(0.9 * error, 2),
        "expected_rms": error,
        "bound_90": 1.6 * error,
        "true_mean": None,
        "badness": 0,
        "warnings": [],
        "unfilled": [],
    }


def _data(
    states: np.ndarray, gaps: list[dict[str, Any]], labels: list[str], errors: dict[int, float]
) -> dict[str, Any]:
    """Return page data; the markers stand in rows and swing to and fro."""
    frames, markers = states.shape
    time = np.arange(frames)[:, None] / RATE
    place = np.arange(markers)
    positions = np.stack(
        [
            200 * np.sin(time + place),
            np.broadcast_to(60.0 * (place % 4), (frames, markers)),
            1500 - np.broadcast_to(170.0 * (place // 4 % 9), (frames, markers)),
        ],
        axis=-1,
    )
    positions[states == 0] = np.nan
    # what is incomplete first, then by expected error
    for rank, gap in enumerate(
        sorted(gaps, key=lambda g: (g["filled"] == g["stop"] - g["start"], -g["expected_mean"]))
    ):
        gap["badness"] = rank
    filled = (states == FILLED) | (states == REPLACED)
    rms = np.where(filled, np.array([errors.get(m, np.nan) for m in range(markers)]), np.nan)
    missing = (states == 0) | filled
    return {
        "format": 1,
        "mode": "report",
        "title": "walk.c3d",
        "clip": {
            "name": "walk",
            "file": "walk.c3d",
            "sha256": "0" * 64,
            "frames": frames,
            "rate": RATE,
            "first_frame": FIRST_FRAME,
            "up": "+Z",
            "unit": "mm",
        },
        "facts": [
            {"title": "Fill", "rows": [["Method", "gpr"], ["Database", "3 clips"]]},
            {"title": "Versions", "rows": [["priorfill", "1.0"]]},
        ],
        "subjects": [""],
        "markers": [
            {
                "label": label,
                "raw": label,
                "own": label,
                "subject": 0,
                "segment": "",
                "missing_before": int(missing[:, number].sum()),
                "missing_after": int((states[:, number] == 0).sum()),
            }
            for number, label in enumerate(labels)
        ],
        "sticks": [[0, 1], [2, 3]],
        "segments": [],
        "versions": [
            {"name": "filled", "kind": "filled", "positions": encode_positions(positions)}
        ],
        "states": encode_runs(states),
        "expected_rms": encode_sparse(rms, filled),
        "bound_90": encode_sparse(1.6 * rms, filled),
        "gaps": gaps,
        "methods": ["auto", "gpr", "linear"],
        "database_clips": [],
        "decisions": [],
        "can": {"refill": False, "save": False},
    }
