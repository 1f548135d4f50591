"""Files of motion capture: read them into clips, write clips into them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError, OptionError
from priorfill.formats.atomic import check_target
from priorfill.formats.c3d_new import create_c3d
from priorfill.formats.c3d_patch import WriteReport, write_c3d
from priorfill.formats.c3d_read import read_c3d
from priorfill.formats.npz_new import create_npz
from priorfill.formats.uncertainty import (
    UNCERTAINTY_SUFFIXES,
    check_uncertainty,
    uncertainty_file,
    write_uncertainty,
)

__all__ = [
    "SUFFIXES",
    "UNCERTAINTY_SUFFIXES",
    "WriteReport",
    "check_output",
    "check_uncertainty",
    "create_c3d",
    "create_npz",
    "read",
    "read_c3d",
    "uncertainty_file",
    "write",
    "write_c3d",
    "write_uncertainty",
]

SUFFIXES = (".c3d",)
"""Suffixes of the files that can be read and written, lower case."""


def read(
    path: Path | str,
    *,
    zeros_missing: bool = True,
    up: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> Clip:
    """Read the markers of a motion-capture file.

    Parameters
    ----------
    path : Path or str
        The file; its suffix tells the format.
    zeros_missing : bool
        Take samples that are exactly (0, 0, 0) as missing.
    up : str or None
        Which axis points up, instead of finding it.
    rate : float or None
        Frames per second (Hz) instead of the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) instead of the file's.
    subject : str or None
        Whose markers to read, where the file holds several subjects.

    Returns
    -------
    Clip
        The markers in mm.

    Raises
    ------
    FormatError
        If the file is absent, of an unknown format, damaged or cut short.
    ClipError
        If its contents make no sense.
    OptionError
        If an option is out of range.
    """
    path = Path(path)
    if path.is_dir():
        raise FormatError(f"{path}: is a folder; give the name of a file")
    if not path.exists():
        raise FormatError(f"{path}: there is no such file; check the name")
    _check_suffix(path)
    return read_c3d(path, zeros_missing=zeros_missing, up=up, rate=rate, unit=unit, subject=subject)


def write(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip.

    A clip that was read from a C3D file is written as a copy of that file in which only the
    filled samples differ; any other clip as a new file.

    Parameters
    ----------
    path : Path or str
        The file to write; its suffix tells the format.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; needed if the clip was read from a file.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        What was written.

    Raises
    ------
    FormatError
        If the format is unknown, or the source cannot be read any more.
    OptionError
        If the clip was read from a file and `filled` is not given.
    OutputError
        If the file cannot be written, exists already, or is the clip's own source.
    """
    path = Path(path)
    _check_suffix(path)
    if clip.source is not None and clip.source.path.suffix.lower() in SUFFIXES:
        if filled is None:
            raise OptionError(
                f"{clip.name}: was read from a file, of which a copy is written; "
                "say which samples are filled"
            )
        return write_c3d(path, clip, filled, overwrite=overwrite)
    return create_c3d(path, clip, filled=filled, overwrite=overwrite)


def check_output(path: Path | str, *, source: Path, overwrite: bool = False) -> None:
    """Find out, before the work is done, whether its result can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    source : Path
        The file that will be read, which it must not be.
    overwrite : bool
        Whether it may replace an existing file.

    Raises
    ------
    FormatError
        If the format is unknown.
    OutputError
        If the folder is missing, the file exists already, or is the source.
    """
    _check_suffix(Path(path))
    check_target(path, overwrite=overwrite, source=source)


def _check_suffix(path: Path) -> None:
    """Raise FormatError if the suffix is of no known format."""
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(
            f"{path}: the suffix {path.suffix or '(none)'!r} is unknown; "
            f"known are {', '.join(SUFFIXES)}"
        )
