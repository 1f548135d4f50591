"""All options of the search for artefacts."""

from __future__ import annotations

from dataclasses import dataclass, field

from priorfill.artefacts.discontinuities import BreakOptions
from priorfill.artefacts.distance_outliers import DistanceOutlierOptions
from priorfill.artefacts.inconsistent_labels import InconsistentLabelOptions
from priorfill.artefacts.label_swaps import MAX_MISS_RATIO
from priorfill.artefacts.marker_path import OutlierRunOptions
from priorfill.artefacts.reference_markers import ReferenceMarkerOptions
from priorfill.artefacts.stuck import StuckOptions

__all__ = ["DEFAULT_ARTEFACT_OPTIONS", "ArtefactOptions"]


@dataclass(frozen=True)
class ArtefactOptions:
    """Options of `priorfill.artefacts.find_artefacts`, one group per detector.

    The defaults were chosen on recordings of HDM05, CMU and clinical gait, into which artefacts
    were planted (``scripts/studies/artefact_study.py``).

    Attributes
    ----------
    reference_markers : ReferenceMarkerOptions
    breaks : BreakOptions
    distance_outliers : DistanceOutlierOptions
    inconsistent_labels : InconsistentLabelOptions
    outlier_runs : OutlierRunOptions
    stuck : StuckOptions
    max_miss_ratio : float
        See `priorfill.artefacts.label_swaps.MAX_MISS_RATIO`.

    Examples
    --------
    >>> strict = ArtefactOptions(breaks=BreakOptions(min_size=5.0))
    >>> strict.breaks.min_size, strict.max_miss_ratio
    (5.0, 0.2)
    """

    reference_markers: ReferenceMarkerOptions = field(default_factory=ReferenceMarkerOptions)
    breaks: BreakOptions = field(default_factory=BreakOptions)
    distance_outliers: DistanceOutlierOptions = field(default_factory=DistanceOutlierOptions)
    inconsistent_labels: InconsistentLabelOptions = field(default_factory=InconsistentLabelOptions)
    outlier_runs: OutlierRunOptions = field(default_factory=OutlierRunOptions)
    stuck: StuckOptions = field(default_factory=StuckOptions)
    max_miss_ratio: float = MAX_MISS_RATIO


DEFAULT_ARTEFACT_OPTIONS = ArtefactOptions()
