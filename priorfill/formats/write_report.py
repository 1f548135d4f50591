"""What all writers share: the report they return, and checks of samples and of the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OutputError

__all__ = ["WriteReport", "check_filled", "check_read_back"]


@dataclass(frozen=True)
class WriteReport:
    """Outcome of writing a file.

    Attributes
    ----------
    samples : int
        Number of filled samples written.
    rounding_mm : float
        Largest change of a coordinate (mm) due to rounding to the file's number format.
    changes : tuple of str
        Differences between the file and its source other than the filled samples.
    notes : tuple of str
        What a user should know of the file, one sentence each.

    See Also
    --------
    priorfill.write
    """

    samples: int
    rounding_mm: float
    changes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def check_filled(clip: Clip, filled: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """Return the mask of filled samples; all False if None is given.

    Parameters
    ----------
    clip : Clip
        The clip, with positions for the filled samples.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled.

    Returns
    -------
    ndarray [shape=(frames, markers), bool]
        The mask.

    Raises
    ------
    OutputError
        If the shape is wrong, or a filled sample has no position.
    """
    if filled is None:
        return np.zeros_like(clip.missing)
    filled = np.asarray(filled, dtype=bool)
    if filled.shape != clip.missing.shape:
        raise OutputError(
            f"{clip.name}: the mask of filled samples has shape {filled.shape}; "
            f"{clip.missing.shape} (frames, markers) is needed"
        )
    without = filled & clip.missing
    if without.any():
        frame, marker = np.argwhere(without)[0]
        raise OutputError(
            f"{clip.name}: marker {clip.labels[marker]} is marked as filled in frame "
            f"{clip.first_frame + int(frame)} but has no position; mark only samples that have one"
        )
    return filled


def check_read_back(path: Path | str, as_intended: bool) -> None:
    """Raise an error if a file that was written does not hold what it should.

    Parameters
    ----------
    path : Path or str
        The file, which the caller removes after an error.
    as_intended : bool
        Whether reading it gave what was written.

    Raises
    ------
    OutputError
        If not.
    """
    if not as_intended:
        raise OutputError(
            f"{path}: the file does not read back as intended and was removed; "
            "check the folder's permissions and space"
        )
