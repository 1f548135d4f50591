"""Files of motion capture: read them into clips, write clips into them.

`FORMATS` says which there are. A file's suffix tells its format; where several share a suffix, what
it begins with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError, OptionError
from priorfill.formats.arrays.mat import create_mat, parse_mat, recognise_mat
from priorfill.formats.arrays.npz import create_npz_clip, parse_npz, recognise_npz
from priorfill.formats.c3d.create import create_c3d
from priorfill.formats.c3d.patch import write_c3d
from priorfill.formats.c3d.read import parse_c3d, read_c3d, read_c3d_bytes
from priorfill.formats.c3d.rewrite import rewrite_c3d
from priorfill.formats.file_bytes import read_bounded
from priorfill.formats.recording import ReadOptions, Recording, clip_from_file
from priorfill.formats.tables.motive_csv import parse_motive, recognise_motive
from priorfill.formats.tables.nexus_csv import parse_nexus, recognise_nexus
from priorfill.formats.tables.qualisys_tsv import parse_qualisys, recognise_qualisys
from priorfill.formats.tables.text_table import TableRecording, write_table
from priorfill.formats.tables.trc import create_trc, parse_trc, recognise_trc
from priorfill.formats.write_report import WriteReport
from priorfill.runtime.atomic_file import check_target
from priorfill.runtime.npz_file import create_npz

__all__ = [
    "FORMATS",
    "SUFFIXES",
    "Format",
    "WriteReport",
    "check_output",
    "create_c3d",
    "create_npz",
    "format_of",
    "read",
    "read_c3d",
    "recognised",
    "rewrite_c3d",
    "write",
    "write_c3d",
]

_HEAD = 1 << 16
"""Bytes of a text file that tell its format."""

_READ_AND_WRITTEN = ("c3d", "trc", "npz", "mat")
"""Formats that a new file can have, for messages."""


@dataclass(frozen=True)
class Format:
    """A format of files.

    Attributes
    ----------
    title : str
        What it is called in messages.
    suffixes : tuple of str
        Its suffixes, lower case.
    read : callable
        Reads the markers of a file.
    recognise : callable
        Tells by its path if a file is one, or none of others that share the suffix.
    copy : callable or None
        Writes a clip that was read from such a file as a copy with the filled samples, all else
        as it was.
    create : callable or None
        Writes any clip as a new file.
    rewrite : callable or None
        As `copy`, but writes everything anew, and says what that changes.
    alone : bool
        Whether its suffixes are used for recordings only: no look into the file is needed.
    """

    title: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Clip]
    recognise: Callable[[Path], bool]
    copy: Callable[..., WriteReport] | None = None
    create: Callable[..., WriteReport] | None = None
    rewrite: Callable[..., WriteReport] | None = None
    alone: bool = False


def _by_head(recognise: Callable[[bytes], bool]) -> Callable[[Path], bool]:
    """Return what tells a file's format by its first bytes."""

    def look(path: Path) -> bool:
        try:
            with path.open("rb") as file:
                return recognise(file.read(_HEAD))
        except OSError:
            return False  # reading says why

    return look


def _reader(
    name: str,
    parse: Callable[[bytes, str], Recording],
    load: Callable[[Path], bytes] = read_bounded,
) -> Callable[[Path, ReadOptions], Clip]:
    """Return a function that reads files of a format, given its parser."""

    def read_one(path: Path, options: ReadOptions) -> Clip:
        return clip_from_file(path, options, name, parse, load)

    return read_one


def _table(
    name: str,
    title: str,
    parse: Callable[[bytes, str], TableRecording],
    recognise: Callable[[bytes], bool],
    suffixes: tuple[str, ...] = (".csv", ".tsv", ".txt"),
    **more: Any,
) -> Format:
    """Return a format of text files, which are copied cell by cell."""

    def recording(data: bytes, of: str) -> Recording:
        return parse(data, of).recording

    def copy(
        path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
    ) -> WriteReport:
        return write_table(path, clip, filled, parse, overwrite=overwrite)

    reader = _reader(name, recording)
    return Format(title, suffixes, reader, _by_head(recognise), copy, **more)


FORMATS = {
    "c3d": Format(
        "C3D",
        (".c3d",),
        _reader("c3d", parse_c3d, read_c3d_bytes),
        lambda path: True,
        write_c3d,
        create_c3d,
        rewrite_c3d,
        alone=True,
    ),
    "trc": _table("trc", "TRC", parse_trc, recognise_trc, (".trc",), create=create_trc, alone=True),
    "nexus": _table(
        "nexus", "text of Vicon Nexus (section Trajectories)", parse_nexus, recognise_nexus
    ),
    "qualisys": _table(
        "qualisys", "TSV of Qualisys (NO_OF_FRAMES ...)", parse_qualisys, recognise_qualisys
    ),
    "motive": _table(
        "motive", "CSV of OptiTrack Motive (Format Version ...)", parse_motive, recognise_motive
    ),
    "npz": Format(
        "NumPy archive",
        (".npz",),
        _reader("npz", parse_npz),
        recognise_npz,
        create=create_npz_clip,
    ),
    "mat": Format(
        "MATLAB file", (".mat",), _reader("mat", parse_mat), recognise_mat, create=create_mat
    ),
}
"""The formats by name."""

SUFFIXES = tuple(dict.fromkeys(s for one in FORMATS.values() for s in one.suffixes))
"""Suffixes of the files that can be read, lower case."""


def format_of(path: Path | str) -> str:
    """Return the name of a file's format.

    Parameters
    ----------
    path : Path or str
        The file.

    Returns
    -------
    str
        One of `FORMATS`.

    Raises
    ------
    FormatError
        If it is unknown.
    """
    path = Path(path)
    _check_suffix(path)
    names = [name for name, one in FORMATS.items() if path.suffix.lower() in one.suffixes]
    if len(names) == 1:
        return names[0]
    for name in names:
        if FORMATS[name].recognise(path):
            return name
    known = "; ".join(FORMATS[name].title for name in names)
    raise FormatError(
        f"{path}: begins like none of the {path.suffix} files that are known: {known}; "
        "export it as one of these, or as C3D"
    )


def recognised(path: Path | str) -> bool:
    """Tell if a file is likely a recording: many a .csv, .npz or .mat is not.

    Parameters
    ----------
    path : Path or str
        The file.
    """
    path = Path(path)
    return any(
        path.suffix.lower() in one.suffixes and (one.alone or one.recognise(path))
        for one in FORMATS.values()
    )


def read(
    path: Path | str,
    *,
    zeros_missing: bool = True,
    up: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> Clip:
    """Read the markers of a motion-capture file.

    Parameters
    ----------
    path : Path or str
        The file; its suffix tells the format.
    zeros_missing : bool
        Take samples that are exactly (0, 0, 0) as missing.
    up : str or None
        Which axis points up, instead of finding it.
    rate : float or None
        Frames per second (Hz) instead of the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) instead of the file's.
    subject : str or None
        Whose markers to read, where the file holds several subjects.

    Returns
    -------
    Clip
        The markers in mm.

    Raises
    ------
    FormatError
        If the file is absent, of an unknown format, damaged or cut short.
    ClipError
        If its contents make no sense.
    OptionError
        If an option is out of range.
    """
    path = Path(path)
    if path.is_dir():
        raise FormatError(f"{path}: is a folder; give the name of a file")
    if not path.exists():
        raise FormatError(f"{path}: there is no such file; check the name")
    return FORMATS[format_of(path)].read(path, ReadOptions(zeros_missing, up, rate, unit, subject))


def write(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
    rewrite: bool = False,
) -> WriteReport:
    """Write a clip.

    A clip that was read from a C3D or text file is written as a copy of that file in which only the
    filled samples differ, if `path` has a suffix of the same format, unless it is to be rewritten;
    else as a new file.

    Parameters
    ----------
    path : Path or str
        The file to write; its suffix tells the format.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; needed if a copy is written.
    overwrite : bool
        Replace an existing file.
    rewrite : bool
        Write the clip's source anew through ezc3d, with float coordinates, instead of a copy.
        The report says what that changes.

    Returns
    -------
    WriteReport
        What was written.

    Raises
    ------
    FormatError
        If the format is unknown, or the source cannot be read any more.
    OptionError
        If a copy is to be written and `filled` is not given.
    OutputError
        If the file cannot be written, exists already, or is the clip's own source.
    """
    path = Path(path)
    source = clip.source
    form = _output_format(path, source.format if source is not None else None)
    copy, create = FORMATS[form].copy, FORMATS[form].create
    if rewrite:
        _check_rewriting(path, form, source.format if source is not None else None)
        copy = FORMATS[form].rewrite
    if source is not None and form == source.format and copy is not None:
        if filled is None:
            raise OptionError(
                f"{clip.name}: was read from a file, of which a copy is written; "
                "say which samples are filled"
            )
        return copy(path, clip, filled, overwrite=overwrite)
    if source is not None:
        check_target(path, overwrite=overwrite, source=source.path)
    assert create is not None  # or there is a copy
    return create(path, clip, filled=filled, overwrite=overwrite)


def check_output(
    path: Path | str, *, source: Path, overwrite: bool = False, rewrite: bool = False
) -> None:
    """Find out, before the work is done, whether its result can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    source : Path
        The file that will be read, which it must not be.
    overwrite : bool
        Whether it may replace an existing file.
    rewrite : bool
        Whether the source is to be written anew.

    Raises
    ------
    FormatError
        If the format is unknown, or cannot be written.
    OptionError
        If it cannot be written anew.
    OutputError
        If the folder is missing, the file exists already, or is the source.
    """
    kind = format_of(source) if source.is_file() else None
    form = _output_format(Path(path), kind)
    if rewrite and kind is not None:
        _check_rewriting(Path(path), form, kind)
    check_target(path, overwrite=overwrite, source=source)


def _check_rewriting(path: Path, form: str, source: str | None) -> None:
    """Raise OptionError where a source of one format cannot be written anew in another."""
    if form != source or FORMATS[form].rewrite is None:
        raise OptionError(
            f"{path}: only a C3D file is rewritten, as a C3D file; leave --rewrite out"
        )


def _output_format(path: Path, source: str | None) -> str:
    """Return which format to write: the source's if the suffix is one of its, else a new one."""
    _check_suffix(path)
    suffix = path.suffix.lower()
    if source is not None and suffix in FORMATS[source].suffixes:
        return source
    for name, one in FORMATS.items():
        if suffix in one.suffixes and one.create is not None:
            return name
    raise FormatError(
        f"{path}: {suffix} is written only as a copy of a {suffix} file with its gaps filled; "
        f"a new file can be {', '.join(f'.{name}' for name in _READ_AND_WRITTEN)}"
    )


def _check_suffix(path: Path) -> None:
    """Raise FormatError if the suffix is of no known format."""
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(
            f"{path}: the suffix {path.suffix or '(none)'!r} is unknown; "
            f"known are {', '.join(SUFFIXES)}"
        )
