"""Where markers sit on a body, as a data file defines it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MarkerSetError, PriorfillError
from priorfill.runtime.resources import resource_path
from priorfill.runtime.toml_file import read_toml
from priorfill.skeleton.part_names import PARTS
from priorfill.skeleton.skeleton_body import PartFrame

__all__ = ["MarkerSite", "known_sites", "marker_positions"]


@dataclass(frozen=True)
class MarkerSite:
    """A part of a body that carries a marker, alone or together with another.

    Attributes
    ----------
    part : str
        One of `PARTS`.
    weight : float
        Weight of the part's origin; the weights of a marker's parts sum to 1.
    position : tuple of float
        Position of the marker in the part's frame, times the weight, in units of the part's sizes.
    """

    part: str
    weight: float
    position: tuple[float, float, float]


def known_sites(file: Path | None = None) -> dict[str, tuple[MarkerSite, ...]]:
    """Return the sites of each marker whose sites are known.

    Parameters
    ----------
    file : Path, optional
        The data file; by default the one shipped with priorfill.

    Raises
    ------
    MarkerSetError
        If it cannot be read.

    Examples
    --------
    >>> len(known_sites())
    41
    """
    file = resource_path("skeletons", "markers.toml") if file is None else file
    try:
        content = read_toml(file, MarkerSetError)
        sites = {label: tuple(map(_site, rows)) for label, rows in content["markers"].items()}
        for label, of_marker in sites.items():
            total = sum(site.weight for site in of_marker)
            if not of_marker or not math.isclose(total, 1.0, abs_tol=1e-3):
                raise ValueError(f"the weights of {label} do not sum to 1")
    except PriorfillError:  # some are ValueErrors
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MarkerSetError(
            f"{file}: is not a valid file of marker sites ({error}); correct it"
        ) from error
    return sites


def _site(row: dict[str, Any]) -> MarkerSite:
    x, y, z = (float(value) for value in row["at"])
    if row["part"] not in PARTS:
        raise ValueError(f"part {row['part']!r} is unknown")
    return MarkerSite(row["part"], float(row.get("weight", 1.0)), (x, y, z))


def marker_positions(
    sites: Mapping[str, tuple[MarkerSite, ...]], frames: Mapping[str, PartFrame]
) -> NDArray[np.float64]:
    """Compute the positions of markers.

    Parameters
    ----------
    sites : mapping of str to tuple of MarkerSite
        The sites of each marker.
    frames : mapping of str to PartFrame
        The frames of the skeleton's parts (`SkeletonBody.frames`).

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        In the order of `sites`.
    """
    positions = np.zeros((len(frames["pelvis"].origin), len(sites), 3))
    for marker, of_marker in enumerate(sites.values()):
        for site in of_marker:
            frame = frames[site.part]
            positions[:, marker] += site.weight * frame.origin + frame.axes @ site.position
    return positions
