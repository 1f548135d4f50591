"""Predict markers that a clip shows in too few frames to learn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import sample_complete_poses
from priorfill.methods.gpr.dropout.donors import Donor, Donors, describe_donors
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.dropout.predict_from_donors import (
    predict_from_donors,
    predict_with_each_model,
)
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE
from priorfill.methods.task import THIS_CLIP, Task

__all__ = ["DropoutPrediction", "DropoutPredictor"]


@dataclass(frozen=True, eq=False)
class DropoutPrediction:
    """Prediction of missing markers from donors.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    expected_rms : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    source : str
        Kinds of the donors.
    source_clips : tuple of str
        Names of their recordings.
    training_poses : int
        Number of poses of all donors.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    source: str
    source_clips: tuple[str, ...]
    training_poses: int


_ProxyKey = tuple[int, bytes, bytes, bool]
"""What decides the errors on a proxy: its number, the markers that it is predicted from together
with it, the frames of the clip to learn from, and whether the clip's own subject is the donor."""


class DropoutPredictor:
    """Predicts markers that the clip of a task shows in too few frames to learn from.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    options : DropoutOptions
        Donors and models.

    See Also
    --------
    priorfill.methods.gpr.blackout.fill_blackouts : Where too few other markers are visible.
    """

    def __init__(self, task: Task, options: DropoutOptions) -> None:
        self.task = task
        self._donors = Donors(task, options)
        self._options = options
        self._squares: dict[_ProxyKey, NDArray[np.float64] | None] = {}

    def nearest_visible(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Choose the visible markers to predict from; see `Donors.nearest_visible`."""
        return self._donors.nearest_visible(markers, visible)

    def predict(
        self,
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
        frames: NDArray[np.intp],
    ) -> DropoutPrediction | None:
        """Predict missing markers.

        Parameters
        ----------
        markers : ndarray of int
            The missing markers.
        visible : ndarray of int
            The markers to predict from, chosen by `nearest_visible`.
        frames : ndarray of int
            Frames of the clip in which these are visible.

        Returns
        -------
        DropoutPrediction or None
            None where there is no donor, or too few markers to predict from.
        """
        if len(visible) < MIN_VISIBLE:
            return None
        donors, coupling = self._donors.donors_of(markers, visible)
        if not donors:
            return None
        query = self.task.positions[np.ix_(frames, visible)]
        subjects = {donor.subject for donor in donors}
        errors = None
        if len(subjects) == 1:  # with it held out, no donor would be left
            errors = self._proxy_errors(markers, visible, from_clip=THIS_CLIP in subjects)
        positions, expected_rms = predict_from_donors(
            donors, query, coupling, self._options, errors
        )
        return DropoutPrediction(
            positions,
            expected_rms,
            describe_donors(donors),
            tuple(dict.fromkeys(name for donor in donors for name in donor.takes)),
            sum(len(donor.visible) for donor in donors),
        )

    def _proxy_errors(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp], *, from_clip: bool
    ) -> NDArray[np.float64]:
        """Estimate the error of each model on visible markers near the missing ones.

        Parameters
        ----------
        markers, visible : ndarray of int
            As for `predict`.
        from_clip : bool
            Whether the only donor is the clip's own subject; else it is one of the database.

        Returns
        -------
        ndarray [shape=(models,), mm]
            Rms error; `DropoutOptions.default_error` where no marker can be predicted.
        """
        options = self._options
        if len(visible) <= MIN_VISIBLE:
            return self._default_errors()
        frames = self._donors.frames_with(markers) if from_clip else np.empty(0, dtype=np.intp)
        frames = frames[self.task.valid[np.ix_(frames, visible)].all(axis=1)]
        together = np.sort(visible)  # in one order, whichever marker is missing
        squares = []
        for marker in visible[: options.max_proxy_markers]:
            key = int(marker), together.tobytes(), frames.tobytes(), from_clip
            if key not in self._squares:  # two threads would compute the same
                self._squares[key] = self._proxy_squares(int(marker), together, frames, from_clip)
            found = self._squares[key]
            if found is not None:
                squares.append(found)
        if not squares:
            return self._default_errors()
        errors: NDArray[np.float64] = np.sqrt(np.mean(squares, axis=0))
        return errors

    def _default_errors(self) -> NDArray[np.float64]:
        """Return the error of each model where no marker can be predicted [shape=(models,), mm]."""
        options = self._options
        return np.full(len(options.alignments) * len(options.processes), options.default_error)

    def _proxy_squares(
        self, marker: int, together: NDArray[np.intp], frames: NDArray[np.intp], from_clip: bool
    ) -> NDArray[np.float64] | None:
        """Return each model's mean squared error on a visible marker.

        Parameters
        ----------
        marker : int
            The proxy.
        together : ndarray of int
            The proxy and the markers that it is predicted from.
        frames : ndarray of int
            Frames of the clip to learn from, which show all of these.
        from_clip : bool
            As for `_proxy_errors`.

        Returns
        -------
        ndarray [shape=(models,), mm²] or None
            None where it cannot be predicted.
        """
        options = self._options
        proxy, others = np.array([marker]), together[together != marker]
        donors = self._proxy_donors(proxy, others, frames, from_clip)
        if all(donor.mirrored for donor in donors) and self._on_midline(marker):
            return None  # its image is the marker itself
        truth = self.task.positions[:, np.concatenate([others, proxy])]
        truth = sample_complete_poses(truth, options.max_image_poses)
        if not (donors and len(truth)):
            return None
        coupling = self._donors.coupling(proxy, others)
        found = predict_with_each_model(
            donors, truth[:, :-1], coupling, options, options.default_error
        )
        error = found.positions[:, :, 0] - truth[:, -1]
        squares: NDArray[np.float64] = (error**2).sum(axis=2).mean(axis=1)
        return squares

    def _proxy_donors(
        self,
        proxy: NDArray[np.intp],
        others: NDArray[np.intp],
        frames: NDArray[np.intp],
        from_clip: bool,
    ) -> list[Donor]:
        """Return donors of a visible marker, the same as those of the missing ones."""
        if from_clip:
            takes = sorted(self._donors.subjects.same_subject_takes)
            return self._donors.own_donors(takes, proxy, others, frames)
        donors, _ = self._donors.donors_of(proxy, others)
        return [donor for donor in donors if donor.subject != THIS_CLIP]

    def _on_midline(self, marker: int) -> bool:
        """Whether a marker is its own contralateral one."""
        return int(self._donors.subjects.contralateral[marker]) == marker
