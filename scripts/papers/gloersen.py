"""Recordings, gaps and errors for the tables of Gløersen and Federolf 2016.

The recording ``WalkL`` of the paper (treadmill walking, 37 markers, 18 s at 240 Hz) and 50 gap
patterns are in its supplement. The scripts rely on the abstract, the published program and values
cited elsewhere. How random gaps were drawn and what each table averages is an interpretation,
which each script states.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from paper import find, method_alone
from threadpoolctl import threadpool_limits

import priorfill as pf
from priorfill.errors import MethodError
from priorfill.evaluation.gap_generator import GapGenerator, Mask, measured_in
from priorfill.evaluation.protocols import RANDOM_GAP_SECONDS, RANDOM_MAX_MISSING, TRIES_PER_GAP
from priorfill.gaps import gap_groups
from priorfill.geometry.axes import from_upright, to_upright
from priorfill.markers.describe import describe
from priorfill.methods.gloersen2016 import Gloersen2016Options, r1, r2
from priorfill.methods.task import Estimate, Task

__all__ = [
    "METHODS",
    "RECORDING",
    "SEED",
    "deviations",
    "distances",
    "is_the_papers",
    "mean_distance",
    "one_run",
    "print_data",
    "published",
    "quartiles",
    "read",
    "recording",
    "runs_in_frames",
    "spread",
]

Array = NDArray[np.float64]

METHODS: dict[str, Callable[..., Estimate]] = {"r1": r1, "r2": r2}
"""The two strategies of the paper: all markers at once, or one after the other."""

RECORDING = "WalkL of the paper's supplement as C3D, or any other recording"

NAMES = ("walkl/WalkL.c3d", "hdm05/HDM_bd_01-02_01_120.c3d")
"""The recording of the paper, and a long walk of HDM05."""

PATTERNS = "missing_masks.npz"
"""File with the published patterns, in the folder of the recording."""

SEED = 2016

QUARTILES = (25.0, 75.0)

CENTRAL_PERCENTILES = (5.0, 95.0)
"""Percentiles that enclose 90 % of the values."""


def recording(arguments: argparse.Namespace) -> Path:
    """Return the recording that the options of the script select."""
    return find(NAMES, arguments.data, arguments.recording)


def is_the_papers(file: Path) -> bool:
    """Return whether a recording is that of the paper, by name."""
    return file.name == Path(NAMES[0]).name


@cache
def read(file: Path) -> pf.Clip:
    """Read a recording, once in each process."""
    return pf.read(file)


def published(file: Path) -> list[Mask]:
    """Return the published patterns, if they are in the folder and fit the recording."""
    pattern_file = file.parent / PATTERNS
    if not pattern_file.is_file():
        return []
    shape = read(file).missing.shape
    with np.load(pattern_file) as stored:
        copies, frames, markers = (int(size) for size in stored["shape"])
        if (frames, markers) != shape:
            return []
        gone = np.unpackbits(stored["missing"], axis=1)[:copies, :frames].astype(bool)
    return [mask & measured_in(read(file)) for mask in gone]


def one_run(clip: pf.Clip, marker: int, share: float, copy: int) -> Mask | None:
    """Remove a marker in one random run of frames; None if there is no room."""
    rng = np.random.default_rng([SEED, marker, round(100 * share), copy])
    generator = GapGenerator(clip, rng, measured_in(clip))
    return generator.mask if generator.remove([marker], round(share * clip.frames)) else None


def runs_in_frames(clip: pf.Clip, share: float, copy: int) -> Mask:
    """Remove random markers at random times until a share of the frames lacks a marker.

    Lengths are those of the published patterns. The gaps of a smaller share are contained in those
    of a larger one, so that shares can be compared.
    """
    generator = GapGenerator(clip, np.random.default_rng([SEED, copy]), measured_in(clip))
    for _ in range(TRIES_PER_GAP * clip.frames):
        if generator.mask.any(axis=1).mean() >= share:
            break
        if generator.scatter_one(RANDOM_GAP_SECONDS, RANDOM_MAX_MISSING) is None:
            break
    return generator.mask


def deviations(
    clip: pf.Clip, gone: Mask, method: str, options: Gloersen2016Options | None = None
) -> Array | None:
    """Remove samples, fill them, and return the difference from the truth.

    Parameters
    ----------
    clip : Clip
        The truth.
    gone : ndarray of bool [shape=(frames, markers)]
        Samples to remove.
    method : str
        Name of a method.
    options : Gloersen2016Options, optional
        Constants of the paper's methods; those of the paper if not given.

    Returns
    -------
    ndarray [shape=(samples, 3), mm] or None
        Differences in the axes of the file, in the order of ``gone``. None if samples stay missing,
        because a mean over fewer samples would not be comparable.
    """
    positions = clip.positions.copy()
    positions[gone] = np.nan
    gappy = clip.with_positions(positions)
    try:
        with threadpool_limits(1):  # other cases run on the other cores
            if options is None:
                found = pf.fill(gappy, method=method, options=method_alone()).clip.positions
            else:
                found = from_upright(
                    METHODS[method](_task(gappy), options=options).positions, clip.up
                )
    except MethodError:
        return None
    off: Array = (found - clip.positions)[gone]
    return off if np.isfinite(off).all() else None


def _task(gappy: pf.Clip) -> Task:
    return Task(
        to_upright(gappy.positions, gappy.up),
        gappy.labels,
        gappy.rate,
        describe(gappy),
        tuple(gap_groups(gappy.missing)),
    )


def distances(
    clip: pf.Clip, gone: Mask, method: str, options: Gloersen2016Options | None = None
) -> Array | None:
    """Return the distance of each removed sample from the truth (mm); see `deviations`."""
    off = deviations(clip, gone, method, options)
    return None if off is None else np.asarray(np.linalg.norm(off, axis=1))


def mean_distance(
    clip: pf.Clip, gone: Mask, method: str, options: Gloersen2016Options | None = None
) -> float:
    """Return the mean error (mm) over the removed samples; NaN if any is left missing."""
    found = distances(clip, gone, method, options)
    return float("nan") if found is None or not found.size else float(found.mean())


def quartiles(values: Array) -> tuple[float, str]:
    """Return the median of the finite values, and their quartiles as text."""
    known = values[np.isfinite(values)]
    if not len(known):
        return float("nan"), "-"
    low, high = np.percentile(known, QUARTILES)
    return float(np.median(known)), f"{low:.1f}-{high:.1f}"


def spread(values: Array) -> str:
    """Return the range of the central 90 % of the finite values as text."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "-"
    low, high = np.percentile(known, CENTRAL_PERCENTILES)
    return f"{low:.1f}-{high:.1f}"


def print_data(file: Path, what: str) -> None:
    """Print the recordings of the paper and of this run."""
    clip = read(file)
    print("Paper: WalkL, walking on a treadmill, 37 markers, 18 s at 240 Hz (its supplement).")
    print(
        f"Here:  {file.name}, {len(clip.labels)} markers, {clip.duration:.0f} s at "
        f"{clip.rate:g} Hz; {what}."
    )
    if not is_the_papers(file):
        print("       Not the recording of the paper: values cannot be compared directly.")
