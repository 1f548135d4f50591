"""Addresses of SQLite files."""

from __future__ import annotations

import os
from pathlib import PurePath
from urllib.parse import quote_from_bytes

__all__ = ["sqlite_address"]


def sqlite_address(path: PurePath, mode: str) -> str:
    r"""Return the URI by which SQLite opens a file.

    `Path.as_uri` does not serve: SQLite refuses the names of servers, which stand where it expects
    ``localhost``, in ``file://server/share/catalogue.sqlite``. With every separator encoded, SQLite
    passes the path to the system as it is, also ``\\server\share\...`` and ``\\?\C:\...``.

    Parameters
    ----------
    path : PurePath
        The file, absolute. SQLite would take a relative path for one from the current folder of
        the moment at which it reopens the file.
    mode : str
        ``ro`` to read, ``rw`` to change a file that exists.
    """
    return f"file:{quote_from_bytes(os.fsencode(path), safe='')}?mode={mode}"
