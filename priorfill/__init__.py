"""priorfill: fills gaps in optical motion capture from a database of motions.

Examples
--------
Remove samples from a synthetic recording and fill the gap:

>>> import priorfill as pf
>>> from priorfill.synthetic import synthesise
>>> recording = synthesise("walking", seconds=2.0, rate=30.0)
>>> positions = recording.positions.copy()  # (frames, markers, 3), mm; NaN = missing
>>> positions[20:35, recording.labels.index("LKNE")] = float("nan")
>>> result = pf.fill(recording.with_positions(positions))
>>> [(gap.label, gap.start, gap.stop) for gap in result.gaps]
[('LKNE', 20, 35)]
>>> result.complete
True

The same with files:

>>> clip = pf.read("walk.c3d")  # doctest: +SKIP
>>> result = pf.fill(clip, database="lab-priors")  # doctest: +SKIP
>>> pf.write("walk_filled.c3d", result.clip, result.filled)  # doctest: +SKIP

or, for all subjects of a file and with all checks, in one step:

>>> done = pf.fill_file("walk.c3d", "walk_filled.c3d", database="lab-priors")  # doctest: +SKIP

The names in ``__all__`` are the public interface. Each is imported on first use, so that
``import priorfill`` loads neither NumPy nor numba.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # that of typing, whose import takes longer than all else here

if TYPE_CHECKING:
    from typing import Any

    from priorfill.artefacts import Artefact, find_artefacts
    from priorfill.clip import Clip
    from priorfill.database import ClipOrigin, PriorDatabase, Selection
    from priorfill.errors import PriorfillError
    from priorfill.evaluation import Evaluation, EvaluationOptions, evaluate
    from priorfill.filling.add_result import AddedClip, add_result
    from priorfill.filling.fill_array import FilledArray, fill_array
    from priorfill.filling.fill_clip import fill
    from priorfill.filling.fill_dataset import fill_dataset
    from priorfill.filling.fill_file import FileOptions, FileResult, fill_file
    from priorfill.filling.fill_options import FillOptions
    from priorfill.filling.gap_filter import GapFilter
    from priorfill.filling.multi_subject import read_subjects
    from priorfill.filling.overrides import GapOverride, MadeFor, Overrides
    from priorfill.filling.overrides_file import read_overrides, write_overrides
    from priorfill.filling.overrides_template import overrides_template
    from priorfill.filling.provenance import Provenance
    from priorfill.filling.report_from_files import report_from_files
    from priorfill.filling.result import FilledGap, Result, UnfilledSpan
    from priorfill.filling.result_from_files import result_from_files
    from priorfill.filling.uncertainty_file import write_uncertainty
    from priorfill.formats import read, write
    from priorfill.gaps import (
        Gap,
        GapGroup,
        find_gaps,
        gap_groups,
    )
    from priorfill.markers.marker_set import MarkerSet
    from priorfill.report.notebook_progress import notebook_progress
    from priorfill.report.report_file import write_report
    from priorfill.reviewing.session import SavedReview
    from priorfill.reviewing.start import ReviewOptions, review
    from priorfill.study.job import JobOutcome
    from priorfill.study.run_study import Study, batch
    from priorfill.study.study_options import StudyOptions, StudyProgress

_PLACES = {
    "AddedClip": "priorfill.filling.add_result",
    "Artefact": "priorfill.artefacts",
    "Clip": "priorfill.clip",
    "ClipOrigin": "priorfill.database",
    "Evaluation": "priorfill.evaluation",
    "EvaluationOptions": "priorfill.evaluation",
    "FileOptions": "priorfill.filling.fill_file",
    "FileResult": "priorfill.filling.fill_file",
    "FillOptions": "priorfill.filling.fill_options",
    "FilledArray": "priorfill.filling.fill_array",
    "FilledGap": "priorfill.filling.result",
    "Gap": "priorfill.gaps",
    "GapFilter": "priorfill.filling.gap_filter",
    "GapGroup": "priorfill.gaps",
    "GapOverride": "priorfill.filling.overrides",
    "JobOutcome": "priorfill.study.job",
    "MadeFor": "priorfill.filling.overrides",
    "MarkerSet": "priorfill.markers.marker_set",
    "Overrides": "priorfill.filling.overrides",
    "PriorDatabase": "priorfill.database",
    "PriorfillError": "priorfill.errors",
    "Provenance": "priorfill.filling.provenance",
    "Result": "priorfill.filling.result",
    "ReviewOptions": "priorfill.reviewing.start",
    "SavedReview": "priorfill.reviewing.session",
    "Selection": "priorfill.database",
    "Study": "priorfill.study.run_study",
    "StudyOptions": "priorfill.study.study_options",
    "StudyProgress": "priorfill.study.study_options",
    "UnfilledSpan": "priorfill.filling.result",
    "add_result": "priorfill.filling.add_result",
    "batch": "priorfill.study.run_study",
    "evaluate": "priorfill.evaluation",
    "fill": "priorfill.filling.fill_clip",
    "fill_array": "priorfill.filling.fill_array",
    "fill_dataset": "priorfill.filling.fill_dataset",
    "fill_file": "priorfill.filling.fill_file",
    "find_artefacts": "priorfill.artefacts",
    "find_gaps": "priorfill.gaps",
    "gap_groups": "priorfill.gaps",
    "notebook_progress": "priorfill.report.notebook_progress",
    "overrides_template": "priorfill.filling.overrides_template",
    "read": "priorfill.formats",
    "read_overrides": "priorfill.filling.overrides_file",
    "read_subjects": "priorfill.filling.multi_subject",
    "review": "priorfill.reviewing.start",
    "report_from_files": "priorfill.filling.report_from_files",
    "result_from_files": "priorfill.filling.result_from_files",
    "write": "priorfill.formats",
    "write_overrides": "priorfill.filling.overrides_file",
    "write_report": "priorfill.report.report_file",
    "write_uncertainty": "priorfill.filling.uncertainty_file",
}
"""The module that defines each public name."""

__all__ = [
    "AddedClip",
    "Artefact",
    "Clip",
    "ClipOrigin",
    "Evaluation",
    "EvaluationOptions",
    "FileOptions",
    "FileResult",
    "FillOptions",
    "FilledArray",
    "FilledGap",
    "Gap",
    "GapFilter",
    "GapGroup",
    "GapOverride",
    "JobOutcome",
    "MadeFor",
    "MarkerSet",
    "Overrides",
    "PriorDatabase",
    "PriorfillError",
    "Provenance",
    "Result",
    "ReviewOptions",
    "SavedReview",
    "Selection",
    "Study",
    "StudyOptions",
    "StudyProgress",
    "UnfilledSpan",
    "__version__",
    "add_result",
    "batch",
    "evaluate",
    "fill",
    "fill_array",
    "fill_dataset",
    "fill_file",
    "find_artefacts",
    "find_gaps",
    "gap_groups",
    "notebook_progress",
    "overrides_template",
    "read",
    "read_overrides",
    "read_subjects",
    "report_from_files",
    "result_from_files",
    "review",
    "write",
    "write_overrides",
    "write_report",
    "write_uncertainty",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version  # takes longer to import than all else here

        return version("priorfill")
    if name not in _PLACES:
        raise AttributeError(f"module 'priorfill' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
