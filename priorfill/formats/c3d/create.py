"""Write a clip as a new C3D file, if its source is not one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OutputError, PriorfillError
from priorfill.formats.c3d.ezc3d_path import ezc3d_path
from priorfill.formats.c3d.layout import parse_layout, read_points
from priorfill.formats.write_report import WriteReport, check_filled, check_read_back
from priorfill.runtime.atomic_file import replace_file

__all__ = ["MAX_C3D_FRAMES", "create_c3d"]

MAX_C3D_FRAMES = 65535
_MAX_C3D_POINTS = 65535
"""Largest values of the format's 16 bit counts. ezc3d writes more without an error, and truncates
on reading."""

_RENUMBERED = f"frame {{}} becomes frame 1, because C3D numbers frames from 1 to {MAX_C3D_FRAMES}"

_MAX_C3D_TEXT = 255
"""Maximum length of a text of a parameter (bytes); its dimensions are single bytes."""

_SHOWN = 40
"""Characters of it in a message."""

_FLOAT_SCALE = -1.0
"""POINT:SCALE; negative for float coordinates."""

_MEASURED = 0.0
_MISSING = -1.0
"""Residuals. A clip has no residuals of its measured samples, so none are stated."""


def create_c3d(
    path: Path | str,
    clip: Clip,
    *,
    filled: NDArray[np.bool_] | None = None,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new C3D file with float coordinates in mm.

    Parameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; they must have a position. Measured and filled samples get
        residual 0, missing ones -1.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of filled samples, and the rounding error of 32 bit floats.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, a filled sample has no position, or the
        clip is longer than the format allows.

    See Also
    --------
    priorfill.write : Write a file of any format.
    """
    import ezc3d  # slow; imported late to keep `--help` fast

    if clip.frames > MAX_C3D_FRAMES or len(clip.labels) > _MAX_C3D_POINTS:
        raise OutputError(
            f"{clip.name}: has {clip.frames} frames of {len(clip.labels)} markers; "
            f"C3D holds {MAX_C3D_FRAMES} of each: cut the clip into parts"
        )
    for text in (*clip.labels, clip.subject):
        if len(text.encode("utf-8", "replace")) > _MAX_C3D_TEXT:
            raise OutputError(
                f"{clip.name}: the name {text[:_SHOWN]}... is longer than the "
                f"{_MAX_C3D_TEXT} bytes that C3D holds; write npz or mat, or rename it"
            )
    written = check_filled(clip, filled)
    missing = clip.missing.T
    points = np.ones((4, len(clip.labels), clip.frames))
    points[:3] = clip.positions.transpose(2, 1, 0)

    content = ezc3d.c3d()
    first = clip.first_frame if 1 <= clip.first_frame <= MAX_C3D_FRAMES - clip.frames + 1 else 1
    content["header"]["points"]["first_frame"] = first - 1  # ezc3d counts from 0
    point = content["parameters"]["POINT"]
    point["RATE"]["value"] = [clip.rate]
    point["UNITS"]["value"] = ["mm"]
    point["SCALE"]["value"] = [_FLOAT_SCALE]
    point["LABELS"]["value"] = list(clip.labels)
    content.add_parameter("POINT", "X_SCREEN", _screen_right(clip.up))
    content.add_parameter("POINT", "Y_SCREEN", clip.up)
    if clip.subject:
        content.add_parameter("SUBJECTS", "USED", [1])
        content.add_parameter("SUBJECTS", "USES_PREFIXES", [0])
        content.add_parameter("SUBJECTS", "NAMES", [clip.subject])
    content["data"]["points"] = points
    content["data"]["meta_points"]["residuals"] = np.where(missing, _MISSING, _MEASURED)[None]
    content["data"]["meta_points"]["camera_masks"] = np.zeros((7, *missing.shape), dtype=bool)
    with replace_file(path, overwrite=overwrite) as temporary:
        with ezc3d_path(temporary, write=True) as plain:
            content.write(plain)
        # ezc3d does not report an incomplete or failed write
        check_read_back(path, _holds(temporary, clip))
    values = clip.positions[written]
    rounded = values.astype(np.float32).astype(np.float64)
    return WriteReport(
        samples=len(values),
        rounding_mm=float(np.abs(rounded - values).max(initial=0.0)),
        changes=() if first == clip.first_frame else (_RENUMBERED.format(clip.first_frame),),
    )


def _holds(path: Path, clip: Clip) -> bool:
    """Check whether a file holds all positions of a clip."""
    data = path.read_bytes()
    try:
        layout = parse_layout(data, path.name)
        positions, residual = read_points(data, layout)
    except PriorfillError:
        return False
    positions[residual < 0] = np.nan
    return np.array_equal(
        positions.astype(np.float32), clip.positions.astype(np.float32), equal_nan=True
    )


def _screen_right(up: str) -> str:
    """Return an axis to display to the right if `up` is displayed upwards."""
    return "+Y" if up.endswith("X") else "+X"
