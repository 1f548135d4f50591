"""The options of the default method."""

from __future__ import annotations

from dataclasses import dataclass, field

from priorfill.constraints.floor import FloorOptions
from priorfill.constraints.rigid_pairs import RigidPairOptions
from priorfill.constraints.segment_lengths import SegmentLengthOptions
from priorfill.constraints.velocity_fusion import VelocityFusionOptions
from priorfill.gp.ensemble import EnsembleOptions
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.ensembles import ModelOptions
from priorfill.methods.gpr.pose_search import SearchOptions
from priorfill.methods.gpr.segment_batches import SegmentOptions
from priorfill.methods.gpr.short_gaps.options import ShortGapOptions
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.methods.gpr.spline_nodes import SplineNodeOptions
from priorfill.methods.gpr.training.options import TrainingOptions
from priorfill.methods.gpr.training.subject_correlation import SubjectCorrelationOptions
from priorfill.runtime.option_checks import check_at_least, check_between
from priorfill.signal.gp_interpolation import InterpolationOptions
from priorfill.signal.smoothing import SmoothingOptions

__all__ = ["GPROptions", "JoiningOptions"]


@dataclass(frozen=True)
class JoiningOptions:
    """How predictions are joined to the measured samples at the edges of a gap.

    The velocity and acceleration terms of the energy spread the offset between the two over a
    time, as a Matérn process of smoothness 3/2 with this time scale would.

    Attributes
    ----------
    seconds : float
        s. That time for a marker whose expected error in the segment is 1 mm or less.
    growth : float
        The time is proportional to the expected error to this power, because larger errors persist
        for longer. Better by 0.3 to 1 % than the same time for all.
    max_seconds : float
        s. The longest time.
    min_relative_error : float
        Least expected error that enters the energy, in units of the greatest in the segment:
        frames at the edges are predicted almost exactly, which makes the system stiff without
        changing its solution.
    """

    seconds: float = 0.015
    growth: float = 0.4
    max_seconds: float = 0.1
    min_relative_error: float = 0.1

    def __post_init__(self) -> None:
        check_at_least(self, 1e-4, "seconds", "max_seconds")
        check_between(self, 0.0, 2.0, "growth")
        check_between(self, 1e-3, 1.0, "min_relative_error")


@dataclass(frozen=True)
class GPROptions:
    """Options of the default method; see `priorfill.methods.gpr.gpr_fill`.

    Unless an option's own documentation differs, the defaults were chosen by the mean error on
    artificial gaps in takes of walking, karate, exercises and acrobatics.

    Attributes
    ----------
    segments : SegmentOptions
        How gaps are joined and divided.
    training : TrainingOptions
        Training poses.
    correlation : SubjectCorrelationOptions
        Correlations with the clip's subject.
    search : SearchOptions
        Search of the database.
    models : ModelOptions
        Ensembles of models.
    gap_windows : GapWindowOptions
        Windows of the database that are as long as a limb's gap.
    ensemble : EnsembleOptions
        Weights of models, and calibration of expected errors.
    spline_nodes : SplineNodeOptions
        Frames that are predicted.
    velocity_fusion : VelocityFusionOptions
        Combination of positions and velocities.
    segment_lengths : SegmentLengthOptions
        Distances that are kept.
    rigid_pairs : RigidPairOptions
        Distances that are kept in blackouts.
    floor : FloorOptions
        The floor constraint.
    smoothing : SmoothingOptions
        Smoothing of jitter.
    interpolation : InterpolationOptions
        Interpolation of short gaps over time.
    dropout : DropoutOptions
        Markers that the clip hardly shows.
    blackout : BlackoutOptions
        Gaps in which too few other markers are visible.
    joining : JoiningOptions
        Edges of gaps.
    short_gaps : ShortGapOptions
        Short gaps that are filled over time before all others.
    short_gap_seconds : float
        s. Up to this length, interpolation over time is preferred to a prediction from other
        recordings.
    max_expected_error : float
        mm. Samples with a larger expected error stay missing. A missing limb, while the rest of
        the body is visible, has an expected error of up to 400 mm.

    See Also
    --------
    priorfill.methods.options.with_values : Set options by dotted name.
    """

    segments: SegmentOptions = field(default_factory=SegmentOptions)
    training: TrainingOptions = field(default_factory=TrainingOptions)
    correlation: SubjectCorrelationOptions = field(default_factory=SubjectCorrelationOptions)
    search: SearchOptions = field(default_factory=SearchOptions)
    models: ModelOptions = field(default_factory=ModelOptions)
    gap_windows: GapWindowOptions = field(default_factory=GapWindowOptions)
    ensemble: EnsembleOptions = field(default_factory=EnsembleOptions)
    spline_nodes: SplineNodeOptions = field(default_factory=SplineNodeOptions)
    velocity_fusion: VelocityFusionOptions = field(default_factory=VelocityFusionOptions)
    segment_lengths: SegmentLengthOptions = field(default_factory=SegmentLengthOptions)
    rigid_pairs: RigidPairOptions = field(default_factory=RigidPairOptions)
    floor: FloorOptions = field(default_factory=FloorOptions)
    smoothing: SmoothingOptions = field(default_factory=SmoothingOptions)
    interpolation: InterpolationOptions = field(default_factory=InterpolationOptions)
    dropout: DropoutOptions = field(default_factory=DropoutOptions)
    blackout: BlackoutOptions = field(default_factory=BlackoutOptions)
    joining: JoiningOptions = field(default_factory=JoiningOptions)
    short_gaps: ShortGapOptions = field(default_factory=ShortGapOptions)
    short_gap_seconds: float = 0.1
    max_expected_error: float = 1000.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "short_gap_seconds")
        check_at_least(self, 1.0, "max_expected_error")
