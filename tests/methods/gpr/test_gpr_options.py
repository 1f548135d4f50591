"""Options of the default method: ranges, and their effect on a fill."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import groupby

import numpy as np
import pytest
from gappy import ARM, person, with_gaps

from priorfill.errors import OptionError
from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods.gpr.ensembles import ModelOptions, lags_of
from priorfill.methods.gpr.gpr_fill import fill
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.options import flattened, with_values
from priorfill.methods.task import Estimate, Task
from priorfill.search.takes import same_subject_take

DEFAULT = GPROptions()
SMALL = GPROptions(
    models=ModelOptions(
        single_marker=DEFAULT.models.single_marker[::9], limb=DEFAULT.models.limb[::12]
    )
)
"""Few models, for speed."""


@cache
def task(kind: str) -> Task:
    """A clip of 3 s with gaps of one kind, and another recording of the same subject."""
    clip = person(seconds=3.0, rate=30.0)
    gaps = {
        "limb": (30, 50, ARM),
        "dropout": (0, clip.frames, ["RKNE"]),
        "blackout": (40, 50, clip.labels),
    }
    clip = with_gaps(clip, gaps[kind])
    other = same_subject_take(person(seconds=3.0, rate=30.0, seed=9), clip.labels)
    groups = tuple(gap_groups(clip.missing))
    return Task(clip.positions, clip.labels, clip.rate, describe(clip), groups, (other,))


@cache
def filled(kind: str, name: str = "", value: object = None) -> Estimate:
    options = with_values(SMALL, {name: value}) if name else SMALL
    return fill(task(kind), options=options)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("segments.joint_distance", 10.0),
        ("training.min_poses", 80),
        ("training.mirror_poses", 5),
        ("training.velocity_seconds", 0.1),
        ("training.database.own_poses", 5),
        ("training.database.penalty_per_doubling", 0.8),
        ("training.database.offset_variance", 0.0),
        ("correlation.mirror_image", 0.1),
        ("training.database.gap_poses", 2),
        ("training.database.gap_neighbours", 1),
        ("ensemble.weight_power", 0.0),
        ("ensemble.relative_std_power", 5.0),
        ("ensemble.prior_blocks", 0.0),
        ("ensemble.velocity_errors.min_bandwidth", 1e6),
        ("spline_nodes.rate", 5.0),
        ("velocity_fusion.error_time", 5.0),
        ("velocity_fusion.slow_error", 1.0),
        ("segment_lengths.spread_factor", 0.0),
        ("dropout.weight_power", 0.0),
        ("blackout.edge_seconds", 0.05),
        ("rigid_pairs.max_spread", 0.0),
        ("joining.seconds", 0.1),
        ("max_expected_error", 1.0),
    ],
)
def test_an_option_changes_the_fill(name: str, value: object) -> None:
    group = name.split(".")[0]
    kind = {"dropout": "dropout", "blackout": "blackout", "rigid_pairs": "blackout"}.get(
        group, "limb"
    )
    plain, changed = filled(kind), filled(kind, name, value)
    missing = ~task(kind).valid
    same = np.array_equal(plain.positions[missing], changed.positions[missing], equal_nan=True)
    same &= np.array_equal(plain.expected_rms[missing], changed.expected_rms[missing])
    assert not same


def test_without_poses_of_the_takes_a_limb_is_filled_from_the_clip() -> None:
    none = {"training.database.gap_poses": 0, "training.database.other_poses": 0}
    options = with_values(SMALL, none)
    found = fill(task("limb"), options=options)
    alone = fill(replace(task("limb"), takes=()), options=options)
    np.testing.assert_array_equal(found.positions, alone.positions)


def test_samples_with_a_large_expected_error_stay_missing() -> None:
    limited, plain = filled("limb", "max_expected_error", 10.0), filled("limb")
    uncertain = plain.expected_rms > 10.0
    assert uncertain.any()
    assert np.isnan(limited.positions[uncertain]).all()
    sure = ~task("limb").valid & ~uncertain
    np.testing.assert_array_equal(limited.positions[sure], plain.positions[sure])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("segments.max_share", 1.1),
        ("training.max_poses", 1),
        ("training.mirror_poses", 251),
        ("ensemble.relative_std_power", 11.0),
        ("training.database.rate", 0.0),
        ("correlation.other_subject", -0.1),
        ("search.max_markers", 2),
        ("ensemble.weight_power", -1.0),
        ("ensemble.velocity_errors.min_bandwidth", 0.0),
        ("spline_nodes.rate", float("nan")),
        ("joining.min_relative_error", 0.0),
        ("max_expected_error", 0.0),
    ],
)
def test_values_out_of_range_are_refused(name: str, value: object) -> None:
    with pytest.raises(OptionError, match=name.rpartition(".")[2]):
        with_values(DEFAULT, {name: value})


def test_every_option_is_documented() -> None:
    groups = [DEFAULT, *(getattr(DEFAULT, name.split(".")[0]) for name in flattened(DEFAULT))]
    groups += [DEFAULT.training.database, DEFAULT.ensemble.velocity_errors]
    for group in groups:
        if not hasattr(group, "__dataclass_fields__"):
            continue
        text = type(group).__doc__ or ""
        for field in group.__dataclass_fields__:
            assert field in text, f"{type(group).__name__}.{field}"


def test_the_ensembles_have_the_published_sizes() -> None:
    models = DEFAULT.models
    ensembles = [getattr(models, field) for field in models.__dataclass_fields__]
    assert [len(ensemble) for ensemble in ensembles] == [17, 38, 27, 32, 10, 9, 8, 2]
    for ensemble in ensembles:
        assert len(set(ensemble)) == len(ensemble)
        for key in (lambda m: m.alignment, lambda m: (m.alignment, m.lag_feature)):
            assert len([*groupby(ensemble, key)]) == len({key(m) for m in ensemble})
    # steps of the poses of a database, which are at 15 Hz
    lags = lags_of((*models.limb, *models.limb_with_database))
    np.testing.assert_allclose(np.array(lags) * 15.0, [1.0, 2.0, 4.0])
