"""Donors of missing markers: recordings that show them together with the visible markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import mirrored, reflected
from priorfill.geometry.poses import complete_poses, evenly_spaced, sample_complete_poses
from priorfill.methods.gpr.dropout.marker_coupling import MarkerCoupling
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.dropout.subjects import Subjects, SubjectSample
from priorfill.methods.task import THIS_CLIP, Task
from priorfill.runtime.elementary import exp

__all__ = ["Donor", "Donors", "describe_donors"]

OWN_FRAMES = "the clip's own few frames"
SAME_SUBJECT = "other recordings of the same subject"
OWN_IMAGE = "the clip's mirror image"
OTHER_SUBJECTS = "other subjects of the database"
_SOURCES = (OWN_FRAMES, SAME_SUBJECT, OWN_IMAGE, OTHER_SUBJECTS)
"""Names of the kinds of donors in reports, in the order in which they are listed."""


@dataclass(frozen=True, eq=False)
class Donor:
    """Poses of a subject, or of its mirror image, that show the missing markers.

    Attributes
    ----------
    subject : int
        Number of the subject; `THIS_CLIP` for the clip's own.
    mirrored : bool
        Whether the poses are those of the mirror image.
    visible : ndarray [shape=(poses, visible markers, 3), mm]
        Upright.
    missing : ndarray [shape=(poses, missing markers, 3), mm]
        The markers that are missing from the clip.
    takes : tuple of str
        Names of the recordings.
    sources : tuple of str
        Kinds of these recordings, for reports.
    """

    subject: int
    mirrored: bool
    visible: NDArray[np.float64]
    missing: NDArray[np.float64]
    takes: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()

    @property
    def is_own(self) -> bool:
        """Whether it is the clip's own subject, not mirrored."""
        return self.subject == THIS_CLIP and not self.mirrored


class Donors:
    """Finds the donors of markers that the clip of a task hardly shows.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    options : DropoutOptions
        Numbers of donors and of their poses.
    """

    def __init__(self, task: Task, options: DropoutOptions) -> None:
        self.task = task
        self.subjects = Subjects(task, options)
        self._options = options

    def nearest_visible(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Choose the visible markers to predict from.

        Parameters
        ----------
        markers : ndarray of int
            The missing markers.
        visible : ndarray of int
            Markers visible where these are to be predicted.

        Returns
        -------
        ndarray of int
            The nearest first; empty where no recording shows the missing markers.
        """
        samples = self.subjects.samples_with(markers)
        if not samples:
            return visible[:0]
        shown = np.array([~np.isnan(s.poses[..., 0]).all(axis=0) for s in samples])
        common = shown[:, visible].mean(axis=0) >= self._options.min_visible_share
        distance = self.subjects.distances_where_shown(markers, markers)[0].min(axis=0)
        usable = visible[common & np.isfinite(distance[visible])]
        image = mirrored(self.task.positions, self.subjects.contralateral)
        image = image[complete_poses(image[:, markers])]
        if (
            self.task.learn_from_clip
            and len(image)
            and not self._own_subject_moves(markers, usable)
        ):
            # a donor pose must show every marker that is used; where the mirror image is the main
            # donor, a visible marker that it never shows would exclude it
            usable = usable[~np.isnan(image[:, usable, 0]).all(axis=0)]
        nearest: NDArray[np.intp] = usable[np.argsort(distance[usable], kind="stable")]
        return nearest[: self._options.max_visible]

    def _own_subject_moves(self, markers: NDArray[np.intp], visible: NDArray[np.intp]) -> bool:
        """Whether recordings of the clip's own subject show some markers in motion."""
        subjects = self.subjects
        own = [
            SubjectSample(s.take, s.subject, s.poses[complete_poses(s.poses[:, markers])])
            for s in subjects.samples
            if (s.from_clip and self.task.learn_from_clip) or s.take in subjects.same_subject_takes
        ]
        if sum(len(s.poses) for s in own) < self._options.min_own_poses:
            return False
        own_spread = subjects.distances(visible, own)[1][:, visible]
        spread = subjects.distances(visible)[1][:, visible]
        known = np.isfinite(own_spread)
        min_ratio = self._options.min_relative_motion
        return bool(known.any() and own_spread[known].mean() >= min_ratio * spread[known].mean())

    def donors_of(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> tuple[list[Donor], MarkerCoupling]:
        """Return the donors of some missing markers, and these markers' coupling.

        Parameters
        ----------
        markers : ndarray of int
            The missing markers.
        visible : ndarray of int
            The visible markers to predict from.

        Returns
        -------
        donors : list of Donor
            The clip's own subject first, then others, those of the most similar shape first.
        coupling : MarkerCoupling
            Of the missing markers to the visible ones.
        """
        options, takes = self._options, self.task.takes
        coupling = self.coupling(markers, visible)
        difference = self._shape_differences(coupling, visible)
        own = [i for i in difference if i in self.subjects.same_subject_takes]
        by_subject: dict[int, list[int]] = {}
        for sample in self.subjects.samples:
            if sample.take in difference and sample.take not in own:
                by_subject.setdefault(sample.subject, []).append(sample.take)

        def rank(subject: int) -> tuple[bool, float, int]:
            """Rank recorded markers before virtual ones, then by shape."""
            some = by_subject[subject]
            virtual = all(takes[i].virtual_markers for i in some)
            return virtual, min(difference[i] for i in some), subject

        donors = self.own_donors(own, markers, visible, self.frames_with(markers))
        for subject in sorted(by_subject, key=rank)[: options.max_donor_subjects]:
            some = sorted(by_subject[subject], key=lambda i: (difference[i], i))
            donors += self._database_donors(
                some[: options.max_takes_per_subject], subject, markers, visible
            )
        return donors, coupling

    def _shape_differences(
        self, coupling: MarkerCoupling, visible: NDArray[np.intp]
    ) -> dict[int, float]:
        """Return the difference (mm) of each take's body shape from the clip's, by take."""
        clip = self.task.positions[:, visible]
        shape = coupling.body_shape(clip[complete_poses(clip)], self._options)
        difference = {}
        for sample in self.subjects.samples:
            poses = sample.poses[:, visible]
            poses = poses[complete_poses(poses)]
            if not sample.from_clip and len(poses):
                other = coupling.body_shape(poses, self._options)
                difference[sample.take] = float(np.linalg.norm(other - shape))
        return difference

    def coupling(self, markers: NDArray[np.intp], visible: NDArray[np.intp]) -> MarkerCoupling:
        """Return the coupling of missing markers to visible ones, from all that show them."""
        subjects, options = self.subjects, self._options
        distances, spreads = subjects.distances_where_shown(markers, markers)
        distance, spread = distances.min(axis=0)[visible], spreads.min(axis=0)[visible]
        visible_spread = subjects.distances(visible)[1][:, visible]
        donor_spread = subjects.distances_where_shown(markers, visible)[1][:, visible]
        motion = np.nanmean(donor_spread[np.isfinite(donor_spread)])
        usual_motion = visible_spread[np.isfinite(visible_spread)].mean()
        if motion < options.min_relative_motion * usual_motion:
            # donors that stand still show no rigidity; that of adjacent markers is used
            near = exp(-0.5 * (distance / options.neighbour_length_scale) ** 2)
            weight = near * (1.0 - np.eye(len(visible)))
            total = weight.sum(axis=1)  # 0 where all others are metres away
            adjacent = np.divide(
                (weight * visible_spread).sum(axis=1), total, np.zeros_like(total), where=total > 0
            )
            spread = np.maximum(spread, adjacent)
        return MarkerCoupling(distance, spread, visible_spread)

    def own_donors(
        self,
        takes: Sequence[int],
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
        frames: NDArray[np.intp],
    ) -> list[Donor]:
        """Return the clip's own subject and its mirror image as donors.

        Parameters
        ----------
        takes : sequence of int
            Other recordings of the subject.
        markers, visible : ndarray of int
            The missing markers, and the visible ones to predict from.
        frames : ndarray of int
            Frames of the clip that may be used.
        """
        task, options = self.task, self._options
        columns = np.concatenate([visible, markers])
        parts, names = [task.positions[np.ix_(frames, columns)]], [task.name]
        for i in takes:
            # at the recorded rate, because the recording may be short
            parts.append(task.takes[i].positions(0, columns).astype(np.float64))
            names.append(task.takes[i].name)
        samples = [sample_complete_poses(part, options.max_own_poses) for part in parts]
        poses = np.concatenate(samples)
        poses = poses[evenly_spaced(len(poses), options.max_own_poses)]
        image = sample_complete_poses(
            mirrored(task.positions, self.subjects.contralateral)[:, columns],
            options.max_image_poses,
        )
        if not task.learn_from_clip:
            image = image[:0]
        count = len(visible)
        donors = []
        if len(poses):
            used = tuple(name for name, part in zip(names, samples, strict=True) if len(part))
            sources: tuple[str, ...] = (OWN_FRAMES,) if len(samples[0]) else ()
            sources += (SAME_SUBJECT,) if any(len(part) for part in samples[1:]) else ()
            donors.append(
                Donor(THIS_CLIP, False, poses[:, :count], poses[:, count:], used, sources)
            )
        if len(image):
            donors.append(
                Donor(
                    THIS_CLIP,
                    True,
                    image[:, :count],
                    image[:, count:],
                    (task.name,),
                    (OWN_IMAGE,),
                )
            )
        return donors

    def _database_donors(
        self,
        takes: Sequence[int],
        subject: int,
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
    ) -> list[Donor]:
        """Return a subject of the database and its mirror image as donors."""
        columns = np.concatenate([visible, markers])
        count, donors = len(visible), []
        for image, wanted in ((False, columns), (True, self.subjects.contralateral[columns])):
            if (wanted < 0).any():
                continue  # a marker without a contralateral one has no image
            parts, names = [], []
            for i in takes:
                take = self.task.takes[i]
                level = take.nearest_level(self._options.database_rate)
                poses = take.positions(level, wanted).astype(np.float64)
                poses = poses[complete_poses(poses)]
                if len(poses):
                    parts.append(poses)
                    names.append(take.name)
            if parts:
                poses = np.concatenate(parts)
                poses = poses[evenly_spaced(len(poses), self._options.poses_per_subject)]
                poses = reflected(poses) if image else poses
                donors.append(
                    Donor(
                        subject,
                        image,
                        poses[:, :count],
                        poses[:, count:],
                        tuple(names),
                        (OTHER_SUBJECTS,),
                    )
                )
        return donors

    def frames_with(self, markers: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the frames of the clip that show some markers and may be learnt from."""
        frames: NDArray[np.intp] = np.flatnonzero(self.task.valid[:, markers].all(axis=1))
        return frames if self.task.learn_from_clip else frames[:0]


def describe_donors(donors: Sequence[Donor]) -> str:
    """Return the kinds of some donors, for reports.

    Examples
    --------
    >>> poses = np.zeros((1, 3, 3))
    >>> image = Donor(1, True, poses, poses, sources=(OTHER_SUBJECTS,))
    >>> own = Donor(THIS_CLIP, False, poses, poses, sources=(OWN_FRAMES,))
    >>> describe_donors([image, own])
    "the clip's own few frames, other subjects of the database"
    """
    found = {source for donor in donors for source in donor.sources}
    return ", ".join(source for source in _SOURCES if source in found)
