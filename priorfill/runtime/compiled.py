"""Functions compiled by numba, and their cache on disk.

numba compiles a function when it is first called, and can keep the machine code next to the source
or in a folder of the user, so that the next process need not compile it. It raises an error if
it can write to neither or finds a damaged file, and runs the code of a file without checking it.
With `compiled`, such a function is compiled in memory instead, and `cache_problem` returns why.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import config, njit
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.misc.appdirs import AppDirs

from priorfill.runtime.atomic_file import check_writable
from priorfill.runtime.held_files import WINDOWS, is_held

__all__ = ["ENTRY", "HELPER", "cache_problem", "compiled"]

_Function = TypeVar("_Function", bound=Callable[..., Any])

ENTRY: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Options of functions called from Python: no C wrapper, no check of each division. Unneeded
wrappers and checks lengthen the compilation, for which the user waits."""

HELPER: dict[str, Any] = {**ENTRY, "no_cpython_wrapper": True}
"""Options of functions called only from compiled ones: no Python wrapper either."""

_DIGEST_BYTES = hashlib.sha256().digest_size

_problems: list[str] = []


def compiled(options: dict[str, Any], **more: Any) -> Callable[[_Function], _Function]:
    """Return a decorator that compiles a function and keeps its code on disk where possible.

    Parameters
    ----------
    options : dict
        `ENTRY` or `HELPER`.
    **more
        Other options of `numba.njit`.
    """

    def decorate(function: _Function) -> _Function:
        dispatcher: _Function = njit(**options, **more)(function)
        if WINDOWS:
            _choose_folder(Path(function.__code__.co_filename).parent)
        try:
            # what njit(cache=True) does with numba's own class
            dispatcher._cache = _TolerantCache(function)  # type: ignore[attr-defined]
        except RuntimeError:
            _problems.append("neither the program's folder nor the user's can be written")
        except OSError as error:
            _report(error)
        return dispatcher

    return decorate


def cache_problem() -> str:
    """Return why compiled code could not be kept on disk; empty if it could."""
    return _problems[0] if _problems else ""


@cache
def _choose_folder(source: Path) -> None:
    """Name the user's folder to numba if the one of the source takes no files.

    numba would find out for each function with `tempfile`, which tries 10,000 names on Windows.
    """
    settings: Any = config
    if not settings.CACHE_DIR and not _takes_files(source / "__pycache__"):
        settings.CACHE_DIR = AppDirs(appname="numba", appauthor=False).user_cache_dir


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(exist_ok=True)
        check_writable(folder / "x", 0)
    except OSError:
        return False
    return True


def _report(error: OSError) -> None:
    if is_held(error):  # another process reads or writes the same file
        return
    where = f"{Path(error.filename).parent}: " if error.filename is not None else ""
    _problems.append(f"{where}{error.strerror or error}")


class _CheckedFile(IndexDataCacheFile):
    """The files of one function, with checksums: unpickling a damaged file may do anything."""

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_index(self) -> dict[Any, str]:
        if not Path(self._index_path).exists():
            return {}
        version, stamp, overloads = self._read(self._index_path)
        is_current = (version, stamp) == (self._version, self._source_stamp)
        return dict(overloads) if is_current else {}

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _load_data(self, name: str) -> Any:
        return self._read(self._data_path(name))

    def _write(self, path: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(path) as file:
            file.write(hashlib.sha256(content).digest() + content)

    def _read(self, path: str) -> Any:
        if not Path(path).is_file():  # a pipe would block
            raise OSError(f"{path} is not a file")
        stored = Path(path).read_bytes()
        digest, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
        if hashlib.sha256(content).digest() != digest:
            raise OSError(f"{path} is damaged")  # then numba compiles the function again
        return pickle.loads(content)


class _TolerantCache(FunctionCache):
    """A cache of one function that the program can do without."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # the index is damaged, or code in it does not fit
            try:
                self.flush()  # an empty index in its place
            except OSError as error:
                _report(error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _report(error)
