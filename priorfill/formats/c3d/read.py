"""Read C3D files.

A strict parser checks the layout, then the points are read from where the layout places them. No
library is used: ezc3d returns the same positions for the files that it can read, but takes forty
times as long, reads a truncated file as a shorter one, cannot read others (MIPS, non-ASCII bytes in
a parameter, more than 65535 frames), and hangs or crashes on malformed ones.
"""

from __future__ import annotations

import re
from pathlib import Path

from priorfill.clip import Clip
from priorfill.formats.c3d.layout import parse_layout, read_points
from priorfill.formats.c3d.parameters import C3DParameters, is_c3d
from priorfill.formats.file_bytes import read_bytes
from priorfill.formats.recording import ReadOptions, Recording, clip_from_file

__all__ = ["parse_c3d", "read_c3d", "read_c3d_bytes"]

MAX_C3D_BYTES = 4_000_000_000
"""Size limit of a file: 11 hours of 50 markers at 120 Hz. A fill takes ten times that in memory."""

_QUALISYS = re.compile(r"qualisys|\bQTM\b", re.IGNORECASE)
"""Makers of files in which the sign of the screen axes has no meaning."""

_OUTPUT_GROUPS = (
    *("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "BONES"),
    "MODELED_MARKERS",
)
"""POINT parameters that list model outputs; TYPE_GROUPS may name more."""

_MEASURED_GROUPS = frozenset({"MARKERS", "POINTS", "LABELS", "TYPE_GROUPS", "DESCRIPTIONS"})
"""Names in TYPE_GROUPS of lists that hold measured points."""


def read_c3d(
    path: Path | str,
    *,
    zeros_missing: bool = True,
    up: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    ignore_residuals: bool = False,
) -> Clip:
    """Read the markers of a C3D file.

    Parameters
    ----------
    path : Path or str
        The file.
    zeros_missing : bool
        Treat samples at exactly (0, 0, 0) with a valid residual as missing, because several
        programs write missing samples this way.
    up : str or None
        The axis that points up, one of `priorfill.geometry.axes.UP_AXES`; found if None.
    rate : float or None
        Frame rate (Hz) that replaces the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) that replaces the file's.
    subject : str or None
        The subject whose markers are read, if the file holds several.
    ignore_residuals : bool
        Take samples as measured whose residual in the file marks them as missing.

    Returns
    -------
    Clip
        The markers in mm. Its source lists the points left out, with the reasons.

    Raises
    ------
    FormatError
        If the file does not exist, or is not C3D, damaged or truncated.
    ClipError
        If the contents are unusable: no points, no frames, no rate, an infinite coordinate, no
        labelled marker, an implausible unit, an unknown subject, or several subjects and none
        chosen (MultipleSubjectsError).
    OptionError
        If an option is out of range.

    See Also
    --------
    priorfill.read : Read a file of any format.
    priorfill.formats.write_c3d : Write a copy of the file with the gaps filled.
    """
    options = ReadOptions(zeros_missing, up, rate, unit, subject, ignore_residuals)
    return clip_from_file(Path(path), options, "c3d", parse_c3d, read_c3d_bytes)


def parse_c3d(data: bytes, name: str) -> Recording:
    """Parse the contents of a C3D file.

    Parameters
    ----------
    data : bytes
        The whole file.
    name : str
        The file's name in messages.

    Returns
    -------
    Recording
        All points, with the residuals of the samples.

    Raises
    ------
    FormatError
        If the file is not C3D, damaged or truncated.
    ClipError
        If it has no points or no frames.
    """
    layout = parse_layout(data, name)
    positions, residuals = read_points(data, layout)
    parameters = layout.parameters
    return Recording(
        positions,
        layout.labels,
        layout.rate or None,
        next(iter(parameters.texts("POINT", "UNITS")), ""),
        first_frame=layout.first_frame,
        up=next(iter(parameters.texts("POINT", "Y_SCREEN")), ""),
        up_sign_declared=not _is_from_qualisys(parameters),
        prefixes=tuple(parameters.texts("SUBJECTS", "LABEL_PREFIXES")),
        subjects=tuple(text for text in parameters.texts("SUBJECTS", "NAMES") if text),
        model_outputs=declared_model_outputs(parameters),
        notes=layout.contradictions + layout.notes,
        residuals=residuals,
    )


def read_c3d_bytes(path: Path) -> bytes:
    """Return a file's contents, or only its first block if the file is not C3D.

    Raises
    ------
    FormatError
        If the file does not exist, cannot be read, or exceeds `MAX_C3D_BYTES`.
    """
    return read_bytes(path, max_bytes=MAX_C3D_BYTES, accept=is_c3d)


def _is_from_qualisys(parameters: C3DParameters) -> bool:
    """Check whether a program of Qualisys wrote the file: it exports -X and -Z where +Z is up."""
    makers = [
        text
        for name in ("COMPANY", "SOFTWARE", "MANUFACTURER", "NAME")
        for text in parameters.texts("MANUFACTURER", name)
    ]
    if any(makers):
        return any(_QUALISYS.search(text) for text in makers)
    # programs that save such a file again may drop the group MANUFACTURER
    return (
        next(iter(parameters.texts("POINT", "X_SCREEN")), "").strip().upper(),
        next(iter(parameters.texts("POINT", "Y_SCREEN")), "").strip().upper(),
    ) == ("-X", "-Z")


def declared_model_outputs(parameters: C3DParameters) -> dict[str, str]:
    """Return the labels that a file lists as model outputs, each with the reason."""
    groups = dict.fromkeys((*_OUTPUT_GROUPS, *parameters.texts("POINT", "TYPE_GROUPS")))
    return {
        label: f"model output (POINT:{group})"
        for group in groups
        if group not in _MEASURED_GROUPS
        for label in parameters.texts("POINT", group.upper())
        if label
    }
