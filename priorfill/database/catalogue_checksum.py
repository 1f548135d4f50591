"""The checksum file of a catalogue, written when a writer closes it.

Rows have checksums of their own, but an SQLite file consists of more than rows. The checksum file
covers every byte. It names the state of the catalogue it belongs to by SQLite's change counter:
while a writer works, or after one was killed, there is no checksum of the present state, and rows
are checked one by one. A catalogue whose counter is below that of its checksum file was restored
from an older copy.
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from pathlib import Path

from priorfill.runtime.atomic_file import finish_file
from priorfill.runtime.held_files import retry_while_held

__all__ = ["SUFFIXES", "CatalogueChecksum"]

SUFFIXES = (".checksum", ".seal")
"""Suffixes of checksum files: of the present format version, and of version 2."""

_COUNTER = slice(24, 28)
_COUNTER_COPY = slice(92, 96)
"""Bytes of an SQLite file with its change counter, big-endian, and with the copy of it."""


MAX_BYTES = 1000
"""Maximum size of a checksum file, which takes 60 bytes."""


class CatalogueChecksum:
    """The checksum file of one catalogue.

    Parameters
    ----------
    catalogue : Path
        The SQLite file; the checksum file is in the same folder.
    version : int
        The format version.

    Attributes
    ----------
    path : Path
        The checksum file.
    problem : str
        Damage found by the last call of `matches`; empty if none.
    catalogue_is_damaged : bool
        Whether that damage is in the catalogue, not in the checksum file.
    refusal : OSError or None
        Why the system did not let the last call of `matches` read the checksum file.
    """

    def __init__(self, catalogue: Path, version: int) -> None:
        suffix = SUFFIXES[version == 2]
        # catalogue.sqlite.new, a catalogue being made, shares the name of the finished one
        self.path = catalogue.with_name(catalogue.name.partition(".")[0] + suffix)
        self.problem = ""
        self.catalogue_is_damaged = False
        self.refusal: OSError | None = None

    def matches(self, connection: sqlite3.Connection) -> bool:
        """Return whether the checksum covers the present state of the catalogue, and fits it.

        Parameters
        ----------
        connection : sqlite3.Connection
            Inside a transaction, so that no other process changes the file.
        """
        self.problem, self.catalogue_is_damaged, self.refusal = "", False, None
        try:
            if not self.path.is_file():  # a pipe would block
                raise FileNotFoundError
            with retry_while_held(lambda: self.path.open("rb")) as file:
                text = file.read(MAX_BYTES).decode("ascii")
        except FileNotFoundError:
            return False
        except OSError as error:
            self.refusal = error
            return False
        except ValueError:
            self.problem = f"{self.path} is damaged"
            return False
        # read through SQLite: opening and closing the file here would drop SQLite's locks on it
        data = connection.serialize()
        counter = int.from_bytes(data[_COUNTER])
        if counter != int.from_bytes(data[_COUNTER_COPY]):
            self.problem, self.catalogue_is_damaged = "its header was changed", True
            return False
        try:
            stored = json.loads(text)
            if _format(stored["counter"], stored["checksum"]) != text:
                raise ValueError
            is_older = counter < stored["counter"]
        except (ValueError, LookupError, TypeError, RecursionError):
            self.problem = f"{self.path} is damaged"
            return False
        if is_older:
            self.problem = f"it is older than {self.path.name}"
            self.catalogue_is_damaged = True
            return False
        if stored["counter"] != counter:
            return False
        if stored["checksum"] != zlib.crc32(data):
            self.problem = "its bytes changed after its last writer closed it"
            self.catalogue_is_damaged = True
            return False
        return True

    def write(self, connection: sqlite3.Connection) -> None:
        """Write the checksum of the present state of the catalogue."""
        data = connection.serialize()
        text = _format(int.from_bytes(data[_COUNTER]), zlib.crc32(data))
        if self.path.is_file() and self.path.read_bytes() == text.encode("ascii"):
            return
        unfinished = self.path.with_name(self.path.name + ".new")
        unfinished.write_bytes(text.encode("ascii"))  # on Windows, text would get other line ends
        finish_file(unfinished, self.path)


def _format(counter: int, checksum: int) -> str:
    content = {"counter": counter, "checksum": checksum}
    check = zlib.crc32(json.dumps(content).encode("ascii"))
    return json.dumps({**content, "check": check}) + "\n"
