"""Paths of the files shipped with priorfill, such as marker sets and the starter database."""

from __future__ import annotations

from pathlib import Path

__all__ = ["resource_path"]


def resource_path(*parts: str) -> Path:
    """Return the path of a file or folder shipped with priorfill.

    In an installed package it is below ``priorfill/_database``, in a checkout below ``database/``.

    Parameters
    ----------
    *parts : str
        Components of the path below ``database/``.

    Raises
    ------
    FileNotFoundError
        If it is in neither place: the installation is incomplete.

    Examples
    --------
    >>> resource_path("markersets", "baumann41.toml").name
    'baumann41.toml'
    """
    package = Path(__file__).resolve().parents[1]
    for root in (package / "_database", package.parent / "database"):
        path = root.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError(
        f"priorfill's file {'/'.join(parts)} is missing; install priorfill again"
    )
