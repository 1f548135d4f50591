"""The ensembles of the regressions: alignments, lag features and Gaussian processes.

They were chosen on several hundred artificial gaps in takes of walking, karate, exercises and
acrobatics. No single model is best for all movements, and the ensemble is better than each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from priorfill.gp.features import Alignment, LagFeature
from priorfill.gp.kernels import Exponential, Forgetting, Matern32, SubjectCorrelation
from priorfill.gp.pose_process import PoseProcess
from priorfill.gp.problem import GPModel

__all__ = ["ModelOptions", "lags_of"]


def lags_of(models: Sequence[GPModel]) -> tuple[float, ...]:
    """Return the lags (s) of some models' lag features, each once."""
    return tuple(dict.fromkeys(m.lag_feature.seconds for m in models if m.lag_feature is not None))


def _combinations(
    alignments: Sequence[Alignment],
    lag_features: Sequence[LagFeature | None],
    processes: Sequence[PoseProcess],
) -> tuple[GPModel, ...]:
    """Return a model for each alignment, lag feature and process."""
    return tuple(
        GPModel(alignment, lag, process)
        for alignment in alignments
        for lag in lag_features
        for process in processes
    )


def _grouped(models: Sequence[GPModel]) -> tuple[GPModel, ...]:
    """Return models, each once, those of one alignment and of one lag feature together."""
    found: dict[Alignment, dict[LagFeature | None, dict[GPModel, None]]] = {}
    for model in models:
        of_alignment = found.setdefault(model.alignment, {})
        of_alignment.setdefault(model.lag_feature, {})[model] = None
    return tuple(m for by_lag in found.values() for some in by_lag.values() for m in some)


# ---- alignments ----------------------------------------------------------------------------------

_SEGMENT = Alignment("rigid", length_scale=220.0, min_weight=0.005, rigidity_scale=10.0)
_NEAR = Alignment("rigid", length_scale=120.0, min_weight=0.001, rigidity_scale=8.0)
_WIDE = Alignment("rigid", length_scale=300.0, min_weight=0.002, rigidity_scale=10.0)
_UPRIGHT = Alignment("heading", length_scale=220.0, min_weight=0.005, rigidity_scale=10.0)
_WHOLE_BODY = Alignment("heading", length_scale=200.0, min_weight=0.1)

# ---- single markers ------------------------------------------------------------------------------

_SHORT_SEAM = 0.001 * Exponential(time_scale=0.1)
_SMOOTH_SEAM = 0.05 * Matern32(time_scale=0.4)

_PLAIN = PoseProcess(linear=1.0, rbf=0.1, of_time=_SHORT_SEAM, noise_variance=1e-4)
_NOISY = replace(_PLAIN, noise_variance=1e-3)
_CURVED = replace(_PLAIN, rbf=1.0, length_scale=1.5)
_FORGETFUL = replace(_PLAIN, factor=SubjectCorrelation() * Forgetting(time=3.0, limit=0.5))
_LINEAR = PoseProcess(linear=30.0, of_time=0.01 * Matern32(time_scale=0.3), noise_variance=1e-4)

_BEFORE_AND_AFTER = LagFeature(1.0 / 30.0, weight=0.4)
_FURTHER_AWAY = LagFeature(1.0 / 15.0, weight=0.4)
_MOTION = LagFeature(1.0 / 30.0, weight=2.0, velocity=True)

_MARKER_PROCESSES = (_PLAIN, _NOISY, _CURVED, _FORGETFUL, _LINEAR)

_LONG_GAP = (
    *(
        model
        for alignment in (_SEGMENT, _NEAR, _UPRIGHT)
        for model in (
            *_combinations([alignment], [None], _MARKER_PROCESSES),
            *_combinations(
                [alignment], [_BEFORE_AND_AFTER, _FURTHER_AWAY, _MOTION], [_PLAIN, _CURVED]
            ),
        )
    ),
    *_combinations([_WIDE], [None], _MARKER_PROCESSES),
)

# Chosen from the 38 models for long gaps by 677 gaps in 94 masked recordings: removed one after the
# other was the model without which the error, and the distance from the mean of all 38, grew least.
# With fewer than 14 models, gaps of recordings that were not used for the choice have larger
# errors.
_SINGLE_MARKER = (
    *_combinations([_SEGMENT], [None], [_CURVED, _FORGETFUL, _LINEAR]),
    *_combinations([_SEGMENT], [_BEFORE_AND_AFTER, _FURTHER_AWAY], [_CURVED]),
    *_combinations([_NEAR], [None], [_CURVED, _FORGETFUL, _LINEAR]),
    *_combinations([_NEAR], [_BEFORE_AND_AFTER, _FURTHER_AWAY, _MOTION], [_PLAIN]),
    *_combinations([_UPRIGHT], [None], [_NOISY]),
    *_combinations([_UPRIGHT], [_BEFORE_AND_AFTER], [_CURVED]),
    *_combinations([_UPRIGHT], [_FURTHER_AWAY], [_PLAIN]),
    *_combinations([_WIDE], [None], [_PLAIN, _NOISY, _LINEAR]),
)

_SHORT_SEGMENT = _combinations([_SEGMENT, _NEAR, _UPRIGHT, _WIDE], [None], [_PLAIN, _LINEAR])

_FIRST_PASS = _combinations([_SEGMENT, _UPRIGHT], [None], [_PLAIN])

# ---- several markers -----------------------------------------------------------------------------

_LIMB_SMOOTH = PoseProcess(linear=3.0, rbf=3.0, of_time=_SMOOTH_SEAM, noise_variance=1e-5)
_LIMB_LINEAR = PoseProcess(linear=30.0, of_time=_SMOOTH_SEAM, noise_variance=1e-4)
_LIMB_LOCAL = PoseProcess(
    linear=0.3, rbf=1.0, length_scale=0.6, of_time=_SMOOTH_SEAM, noise_variance=1e-4
)

# follow the training poses closely
_STRONGLY_CURVED = tuple(
    replace(_LIMB_SMOOTH, rbf=10.0, length_scale=length_scale) for length_scale in (0.6, 0.4)
)

# returns to the mean pose where no training pose is similar
_TO_THE_MEAN = replace(_LIMB_LOCAL, linear=0.1, rbf=0.1, length_scale=0.4)

# Lags are multiples of 1/15 s, a step of the database's poses.
_LIMB_LAGS = (
    LagFeature(1.0 / 15.0, weight=0.8),
    LagFeature(2.0 / 15.0, weight=0.4),
    LagFeature(4.0 / 15.0, weight=0.6),
    LagFeature(2.0 / 15.0, weight=1.5, velocity=True),
)

# Chosen as the single marker's were, by 91 gaps of limbs and segments in 40 masked recordings, from
# all combinations of these processes and lags with three alignments, and five with the fourth: 74.
# In the half of the gaps that was not used for the choice, errors are 0.99 to 1.00 of those of all
# 74, and with 20 models 1.00 to 1.02.
_LIMB = (
    *_combinations(
        [_SEGMENT],
        [None],
        [_PLAIN, _LIMB_SMOOTH, _LIMB_LINEAR, _STRONGLY_CURVED[0], _TO_THE_MEAN],
    ),
    *_combinations([_SEGMENT], _LIMB_LAGS[:1], [_PLAIN, _LIMB_LINEAR, _LIMB_LOCAL]),
    *_combinations([_SEGMENT], _LIMB_LAGS[1:2], [_LIMB_SMOOTH]),
    *_combinations([_SEGMENT], _LIMB_LAGS[2:3], [_PLAIN]),
    *_combinations([_SEGMENT], _LIMB_LAGS[3:], [_LIMB_SMOOTH, _LIMB_LINEAR]),
    *_combinations([_UPRIGHT], [None], [_PLAIN, _LIMB_LINEAR, _STRONGLY_CURVED[1], _TO_THE_MEAN]),
    *_combinations([_UPRIGHT], _LIMB_LAGS[:2], [_PLAIN, _LIMB_LOCAL]),
    *_combinations([_UPRIGHT], _LIMB_LAGS[2:3], [_LIMB_SMOOTH, _LIMB_LINEAR, _LIMB_LOCAL]),
    *_combinations([_WHOLE_BODY], [None], [_STRONGLY_CURVED[0]]),
    *_combinations([_WHOLE_BODY], _LIMB_LAGS[:1], [_LIMB_SMOOTH]),
    *_combinations([_WHOLE_BODY], _LIMB_LAGS[1:2], [_PLAIN, _LIMB_SMOOTH, _LIMB_LINEAR]),
    *_combinations([_WHOLE_BODY], _LIMB_LAGS[2:3], [_LIMB_LOCAL]),
    *_combinations([_NEAR], [None], [_PLAIN, _LIMB_LINEAR]),
    *_combinations([_NEAR], _LIMB_LAGS[:1], [_PLAIN]),
)

# On 31 gaps in sets of one marker a joint the errors are 0.89 of those of the first of these models
# alone, and 0.88 with all models for limbs.
_LOOSE_MARKER = _grouped(
    (
        *_SINGLE_MARKER,
        *_combinations([_UPRIGHT, _WHOLE_BODY], [None, *_LIMB_LAGS], [_LIMB_SMOOTH]),
    )
)

# With the poses of a database, a problem is four times as large, and each model costs ten times as
# much. These were chosen from the 74 by 15 cases of limbs with databases of hours of motion and of
# real recordings, as the single marker's were. Fewer than 10 fill worse, and so do all 74.
_LIMB_WITH_DATABASE = (
    *_combinations([_SEGMENT], [None], [_STRONGLY_CURVED[1]]),
    *_combinations([_SEGMENT], _LIMB_LAGS[:1], [_LIMB_LOCAL]),
    *_combinations([_UPRIGHT], [None, _LIMB_LAGS[0]], [_PLAIN]),
    *_combinations([_UPRIGHT], _LIMB_LAGS[1:2], [_LIMB_LOCAL]),
    *_combinations([_UPRIGHT], _LIMB_LAGS[2:3], [_LIMB_SMOOTH]),
    *_combinations([_WHOLE_BODY], _LIMB_LAGS[:2], [_PLAIN]),
    *_combinations([_WHOLE_BODY], _LIMB_LAGS[3:], [_LIMB_LOCAL]),
    *_combinations([_NEAR], _LIMB_LAGS[:1], [_LIMB_SMOOTH]),
)

_SIMULATED_GAP = _combinations(
    [_SEGMENT, _UPRIGHT, _WHOLE_BODY], [None], [_PLAIN, _LIMB_SMOOTH, _LIMB_LOCAL]
)


@dataclass(frozen=True)
class ModelOptions:
    """The ensembles of models.

    Attributes
    ----------
    single_marker : tuple of GPModel
        For one marker, whose neighbours on the same body segment are mostly visible.
    long_gap : tuple of GPModel
        For one marker that is missing in more frames at once than it is measured in: what the
        models leave open matters more the less there is to learn from. On 40 markers missing in
        the last 60 and 90 % of ten recordings, errors are 0.95 and 0.98 of those by the models for
        a single marker, on a treadmill 0.84 and 0.89; of those missing in the last 30 %, 0.99.
    loose_marker : tuple of GPModel
        For one marker that moves relative to its neighbours, such as those of sparse marker sets:
        those for a single marker, and some for a limb.
    limb : tuple of GPModel
        For several markers at once, mostly those of a limb, which moves relative to what is
        visible.
    limb_with_database : tuple of GPModel
        For the same markers, learnt from the clip and the database together.
    simulated_gap : tuple of GPModel
        For gaps simulated in other recordings, whose own poses show what they are worth.
    short_segment : tuple of GPModel
        For segments of a few frames; where gaps have ragged edges there are hundreds of them.
    first_pass : tuple of GPModel
        For a first pass that a second one will replace.
    """

    single_marker: tuple[GPModel, ...] = _SINGLE_MARKER
    long_gap: tuple[GPModel, ...] = _LONG_GAP
    loose_marker: tuple[GPModel, ...] = _LOOSE_MARKER
    limb: tuple[GPModel, ...] = _LIMB
    limb_with_database: tuple[GPModel, ...] = _LIMB_WITH_DATABASE
    simulated_gap: tuple[GPModel, ...] = _SIMULATED_GAP
    short_segment: tuple[GPModel, ...] = _SHORT_SEGMENT
    first_pass: tuple[GPModel, ...] = _FIRST_PASS
