from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from gappy import ARM, FOOT, error, fill_unchecked, person, straight, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip
from priorfill.errors import MethodError
from priorfill.formats import read
from priorfill.gaps import Gap, runs
from priorfill.methods import METHODS
from priorfill.methods.tits2018 import (
    continuity,
    distance_bounds,
    global_pca,
    global_regression,
    local_grnn,
    local_interpolation,
    local_polynomial,
    median_mean_filter,
    model_averaging,
    reference_triads,
    triad_frame,
)
from priorfill.methods.tits2018.recovery import MODELS, recover
from priorfill.methods.tits2018.tits2018_options import Tits2018Options, thinned

ALL = (*MODELS, "pma")

GAPS = with_gaps(person(), (60, 90, ARM), (100, 140, FOOT), (150, 180, ("C7",)))

seeds = st.integers(0, 2**32 - 1)


def wander(rng, *shape):
    """Random walks."""
    return rng.normal(size=shape).cumsum(axis=0)


def holed(rng, values, share=0.2):
    """Values with frames missing here and there."""
    values = values.copy()
    values[rng.random(len(values)) < share] = np.nan
    return values


# smoothing


def naive_smooth(column, window):
    """Smooth sample by sample, from the definition."""
    back, ahead = window // 2, window - 1 - window // 2
    for middle in (np.median, np.mean):
        out = column.copy()
        for i in range(len(column)):
            if np.isnan(column[i]):
                continue
            around = column[i - back : i + ahead + 1] if i >= back else column[:0]
            if len(around) < window or np.isnan(around).any():
                half = 0
                while (
                    i - half - 1 >= 0
                    and i + half + 1 < len(column)
                    and not np.isnan(column[[i - half - 1, i + half + 1]]).any()
                ):
                    half += 1
                around = column[i - half : i + half + 1] if half >= 2 else column[i : i + 1]
            out[i] = middle(around)
        column = out
    return column


@given(seed=seeds, frames=st.integers(1, 40), window=st.integers(1, 12))
def test_smooth_equals_its_definition(seed, frames, window):
    rng = np.random.default_rng(seed)
    values = holed(rng, wander(rng, frames, 2), 0.1)
    expected = values if window < 2 else np.stack([naive_smooth(c, window) for c in values.T], 1)
    np.testing.assert_allclose(median_mean_filter.smooth(values, window), expected, atol=1e-12)


@given(seed=seeds, window=st.integers(1, 15))
def test_smooth_keeps_straight_lines(seed, window):
    window = 2 * window + 1
    line = np.arange(50.0)[:, None] * np.array([1.0, -2.0]) + 3.0
    line = holed(np.random.default_rng(seed), line, 0.1)
    np.testing.assert_allclose(median_mean_filter.smooth(line, window), line, atol=1e-9)


# the frame of a triad


@given(seed=seeds)
def test_triad_there_and_back(seed):
    rng = np.random.default_rng(seed)
    markers, points = 100 * rng.normal(size=(7, 3, 3)), 100 * rng.normal(size=(7, 3))
    frame = triad_frame.axes(markers)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), [np.eye(3)] * 7, atol=1e-6)
    local = triad_frame.into(points, markers, frame)
    np.testing.assert_allclose(triad_frame.out_of(local, markers, frame), points, atol=1e-3)
    for f in range(7):
        second = triad_frame.into(markers[:, 1], markers, frame)[f]
        third = triad_frame.into(markers[:, 2], markers, frame)[f]
        np.testing.assert_allclose(second[1:], 0.0, atol=1e-6)
        np.testing.assert_allclose(third[1], 0.0, atol=1e-6)
        shape = triad_frame.shape_of(markers, frame)[f]
        np.testing.assert_allclose(shape, [second[0], third[0], third[2]], atol=1e-6)


def test_triad_without_a_frame():
    line = np.arange(3.0)[None, :, None] * np.array([10.0, 0.0, 5.0])
    place = np.ones((1, 3, 3))
    missing = np.where(np.arange(3)[:, None] == 2, np.nan, np.eye(3))[None]
    assert np.isnan(triad_frame.axes(np.concatenate([line, place, missing]))).all()


# the continuity correction


@given(seed=seeds, frames=st.integers(2, 9), known=st.tuples(st.booleans(), st.booleans()))
def test_ramp_equals_its_definition(seed, frames, known):
    before, after = np.random.default_rng(seed).normal(size=(2, 3))
    off = continuity.ramp(frames, before if known[0] else None, after if known[1] else None)
    for f in range(frames):
        share = f / (frames - 1)
        expected = {
            (True, True): before * (1 - share) + after * share,
            (True, False): before,
            (False, True): after,
            (False, False): np.zeros(3),
        }[known]
        np.testing.assert_allclose(off[f], expected, atol=1e-12)


# the skeleton constraint


def naive_constrain(point, references, shortest, longest, rounds):
    for _ in range(rounds):
        distances = [np.linalg.norm(point - r) for r in references]
        if all(lo <= d <= hi for lo, d, hi in zip(shortest, distances, longest, strict=True)):
            break
        for i in (2, 1, 0):
            distance = np.linalg.norm(point - references[i])
            for bound, beyond in (
                (longest[i], distance > longest[i]),
                (shortest[i], distance < shortest[i]),
            ):
                if beyond:
                    point = references[i] + (point - references[i]) / distance * bound
    return point


@given(seed=seeds, missing=st.booleans())
def test_constrain_equals_its_definition(seed, missing):
    rng = np.random.default_rng(seed)
    points, references = rng.normal(size=(20, 3)), rng.normal(size=(20, 3, 3))
    shortest = rng.uniform(0.2, 1.5, size=3)
    longest = shortest + rng.uniform(0.0, 2.0, size=3)
    if missing:
        references[::3, 1] = np.nan
    got = distance_bounds.constrain(points, references, shortest, longest, 5)
    for f in range(20):
        some = np.where(np.isnan(references[f]), points[f], references[f])
        if missing and f % 3 == 0:
            continue
        expected = naive_constrain(points[f], some, shortest, longest, 5)
        np.testing.assert_allclose(got[f], expected, atol=1e-9)
    assert np.isfinite(got).all()
    # the first reference is last in each round: its bounds hold
    length = np.linalg.norm(got - references[:, 0], axis=1)
    assert (length > shortest[0] - 1e-9).all()
    assert (length < longest[0] + 1e-9).all()


def test_constrain_leaves_alone_what_is_within_bounds():
    points = np.zeros((1, 3))
    references = 10.0 * np.eye(3)[None]
    got = distance_bounds.constrain(points, references, np.full(3, 9.0), np.full(3, 11.0), 5)
    np.testing.assert_array_equal(got, points)
    on_it = np.zeros((1, 3, 3))
    assert np.isfinite(
        distance_bounds.constrain(points, on_it, np.full(3, 9.0), np.full(3, 11.0), 5)
    ).all()


def test_bounds():
    distances = np.array([[1.0, np.nan], [2.0, np.nan], [3.0, np.nan], [4.0, np.nan]])
    shortest, longest = distance_bounds.bounds(distances, 0.25, 0.99)
    # samples are the quantiles 1/8, 3/8, 5/8, 7/8
    np.testing.assert_allclose([shortest[0], longest[0]], [1.5, 4.0])
    assert (shortest[1], longest[1]) == (0.0, np.inf)


# references


@given(seed=seeds, frames=st.integers(2, 12))
def test_deviations_equal_their_definition(seed, frames):
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(frames, 5, 3))
    positions[rng.random((frames, 5)) < 0.3] = np.nan
    got = reference_triads.deviations(positions, Tits2018Options())
    for a in range(5):
        assert got[a, a] == np.inf
        for b in set(range(5)) - {a}:
            distance = [np.linalg.norm(f[a] - f[b]) for f in positions]
            distance = [d for d in distance if not np.isnan(d)]
            expected = np.std(distance, ddof=1) if len(distance) > 1 else np.nan
            np.testing.assert_allclose(got[a, b], expected, atol=1e-9)


def test_deviations_of_complete_frames_alone():
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(20, 4, 3))
    positions[:10, 3] = np.nan
    got = reference_triads.deviations(positions, Tits2018Options(min_complete_frames=5))
    distance = np.linalg.norm(positions[10:, 0] - positions[10:, 1], axis=1)
    assert got[0, 1] == pytest.approx(distance.std(ddof=1))


@given(seed=seeds, share=st.floats(0.0, 0.7))
def test_choose_equals_its_definition(seed, share):
    rng = np.random.default_rng(seed)
    seen = rng.random((12, 6)) > share
    seen[3:6, 0] = seen[8:, 0] = False
    gaps = [Gap(start, stop, 0) for start, stop in runs(~seen[:, 0])]
    deviation = rng.random(6)
    deviation[0] = np.inf

    def fits(three, gap):
        three = list(three)
        adjacent = [f for f in (gap.start - 1, gap.stop) if 0 <= f < 12]
        return seen[adjacent][:, three].all() and any(
            seen[f, three].all() for f in range(gap.start, gap.stop)
        )

    expected = None
    for three in combinations(np.argsort(deviation)[:5].tolist(), 3):
        filled = tuple(gap for gap in gaps if fits(three, gap))
        if filled:
            expected = reference_triads.Triad(three, filled)
            break
    assert reference_triads.choose(seen, 0, gaps, deviation) == expected


@given(count=st.integers(0, 3000), most=st.integers(1, 600))
def test_thinned(count, most):
    rows = thinned(count, most)
    assert len(rows) == count if count < most else most <= len(rows) < 2 * most
    assert (np.diff(rows) > 0).all()
    assert len(rows) == 0 or (rows[0] == 0 and rows[-1] < count)


# models


@given(seed=seeds)
def test_interpolate_equals_its_definition(seed):
    rng = np.random.default_rng(seed)
    local = holed(rng, wander(rng, 12, 3), 0.5)
    got = local_interpolation.interpolate(local)
    seen = np.flatnonzero(~np.isnan(local[:, 0]))
    for f in range(12):
        if not len(seen):
            assert np.isnan(got[f]).all()
            continue
        before, after = seen[seen <= f], seen[seen >= f]
        one = before[-1] if len(before) else after[0]
        two = after[0] if len(after) else before[-1]
        share = (f - one) / (two - one) if two > one else 0.0
        np.testing.assert_allclose(got[f], local[one] * (1 - share) + local[two] * share, atol=1e-9)


def test_products():
    x, y, z = 2.0, 3.0, 5.0
    got = local_polynomial.products(np.array([[x, y, z]]))[0]
    assert sorted(got) == sorted([x, y, z, x * x, x * y, x * z, y * y, y * z, z * z])


@given(seed=seeds)
def test_polynomial_recovers_a_polynomial(seed):
    rng = np.random.default_rng(seed)
    shape = 300.0 + 40.0 * rng.normal(size=(60, 3))
    local = local_polynomial.products(shape) @ rng.normal(size=(9, 3)) / 300.0 + 50.0
    got = local_polynomial.predict(shape[:40], local[:40], shape[40:], shape)
    np.testing.assert_allclose(got, local[40:], rtol=1e-6, atol=1e-3)
    # the shape of a rigid triad is constant, so the prediction is the mean
    still = np.full((60, 3), 300.0)
    got = local_polynomial.predict(still[:40], local[:40], still[40:], still)
    np.testing.assert_allclose(got, [local[:40].mean(axis=0)] * 20, atol=1e-6)


@given(seed=seeds)
def test_network_equals_its_definition(seed):
    rng = np.random.default_rng(seed)
    shape, local = 300.0 + 20.0 * rng.normal(size=(30, 3)), rng.normal(size=(25, 3))
    shape[27] = np.nan
    known = shape[~np.isnan(shape[:, 0])]
    got = local_grnn.predict(shape[:25], local, shape[25:], known, 0.3)
    scaled = (shape - known.mean(axis=0)) / known.std(axis=0, ddof=1)
    for i in range(5):
        weight = [0.5 ** (np.sum((scaled[25 + i] - row) ** 2) / 0.3**2) for row in scaled[:25]]
        expected = np.sum([w * p for w, p in zip(weight, local, strict=True)], axis=0) / sum(weight)
        np.testing.assert_allclose(got[i], np.full(3, np.nan) if i == 2 else expected, rtol=1e-6)


def test_network_far_from_all():
    shape = np.linspace(0.0, 10.0, 11)[:, None] * np.ones(3)
    local = shape**2
    far = np.full((1, 3), 1e6)
    np.testing.assert_allclose(local_grnn.predict(shape, local, far, shape, 0.3), local[-1:])


@given(seed=seeds, start=st.integers(0, 20))
def test_regression_recovers_a_linear_relation(seed, start):
    rng = np.random.default_rng(seed)
    positions = 10.0 * rng.normal(size=(80, 6, 3))
    mixed = positions[:, 1:].reshape(80, -1) @ rng.normal(size=(15, 3)) + 7.0
    positions[:, 0] = mixed
    gaps = [Gap(start, start + 8, 0), Gap(50, 62, 0)]
    for gap in gaps:
        positions[gap.start : gap.stop, 0] = np.nan
    positions[52, 5] = np.nan
    stiff = np.array([np.inf, 1.0, 1.0, 1.0, 1.0, 1.0])
    got = global_regression.predict(positions, 0, gaps, stiff, Tits2018Options())
    first = slice(start, start + 8)
    np.testing.assert_allclose(got[first], mixed[first], atol=1e-6)
    # marker 5 is missing in the second gap, whose fill is continuous all the same
    expected = np.column_stack([np.ones(80), positions[:, 1:5].reshape(80, -1)])
    rows = ~np.isnan(positions[:, 0, 0])
    plain = expected @ np.linalg.lstsq(expected[rows], positions[rows, 0], rcond=None)[0]
    ramp = np.linspace(plain[49] - positions[49, 0], plain[62] - positions[62, 0], 14)[1:-1]
    np.testing.assert_allclose(got[50:62], plain[50:62] - ramp, atol=1e-6)
    assert np.isnan(got[63:]).all()


def test_regression_by_rigid_markers_alone():
    rng = np.random.default_rng(1)
    positions = 10.0 * rng.normal(size=(60, 6, 3))
    positions[:, 0] = positions[:, 1] + 3.0
    truth = positions[:, 0].copy()
    positions[20:30, 0] = np.nan
    deviation = np.array([np.inf, 1.0, 60.0, 60.0, 60.0, 60.0])
    positions[:12, 2:] = 1e6  # would spoil any fit that used them
    got = global_regression.predict(positions, 0, [Gap(20, 30, 0)], deviation, Tits2018Options())
    np.testing.assert_allclose(got[20:30], truth[20:30], atol=1e-6)
    few = positions[:, :4]
    assert np.isnan(
        global_regression.predict(few, 0, [Gap(20, 30, 0)], deviation[:4], Tits2018Options())
    ).all()


def test_pca_is_that_of_gloersen_about_the_centre():
    truth = person().positions
    positions = truth - truth[:, 20:].mean(axis=1, keepdims=True)
    positions[60:90, :2] = np.nan  # near each other, and missing together
    positions[120:150, 5] = np.nan
    constant = ~np.isnan(positions[..., 0]).any(axis=0)
    about = np.zeros((len(positions), 1, 3)) + positions[:, constant].mean(axis=1, keepdims=True)
    got = global_pca.predict(positions - about, Tits2018Options())
    missing = np.isnan(positions[..., 0])
    np.testing.assert_array_equal(np.isnan(got[..., 0]), ~missing)
    clip = replace(person(), positions=positions)
    want = fill_unchecked(clip, method="r2").clip.positions
    np.testing.assert_allclose((got + about)[missing], want[missing], atol=1e-6)


# averaging


@given(seed=seeds)
def test_density_equals_its_definition(seed):
    rng = np.random.default_rng(seed)
    sample, at = rng.normal(size=30), rng.normal(size=8)
    spread = np.median(np.abs(sample - np.median(sample))) / 0.6745
    width = spread * (4 / (3 * 30)) ** (1 / 5)
    for point, got in zip(at, model_averaging.density(sample, at), strict=True):
        each = np.exp(-0.5 * ((point - sample) / width) ** 2) / (width * np.sqrt(2 * np.pi))
        assert got == pytest.approx(each.mean())
    assert model_averaging.bandwidth(np.ones(5)) > 0.0


def test_average_prefers_models_that_keep_the_distances():
    references = np.zeros((20, 3, 3))
    references[:, 1], references[:, 2] = [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]
    right = np.full((20, 3), 50.0) + np.arange(20.0)[:, None] / 100.0
    truth = np.linalg.norm(right[:, None] - references, axis=2)
    noise = np.random.default_rng(0).normal(size=(200, 3))
    samples = [truth[:, i].mean() + noise[:, i] for i in range(3)]
    curves = np.stack([right, right + 40.0, right + np.array([0.0, 0.0, 90.0])])
    np.testing.assert_allclose(
        model_averaging.average(curves, references, samples, 3), right, atol=1e-6
    )
    curves[0, 4:7] = references[12, 1] = np.nan
    got = model_averaging.average(curves, references, samples, 3)
    assert np.flatnonzero(np.isnan(got[:, 0])).tolist() == [4, 5, 6, 12]
    references[12, 1] = references[11, 1]
    # models with equally small densities have equal weights
    far = np.stack([right + 4e4, right + 2e4])
    got = model_averaging.average(far, references, samples, 3)
    np.testing.assert_allclose(got, right + 3e4, atol=0.1)


# all together


@pytest.mark.parametrize("method", ALL)
def test_better_than_straight_lines(method):
    where = GAPS.missing
    result = fill_unchecked(GAPS, method=method)
    assert result.filled[where].all()
    truth = person().positions
    own, lines = (error(p, truth, where) for p in (result.clip.positions, straight(GAPS)))
    assert own < 0.8 * lines


@settings(max_examples=8, deadline=None)
@given(seed=seeds, method=st.sampled_from(ALL))
def test_moves_and_turns_with_the_clip(seed, method):
    rng = np.random.default_rng(seed)
    positions, models = GAPS.positions, MODELS if method == "pma" else (method,)
    move = 1000.0 * rng.normal(size=3)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    one = recover(positions, GAPS.rate, models, Tits2018Options()).positions
    two = recover(positions @ turn.T + move, GAPS.rate, models, Tits2018Options()).positions
    np.testing.assert_allclose(two, one @ turn.T + move, atol=1e-3)


def test_rigid_bodies_are_filled_exactly():
    rng = np.random.default_rng(5)
    body = 100.0 * rng.normal(size=(5, 3))
    angle = np.linspace(0.0, 2.0, 200)
    turns = np.stack(
        [
            np.stack([np.cos(angle), -np.sin(angle), 0 * angle], axis=1),
            np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1),
            np.stack([0 * angle, 0 * angle, 1 + 0 * angle], axis=1),
        ],
        axis=1,
    )
    truth = np.einsum("fij,mj->fmi", turns, body) + 500.0
    gappy = truth.copy()
    gappy[50:120, 2] = np.nan
    # up to the effect of smoothing on a curve that turns by 0.01 per frame
    got = recover(gappy, 60.0, ("li",), Tits2018Options()).positions
    np.testing.assert_allclose(got, truth, atol=0.1)


@pytest.mark.parametrize("method", ALL)
def test_somebody_who_walks_in(method):
    """No marker is visible at first, then one after another."""
    clip = person()
    gaps = [(0, 20 + 2 * (i % 15), (label,)) for i, label in enumerate(clip.labels[:40])]
    gappy = with_gaps(clip, (0, 20, clip.labels), *gaps)
    try:
        result = fill_unchecked(gappy, method=method)
    except MethodError:
        assert method == "wpca"
        return
    assert not result.filled[:20].any()
    late = gappy.missing & (np.arange(240) >= 26)[:, None]
    if method == "glr":  # no marker is visible throughout a gap
        assert not result.filled.any()
        return
    assert result.filled[late].mean() > 0.9
    assert error(result.clip.positions, clip.positions, result.filled) < 50.0


def test_measured_samples_stay_and_help():
    """Measured samples adjacent to a gap do not change, unlike in the published program."""
    for models in [(name,) for name in MODELS] + [MODELS]:
        got = recover(GAPS.positions, GAPS.rate, models, Tits2018Options()).positions
        measured = ~GAPS.missing
        assert got[measured].tobytes() == GAPS.positions[measured].tobytes()


def test_reasons():
    clip = with_gaps(
        person(), (0, 240, ("LKNE",)), (0, 200, ("C7",)), (100, 110, person().labels[:40])
    )
    result = fill_unchecked(clip, method="li")
    reasons = {gap.label: gap.unfilled[0].reason for gap in result.gaps if gap.unfilled}
    assert reasons["LKNE"].startswith("it is never visible")
    assert reasons["C7"] == "it is visible in 17% of the frames, less than 30%"
    assert reasons["LFHD"].startswith("no three other markers")
    few = with_gaps(person(), (100, 110, person().labels[:38]))
    result = fill_unchecked(few, method="glr")
    reasons = {gap.unfilled[0].reason for gap in result.gaps if gap.unfilled}
    assert any(reason.startswith("fewer than four other markers") for reason in reasons)


def test_clips_without_what_a_method_needs_are_refused():
    clip = person()
    three = Clip(clip.positions[:, :3], clip.labels[:3], clip.rate)
    three = with_gaps(three, (5, 9, clip.labels[:1]))
    with pytest.raises(MethodError, match=r"3 markers are visible .* needs 4"):
        fill_unchecked(three, method="glr")
    gaps = [(5 * i, 5 * i + 3, (label,)) for i, label in enumerate(clip.labels)]
    never_whole = with_gaps(clip, *gaps)
    with pytest.raises(MethodError, match=r"no marker is visible in every frame.*pma"):
        fill_unchecked(never_whole, method="wpca")
    for method in ("li", "lpr", "lgrnn", "glr", "pma"):
        result = fill_unchecked(never_whole, method=method)
        assert result.filled[never_whole.missing].all()
        assert error(result.clip.positions, clip.positions, never_whole.missing) < 10.0


def test_all_are_registered():
    assert {name for name, entry in METHODS.items() if "Tits" in entry.source} == set(ALL)


ARMS = tuple(side + name[1:] for side in "LR" for name in ARM)


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("method", "published"),
    [("li", 126.99), ("glr", 24.16), ("lpr", 152.48), ("lgrnn", 67.72), ("wpca", 28.11)],
)
def test_as_the_published_program(data, method, published):
    """Mean error (mm) of the authors' program with both arms missing for a second."""
    clip = read(data / "cmu" / "02_01.c3d")
    names = [label.split(":")[-1] for label in clip.labels]
    # markers with equally long gaps are filled in their order, which affects the result
    order = [names.index(label) for label in person().labels]
    clip = Clip(clip.positions[:, order], person().labels, clip.rate)
    gappy = with_gaps(clip, (120, 240, ARMS))
    got = fill_unchecked(gappy, method=method).clip.positions
    assert error(got, clip.positions, gappy.missing) == pytest.approx(published, rel=0.05)
