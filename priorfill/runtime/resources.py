"""Where the files are that ship with priorfill: marker sets and the starter database."""

from __future__ import annotations

from pathlib import Path

__all__ = ["resource_path"]


def resource_path(*parts: str) -> Path:
    """Return the path of a file or folder that ships with priorfill.

    It is inside the package once installed (``priorfill/_database``), and in ``database/``
    of a checkout.

    Parameters
    ----------
    *parts : str
        Path below ``database/``, piece by piece.

    Raises
    ------
    FileNotFoundError
        Where neither place has it: the installation is incomplete.
    """
    package = Path(__file__).resolve().parents[1]
    for root in (package / "_database", package.parent / "database"):
        path = root.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError(
        f"priorfill's own {'/'.join(parts)} is not installed; install priorfill again"
    )
