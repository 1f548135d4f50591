"""The size that an array file may unpack to."""

from __future__ import annotations

from priorfill.errors import FormatError
from priorfill.formats.file_bytes import check_size

__all__ = ["check_unpacked"]

FREE_BYTES = 1 << 26
"""Unpacked size (bytes) that is always accepted: 64 MiB, 14 minutes of 50 markers at 100 Hz."""

MAX_RATIO = 200
"""Maximum compression ratio above `FREE_BYTES`. Measured positions shrink to a half or a tenth,
those of a recording that is mostly missing to a fiftieth; DEFLATE reaches 1032 on constant data."""


def check_unpacked(unpacked: int, packed: int, name: str) -> None:
    """Check how much a file unpacks to before memory is taken.

    Parameters
    ----------
    unpacked, packed : int
        Bytes after and before unpacking.
    name : str
        The file's name in messages.

    Raises
    ------
    FormatError
        If it unpacks to more than `priorfill.formats.file_bytes.MAX_BYTES`, or to more than
        recorded positions can.
    """
    check_size(unpacked, name)
    if unpacked > FREE_BYTES + MAX_RATIO * packed:
        raise FormatError(
            f"{name}: unpacks from {packed / 1e6:.3g} to {unpacked / 1e6:.3g} MB, more than a "
            "recording does; save it again, uncompressed"
        )
