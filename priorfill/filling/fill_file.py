"""Fill the gaps of a file: read, fill each subject, write, and add to a database.

Without an output this is a dry run: the same fill, but only what was requested in addition is
written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

from priorfill import formats
from priorfill.artefacts import Artefact, find_artefacts
from priorfill.clip import Clip
from priorfill.errors import ClipError, DatabaseError, OptionError, PriorfillError
from priorfill.filling.add_result import AddedClip, add_subject, can_create_database
from priorfill.filling.bids_derivative import derivative_output
from priorfill.filling.companion_files import check_companions, write_companions
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillKeywords, FillOptions
from priorfill.filling.further_outputs import check_further_outputs, further_outputs
from priorfill.filling.leave_missing import leave_missing
from priorfill.filling.multi_subject import merge_artefacts, read_subjects
from priorfill.filling.overrides import Overrides
from priorfill.filling.overrides_file import read_overrides
from priorfill.filling.result import Result
from priorfill.filling.swaps import swap_markers
from priorfill.formats import WriteReport
from priorfill.methods import get_method
from priorfill.runtime.argument_types import check_path, check_type
from priorfill.runtime.display import shell_command

__all__ = ["FileOptions", "FileResult", "FileToFill", "fill_file", "write_filled"]


@dataclass(frozen=True)
class FileOptions:
    """How `priorfill.fill_file` reads and writes files.

    Attributes
    ----------
    subject : str or None
        The subject to fill; all subjects of the file by default.
    up, rate, unit, zeros_missing, ignore_residuals
        How to interpret the file; see `priorfill.read`.
    uncertainty : Path or str, optional
        File for the expected error of each filled sample, .npz or .csv. It appears together with
        the output, or neither appears; without an output it is written by itself.
    report : Path or str, optional
        Page that shows the fill, .html; it appears together with the output, too.
    write_overrides : Path or str, optional
        File of overrides with an entry for each gap, .toml; see `priorfill.overrides_template`.
        Like the uncertainty.
    plot : Path or str, optional
        File for a plot of the worst gaps, .png, .svg or .pdf, or a folder (a name without a suffix)
        for a picture of each marker with gaps. Like the uncertainty.
    plot_gaps : int
        Number of gaps of the plot, the worst first; in a folder of each marker.
    rewrite : bool
        Write a C3D file anew, with float coordinates, instead of a copy with filled samples.
    program : str or None
        The program that the output is for: "opensim" makes a new .trc file with +Y up and without
        blank cells, and next to it a table of what was estimated.
    overwrite : bool
        Replace existing files.
    add_to_database : bool
        Add the filled clips to the database, which is created if there is none.

    See Also
    --------
    priorfill.fill_file : Fill the gaps of a file.

    Examples
    --------
    >>> FileOptions(unit="m", overwrite=True).reading["unit"]
    'm'
    """

    subject: str | None = None
    up: str | None = None
    rate: float | None = None
    unit: str | None = None
    zeros_missing: bool = True
    ignore_residuals: bool = False
    uncertainty: Path | str | None = None
    plot: Path | str | None = None
    plot_gaps: int = 6
    report: Path | str | None = None
    write_overrides: Path | str | None = None
    rewrite: bool = False
    program: str | None = None
    overwrite: bool = False
    add_to_database: bool = False

    @property
    def reading(self) -> dict[str, Any]:
        """Keyword arguments of `priorfill.read`."""
        names = ("subject", "up", "rate", "unit", "zeros_missing", "ignore_residuals")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False)
class FileResult:
    """What `priorfill.fill_file` did.

    Attributes
    ----------
    source : Path
        The file with gaps.
    output : Path or None
        The filled file; None after a dry run.
    uncertainty : Path or None
        The file with the expected error of each filled sample, if one was requested.
    result : Result
        The fill; of several subjects merged.
    report : WriteReport
        What writing the output changed; nothing after a dry run.
    artefacts : tuple of Artefact
        Artefacts of the file: those rejected, or those found and kept as measured.
    added : tuple of AddedClip or None
        What became of adding each subject to the database; None where it failed. Empty if the
        result was not to be added.
    not_added : DatabaseError or None
        Why a filled clip could not be added to the database although the output was written, and
        the command that adds it.
    further : mapping of str to tuple of Path
        The files that were written in addition, by the option of `FileOptions` that named them.
    companions : tuple of Path
        Files that belong to the output: the mask, errors and side files of a recording of
        Motion-BIDS; the table of what was estimated in a file for OpenSim.

    See Also
    --------
    priorfill.fill_file : Fill the gaps of a file.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pf.write(f"{folder}/walk.c3d", make_demo_clip()[1])
    ...     done = pf.fill_file(f"{folder}/walk.c3d", f"{folder}/out.c3d", method="linear")
    >>> bool(done.result.filled.any()), done.not_added
    (True, None)
    """

    source: Path
    output: Path | None
    uncertainty: Path | None
    result: Result
    report: WriteReport
    artefacts: tuple[Artefact, ...] = ()
    added: tuple[AddedClip | None, ...] = ()
    not_added: DatabaseError | None = None
    further: Mapping[str, tuple[Path, ...]] = field(default_factory=dict)
    companions: tuple[Path, ...] = ()


def fill_file(
    source: Path | str,
    output: Path | str | None = None,
    *,
    database: Path | str | None = None,
    same_subject: Sequence[Path | str] = (),
    files: FileOptions | None = None,
    **arguments: Unpack[FillKeywords],
) -> FileResult:
    """Fill the gaps of a file and write the result.

    Measured samples, and everything else in the file, are copied unchanged. Each subject of a file
    is filled by itself, and all are written to one output. Whatever would prevent writing is
    checked before anything is filled.

    Parameters
    ----------
    source : Path or str
        The file with gaps.
    output : Path or str, optional
        The file to write: a copy of the source, or a new file if its suffix is of another format.
        For a recording of Motion-BIDS also the folder of a derivative dataset.
        None is a dry run: everything is filled, but no filled file is written.
    database : Path or str, optional
        Folder of the prior database to learn from.
    same_subject : sequence of Path or str
        Other recordings of the same subjects with the same markers attached.
    files : FileOptions, optional
        How to read and write files, and whether to add the result to the database.
    **arguments
        ``method``, ``gap_filter``, ``overrides``, ``reject_artefacts`` and ``options`` of
        `priorfill.fill`.

    Returns
    -------
    FileResult
        The fill, and what was written and added.

    Raises
    ------
    FormatError, OutputError
        Where the file cannot be read, or an output cannot be written.
    MethodError, OptionError, ClipError, DatabaseError
        As in `priorfill.fill`. Failure to add the result to the database is no exception:
        `FileResult.not_added` has the reason.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.
    priorfill.add_result : Add a result to a database.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pf.write(f"{folder}/walk.c3d", make_demo_clip()[1])
    ...     done = pf.fill_file(f"{folder}/walk.c3d", f"{folder}/out.c3d", method="linear")
    ...     filled = pf.read(f"{folder}/out.c3d")
    >>> filled.missing.sum() < make_demo_clip()[1].missing.sum()
    np.True_
    """
    check_path("source", source)
    if output is not None:
        check_path("output", output)
    if files is not None:
        check_type("files", files, FileOptions, "FileOptions")
    check_type("same_subject", same_subject, (list, tuple), "a list of paths")
    source, files = Path(source), files or FileOptions()
    output = None if output is None else derivative_output(source, Path(str(output)))
    work = FileToFill.read(
        source,
        output,
        database=database,
        same_subject=same_subject,
        files=files,
        **arguments,
    )
    result = work.fill()
    done = write_filled(work, result, output, files)
    if output is None or database is None or not files.add_to_database:
        return done
    return _add(done, output, Path(database), files)


@dataclass(frozen=True, eq=False)
class FileToFill:
    """A file that was read to be filled, once or several times with other overrides.

    Attributes
    ----------
    source : Path
        The file with gaps.
    output : Path or None
        The file to write.
    clips : tuple of Clip
        One for each subject.
    same_subject : tuple of Clip
        Other recordings of the same subjects.
    database : Path or str or None
        The database to learn from.
    files : FileOptions
        How to read and write files.
    arguments : FillKeywords
        Of `priorfill.fill`; overrides are read.
    found : tuple of Artefact or None
        Artefacts of the file; None where each fill finds them.
    """

    source: Path
    output: Path | None
    clips: tuple[Clip, ...]
    same_subject: tuple[Clip, ...]
    database: Path | str | None
    files: FileOptions
    arguments: FillKeywords
    found: tuple[Artefact, ...] | None

    @classmethod
    def read(
        cls,
        source: Path,
        output: Path | None,
        *,
        database: Path | str | None = None,
        same_subject: Sequence[Path | str] = (),
        files: FileOptions,
        read_alike: bool = False,
        **arguments: Unpack[FillKeywords],
    ) -> FileToFill:
        """Check what can be checked, and read the file and those of the same subjects.

        Parameters
        ----------
        source, output, database, same_subject, files, **arguments
            As for `fill_file`.
        read_alike : bool
            Whether `up`, `rate` and `unit` of `files` hold for the other recordings of the subject,
            too, as for files of one study.
        """
        prior, overrides = _check(source, output, database, files, arguments)
        clips = read_subjects(source, **files.reading)
        own = () if read_alike else ("up", "rate", "unit")  # by default, each recording has its own
        reading = {name: value for name, value in files.reading.items() if name not in own}
        others = _read_same_subject(same_subject, source, clips, reading)
        options = arguments.get("options") or FillOptions()
        found = None
        if not (arguments.get("reject_artefacts") or options.plausibility.hide_doubtful):
            # before the fill, whose results take memory too
            found = merge_artefacts(
                [clip.subject for clip in clips],
                [find_artefacts(swap_markers(overrides, clip).clip) for clip in clips],
            )
        arguments["overrides"] = overrides
        return cls(source, output, clips, tuple(others), prior, files, arguments, found)

    def fill(self) -> Result:
        """Fill the gaps, but for samples that the output cannot hold."""
        result = fill(
            self.clips, database=self.database, same_subject=self.same_subject, **self.arguments
        )
        result = _with_reading(result, self.files.reading)
        overrides = result.provenance.overrides
        measured = [swap_markers(overrides, clip).clip for clip in self.clips]
        return _within_range(result, measured, self.output or self.source, self.files)

    def artefacts(self, result: Result) -> tuple[Artefact, ...]:
        """Return the artefacts of the file: those rejected, or those found and kept as measured.

        Parameters
        ----------
        result : Result
            Of `fill`.
        """
        return result.artefacts if self.found is None else self.found


def _check(
    source: Path,
    output: Path | None,
    database: Path | str | None,
    files: FileOptions,
    arguments: FillKeywords,
) -> tuple[Path | str | None, Overrides | None]:
    """Check what can be checked before reading; return the database to learn from, and overrides.

    A database that is still to be created is none to learn from.
    """
    get_method(arguments.get("method", "auto"))
    overrides = arguments.get("overrides")
    if isinstance(overrides, (str, Path)):
        overrides = read_overrides(overrides)
    if output is not None:
        formats.check_output(
            output,
            source=source,
            overwrite=files.overwrite,
            rewrite=files.rewrite,
            program=files.program,
        )
        check_companions(output, source, files.program, overwrite=files.overwrite)
    elif files.program is not None:
        raise OptionError("`program` is for a file to write; name it (`output`)")
    check_further_outputs(source, output, files)
    if files.add_to_database:
        if database is None:
            raise OptionError("the result cannot be added to a database; give one (`database`)")
        if output is None:
            raise OptionError(
                "a dry run adds nothing to a database; give the file to write (`output`)"
            )
        if can_create_database(Path(database)):
            database = None
    return database, overrides


def _read_same_subject(
    paths: Sequence[Path | str], source: Path, clips: Sequence[Clip], reading: Mapping[str, Any]
) -> list[Clip]:
    """Read other recordings of the subjects of a file; other subjects are left out."""
    names = [clip.subject for clip in clips]
    found: list[Clip] = []
    for given in paths:
        check_path("same_subject", given)
        path = Path(given)
        if path.exists() and path.samefile(source):
            raise OptionError(
                f"{path}: is the file to be filled; `same_subject` takes another recording of the "
                "same subject"
            )
        if len(clips) == 1:
            found.append(formats.read(path, **reading))
            continue
        there = read_subjects(path, **{**reading, "subject": None})
        matching = [clip for clip in there if clip.subject in names]
        found += matching or there  # `fill` reports a recording of none of the subjects
    return found


def _with_reading(result: Result, reading: dict[str, Any]) -> Result:
    """Return a result with the reading options in its provenance."""
    return replace(
        result,
        provenance=replace(result.provenance, reading=reading),
        subjects=tuple(
            _with_reading(one, reading | {"subject": one.clip.subject}) for one in result.subjects
        ),
    )


def _within_range(
    result: Result, clips: Sequence[Clip], output: Path, files: FileOptions
) -> Result:
    """Return a result without the samples that its output file cannot hold."""
    beyond = formats.samples_out_of_range(output, result.clip, result.filled, rewrite=files.rewrite)
    reason = (
        "its position is beyond the range of the integers of the file; write a file of floats "
        "(`rewrite`)"
    )
    return leave_missing(result, clips, beyond, reason)


def write_filled(
    work: FileToFill, result: Result, output: Path | None, files: FileOptions
) -> FileResult:
    """Write the filled clip, unless this is a dry run, and further outputs: all or none.

    Parameters
    ----------
    work : FileToFill
        What was filled.
    result : Result
        Of `FileToFill.fill`.
    output : Path or None
        The file to write; None is a dry run.
    files : FileOptions
        How files are written, and which in addition.

    Raises
    ------
    OutputError
        Where a file cannot be written.
    """
    writing = write_companions(
        output,
        result,
        place=work.output,
        program=files.program,
        overwrite=files.overwrite,
    )
    with further_outputs(result, work.clips, files) as further, writing as companions:
        report = WriteReport(0, 0.0)
        if output is not None:
            report = formats.write(
                output,
                result.clip,
                result.filled,
                overwrite=files.overwrite,
                rewrite=files.rewrite,
                program=files.program,
            )
    return FileResult(
        work.source,
        output,
        None if files.uncertainty is None else Path(files.uncertainty),
        result,
        report,
        work.artefacts(result),
        further=further,
        companions=companions,
    )


def _add(done: FileResult, output: Path, database: Path, files: FileOptions) -> FileResult:
    """Add each subject to a database; a failure does not undo what was written."""
    added: list[AddedClip | None] = []
    failure: DatabaseError | None = None
    merged = done.result.clip if done.result.subjects else None
    for one in done.result.by_subject:
        try:
            added.append(add_subject(database, one, merged, output, files.reading))
        except (PriorfillError, OSError) as error:
            subject = files.subject if merged is None else one.clip.subject
            failure = _not_added(error, database, done, replace(files, subject=subject))
            failure.__cause__ = error
            added.append(None)
    return replace(done, added=tuple(added), not_added=failure)


def _not_added(
    error: PriorfillError | OSError, database: Path, done: FileResult, files: FileOptions
) -> DatabaseError:
    """Return an error with the reason, what was done, and the command that does the rest."""
    reason = str(error)
    if not isinstance(error, PriorfillError):
        reason = f"{database}: cannot be written ({error.strerror or error})"
    reason += f"; {done.output} is written but not added"
    if isinstance(error, ClipError):  # the clip does not qualify, so there is nothing to repeat
        return DatabaseError(reason)
    command = ["priorfill", "db", "accept", "--database", str(database), str(done.output)]
    command += ["--original", str(done.source), "--method", done.result.method]
    for name in ("up", "rate", "unit", "subject"):
        value = getattr(files, name)
        if value is not None:
            command += [f"--{name}", str(value)]
    if not files.zeros_missing:
        command.append("--keep-zeros")
    if files.ignore_residuals:
        command.append("--ignore-residuals")
    return DatabaseError(f"{reason}; add it later with: {shell_command(command)}")
