"""TRC files as OpenSim takes them: +Y up, names of its rules, and no blank cells.

OpenSim 4.6 refuses a row whose last cell is blank, and inverse kinematics refuses a name that
occurs twice; it passes over a marker that is NaN, but stops at a frame without any marker.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.formats.tables.trc import write_new_trc
from priorfill.formats.write_report import WriteReport
from priorfill.geometry.axes import from_upright, to_upright
from priorfill.runtime.option_texts import first_names

__all__ = ["create_opensim_trc", "opensim_labels"]

_UP = "+Y"
"""The axis that points up in OpenSim."""

_NOT_IN_NAMES = re.compile(r'[\s\\/*+"\0]+')
"""Characters that names of markers of an OpenSim model, or a TRC file, cannot have."""

_MAX_NAMED = 5
"""Markers in a note; more are counted."""


def create_opensim_trc(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a TRC file for OpenSim, in mm.

    The clip is turned by right angles so that +Y points up: X, Y, Z of a clip with +Z up become X,
    Z, -Y. Samples that are missing are NaN.

    Parameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; the file does not mark them.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of filled samples, the rounding error, and what a user should know.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, or a filled sample has no position.
    """
    labels = opensim_labels(clip.labels)
    turned = replace(
        clip,
        positions=from_upright(to_upright(clip.positions, clip.up), _UP),
        up=_UP,
        labels=labels,
        source=None,
    )
    report = write_new_trc(path, turned, filled, missing="NaN", overwrite=overwrite)
    return replace(report, notes=tuple(_notes(clip, labels)))


def opensim_labels(labels: Sequence[str]) -> tuple[str, ...]:
    """Return names of markers that OpenSim takes, each once.

    Parameters
    ----------
    labels : sequence of str
        The labels of a clip.

    Examples
    --------
    >>> opensim_labels(("L TOE", "RTOE", "L/TOE"))
    ('L_TOE', 'RTOE', 'L_TOE_2')
    """
    names: list[str] = []
    kept = {label for label in labels if not _NOT_IN_NAMES.search(label)}
    for label in labels:
        name = label
        if label not in kept:
            base = name = _NOT_IN_NAMES.sub("_", label)
            number = 2
            while name in names or name in kept:
                name = f"{base}_{number}"
                number += 1
        names.append(name)
    return tuple(names)


def _notes(clip: Clip, labels: Sequence[str]) -> list[str]:
    """Return what a user should know of the file."""
    notes = []
    if clip.up != _UP:
        notes.append(f"Turned for OpenSim, so that {clip.up} of the recording is {_UP}.")
    renamed = [
        f"{old} is {new}" for old, new in zip(clip.labels, labels, strict=True) if old != new
    ]
    if renamed:
        notes.append(f"Names of markers for OpenSim: {first_names(renamed, _MAX_NAMED)}.")
    empty = clip.missing.all(axis=1)
    gone = clip.missing[~empty]
    partly = [label for marker, label in enumerate(labels) if gone[:, marker].any()]
    if partly:
        notes.append(
            f"Samples that stay missing are NaN, which inverse kinematics passes over: "
            f"{first_names(partly, _MAX_NAMED)}."
        )
    if empty.any():
        times = np.flatnonzero(empty) / clip.rate
        notes.append(
            f"{int(empty.sum())} frames from {times[0]:.3f} to {times[-1]:.3f} s have no marker; "
            "OpenSim stops there, so choose a time range without them."
        )
    return notes
