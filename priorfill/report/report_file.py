"""Write the page of a result to a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.report.page import page_text
from priorfill.report.report_data import PageContents, page_data
from priorfill.runtime.argument_types import check_path, check_result
from priorfill.runtime.atomic_file import check_target, check_writable, replace_file
from priorfill.runtime.option_checks import check_suffix

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.filling.result import Result

__all__ = ["REPORT_SUFFIXES", "check_report", "report_file", "write_report"]

REPORT_SUFFIXES = (".html", ".htm")
"""Suffixes that browsers open on a double click."""


def check_report(
    path: Path | str,
    *,
    sources: Sequence[Path] = (),
    overwrite: bool = False,
) -> None:
    """Check before a fill whether its report can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    sources : sequence of Path
        Files that are read.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OptionError
        If the suffix is not one of `REPORT_SUFFIXES`.
    OutputError
        If the folder takes no files, or the file exists already or is one of those read.
    """
    path = Path(str(path))  # as in `check_target`
    check_suffix(path, "a report", REPORT_SUFFIXES)
    for source in sources:  # before `overwrite`, which is no remedy for these
        check_target(path, overwrite=True, source=source)
    check_target(path, overwrite=overwrite)
    check_writable(path, 0)


@contextmanager
def report_file(
    path: Path | str,
    result: Result,
    contents: PageContents | None = None,
    *,
    overwrite: bool = False,
) -> Iterator[None]:
    """Write the page of a result; the file appears when the block ends without an error.

    So it can be written together with other files: either all appear, or none.

    Parameters
    ----------
    path : Path or str
        The file to write.
    result : Result
        Of a fill.
    contents : PageContents, optional
        What else the page shows.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OptionError
        If the suffix is not one of `REPORT_SUFFIXES`.
    OutputError
        If the file exists already or cannot be written.
    """
    path = Path(str(path))
    check_suffix(path, "a report", REPORT_SUFFIXES)
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(page_text(page_data(result, contents)).encode("utf-8"))
        yield


def write_report(
    path: Path | str,
    result: Result,
    *,
    before: Clip | Sequence[Clip] | None = None,
    truth: Clip | Sequence[Clip] | None = None,
    overwrite: bool = False,
) -> None:
    """Write a page that shows a result: every gap, the body in motion, curves and what was done.

    The page is one HTML file that needs no network. Equal results give equal bytes.

    Parameters
    ----------
    path : Path or str
        The file to write, ``.html``.
    result : Result
        Of a fill.
    before : Clip or sequence of Clip, optional
        The clip as it was measured, to show measured samples that were replaced; of a file of
        several subjects one clip for each.
    truth : Clip or sequence of Clip, optional
        The same recording without gaps, to show the true errors.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OptionError
        If the suffix is another one, or the clips do not fit the result.
    OutputError
        If the file exists already or cannot be written.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.
    priorfill.write_uncertainty : Write the expected error of each sample.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> truth, clip = make_demo_clip()
    >>> result = pf.fill(clip, method="linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pf.write_report(f"{folder}/walk.html", result, truth=truth)
    ...     Path(f"{folder}/walk.html").stat().st_size < 1_000_000
    True
    """
    check_path("path", path)
    check_result(result)
    contents = PageContents(before=before, truth=truth)
    with report_file(path, result, contents, overwrite=overwrite):
        pass
