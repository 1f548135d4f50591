"""Options of the training data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from priorfill.methods.gpr.gap_segments import SegmentBatch
from priorfill.methods.gpr.sources.simulated_gaps import SimulatedGapOptions
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["DatabaseTrainingOptions", "TrainingOptions"]


@dataclass(frozen=True)
class DatabaseTrainingOptions:
    """Training data of the clip and the database together.

    Attributes
    ----------
    own_poses : int
        Evenly spaced poses of the clip; those adjacent to the gap are added.
    mirror_poses : int
        Poses of the clip's mirror image.
    gap_poses : int
        Poses of the database nearest to those in the gap.
    gap_neighbours : int
        Nearest poses of each pose in the gap from which these are chosen, at most.
    gap_share : float
        These nearest poses as a share of the poses searched, but no fewer than `clip_neighbours`:
        where a database is sparse, more of them are poses of other movements.
    other_poses : int
        Poses of the database nearest to the clip's training poses.
    clip_neighbours : int
        Nearest poses of each training pose of the clip from which these are chosen.
    rate : float
        Hz. Resolution at which the database is searched: at a lower rate the same number of poses
        is more varied.
    sufficient_seconds : float
        s. A clip that shows the missing markers for longer needs other subjects less.
    penalty_per_doubling : float
        Relative increase of `RegressionProblem.error_penalty` for each doubling of that time, and
        its decrease where it is half as long or less: few blocks can be held out then.
    offset_variance : float
        Variance of the subjects' offsets, in units of the kernels' constant: in effect, offsets
        are free.
    """

    own_poses: int = 60
    mirror_poses: int = 30
    gap_poses: int = 1000
    gap_neighbours: int = 200
    gap_share: float = 1.0 / 1000.0
    other_poses: int = 60
    clip_neighbours: int = 12
    rate: float = 15.0
    sufficient_seconds: float = 4.0
    penalty_per_doubling: float = 0.1
    offset_variance: float = 10.0

    def __post_init__(self) -> None:
        check_at_least(self, 0, "mirror_poses", "gap_poses", "other_poses", "offset_variance")
        check_between(self, 0.0, 1.0, "gap_share")
        check_at_least(self, 1, "own_poses", "gap_neighbours", "clip_neighbours")
        check_at_least(self, 0.1, "rate", "sufficient_seconds")
        check_between(self, 0.0, 0.9, "penalty_per_doubling")


@dataclass(frozen=True)
class TrainingOptions:
    """Which poses the regressions are trained with.

    Attributes
    ----------
    max_poses : int
        Evenly spaced poses of the clip; those adjacent to the gap are added. More do not fill
        better.
    part_rate : float
        Hz. A gap in which visible markers come and go has many parts with a regression each. Those
        of single markers are trained with this many poses for each second that shows them, at least
        `min_part_poses` and at most `max_poses`: in short clips, more poses are only denser. On
        309 gaps in patterns of a raw trial, errors are 1.004 +- 0.007 times those with `max_poses`;
        limbs are filled worse with fewer.
    min_part_poses : int
        See `part_rate`.
    adjacent_seconds : float
        s. Poses nearer than this to the gap are all used.
    mirror_poses : int
        Of each `max_poses`, in segments longer than `short_segment_seconds`: poses of the mirror
        image.
    min_poses : int
        With fewer complete poses of its own, a clip is filled from other recordings alone.
    enough_poses : int
        Distant visible markers are dropped until this many frames, or `enough_share` of those
        that show the missing markers, show the visible ones too.
    enough_share : float
        Share of the frames that show the missing markers; see `enough_poses`.
    min_kept_markers : int
        Visible markers that are not dropped, however few frames show them together.
    second_pass_share : float
        A gap segment is predicted a second time, its training poses completed by the first pass,
        if the first pass could use less than this share of the frames that show its markers.
    velocity_seconds : float
        s. Velocities are central differences over twice this time. Twice as long fills worse by
        one per cent.
    short_segment_seconds : float
        s. Segments no longer than this are predicted by a small ensemble: they are determined by
        the samples at their edges.
    min_third_weight : float
        A single marker is predicted like a limb if only two neighbours have a greater weight in
        the alignment (`priorfill.gp.features.Alignment`): it has no rigid segment. In sets of 41
        markers one or two of the thigh are below this, in sets of one marker a joint most are.
    database : DatabaseTrainingOptions
        Training data of the clip and the database together.
    simulated_gaps : SimulatedGapOptions
        Gaps in other recordings, which show what the database is worth.
    """

    max_poses: int = 250
    part_rate: float = 33.0
    min_part_poses: int = 150
    adjacent_seconds: float = 0.03
    mirror_poses: int = 90
    min_poses: int = 12
    enough_poses: int = 150
    enough_share: float = 0.5
    min_kept_markers: int = 4
    second_pass_share: float = 0.7
    velocity_seconds: float = 1.0 / 30.0
    short_segment_seconds: float = 0.1
    min_third_weight: float = 0.1
    database: DatabaseTrainingOptions = field(default_factory=DatabaseTrainingOptions)
    simulated_gaps: SimulatedGapOptions = field(default_factory=SimulatedGapOptions)

    def __post_init__(self) -> None:
        check_at_least(self, 2, "max_poses", "min_poses", "enough_poses")
        check_at_least(self, 3, "min_kept_markers")
        check_between(self, 0, self.max_poses, "mirror_poses")
        check_at_least(self, 2, "min_part_poses")
        check_at_least(self, 0.0, "part_rate")
        check_at_least(self, 0.0, "adjacent_seconds", "short_segment_seconds")
        check_at_least(self, 0.0, "min_third_weight")
        check_at_least(self, 1e-3, "velocity_seconds")
        check_between(self, 0.0, 1.0, "enough_share", "second_pass_share")

    def spaced_poses(self, batch: SegmentBatch, seconds: float) -> int:
        """Return how many evenly spaced poses of some seconds a batch is trained with."""
        if len(batch.markers) > 1 or batch.gap_frames <= batch.frames:
            return self.max_poses
        wanted = max(math.ceil(seconds * self.part_rate), self.min_part_poses)
        return min(wanted, self.max_poses)
