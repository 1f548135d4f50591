"""Read a catalogue on read-only media whose last writer was killed during a commit."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

__all__ = ["rolled_back_copy"]


def rolled_back_copy(catalogue: Path) -> sqlite3.Connection:
    """Return a connection to a copy in memory, as the catalogue was before that commit.

    SQLite undoes the commit by writing, which the media do not allow; the file and its journal are
    therefore copied, and undone there.

    Parameters
    ----------
    catalogue : Path
        The SQLite file.

    Raises
    ------
    sqlite3.Error
        If it is damaged.
    """
    # on Windows, a virus scanner may still have the copy open
    with tempfile.TemporaryDirectory(prefix="priorfill-", ignore_cleanup_errors=True) as folder:
        copy = Path(folder) / catalogue.name
        for name in (catalogue.name, f"{catalogue.name}-journal"):
            if catalogue.with_name(name).exists():
                shutil.copyfile(catalogue.with_name(name), copy.with_name(name))
        result = sqlite3.connect(":memory:", isolation_level=None)
        with closing(sqlite3.connect(copy, isolation_level=None)) as connection:
            connection.execute("PRAGMA user_version").fetchone()  # undoes the commit
            result.deserialize(connection.serialize())
    return result
