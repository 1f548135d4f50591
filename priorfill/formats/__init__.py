"""Motion-capture files: read them as clips, and write clips to them.

========  ========================================  ====================  =================  ======
Name      Format                                    Suffixes              Filled copy        New
========  ========================================  ====================  =================  ======
c3d       C3D                                       .c3d                  byte by byte       yes
trc       TRC of OpenSim and Motion Analysis        .trc                  cell by cell       yes
nexus     Vicon Nexus, section Trajectories         .csv .tsv .txt        cell by cell       no
qualisys  Qualisys Track Manager, TSV               .csv .tsv .txt        cell by cell       no
motive    OptiTrack Motive, CSV                     .csv .tsv .txt        cell by cell       no
bids      Motion-BIDS, ``*_motion.tsv``             .tsv                  cell by cell       yes
npz       NumPy archive                             .npz                  no                 yes
mat       MATLAB, version 4 to 7; Qualisys' export  .mat                  no                 yes
========  ========================================  ====================  =================  ======

`FORMATS` holds this table in code. The suffix of a file determines its format; if several formats
share a suffix, the first bytes decide, or the name for Motion-BIDS, which has no header. The
parser of each format turns bytes into a `Recording`, and `make_clip` turns any recording into a
clip (both in `priorfill.formats.recording`). Skeleton files (`priorfill.formats.skeletons`) hold no
markers and are read separately.
"""

from __future__ import annotations

import codecs
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
from priorfill.formats.bids.create_motion import create_motion
from priorfill.formats.bids.motion_tsv import copy_motion, holds_positions, read_motion
from priorfill.formats.bids.names import is_motion, motion_name_fault, new_motion_fault
from priorfill.formats.c3d.create import create_c3d
from priorfill.formats.c3d.patch import beyond_range, write_c3d
from priorfill.formats.c3d.read import parse_c3d, read_c3d, read_c3d_bytes
from priorfill.formats.c3d.rewrite import rewrite_c3d
from priorfill.formats.file_bytes import (
    check_regular,
    no_such_file,
    os_errors_explained,
    read_bounded,
)
from priorfill.formats.recording import ReadOptions, Recording, clip_from_file
from priorfill.formats.tables.motive_csv import parse_motive, recognise_motive
from priorfill.formats.tables.nexus_csv import parse_nexus, recognise_nexus
from priorfill.formats.tables.opensim_trc import create_opensim_trc
from priorfill.formats.tables.qualisys_tsv import parse_qualisys, recognise_qualisys
from priorfill.formats.tables.text_table import TableRecording, write_table
from priorfill.formats.tables.trc import create_trc, parse_trc, recognise_trc
from priorfill.formats.write_report import WriteReport
from priorfill.runtime.argument_types import check_path, check_type
from priorfill.runtime.atomic_file import check_target, check_writable
from priorfill.runtime.npz_file import create_npz

__all__ = [
    "FORMATS",
    "PROGRAMS",
    "SUFFIXES",
    "FileFormat",
    "ProgramFile",
    "WriteReport",
    "check_output",
    "create_c3d",
    "create_npz",
    "format_of",
    "is_recording",
    "output_format",
    "read",
    "read_c3d",
    "rewrite_c3d",
    "samples_out_of_range",
    "write",
    "write_c3d",
]

_HEAD_BYTES = 1 << 16
"""Bytes of a text file examined to determine its format."""


@dataclass(frozen=True)
class FileFormat:
    """A file format.

    Attributes
    ----------
    title : str
        Name in messages.
    suffixes : tuple of str
        Suffixes in lower case.
    read : callable
        Reads a clip from a path.
    recognise : callable
        Checks whether the file at a path has this format, among those that share its suffix.
    copy : callable or None
        Writes a copy of a clip's source in which only the filled samples differ.
    create : callable or None
        Writes a clip as a new file.
    rewrite : callable or None
        Like `copy`, but writes the whole source through a library, and reports the differences.
    beyond_range : callable or None
        Returns the filled samples of a clip that a copy cannot hold; None: it can hold all.
    exclusive : bool
        Whether the suffixes are used for recordings only, so that the contents need no check.
    holds_markers : callable or None
        Checks whether a file of the format holds markers; None: all do.
    name_fault, new_name_fault : callable or None
        Return why a copy, or a new file, cannot have a name, with the remedy; empty if it can.
    """

    title: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Clip]
    recognise: Callable[[Path], bool]
    copy: Callable[..., WriteReport] | None = None
    create: Callable[..., WriteReport] | None = None
    rewrite: Callable[..., WriteReport] | None = None
    beyond_range: Callable[[Clip, NDArray[np.bool_]], NDArray[np.bool_]] | None = None
    exclusive: bool = False
    holds_markers: Callable[[Path], bool] | None = None
    name_fault: Callable[[Path], str] | None = None
    new_name_fault: Callable[[Path], str] | None = None


def _by_head(recognise: Callable[[bytes], bool]) -> Callable[[Path], bool]:
    """Return a check of a path that examines the file's first bytes."""

    def look(path: Path) -> bool:
        try:
            with os_errors_explained(path), path.open("rb") as file:
                return recognise(file.read(_HEAD_BYTES))
        except FormatError:
            return False  # reading reports the reason

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


def _text_format(
    name: str,
    title: str,
    parse: Callable[[bytes, str], TableRecording],
    recognise: Callable[[bytes], bool],
    suffixes: tuple[str, ...] = (".csv", ".tsv", ".txt"),
    **more: Any,
) -> FileFormat:
    """Return a text format, whose files are copied cell by cell."""

    def parse_recording(data: bytes, file_name: str) -> Recording:
        return parse(data, file_name).recording

    def copy(
        path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
    ) -> WriteReport:
        return write_table(path, clip, filled, parse, overwrite=overwrite)

    reader = _reader(name, parse_recording)
    return FileFormat(title, suffixes, reader, _by_head(recognise), copy, **more)


FORMATS = {
    "c3d": FileFormat(
        "C3D",
        (".c3d",),
        _reader("c3d", parse_c3d, read_c3d_bytes),
        lambda path: True,
        write_c3d,
        create_c3d,
        rewrite_c3d,
        beyond_range,
        exclusive=True,
    ),
    "trc": _text_format(
        "trc", "TRC", parse_trc, recognise_trc, (".trc",), create=create_trc, exclusive=True
    ),
    "nexus": _text_format(
        "nexus", "text of Vicon Nexus (section Trajectories)", parse_nexus, recognise_nexus
    ),
    "qualisys": _text_format(
        "qualisys", "TSV of Qualisys (NO_OF_FRAMES ...)", parse_qualisys, recognise_qualisys
    ),
    "motive": _text_format(
        "motive", "CSV of OptiTrack Motive (Format Version ...)", parse_motive, recognise_motive
    ),
    "bids": FileFormat(
        "Motion-BIDS (a name that ends with _motion.tsv)",
        (".tsv",),
        read_motion,
        is_motion,
        copy_motion,
        create_motion,
        holds_markers=holds_positions,
        name_fault=motion_name_fault,
        new_name_fault=new_motion_fault,
    ),
    "npz": FileFormat(
        "NumPy archive",
        (".npz",),
        _reader("npz", parse_npz),
        recognise_npz,
        create=create_npz_clip,
    ),
    "mat": FileFormat(
        "MATLAB file", (".mat",), _reader("mat", parse_mat), recognise_mat, create=create_mat
    ),
}
"""All formats by name."""


@dataclass(frozen=True)
class ProgramFile:
    """A new file as a program takes it.

    Attributes
    ----------
    title : str
        Name of the program in messages.
    suffix : str
        Suffix of the file.
    create : callable
        Writes a clip as such a file.
    """

    title: str
    suffix: str
    create: Callable[..., WriteReport]


PROGRAMS = {"opensim": ProgramFile("OpenSim", ".trc", create_opensim_trc)}
"""Programs that files are made for, by name."""

SUFFIXES = tuple(dict.fromkeys(s for one in FORMATS.values() for s in one.suffixes))
"""Suffixes of all formats in lower case."""


def format_of(path: Path | str) -> str:
    """Return the name of a file's format in `FORMATS`.

    Parameters
    ----------
    path : Path or str
        The file.

    Returns
    -------
    str
        The name.

    Raises
    ------
    FormatError
        If the format is unknown.

    Examples
    --------
    >>> format_of("walk.C3D")
    'c3d'
    """
    path = Path(path)
    _check_suffix(path, FormatError)
    names = [name for name, one in FORMATS.items() if path.suffix.lower() in one.suffixes]
    if len(names) == 1:
        return names[0]
    for name in names:
        if FORMATS[name].recognise(path):
            return name
    if _by_head(lambda head: head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))(path):
        raise FormatError(f"{path}: is text in UTF-16; save it as UTF-8 or ASCII")
    known = "; ".join(FORMATS[name].title for name in names)
    raise FormatError(
        f"{path}: is none of the known {path.suffix} files: {known}; "
        "export it as one of these, or as C3D"
    )


def is_recording(path: Path | str) -> bool:
    """Check whether a file is likely a recording; many .csv, .npz and .mat files are not.

    Parameters
    ----------
    path : Path or str
        The file.

    Returns
    -------
    bool
        True if its suffix, and if necessary its contents, are those of a format in `FORMATS`, and
        it holds markers.
    """
    path = Path(path)
    for one in FORMATS.values():
        if path.suffix.lower() in one.suffixes and (one.exclusive or one.recognise(path)):
            return one.holds_markers is None or one.holds_markers(path)
    return False


def read(
    path: Path | str,
    *,
    zeros_missing: bool = True,
    up: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    ignore_residuals: bool = False,
) -> Clip:
    """Read the markers of a motion-capture file.

    Parameters
    ----------
    path : Path or str
        The file; its suffix determines the format.
    zeros_missing : bool
        Treat samples at exactly (0, 0, 0) as missing.
    up : str or None
        The axis that points up, one of +X, -X, +Y, -Y, +Z, -Z; found if None.
    rate : float or None
        Frame rate (Hz) that replaces the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) that replaces the file's.
    subject : str or None
        The subject whose markers are read, if the file holds several.
    ignore_residuals : bool
        Take samples as measured whose residual in the file marks them as missing.

    Returns
    -------
    Clip
        The markers in mm. Its source lists the points left out, and notes on how the file was
        interpreted.

    Raises
    ------
    FormatError
        If the file does not exist, is of unknown format, damaged or truncated.
    ClipError
        If the contents are unusable: no frames, no labelled marker, no rate, an infinite
        coordinate, an implausible unit, an unknown subject, or several subjects and none chosen
        (MultipleSubjectsError).
    OptionError
        If an option is out of range.

    See Also
    --------
    priorfill.write : Write a clip.
    priorfill.fill : Fill the gaps of a clip.
    priorfill.interop : Clips from and to other Python packages.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from priorfill import Clip, read, write
    >>> clip = Clip(np.full((4, 1, 3), 900.0), ("SACR",), 120.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write(f"{folder}/walk.npz", clip)
    ...     again = read(f"{folder}/walk.npz")
    >>> again.labels, again.rate
    (('SACR',), 120.0)
    """
    check_path("path", path)
    path = Path(path)
    if path.is_dir():
        raise FormatError(f"{path}: is a folder; give the name of a file")
    if not path.exists():
        raise no_such_file(path)
    check_regular(path)
    options = ReadOptions(zeros_missing, up, rate, unit, subject, ignore_residuals)
    return FORMATS[format_of(path)].read(path, options)


def write(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
    rewrite: bool = False,
    program: str | None = None,
) -> WriteReport:
    """Write a clip.

    If the clip was read from a C3D or text file and `path` has a suffix of the same format, a copy
    of that file is written in which only the filled samples differ. Otherwise the file is new.

    Parameters
    ----------
    path : Path or str
        The file to write; its suffix determines the format.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; required for a copy.
    overwrite : bool
        Replace an existing file.
    rewrite : bool
        Instead of a copy, write the contents of a C3D source through ezc3d with float coordinates.
        The report lists the differences.
    program : str or None
        The program that the file is for, such as ``"opensim"``: always a new file, as that program
        takes it.

    Returns
    -------
    WriteReport
        The number of filled samples, the rounding error, and other differences to the source.

    Raises
    ------
    FormatError
        If the source can no longer be read.
    OptionError
        If the format is unknown or cannot be written, `filled` is missing for a copy, or `rewrite`
        does not apply.
    OutputError
        If the file cannot be written, exists already, or is the clip's source; if the source has
        changed since it was read; or if a filled sample has no position or does not fit the file's
        number format.

    See Also
    --------
    priorfill.read : Read a clip.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import priorfill as pf
    >>> from priorfill.synthetic import synthesise
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = pf.write(Path(folder) / "walk.npz", synthesise("walking", seconds=1.0))
    >>> report.samples
    0
    """
    check_path("path", path)
    check_type("clip", clip, Clip, "a Clip, after the path")
    if filled is not None:
        check_type("filled", filled, np.ndarray, "an array of bool, (frames, markers)")
    path = Path(str(path))  # as in `check_target`
    source = clip.source
    if program is not None:
        _check_program(path, program)
        check_target(path, overwrite=overwrite, source=None if source is None else source.path)
        return PROGRAMS[program].create(path, clip, filled, overwrite=overwrite)
    form = output_format(path, source.format if source is not None else None)
    copy, create = FORMATS[form].copy, FORMATS[form].create
    if rewrite:
        _check_rewriting(path, form, source.format if source is not None else None)
        copy = FORMATS[form].rewrite
    if source is not None and form == source.format and copy is not None:
        if filled is None:
            raise OptionError(
                f"{clip.name}: a copy of its source file needs the mask of filled samples; "
                "give `filled`, or, for a new file, a clip without its source "
                "(dataclasses.replace(clip, source=None))"
            )
        return copy(path, clip, filled, overwrite=overwrite)
    if source is not None:
        check_target(path, overwrite=overwrite, source=source.path)
    assert create is not None  # every format has copy or create
    return create(path, clip, filled=filled, overwrite=overwrite)


def samples_out_of_range(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, rewrite: bool = False
) -> NDArray[np.bool_]:
    """Return the filled samples that do not fit the number format of the file to be written.

    Parameters
    ----------
    path, clip, filled, rewrite
        As for `write`, which refuses such samples.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)]
        Samples beyond the range of the integers of a C3D file.

    Raises
    ------
    FormatError, OutputError
        As in `write`.
    """
    source = clip.source
    form = output_format(Path(path), source.format if source is not None else None)
    find = FORMATS[form].beyond_range
    if source is None or form != source.format or rewrite or find is None:
        return np.zeros_like(filled)
    return find(clip, filled)


def check_output(
    path: Path | str,
    *,
    source: Path,
    overwrite: bool = False,
    rewrite: bool = False,
    program: str | None = None,
) -> None:
    """Check before a computation whether its result can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    source : Path
        The file to be read; it must not be `path`.
    overwrite : bool
        Whether an existing file may be replaced.
    rewrite : bool
        Whether the source is to be rewritten.
    program : str or None
        The program that the file is for.

    Raises
    ------
    OptionError
        If the format is unknown, cannot be written, or the source cannot be rewritten.
    OutputError
        If the folder does not exist, takes no files or is too full, or the file exists already or
        is the source.
    """
    if program is not None:
        _check_program(Path(path), program)
    source_format = format_of(source) if source.is_file() else None
    form = output_format(Path(path), source_format)
    if rewrite and source_format is not None:
        _check_rewriting(Path(path), form, source_format)
    check_target(path, overwrite=overwrite, source=source)
    check_writable(path, source.stat().st_size if source.is_file() else 0)


def _check_program(path: Path, program: str) -> None:
    """Raise OptionError if a program is unknown, or does not take files with a suffix."""
    if program not in PROGRAMS:
        raise OptionError(f"`program` {program!r} is unknown; use one of {', '.join(PROGRAMS)}")
    suffix = PROGRAMS[program].suffix
    if path.suffix.lower() != suffix:
        raise OptionError(
            f"{path}: a file for {PROGRAMS[program].title} has the suffix {suffix}; name it so"
        )


def _check_rewriting(path: Path, form: str, source: str | None) -> None:
    """Raise OptionError if a source of one format cannot be rewritten in another."""
    if form != source or FORMATS[form].rewrite is None:
        raise OptionError(
            f"{path}: only a C3D file is rewritten, as a C3D file; leave `rewrite` out"
        )


def output_format(path: Path, source: str | None) -> str:
    """Return the format to write: the source's if the suffix fits, else that of a new file.

    Parameters
    ----------
    path : Path
        The file to write.
    source : str or None
        Format of the source; None for a clip made in memory.

    Raises
    ------
    OptionError
        If the format is unknown or cannot be written, or the file needs another name.
    """
    _check_suffix(path, OptionError)
    suffix = path.suffix.lower()
    if source is not None and suffix in FORMATS[source].suffixes:
        _check_name(path, FORMATS[source].name_fault)
        return source
    for name, one in FORMATS.items():
        if suffix in one.suffixes and one.create is not None:
            _check_name(path, one.new_name_fault)
            return name
    new = [
        suffix
        for one in FORMATS.values()
        if one.create is not None and one.new_name_fault is None
        for suffix in one.suffixes
    ]
    raise OptionError(
        f"{path}: {suffix} is written only as a copy of a {suffix} file with its gaps filled; "
        f"a new file can be {', '.join(new)}"
    )


def _check_name(path: Path, find_fault: Callable[[Path], str] | None) -> None:
    """Raise OptionError if a file of a format cannot have a name."""
    if find_fault is not None and (fault := find_fault(path)):
        raise OptionError(f"{path}: {fault}")


_SKELETON_SUFFIXES = (".amc", ".asf", ".bvh")
"""Of files that `priorfill.cli.db.skeletons` reads."""


def _check_suffix(path: Path, error: type[FormatError] | type[OptionError]) -> None:
    """Raise an error if no format has the suffix."""
    if path.suffix.lower() not in SUFFIXES:
        found = f"the suffix {path.suffix!r} is unknown" if path.suffix else "has no suffix"
        if path.suffix.lower() in _SKELETON_SUFFIXES:
            found = "is a skeleton file, which only a database can use (priorfill db add)"
        raise error(f"{path}: {found}; known are {', '.join(SUFFIXES)}")
