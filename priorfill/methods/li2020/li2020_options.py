"""The constants of the methods of Li et al. 2020."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Li2020Options"]


@dataclass(frozen=True)
class Li2020Options:
    """Options of `pca_train`, `pca_pieces` and `pca_frames`.

    Attributes
    ----------
    share : float
        As many eigenvectors are kept as it takes for their singular values (not squared) to sum
        up to this share: 0.99 in the authors' program, after Gløersen and Federolf 2016.
    rank : int, optional
        How many eigenvectors are kept, instead of `share`.
    sigma : float
        Width (mm) of the weights exp(-d² / 2 sigma²) of visible markers at a mean distance d from
        the nearest marker with a gap: 200 in the authors' program.
    gap_weight : float
        Weight of markers with gaps: 0.02 there.
    pieces : int
        How many pieces of the database are learnt from, beside the clip. The paper has 16 to 36,
        chosen by hand among the same dancer's dances; the fewer, the more alike they are.
    body : float
        How many mm between poses a difference of 1 mm between two bodies' distances counts as
        where pieces are chosen.
    context : float
        How many frames of a trajectory are looked at before and after missing frames, as a
        multiple of their number. The paper's pieces have 100 frames of which up to 40 are missing.
    fewest_context : int
        That many frames at least, before and after.
    stride : float
        Own pieces of trajectories start this share of their length apart.
    trajectory_share : float
        As `share`, for trajectories. With 0.99, whole frames of karate and of synthetic walking
        were filled 1.2 to 1.6 times worse, and with 0.9 twice to three times.
    """

    share: float = 0.99
    rank: int | None = None
    sigma: float = 200.0
    gap_weight: float = 0.02
    pieces: int = 8
    body: float = 10.0
    context: float = 1.0
    fewest_context: int = 30
    stride: float = 0.25
    trajectory_share: float = 0.999
