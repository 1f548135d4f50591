"""Machine code of compiled functions on disk.

A file is a checksum, the hash of what the code is made from, and the code. It is next to the
source, in ``__pycache__``, or in the user's folder for caches if that takes no files; the
environment variable `VARIABLE` names another folder.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import check_writable, replace_file
from priorfill.runtime.held_files import is_held

__all__ = ["VARIABLE", "CodeKey", "find", "keep", "problem"]

VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable with a folder for compiled code."""

SUFFIX = ".code"

_DIGEST_BYTES = hashlib.sha256().digest_size

_problems: list[str] = []


@dataclass(frozen=True)
class CodeKey:
    """What the code of a function is found by.

    Parameters
    ----------
    folder : Path
        Of its source.
    name : str
        Of its module and itself.
    variant : str
        Types of arguments, versions, processor: each has a file of its own.
    digest : bytes
        Hash of its source: a file with another one is replaced.
    """

    folder: Path
    name: str
    variant: str
    digest: bytes

    @property
    def file_name(self) -> str:
        """Name of its file."""
        return f"{self.name}-{hashlib.sha256(self.variant.encode()).hexdigest()[:20]}{SUFFIX}"


def problem() -> str:
    """Return why code could not be kept; empty if it could."""
    return _problems[0] if _problems else ""


def find(key: CodeKey) -> bytes | None:
    """Return the code of a function; None if there is none, or it is damaged."""
    for folder in _folders(key.folder):
        code = _read(folder / key.file_name, key.digest)
        if code is not None:
            return code
    return None


def keep(key: CodeKey, code: bytes) -> None:
    """Write the code of a function into the first folder that takes it."""
    content = key.digest + code
    reason = ""
    for folder in _folders(key.folder):
        try:
            with replace_file(folder / key.file_name, overwrite=True) as temporary:
                temporary.write_bytes(hashlib.sha256(content).digest() + content)
        except (OSError, OutputError) as error:
            cause = error.__cause__ or error
            if isinstance(cause, OSError) and is_held(cause) and _takes_files(folder):
                return  # another process reads or writes the same file
            reason = f"{folder}: {getattr(cause, 'strerror', None) or error}"
        else:
            return
    _problems.append(reason)


def _read(path: Path, digest: bytes) -> bytes | None:
    try:
        if not path.is_file():  # a pipe would block
            return None
        stored = path.read_bytes()
    except OSError:
        return None
    checksum, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != checksum or not content.startswith(digest):
        return None
    return content[len(digest) :]


def _takes_files(folder: Path) -> bool:
    try:
        check_writable(folder / "x", 0)
    except (OSError, OutputError):
        return False
    return True


def _folders(source: Path) -> Iterator[Path]:
    """Yield the folders that may have the code, the first choice first."""
    if named := os.environ.get(VARIABLE):
        yield Path(named)
        return
    if source.is_dir():
        yield source / "__pycache__"
    from platformdirs import user_cache_path  # slow to import

    yield user_cache_path("priorfill", appauthor=False)
