"""The seal of a catalogue: a checksum over every byte of it, made when a writer closes it.

Rows have checksums of their own, but a file holds more than rows. The seal names the state of
the file that it is for by SQLite's change counter: where a writer was killed, or is still at
work, there is none for the present state, and rows are checked one by one.
"""

from __future__ import annotations

import json
import os
import sqlite3
import zlib
from pathlib import Path

from priorfill.database.segments import sync_folder

__all__ = ["CatalogueChecksum"]

_COUNTER = slice(24, 28)
_COUNTER_AGAIN = slice(92, 96)
"""Where an SQLite file has its change counter, big-endian, and where it repeats it."""


class CatalogueChecksum:
    """The seal of one catalogue.

    Parameters
    ----------
    catalogue : Path
        The SQLite file; the seal lies beside it.

    Attributes
    ----------
    path : Path
        Where it lies.
    finding : str
        What was found wrong the last time that it was looked at; empty if nothing.
    denies : bool
        Whether that is the catalogue, and not the seal itself.
    """

    def __init__(self, catalogue: Path) -> None:
        # a catalogue that is being made has its seal ready
        self.path = catalogue.with_name(catalogue.name.partition(".")[0] + ".seal")
        self.finding = ""
        self.denies = False

    def fits(self, connection: sqlite3.Connection) -> bool:
        """Return whether the seal vouches for every byte of the file as it is.

        Parameters
        ----------
        connection : sqlite3.Connection
            Within a transaction, so that nobody changes the file meanwhile.
        """
        self.finding, self.denies = "", False
        try:
            text = self.path.read_text(encoding="ascii")
        except FileNotFoundError:
            return False
        except (OSError, ValueError):
            self.finding = f"{self.path} cannot be read"
            return False
        # read by SQLite: to open and close the file here would drop SQLite's locks on it
        data = connection.serialize()
        counter = int.from_bytes(data[_COUNTER])
        if counter != int.from_bytes(data[_COUNTER_AGAIN]):
            self.finding, self.denies = "its header was changed", True
            return False
        try:
            sealed = json.loads(text)
            if _of(sealed["counter"], sealed["checksum"]) != text:
                raise ValueError
        except (ValueError, KeyError, TypeError):
            self.finding = f"{self.path} is damaged"
            return False
        if sealed["counter"] != counter:
            return False
        if sealed["checksum"] != zlib.crc32(data):
            self.finding, self.denies = "bytes of it changed since it was sealed", True
            return False
        return True

    def renew(self, connection: sqlite3.Connection) -> None:
        """Seal the file as it is now."""
        data = connection.serialize()
        text = _of(int.from_bytes(data[_COUNTER]), zlib.crc32(data))
        if self.path.exists() and self.path.read_bytes() == text.encode("ascii"):
            return
        unfinished = self.path.with_name(self.path.name + ".new")
        with unfinished.open("w", encoding="ascii") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(self.path)
        sync_folder(self.path.parent)


def _of(counter: int, checksum: int) -> str:
    sealed = {"counter": counter, "checksum": checksum}
    check = zlib.crc32(json.dumps(sealed).encode("ascii"))
    return json.dumps({**sealed, "check": check}) + "\n"
