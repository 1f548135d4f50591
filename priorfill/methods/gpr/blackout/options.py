"""Options of the prediction of blackouts."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.gp.kernels import (
    RBF,
    Constant,
    Linear,
    Matern32,
    Matern52,
    Matern72,
    SubjectCorrelation,
)
from priorfill.gp.process import GaussianProcess
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["BlackoutOptions"]

_CURVE_PROCESSES = (
    GaussianProcess(Matern52(time_scale=0.3), noise_variance=1e-7),
    GaussianProcess(Matern52(time_scale=0.5), noise_variance=1e-7),
    GaussianProcess(Matern52(time_scale=1.0), noise_variance=1e-7),
    GaussianProcess(Matern52(time_scale=0.3), noise_variance=1e-5),
    GaussianProcess(Matern52(time_scale=0.2), noise_variance=1e-5),
    GaussianProcess(Matern52(time_scale=0.3), noise_variance=1e-4),
    GaussianProcess(Matern72(time_scale=0.2), noise_variance=1e-7),
    GaussianProcess(Matern72(time_scale=0.2), noise_variance=1e-6),
    GaussianProcess(Matern32(time_scale=0.3), noise_variance=1e-7),
)

_REST_PROCESSES = (
    GaussianProcess(Matern52(time_scale=0.3), noise_variance=1e-2),
    GaussianProcess(Matern52(time_scale=0.3), noise_variance=1.0),  # nearly a straight line
)

_CORRECTION_PROCESSES = tuple(
    GaussianProcess((0.1 * Linear() + RBF(length_scale) + Constant()) * SubjectCorrelation(), noise)
    for length_scale in (0.4, 0.7)
    for noise in (0.1, 0.5)
)


@dataclass(frozen=True)
class BlackoutOptions:
    """Options of the prediction of blackouts (`priorfill.methods.gpr.blackout`).

    The defaults were chosen on blackouts cut into recordings of CMU, HDM05 and gait laboratories.
    Where a value was compared with others, or has another reason, its description says so.

    Attributes
    ----------
    edge_seconds : float
        s. How much of the recording on either side of a blackout is used; 0.1 to 0.3 s fill
        equally well.
    max_edge_samples : int
        Samples of each side that are used.
    difference_seconds : float
        s. Step of the finite differences that give velocities and accelerations at an edge.
    inside_rate : float
        Hz. Rate at which the movement inside a blackout is learnt: the errors of the curves vary
        slowly.
    min_inside_frames, max_inside_frames : int
        Limits of the number of frames at which it is learnt. A second away from either edge only
        the coarse shape is predictable.
    curve_processes : tuple of GaussianProcess
        Processes in time (s) whose predictions are the curves through a blackout with two edges;
        the first gives the base curve, to which everything else is a correction. Noisy and smooth
        recordings, and long and short blackouts, need different ones.
    rest_processes : tuple of GaussianProcess
        Further processes, where there are windows of a database, for a body that hardly moves:
        without them such blackouts err by up to a fifth more. A clip has too few windows at rest of
        its own to choose them: they would make blackouts of moving bodies up to 14 % worse.
    marker_decay_seconds : tuple of float
        s. Decay times of a marker's velocity, one curve each, for a blackout with one edge; the
        first gives the base curve.
    common_decay_seconds : tuple of float
        s. Decay times of the mean velocity of all markers, one further curve each.
    velocity_fit_seconds : float
        s. The velocity at the edge is the slope of a line fitted to this much of the recording.
    max_windows : int
        Training windows of the clip, and as many of its mirror image.
    nearest_share : float
        Share of them whose edges are the most similar to the blackout's; the others are evenly
        spaced.
    max_candidates : int
        Windows of the clip that they are chosen from.
    window_spacing : float
        Distance between the first frames of consecutive windows, in units of their length.
    min_windows : int
        With fewer windows none is used.
    min_paired_share : float
        Share of the markers that must have a contralateral one for the mirror image to be used.
    velocity_seconds : float
        s. A velocity at an edge enters the features as the distance covered in this time.
    acceleration_seconds : float
        s. An acceleration at an edge enters multiplied by the square of this.
    max_database_windows : int
        Windows of the database.
    database_window_spacing : float
        s. Distance between the first frames of windows of one recording.
    max_stacked_windows, max_scored_windows : int
        Those with the most similar edges, by whose errors the curves are combined, and on which
        the errors of the corrected curves are estimated.
    similar_windows : int
        A window counts half if its edges are as far from the blackout's as those of this window, in
        order of distance.
    search_markers : int
        Markers by which poses of the database are searched.
    max_edge_distance : float
        mm. Rms distance of the markers at the edges above which a window of the database belongs
        to a different movement. The most similar walks of other people are at 60 to 90 mm;
        windows farther away gain nothing.
    weight_power : float
        Curves, and corrections, are weighted by their error to the power of minus this.
    stacking_ridge : float
        Ridge penalty of the stacking weights, in units of each curve's own sum of squares.
    correction_processes : tuple of GaussianProcess
        Processes that predict the errors of the curves from the edge features, whose unit is their
        rms distance from the mean of all windows.
    correction_exponents : tuple of float
        The errors of the curves are proportional to about this power of their disagreement. Each
        process is used with each exponent.
    scale_log_std : float
        Windows are weighted by a normal density of the logarithm of their disagreement relative
        to the blackout's; this is its standard deviation.
    min_similarity : float
        Added to that weight, in units of its maximum.
    min_relative_scale : float
        Lower limit of a window's disagreement in units of the median: at rest, only measurement
        noise is left of it.
    error_scale_exponent : float
        The expected error is proportional to this power of the disagreement, which leaves a third
        of the variance of its logarithm.
    untrained_error_ratio : float
        Expected error without windows, in units of the disagreement of the curves.
    predictable_seconds : float
        s. A movement continues as it began for this long; without windows, the distance covered
        afterwards is added to the expected error.
    min_speed : float
        mm/s. Lower limit of the speed used for that distance.
    max_gap_share : float
        A marker whose own gap is shorter than this share of the blackout that it belongs to is also
        interpolated over time by itself, and the prediction of the smaller expected error is used.
    """

    edge_seconds: float = 0.15
    max_edge_samples: int = 9
    difference_seconds: float = 0.05
    inside_rate: float = 20.0
    min_inside_frames: int = 3
    max_inside_frames: int = 60
    curve_processes: tuple[GaussianProcess, ...] = _CURVE_PROCESSES
    rest_processes: tuple[GaussianProcess, ...] = _REST_PROCESSES
    marker_decay_seconds: tuple[float, ...] = (0.2, 0.05, 0.1, 0.4, 1.0)
    common_decay_seconds: tuple[float, ...] = (0.3, 1.0, 4.0)
    velocity_fit_seconds: float = 0.05
    max_windows: int = 100
    nearest_share: float = 0.5
    max_candidates: int = 600
    window_spacing: float = 0.25
    min_windows: int = 3
    min_paired_share: float = 0.5
    velocity_seconds: float = 0.15
    acceleration_seconds: float = 0.1
    max_database_windows: int = 500
    database_window_spacing: float = 0.1
    max_stacked_windows: int = 200
    max_scored_windows: int = 100
    similar_windows: int = 20
    search_markers: int = 12
    max_edge_distance: float = 130.0
    weight_power: float = 8.0
    stacking_ridge: float = 0.02
    correction_processes: tuple[GaussianProcess, ...] = _CORRECTION_PROCESSES
    correction_exponents: tuple[float, ...] = (0.5, 1.0)
    scale_log_std: float = 0.4
    min_similarity: float = 0.05
    min_relative_scale: float = 0.2
    error_scale_exponent: float = 0.7
    untrained_error_ratio: float = 1.5
    predictable_seconds: float = 0.25
    min_speed: float = 100.0
    max_gap_share: float = 0.25

    def __post_init__(self) -> None:
        check_at_least(
            self,
            1e-3,
            "edge_seconds",
            "difference_seconds",
            "inside_rate",
            "velocity_fit_seconds",
            "marker_decay_seconds",
            "common_decay_seconds",
            "window_spacing",
            "database_window_spacing",
            "scale_log_std",
        )
        check_at_least(
            self,
            1,
            "min_inside_frames",
            "max_inside_frames",
            "max_windows",
            "max_candidates",
            "max_stacked_windows",
            "max_scored_windows",
            "similar_windows",
            "min_windows",
        )
        check_at_least(self, 2, "max_edge_samples")  # two give a velocity
        check_at_least(self, 3, "search_markers")  # three points define a frame of reference
        check_at_least(
            self,
            0,
            "velocity_seconds",
            "acceleration_seconds",
            "max_database_windows",
            "max_edge_distance",
            "weight_power",
            "stacking_ridge",
            "min_similarity",
            "min_relative_scale",
            "error_scale_exponent",
            "untrained_error_ratio",
            "predictable_seconds",
            "min_speed",
        )
        check_between(self, 0, 1, "nearest_share", "min_paired_share", "max_gap_share")
