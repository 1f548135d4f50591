"""Recordings, gaps and errors for the tables of Gløersen and Federolf 2016.

The paper fills three motions: *WalkL* and *CP-gait* of its supplement, read from
``walkl/WalkL.c3d`` and ``walkl/CP-gait.c3d``, and *WalkRun*, a part of an HDM05 take. Where a
recording is lacking, a similar one is filled and called a stand-in; its errors need not agree.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from paper import find, method_alone
from threadpoolctl import threadpool_limits

import priorfill as pf
from priorfill.errors import MethodError
from priorfill.evaluation.gap_generator import GapGenerator, Mask, measured_in
from priorfill.gaps import gap_groups
from priorfill.geometry.axes import from_upright, to_upright
from priorfill.markers.describe import describe
from priorfill.methods.gloersen2016 import Gloersen2016Options, r1, r2
from priorfill.methods.task import Estimate, Task

__all__ = [
    "CP_GAIT",
    "METHODS",
    "MOTIONS",
    "RECORDING",
    "SEED",
    "WALKL",
    "WALKRUN",
    "Motion",
    "Sample",
    "Source",
    "deviations",
    "distances",
    "marker_of",
    "mean_distance",
    "patterns",
    "print_data",
    "quartiles",
    "random_gaps",
    "read",
    "recording",
    "samples",
]

Array = NDArray[np.float64]

METHODS: dict[str, Callable[..., Estimate]] = {"r1": r1, "r2": r2}
"""The two strategies of the paper: all markers at once, or one after the other."""

RECORDING = "fill this recording in place of all three"

PATTERNS = "missing_masks.npz"
"""File of gap patterns, in the folder of the recording."""

SEED = 2016

QUARTILES = (25.0, 75.0)


@dataclass(frozen=True)
class Source:
    """Frames of a recording.

    Attributes
    ----------
    file : str
        Below the folder of recordings.
    what : str
        Description.
    part : (int, int), optional
        First and last frame, counted from 1; all frames if not given.
    markers : str, optional
        Labels; all markers if not given.
    """

    file: str
    what: str
    part: tuple[int, int] | None = None
    markers: str = ""


@dataclass(frozen=True)
class Motion:
    """A motion of the paper.

    Attributes
    ----------
    name : str
        The paper's.
    own, stand_in : Source
        The paper's recording, and a similar one.
    gaps : (int, int)
        Smallest and largest number of gaps in a copy.
    seconds : (float, float)
        Their shortest and longest length.
    """

    name: str
    own: Source
    stand_in: Source
    gaps: tuple[int, int]
    seconds: tuple[float, float]


PLUG_IN_GAIT = (
    "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO LELB LWRA LWRB LFIN RSHO RELB RWRA RWRB RFIN "
    "LASI RASI SACR LTHI LKNE LTIB LANK LHEE LTOE RTHI RKNE RTIB RANK RHEE RTOE"
)
"""34 markers; the paper's child has 35."""

WALKL = Motion(
    "WalkL",
    Source("walkl/WalkL.c3d", "walking on a treadmill"),
    Source("hdm05/HDM_bd_01-02_01_120.c3d", "movements on the spot"),
    (5, 15),
    (20 / 240, 480 / 240),
)
WALKRUN = Motion(
    "WalkRun",
    Source("HDM_bd_01-03_01_120.c3d", "from walking to running", (1951, 2350)),
    Source(
        "hdm05/HDM_bd_01-02_01_120.c3d",
        "the same actor, from stepping to running on the spot",
        (886, 1285),
    ),
    (2, 6),
    (20 / 120, 120 / 120),
)
CP_GAIT = Motion(
    "CP-gait",
    Source("walkl/CP-gait.c3d", "a child with cerebral palsy walks"),
    Source("gait/HC044A15.c3d", "a healthy person walks", markers=PLUG_IN_GAIT),
    (2, 6),
    (20 / 200, 120 / 200),
)
MOTIONS = (WALKL, WALKRUN, CP_GAIT)

MARKERS = {
    "LHEE": ("M03",),
    "LANK": ("M02",),
    "LKNE": ("M05",),
    "LASIS": ("M14", "LASI", "LFWT"),
    "LSHO": ("M28",),
    "LELB": ("M30",),
    "LWRA": ("M32",),
    "LFHD": ("M34",),
}
"""Other labels of the paper's markers. Those of WalkL are numbers; which marker is which follows
from the geometry of its poses (anterior is -x, the left side -y)."""


@dataclass(frozen=True)
class Sample:
    """A recording that is filled.

    Attributes
    ----------
    motion : Motion
        The motion of the paper.
    file : Path
        The recording.
    own : bool
        Whether it is the paper's recording.
    """

    motion: Motion
    file: Path
    own: bool

    @property
    def source(self) -> Source:
        """What is filled."""
        return self.motion.own if self.own else self.motion.stand_in

    @property
    def clip(self) -> pf.Clip:
        """The frames that are filled."""
        whole = read(self.file)
        if self.file.name != Path(self.source.file).name:
            return whole
        first, last = self.source.part or (1, whole.frames)
        kept = [whole.index(label) for label in self.source.markers.split() or whole.labels]
        return replace(
            whole,
            positions=whole.positions[first - 1 : last, kept],
            labels=tuple(whole.labels[i] for i in kept),
            source=None,
        )

    @property
    def name(self) -> str:
        """The paper's name, marked if it is not its recording."""
        return self.motion.name if self.own else f"{self.motion.name}*"

    @property
    def why(self) -> str:
        """Why errors differ from the paper's; empty for its recording."""
        return "" if self.own else f"stand-in: {self.source.what}"


@cache
def read(file: Path) -> pf.Clip:
    """Read a recording, once in each process."""
    return pf.read(file)


def recording(arguments: argparse.Namespace, motion: Motion = WALKL) -> Sample:
    """Return the recording for a motion that the options of the script select."""
    names = motion.own.file, motion.stand_in.file
    file = find(names, arguments.data, arguments.recording)
    return Sample(motion, file, file.name == Path(names[0]).name)


def samples(arguments: argparse.Namespace, motions: Sequence[Motion] = MOTIONS) -> list[Sample]:
    """Return a recording for each motion, or the given one alone."""
    chosen = motions[:1] if arguments.recording else motions
    return [recording(arguments, motion) for motion in chosen]


def print_data(some: Sequence[Sample]) -> None:
    """Print the recordings of the paper, and what is filled in their place."""
    for sample in some:
        print(f"{sample.motion.name}: {_described(sample.motion.own)}")
        if not sample.own:
            given = sample.file.name != Path(sample.source.file).name
            what = sample.file.name if given else _described(sample.source)
            print(f"  * Stand-in: {what}")
        clip = sample.clip
        print(
            f"    {len(clip.labels)} markers, {clip.frames} frames, {clip.duration:.1f} s at "
            f"{clip.rate:g} Hz"
        )


def _described(source: Source) -> str:
    frames = "" if source.part is None else " frames {} to {}".format(*source.part)
    return f"{source.what} ({Path(source.file).name}{frames})"


def marker_of(clip: pf.Clip, name: str) -> int | None:
    """Return the index of a marker of the paper; None if there is none."""
    known = [label for label in (name, *MARKERS[name]) if label in clip.labels]
    return clip.labels.index(known[0]) if known else None


def patterns(file: Path) -> list[Mask]:
    """Return the patterns in the folder of a recording, if they fit it."""
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


def random_gaps(sample: Sample, copy: int) -> Mask:
    """Remove random markers at random times, as in the copies of the paper.

    Numbers of gaps, and their lengths, are uniform over the paper's ranges; no two gaps of a marker
    touch. The paper does not state how they are distributed.
    """
    clip, motion = sample.clip, sample.motion
    rng = np.random.default_rng([SEED, MOTIONS.index(motion), copy])
    generator = GapGenerator(clip, rng, measured_in(clip))
    low, high = motion.gaps
    for _ in range(int(rng.integers(low, high + 1))):
        generator.remove(generator.marker(), generator.length(*motion.seconds))
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
