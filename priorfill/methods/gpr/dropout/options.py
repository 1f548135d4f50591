"""Options of the prediction of dropouts."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.gp.features import Alignment
from priorfill.gp.process import GaussianProcess
from priorfill.methods.gpr.dropout.multi_subject_kernel import MultiSubjectKernel
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["DropoutOptions"]

_ALIGNMENTS = (
    Alignment("rigid", length_scale=160.0, min_weight=0.002),
    Alignment("rigid", length_scale=220.0, min_weight=0.005, rigidity_scale=10.0),
    Alignment("heading", length_scale=220.0, min_weight=0.005, rigidity_scale=10.0),
)

_LINEAR_KERNEL = MultiSubjectKernel(
    linear_variance=1.0,
    rbf_variance=1.0,
    length_scale=0.6,
    offset_variance=0.2,
    movement_ratio=0.2,
    shape_share=0.75,
    image_share=0.20,
    shape_scale=30.0,
)
_LOCAL_KERNEL = MultiSubjectKernel(
    linear_variance=0.1,
    rbf_variance=2.0,
    length_scale=0.6,
    offset_variance=0.2,
    movement_ratio=0.2,
    shape_share=0.80,
    image_share=0.10,
    shape_scale=30.0,
)


@dataclass(frozen=True)
class DropoutOptions:
    """Options of the prediction of dropouts (`priorfill.methods.gpr.dropout`).

    The defaults were chosen on markers removed from recordings of CMU, HDM05 and gait laboratories.
    Where a value was compared with others, or has another reason, its description says so.

    Attributes
    ----------
    max_database_takes : int
        Takes of a database that are examined, evenly spaced: enough to include most of its
        subjects.
    shape_poses : int
        Poses of each take from which distances of markers and body shapes are estimated.
    max_own_poses : int
        Training poses of the clip's own subject.
    max_image_poses : int
        Training poses of the clip's mirror image; also the poses on which the models are
        compared where only one subject is a donor.
    database_rate : float
        Hz. Rate at which takes of a database are read: poses closer in time are redundant.
    same_subject_distance : float
        mm. A database take whose rigid distances differ from the clip's by no more than this
        (median) is of the clip's own subject with the same marker placement. In CMU, HDM05 and
        gait recordings, takes of one session differ by 0.3 to 2.4 mm, those of different people by
        3.4 mm and more.
    same_name_distance : float
        mm. The same for takes whose subject has the name of the clip's. Markers placed again
        differ by 4 mm and more, but a name such as "male" proves nothing.
    rigid_pairs_per_marker : int
        Pairs of markers compared, per marker: those whose distances vary least.
    max_visible : int
        Nearest visible markers that a missing marker is predicted from.
    max_donor_subjects : int
        Other subjects used as donors, those of the most similar shape.
    max_takes_per_subject : int
        Takes of each of them.
    poses_per_subject : int
        Training poses of each of them, and as many of its mirror image.
    min_visible_share : float
        Visible markers that a smaller share of the donors shows are not used, because a training
        pose must show all that are.
    min_own_poses : int
        With fewer poses of the clip's own subject, its mirror image decides which visible markers
        are used.
    min_relative_motion : float
        A donor whose markers move against each other by less than this part of the clip's does not
        show how the markers move together.
    neighbour_length_scale : float
        mm. In that case the rigidity of a missing marker is that of visible markers near it,
        weighted by exp(-D² / 2 neighbour_length_scale²).
    shape_rigidity_scale : float
        mm. Standard deviation of a distance at which it has half the weight in a body's shape.
    shape_length_scale : float
        mm. Distance D from the missing marker at which a visible one has the weight exp(-1/2) in
        a body's shape.
    alignments : tuple of Alignment
        How poses are aligned, and how visible markers are weighted, in the models.
    processes : tuple of GaussianProcess
        Covariances and noise of the models; each is used with each alignment. Chosen on 92 markers
        removed from recordings of other people; a higher `image_share` predicts no better.
    own_noise_ratio : float
        Noise variance of poses of the clip's own subject, in units of that of other poses.
    weight_power : float
        Models are weighted by their cross-validated error to the power of minus this: 0 is
        their mean, infinity the best one alone.
    max_proxy_markers : int
        Visible markers near the missing one that are predicted in its place where there is only
        one donor subject, which cannot be held out.
    default_error : float
        mm. Expected error where neither a subject nor a marker can be held out.
    """

    max_database_takes: int = 400
    shape_poses: int = 24
    max_own_poses: int = 400
    max_image_poses: int = 60
    database_rate: float = 15.0
    same_subject_distance: float = 2.8
    same_name_distance: float = 6.0
    rigid_pairs_per_marker: int = 2
    max_visible: int = 12
    max_donor_subjects: int = 16
    max_takes_per_subject: int = 6
    poses_per_subject: int = 20
    min_visible_share: float = 0.5
    min_own_poses: int = 12
    min_relative_motion: float = 0.25
    neighbour_length_scale: float = 120.0
    shape_rigidity_scale: float = 5.0
    shape_length_scale: float = 300.0
    alignments: tuple[Alignment, ...] = _ALIGNMENTS
    processes: tuple[GaussianProcess, ...] = (
        GaussianProcess(_LINEAR_KERNEL, noise_variance=0.1),
        GaussianProcess(_LOCAL_KERNEL, noise_variance=0.1),
    )
    own_noise_ratio: float = 0.1
    weight_power: float = 4.0
    max_proxy_markers: int = 5
    default_error: float = 100.0

    def __post_init__(self) -> None:
        check_at_least(
            self,
            1,
            "max_database_takes",
            "shape_poses",
            "max_own_poses",
            "max_image_poses",
            "rigid_pairs_per_marker",
            "max_takes_per_subject",
            "poses_per_subject",
        )
        check_at_least(self, 3, "max_visible")  # three points define a frame of reference
        check_at_least(
            self,
            0,
            "same_subject_distance",
            "same_name_distance",
            "max_donor_subjects",
            "min_own_poses",
            "min_relative_motion",
            "own_noise_ratio",
            "weight_power",
            "max_proxy_markers",
            "default_error",
        )
        check_at_least(
            self,
            1e-3,
            "database_rate",
            "neighbour_length_scale",
            "shape_rigidity_scale",
            "shape_length_scale",
        )
        check_between(self, 0, 1, "min_visible_share")
