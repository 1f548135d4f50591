"""Correlation of a recording's subject with the subject of the clip; 1 for the same one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.task import THIS_CLIP
from priorfill.runtime.option_checks import check_at_least, check_between
from priorfill.search.takes import Take

__all__ = ["SubjectCorrelationOptions", "take_correlations"]


@dataclass(frozen=True)
class SubjectCorrelationOptions:
    """Correlations with the subject of the clip, apart from constant offsets.

    Attributes
    ----------
    mirror_image : float
        Of the mirror image of the clip's own subject; 0.7 to 0.95 fill about equally well.
    other_subject : float
        Of other subjects; 0.8 to 0.95 fill about equally well.
    virtual_markers : float
        Of other subjects whose markers were computed from a skeleton, which adds about a
        centimetre that depends on the pose.
    same_subject_distance : float
        mm. A take of the database whose rigid distances differ from the clip's by no more than this
        (median) is of the clip's own subject with the same marker placement: its correlation is 1,
        and it has no offset. In CMU, HDM05 and gait recordings, takes of one session differ by 0.3
        to 2.4 mm, those of different people by 3.4 mm and more.
    same_name_distance : float
        mm. The same for takes whose subject has the name of the clip's. Markers placed again
        differ by 4 mm and more, but a name such as "male" proves nothing.
    """

    mirror_image: float = 0.95
    other_subject: float = 0.9
    virtual_markers: float = 0.8
    same_subject_distance: float = 2.8
    same_name_distance: float = 6.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "same_subject_distance", "same_name_distance")
        check_between(self, 0.0, 1.0, "mirror_image", "other_subject", "virtual_markers")


def take_correlations(
    takes: Sequence[Take], subjects: NDArray[np.intp], options: SubjectCorrelationOptions
) -> NDArray[np.float64]:
    """Return the correlation of each take's subject with that of the clip [shape=(takes,)].

    Parameters
    ----------
    takes : sequence of Take
        The recordings.
    subjects : ndarray of int [shape=(takes,)]
        Number of each one's subject; `THIS_CLIP` for the clip's own.
    options : SubjectCorrelationOptions
        The correlations.
    """
    virtual = np.array([take.virtual_markers for take in takes], dtype=bool)
    others = np.where(virtual, options.virtual_markers, options.other_subject)
    return np.where(subjects == THIS_CLIP, 1.0, others)
