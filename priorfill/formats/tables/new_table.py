"""The positions of a new table as text, and the check of what was written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport, check_read_back

__all__ = ["DECIMALS", "position_rows", "report_of_new_table"]

DECIMALS = 6
"""Decimals of coordinates in mm (nm), finer than the 32 bit floats of C3D."""

_STEP = 10.0**-DECIMALS
"""mm."""


def position_rows(clip: Clip, filled: NDArray[np.bool_], missing: str) -> list[str]:
    """Return the cells of each frame: X, Y and Z of each marker in mm, separated by tabs.

    Parameters
    ----------
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool]
        Which samples were filled.
    missing : str
        Contents of the cells of missing samples.
    """
    positions = clip.positions.copy()
    at_origin = filled & (np.abs(positions).max(axis=2) < _STEP)
    positions[at_origin] = (0, 0, _STEP)  # (0, 0, 0) would read as missing
    return [
        "\t".join(missing if value != value else f"{value:.{DECIMALS}f}" for value in row)
        for row in positions.reshape(clip.frames, -1).tolist()
    ]


def report_of_new_table(
    path: Path | str, again: Recording, clip: Clip, filled: NDArray[np.bool_]
) -> WriteReport:
    """Return the report on a new table, after a comparison with what was to be written.

    Parameters
    ----------
    path : Path or str
        The file in the message.
    again : Recording
        What was read from it.
    clip : Clip
        The clip that was written.
    filled : ndarray [shape=(frames, markers), bool]
        Which samples were filled.

    Raises
    ------
    OutputError
        If labels or positions differ by more than rounding.
    """
    check_read_back(
        path,
        again.labels == clip.labels
        and np.allclose(again.positions, clip.positions, rtol=0, atol=2 * _STEP, equal_nan=True),
    )
    worst = np.abs(again.positions - clip.positions)[filled]
    return WriteReport(samples=int(filled.sum()), rounding_mm=float(worst.max(initial=0.0)))
