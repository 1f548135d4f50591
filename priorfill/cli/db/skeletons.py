"""Read skeleton motions for a database, and compute virtual markers from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.errors import FormatError, MarkerSetError

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.markers.marker_set import MarkerSet

__all__ = ["SUFFIXES", "find_set", "is_skeleton", "read_joints", "read_skeleton"]

SUFFIXES = (".amc", ".bvh")
"""Lower-case suffixes of files with skeleton motions."""


def is_skeleton(path: Path) -> bool:
    """Return whether a file holds a skeleton motion, by its suffix."""
    return path.suffix.lower() in SUFFIXES


def find_set(name: str) -> MarkerSet:
    """Return the marker set of a name, a definition's path, or a number of markers.

    ``41`` selects the set whose name ends with 41.

    Raises
    ------
    MarkerSetError
        If there is none.
    """
    from priorfill.markers import definitions

    if not name.isdigit():
        return definitions.load(name)
    ending = [one for one in definitions.available() if one.endswith(name)]
    if len(ending) != 1:
        raise MarkerSetError(
            f"{name}: {'several marker sets end' if ending else 'no marker set ends'} with this "
            f"number; use one of {', '.join(definitions.available())}"
        )
    return definitions.load(ending[0])


def read_joints(file: Path) -> dict[str, str]:
    """Return the names of joints by part of the body, as the user's file gives them."""
    from priorfill.skeleton.joints_file import read_joint_names

    return read_joint_names(file)


def read_skeleton(
    path: Path,
    marker_set: MarkerSet,
    skeleton: Path | None,
    joints: dict[str, str] | None = None,
    *,
    up: str | None,
    rate: float | None,
    unit: str | None,
    **without_effect: bool,
) -> tuple[Clip, tuple[str, ...]]:
    """Read a skeleton motion and compute virtual markers from it.

    Parameters
    ----------
    path : Path
        AMC or BVH.
    marker_set : MarkerSet
        The markers to compute.
    skeleton : Path or None
        The ASF file of AMC files, in place of the one of the same name.
    joints : dict of str to str, optional
        Names of joints by part of the body.
    up, rate, unit
        Options of `priorfill.cli.reading.file_options`. The unit may be a number of mm.
    **without_effect
        The other options.

    Returns
    -------
    clip : Clip
        The markers.
    notes : tuple of str
        What was assumed about the file.

    Raises
    ------
    FormatError, ClipError
        If this file cannot be read.
    click.UsageError
        If an option is invalid.
    """
    from priorfill.formats.skeletons.asf_amc import find_asf, read_amc, read_asf
    from priorfill.formats.skeletons.bvh import read_bvh
    from priorfill.geometry.axes import UP_AXES
    from priorfill.skeleton.virtual_markers import compute_virtual_markers

    if up is not None and up not in UP_AXES:
        raise click.UsageError(f"up axis {up!r} is unknown; use one of {' '.join(UP_AXES)}")
    options: dict[str, Any] = {
        "rate": rate,
        "up": up,
        "joints": joints,
        "mm_per_unit": _millimetres(unit),
    }
    if path.suffix.lower() == ".bvh":
        motion = read_bvh(path)
        subject = ""
    else:
        asf = skeleton or find_asf(path)
        if asf is None:
            raise FormatError(
                f"{path}: its folder has no skeleton of the same name (.asf); give one (--skeleton)"
            )
        motion = read_amc(path, read_asf(asf))
        subject = asf.stem
    clip, notes = compute_virtual_markers(
        motion, marker_set, name=path.stem, file=str(path), **options
    )
    return replace(clip, subject=subject), notes


def _millimetres(unit: str | None) -> float | None:
    """Return the millimetres in a unit that the user gives."""
    from priorfill.formats.units import UNITS

    if unit is None:
        return None
    try:
        value = UNITS[unit] if unit in UNITS else float(unit)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise click.UsageError(
            f"unit {unit!r} is unknown; use one of {' '.join(UNITS)}, or a number of mm"
        )
    return value
