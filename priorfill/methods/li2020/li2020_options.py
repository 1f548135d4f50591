"""The constants of the methods of Li et al. 2020."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from priorfill.errors import OptionError
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["Li2020Options"]

MIN_POSITIVE = 1e-6
"""Smallest σ and weight; all are divisors."""

Over = Literal["coordinates", "frames"]
Mask = Literal["markers", "entries"]


@dataclass(frozen=True)
class Li2020Options:
    """Options of ``pca-train``, ``pca-pieces`` and ``pca-frames``.

    Attributes
    ----------
    min_singular_share : float
        As many eigenvectors are kept as are needed for their singular values (not squared) to sum
        to this share of the total: 0.99 in the authors' program, after Gløersen and Federolf 2016.
    rank : int, optional
        Number of eigenvectors, in place of `min_singular_share`.
    sigma : float
        mm. σ of the weights exp(-d² / 2σ²) of visible markers at a mean distance d from the nearest
        marker with a gap: 200 in the authors' program.
    gap_weight : float
        Weight of markers with gaps: 0.02 in the authors' program.
    max_windows : int
        Number of windows of the database in the training data, in addition to the clip. The paper
        uses 16 to 36, chosen by hand among dances of the same dancer; with fewer, they are more
        similar to the clip.
    body_shape_weight : float
        Distance of poses (mm) that is equivalent to a difference of 1 mm between the rigid
        distances of two subjects, where windows are chosen.
    context : float
        Number of frames of a trajectory used before and after missing frames, as a multiple of
        their number. The paper uses windows of 100 frames with up to 40 missing ones.
    min_context_frames : int
        Minimum number of these frames.
    stride : float
        Distance between the starts of windows of the clip, relative to their length, from which
        trajectories are taken.
    trajectory_singular_share : float
        As `min_singular_share`, for trajectories. With 0.99 the errors of complete frames of karate
        and of synthetic walking were 1.2 to 1.6 times as large, with 0.9 twice to three times.
    over : "coordinates" or "frames"
        What the eigenvectors of ``pca-train`` and ``pca-pieces`` are over: coordinates,
        Eqs. (1)-(4), or the frames of a piece, Eqs. (5)-(8), which mask by entries.
    mask : "markers" or "entries"
        What the template of the clip masks in training data: a marker with a gap in all frames, or
        the missing samples only, as in the paper.
    scale_sources : bool
        Whether other recordings are scaled to the size of the clip's subject, by the distances of
        markers that move as one: the paper scales sequences of different sources to the same
        level, and does not state how.
    frame_sigma : float, optional
        σ of the weights W = exp(-d² / 2σ²) of measured frames at d frames from the nearest missing
        one, Eqs. (13)-(16) of ``pca-frames``; as a multiple of the number of missing frames. The
        paper does not state W: weights are equal if it is not given. With 0.5, errors of 2 to 10
        missing frames inside clips were 0.3 to 1.04 times those with equal weights at 100 to
        120 Hz, 0.6 to 2.3 times at 30 Hz; those of single frames 1.8 to 3.3 times in most
        recordings; those of gaps at clip ends 0.9 to 3.3 times. Choose it by gaps of the same
        length that are cut into a recording of the same movements and frame rate.

    Raises
    ------
    OptionError
        Where a value is outside its range.
    """

    min_singular_share: float = 0.99
    rank: int | None = None
    sigma: float = 200.0
    gap_weight: float = 0.02
    max_windows: int = 8
    body_shape_weight: float = 10.0
    context: float = 1.0
    min_context_frames: int = 30
    stride: float = 0.25
    trajectory_singular_share: float = 0.999
    over: Over = "coordinates"
    mask: Mask = "markers"
    scale_sources: bool = False
    frame_sigma: float | None = None

    def __post_init__(self) -> None:
        check_between(self, 0.0, 1.0, "min_singular_share", "trajectory_singular_share")
        check_at_least(self, MIN_POSITIVE, "sigma", "gap_weight")
        check_at_least(self, 0, "max_windows", "body_shape_weight", "context", "stride")
        check_at_least(self, 1, "min_context_frames")
        if self.rank is not None and self.rank < 1:
            raise OptionError(f"Li2020Options.rank is {self.rank}; it must be at least 1, or none")
        if self.frame_sigma is not None:
            check_at_least(self, MIN_POSITIVE, "frame_sigma")
        for name, kind in (("over", Over), ("mask", Mask)):
            if getattr(self, name) not in get_args(kind):
                raise OptionError(
                    f"Li2020Options.{name} is {getattr(self, name)!r}; "
                    f"it must be {' or '.join(map(repr, get_args(kind)))}"
                )
