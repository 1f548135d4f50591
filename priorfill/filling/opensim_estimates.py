"""What was estimated in a file for OpenSim: a table next to it.

OpenSim's files do not mark samples. The table has a row for each marker with estimated or missing
samples, and a weight for inverse kinematics that counts the expected errors.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.filling.assemble import expected_errors
from priorfill.filling.result import Result
from priorfill.formats.tables.opensim_trc import opensim_labels
from priorfill.gaps import runs
from priorfill.runtime.display import csv_cell

__all__ = ["estimates_path", "estimates_table"]

COLUMNS = (
    *("marker", "marker_in_file", "filled", "filled_frames", "missing", "missing_frames"),
    *("expected_mean_error_mm", "error_bound_90_mm", "ik_weight"),
)
"""Columns of the table."""

MODEL_ERROR_MM = 10.0
"""Rms distance of a measured marker from that of the model (mm) in inverse kinematics: skin moves,
and markers are placed by hand. OpenSim's guide calls 20 mm the limit of a good solution."""

_DECIMALS = 2


def estimates_path(output: Path) -> Path:
    """Return where the table of a file is."""
    return output.with_name(f"{output.stem}_estimates.csv")


def estimates_table(result: Result) -> bytes:
    """Return the table of a result.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    clip = result.clip
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for marker, name in enumerate(opensim_labels(clip.labels)):
        filled, missing = result.filled[:, marker], clip.missing[:, marker]
        if not (filled.any() or missing.any()):
            continue
        rms = result.expected_rms_mm[filled, marker]
        _, mean, bound = expected_errors(rms, result.error_bound_90_mm[filled, marker])
        writer.writerow(
            (
                csv_cell(clip.labels[marker]),
                csv_cell(name),
                int(filled.sum()),
                _runs(filled, clip.first_frame),
                int(missing.sum()),
                _runs(missing, clip.first_frame),
                _number(mean),
                _number(bound),
                _weight(rms, int((~missing).sum())),
            )
        )
    return text.getvalue().encode()


def _weight(rms: NDArray[np.float64], present: int) -> str:
    """Return the weight of a marker in least squares, 1 for one without filled samples.

    It is the variance of a measured marker relative to the mean variance of this one over its
    samples. Empty where no error is known.
    """
    known = rms[np.isfinite(rms)]
    if not present or len(known) < len(rms):
        return ""
    share = float((known**2).sum()) / present / MODEL_ERROR_MM**2
    return f"{1 / (1 + share):.{_DECIMALS}f}"


def _runs(chosen: NDArray[np.bool_], first: int) -> str:
    """Return the runs of frames, as the recording numbers them: ``92-116 130``."""
    spans = [(first + start, first + stop - 1) for start, stop in runs(chosen)]
    return " ".join(str(a) if a == b else f"{a}-{b}" for a, b in spans)


def _number(value: float) -> str:
    return f"{value:.{_DECIMALS}f}" if np.isfinite(value) else ""
