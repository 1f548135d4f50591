"""Write the page that compares a recording with filled versions of it, by any program."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from priorfill.errors import OptionError
from priorfill.filling.multi_subject import read_subjects
from priorfill.filling.read_uncertainty import read_uncertainty
from priorfill.filling.result import Result
from priorfill.filling.result_from_files import result_from_clips
from priorfill.report.compared import notes_on_fit
from priorfill.report.report_data import PageContents
from priorfill.report.report_file import check_report, report_file
from priorfill.runtime.argument_types import check_path, check_type

__all__ = ["report_from_files"]


def report_from_files(
    path: Path | str,
    before: Path | str,
    after: Sequence[Path | str],
    *,
    truth: Path | str | None = None,
    uncertainty: Path | str | None = None,
    overwrite: bool = False,
    **reading: Any,
) -> Result:
    """Write a page that shows what filled versions of a recording have in its gaps.

    Parameters
    ----------
    path : Path or str
        The file to write, ``.html``.
    before : Path or str
        The recording with gaps.
    after : sequence of Path or str
        The same recording, filled. The first one is shown in full; the others are compared with it.
    truth : Path or str, optional
        The same recording without gaps, to show the true errors.
    uncertainty : Path or str, optional
        The expected error of each sample of the first one, as `priorfill.write_uncertainty` writes
        it.
    overwrite : bool
        Replace an existing file.
    **reading
        As for `priorfill.read_subjects`, for all files.

    Returns
    -------
    Result
        That of the first version. `Result.notes` also names other rates, frame numbers and markers
        of all versions.

    Raises
    ------
    FormatError, OptionError
        Where a file cannot be read.
    ClipError
        Where frames, rate or markers do not fit.
    OutputError
        If the file exists already, is one of the others, or cannot be written.

    See Also
    --------
    priorfill.result_from_files : The result alone.
    priorfill.write_report : Write the page of a result.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> truth, clip = make_demo_clip()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     before, after = f"{folder}/walk.c3d", f"{folder}/filled.trc"
    ...     _ = pf.write(before, clip), pf.write(after, truth)
    ...     result = report_from_files(f"{folder}/walk.html", before, [after])
    >>> result.complete
    True
    """
    check_type("after", after, (list, tuple), "a list of paths")
    for name, one in (("path", path), ("before", before), *(("after", one) for one in after)):
        check_path(name, one)
    files = [Path(one) for one in (before, *after)]
    if len(files) < 2:
        raise OptionError("there is no filled file; give one or several (`after`)")
    further = [Path(one) for one in (truth, uncertainty) if one is not None]
    check_report(path, sources=[*files, *further], overwrite=overwrite)
    measured = read_subjects(before, **reading)
    found = None if uncertainty is None else read_uncertainty(uncertainty)
    versions = [read_subjects(one, **reading) for one in after]
    result = result_from_clips(measured, versions[0], found)
    names = _names(files[1:])
    facts = [("Before", files[0].name), *(("After", name) for name in names)]
    facts += [("Truth", Path(truth).name)] if truth is not None else []
    facts += [("Expected errors", Path(uncertainty).name)] if uncertainty is not None else []
    true = None if truth is None else read_subjects(truth, **reading)
    beside = [*versions[1:], *([] if true is None else [true])]
    notes = [note for one in beside for note in notes_on_fit(one, measured)]
    result = replace(result, notes=(*result.notes, *notes))
    contents = PageContents(
        before=measured,
        truth=true,
        others=list(zip(names[1:], versions[1:], strict=True)),
        name=names[0],
        facts={"Files": facts},
    )
    with report_file(path, result, contents, overwrite=overwrite):
        pass
    return result


def _names(files: Sequence[Path]) -> list[str]:
    """Return the names of files, with their folders where names repeat."""
    count = Counter(file.name for file in files)
    return [
        file.name if count[file.name] == 1 else f"{file.resolve().parent.name}/{file.name}"
        for file in files
    ]
