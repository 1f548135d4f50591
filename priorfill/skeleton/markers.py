"""Where markers sit on a body, as a data file says it."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MarkerSetError
from priorfill.runtime.resources import resource_path
from priorfill.skeleton.body import Body, part_frames
from priorfill.skeleton.joints import Placed
from priorfill.skeleton.part_names import PARTS

__all__ = ["Site", "known_sites", "positions_of"]


@dataclass(frozen=True)
class Site:
    """A part of a body that carries a marker, or one of two that do so together.

    Attributes
    ----------
    part : str
        One of `PARTS`.
    weight : float
        How much of the part's origin counts; those of a marker sum to 1.
    place : tuple of float
        Where the marker is in the part's frame, times the weight, in the part's sizes.
    """

    part: str
    weight: float
    place: tuple[float, float, float]


def known_sites(file: Path | None = None) -> dict[str, tuple[Site, ...]]:
    """Return the sites of each marker of which they are known.

    Parameters
    ----------
    file : Path, optional
        The data file; by default the one that ships with priorfill.

    Raises
    ------
    MarkerSetError
        Where it cannot be read.
    """
    file = resource_path("skeletons", "markers.toml") if file is None else file
    try:
        content: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
        sites = {label: tuple(map(_site, rows)) for label, rows in content["markers"].items()}
        for label, some in sites.items():
            if not some or not math.isclose(sum(s.weight for s in some), 1.0, abs_tol=1e-3):
                raise ValueError(f"the weights of {label} do not sum to 1")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MarkerSetError(f"{file}: does not say where markers sit ({error})") from error
    return sites


def _site(row: dict[str, Any]) -> Site:
    x, y, z = (float(value) for value in row["at"])
    if row["part"] not in PARTS:
        raise ValueError(f"part {row['part']!r} is unknown")
    return Site(row["part"], float(row.get("weight", 1.0)), (x, y, z))


def positions_of(
    sites: dict[str, tuple[Site, ...]], body: Body, placed: Placed, mm_per_unit: float
) -> NDArray[np.float64]:
    """Compute where markers are.

    Parameters
    ----------
    sites : dict of str to tuple of Site
        Of each marker, where it sits.
    body : Body
        The skeleton's body, in mm.
    placed : Placed
        Where the skeleton's joints are.
    mm_per_unit : float
        Millimetres in its unit of length.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        In the order of `sites`.
    """
    used = {site.part for some in sites.values() for site in some}
    frames = {part: part_frames(body.parts[part], placed, mm_per_unit) for part in used}
    positions = np.zeros((len(placed.places), len(sites), 3))
    for marker, some in enumerate(sites.values()):
        for site in some:
            origin, axes = frames[site.part]
            positions[:, marker] += site.weight * origin + axes @ np.array(site.place)
    return positions
