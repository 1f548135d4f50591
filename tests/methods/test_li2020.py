"""The methods of Li et al. 2020: their equations, and clips of many kinds."""

from __future__ import annotations

from dataclasses import replace

import naive
import numpy as np
import pytest
from gappy import ARM, FOOT, error, fill_unchecked, person, straight, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import MethodError
from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods.li2020 import (
    Li2020Options,
    eigenspaces,
    frames_fill,
    pca_frames,
    pca_pieces,
    pca_train,
)
from priorfill.methods.task import Task

MARKERS = pytest.mark.parametrize("method", ["pca-train", "pca-pieces"])
ALL = pytest.mark.parametrize("method", ["pca-train", "pca-pieces", "pca-frames"])

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> PriorDatabase:
    """Two other subjects walking."""
    place = tmp_path_factory.mktemp("priors") / "db"
    with PriorDatabase.create(place) as made:
        for body in (11, 12):
            made.add(person(seconds=6.0, seed=body, body=body))
    with PriorDatabase.open(place) as opened:
        yield opened


def low_rank(rng, frames, columns, rank):
    """Rows in a space of few dimensions."""
    return 100.0 * rng.normal(size=(frames, rank)) @ rng.normal(size=(rank, columns))


def masked_windows(rng, columns=12, rank=3, pieces=4, hidden=5):
    """Windows of low rank, the same with their first columns masked, and these columns."""
    space = rng.normal(size=(rank, columns))
    full = [
        100.0 * rng.normal(size=(int(rng.integers(5, 30)), rank)) @ space for _ in range(pieces)
    ]
    shown = np.arange(columns) >= hidden
    return full, [piece * shown for piece in full], shown


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(1, 6))
def test_transformation_is_the_least_squares_of_equation_2(seed, r):
    """The normal equations window by window, in the order that solves Eq. (2), and lstsq."""
    rng = np.random.default_rng(seed)
    masked = [rng.normal(size=(20, r)) for _ in range(3)]
    full = [rng.normal(size=(20, r)) for _ in range(3)]
    found = eigenspaces.transformation(np.concatenate(masked), np.concatenate(full))
    products = sum(a.T @ a for a in masked)
    mixed = sum(a.T @ b for a, b in zip(masked, full, strict=True))
    np.testing.assert_allclose(found, np.linalg.inv(products) @ mixed, atol=1e-8)
    expected = np.linalg.lstsq(np.concatenate(masked), np.concatenate(full), rcond=None)[0]
    np.testing.assert_allclose(found, expected, atol=1e-8)

    def cost(t):
        return sum(((b - a @ t) ** 2).sum() for a, b in zip(masked, full, strict=True))

    assert cost(found) <= cost(mixed @ np.linalg.inv(products)) + 1e-9  # the order as printed
    assert cost(found) <= cost(found + 1e-3 * rng.normal(size=found.shape))


def test_transformation_has_bounds_where_the_published_one_has_none():
    rng = np.random.default_rng(0)
    masked = rng.normal(size=(40, 2)) @ rng.normal(size=(2, 6))  # spans two of six directions
    full = rng.normal(size=(40, 6))
    assert abs(eigenspaces.transformation(masked, full)).max() < 100.0


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(1, 40), st.integers(1, 9))
def test_eigenspace(seed, rows, columns):
    matrix = np.random.default_rng(seed).normal(size=(rows, columns))
    values, vectors = eigenspaces.eigenspace(matrix)
    squares, _ = np.linalg.eigh(matrix.T @ matrix)
    np.testing.assert_allclose(values**2, squares[::-1][: len(values)], atol=1e-9)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(values)), atol=1e-9)
    np.testing.assert_allclose(
        matrix.T @ matrix @ vectors, vectors * values**2, atol=1e-8 * (1 + values[0] ** 2)
    )


def test_components():
    assert eigenspaces.components(np.array([98.0, 1.0, 1.0]), 0.99) == 2
    assert eigenspaces.components(np.array([100.0, 0.1]), 0.99) == 1
    assert eigenspaces.components(np.array([1.0, 1.0, 1.0]), 1.0) == 3
    assert eigenspaces.components(np.zeros(3), 0.99) == 1


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_low_rank_is_recovered_exactly(seed):
    """Eqs. (1)-(4) and (5)-(8): windows and clip in one space that visible columns determine."""
    rng = np.random.default_rng(seed)
    full, masked, shown = masked_windows(rng)
    one = eigenspaces.train(np.concatenate(full), np.concatenate(masked), rank=3)
    two = eigenspaces.train_pieces(full, masked, rank=3)
    for truth, clip in zip(full, masked, strict=True):
        np.testing.assert_allclose(one.complete(clip), truth, atol=1e-6)
        np.testing.assert_allclose(two.complete(clip), truth, atol=1e-6)
    assert not shown.all()


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_trajectories_of_low_rank_are_recovered_exactly(seed):
    """Eqs. (9)-(16)."""
    rng = np.random.default_rng(seed)
    truth = low_rank(rng, 60, 50, 4)  # a row a frame
    shown = np.ones(60, dtype=bool)
    shown[25:40] = False
    space = eigenspaces.trajectory_space(truth[:, 9:].T, rank=4)
    found = eigenspaces.complete_frames(truth[shown, :9], space, shown)
    np.testing.assert_allclose(found, truth[~shown, :9], atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_nearest_basis_spans_the_same_and_is_nearest(seed):
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(9, 4)))
    wanted, _ = np.linalg.qr(rng.normal(size=(9, 4)))
    found = eigenspaces.nearest_basis(basis, wanted)
    np.testing.assert_allclose(found @ found.T, basis @ basis.T, atol=1e-9)
    turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    assert np.linalg.norm(found - wanted) <= np.linalg.norm(basis @ turn - wanted) + 1e-9
    # signs and order of the eigenvectors have no effect
    np.testing.assert_allclose(
        eigenspaces.nearest_basis(basis[:, ::-1] * -1, wanted), found, atol=1e-7
    )


def low_rank_clip(rng, frames=120, markers=8, rank=5):
    """A clip of low rank."""
    positions = low_rank(rng, frames, 3 * markers, rank).reshape(frames, markers, 3)
    positions += 1000.0 * rng.normal(size=(markers, 3))
    return Clip(positions, tuple(f"M{i}" for i in range(markers)), 60.0)


def task_of(clip):
    """A task without takes."""
    groups = tuple(gap_groups(clip.missing))
    return Task(clip.positions, clip.labels, clip.rate, describe(clip), groups)


@pytest.mark.parametrize("method", [pca_train, pca_pieces])
def test_a_clip_of_low_rank_is_filled_exactly(method):
    truth = low_rank_clip(np.random.default_rng(4))
    clip = with_gaps(truth, (20, 50, ("M1", "M2")), (70, 90, ("M5",)))
    found = method(task_of(clip), options=Li2020Options(rank=5)).positions
    np.testing.assert_allclose(found, truth.positions, atol=1e-6)


def test_missing_frames_of_a_periodic_clip_are_filled_exactly():
    """Two sines per marker: trajectories of four dimensions, wherever a window starts."""
    rng = np.random.default_rng(8)
    t = np.arange(400)
    waves = np.stack([f(2 * np.pi * t / p) for p in (40.0, 64.0) for f in (np.sin, np.cos)], axis=1)
    positions = (waves @ (100.0 * rng.normal(size=(4, 15)))).reshape(400, 5, 3)
    truth = Clip(positions, tuple("ABCDE"), 60.0)
    clip = with_gaps(truth, (150, 190, truth.labels), (300, 320, ("A", "C")))
    options = Li2020Options(rank=4)
    found = pca_frames(task_of(clip), options=options).positions
    np.testing.assert_allclose(found, truth.positions, atol=1e-6)


GAPS = {
    "single": [(100, 130, ("LKNE",))],
    "limb": [(80, 170, ARM)],
    "overlapping": [(70, 160, ARM), (100, 190, FOOT), (120, 135, ("C7",))],
    "start": [(0, 40, ("RWRA", "RFIN"))],
    "end": [(200, 240, ("LANK", "LHEE"))],
}


@MARKERS
@pytest.mark.parametrize("name", GAPS)
def test_gaps_of_a_person(method, name, database):
    truth = person()
    clip = with_gaps(truth, *GAPS[name])
    for priors in (None, database):
        result = fill_unchecked(clip, method=method, database=priors)
        assert result.complete
        assert all(bool(gap.source_clips) == (priors is not None) for gap in result.gaps)
        off = error(result.clip.positions, truth.positions, result.filled)
        assert off < error(straight(clip), truth.positions, result.filled)


@MARKERS
def test_short_gaps(method):
    truth = person()
    clip = with_gaps(truth, (100, 112, ("LKNE",)))
    result = fill_unchecked(clip, method=method)
    assert result.complete
    assert error(result.clip.positions, truth.positions, result.filled) < 25.0


def test_missing_frames():
    truth = person()
    clip = with_gaps(truth, (100, 115, truth.labels))
    for method in ("pca-train", "pca-pieces"):
        result = fill_unchecked(clip, method=method)
        assert not result.filled.any()
        assert {p.reason for gap in result.gaps for p in gap.unfilled} == {
            "no marker is visible; pca-frames fills whole frames"
        }
    result = fill_unchecked(clip, method="pca-frames")
    assert result.complete
    off = error(result.clip.positions, truth.positions, result.filled)
    assert off < 40.0  # the body goes 310 mm meanwhile


@pytest.mark.parametrize("bounded", [True, False])
def test_errors_are_not_multiplied_at_the_ends(bounded, monkeypatch):
    """Sums of slow waves whose first half is measured with a small error."""
    if not bounded:
        monkeypatch.setattr(frames_fill, "MAX_AMPLIFICATION", np.inf)
        monkeypatch.setattr(frames_fill, "SHRINKAGES", (1e-6,))
    rng = np.random.default_rng(3)
    waves = np.cos(np.pi * np.outer(np.arange(80) + 0.5, np.arange(1, 13)) / 80)
    rows = rng.normal(size=(200, 12)) @ waves.T
    shown = np.arange(80) < 40
    window = 100.0 * rows[:2].T[:, :, None] * np.ones(3)
    noise = rng.normal(size=window.shape) * shown[:, None, None]
    rows += 1e-3 * rng.normal(size=rows.shape)
    options = Li2020Options(trajectory_singular_share=0.9999)
    halves = [rows[:100], rows[100:]]
    measured = frames_fill._Measured(shown, np.ones(int(shown.sum())))
    noisy, clean = (
        frames_fill._completed(some, measured, halves, options) for some in (window + noise, window)
    )
    change = noisy - clean
    # that of the fit, and the mean
    multiplied = np.linalg.norm(change[~shown]) / np.linalg.norm(noise)
    assert (multiplied < 15.0 + 1.0) == bounded


@MARKERS
def test_dropouts_need_a_database(method, database):
    truth = person()
    clip = with_gaps(truth, (0, 240, ("C7",)), (60, 100, ("LELB",)))
    alone = fill_unchecked(clip, method=method)
    assert [gap.label for gap in alone.gaps if gap.unfilled] == ["C7"]
    helped = fill_unchecked(clip, method=method, database=database)
    assert helped.complete
    assert error(helped.clip.positions, truth.positions, helped.filled) < 80.0


@MARKERS
def test_no_marker_is_visible_throughout(method):
    """Then each set of missing markers has its own template."""
    truth = person()
    clip = with_gaps(truth, *[(5 * i, 5 * i + 5, (label,)) for i, label in enumerate(truth.labels)])
    result = fill_unchecked(clip, method=method)
    assert result.complete
    assert error(result.clip.positions, truth.positions, result.filled) < 30.0


@MARKERS
def test_no_frame_is_complete(method, database):
    truth = person()
    gaps = [(i, i + 8, (truth.labels[(i // 8) % 41],)) for i in range(0, 240, 8)]
    clip = with_gaps(truth, *gaps)
    with pytest.raises(MethodError, match="give a database"):
        fill_unchecked(clip, method=method)
    assert fill_unchecked(clip, method=method, database=database).complete


@ALL
@pytest.mark.parametrize("frames", [1, 2, 3, 20])
@pytest.mark.parametrize("markers", [1, 2, 5])
def test_small_clips(method, frames, markers, database):
    truth = person()
    clip = replace(
        truth, positions=truth.positions[:frames, :markers], labels=truth.labels[:markers]
    )
    clip = with_gaps(clip, (frames // 2, frames // 2 + 1, clip.labels[:1]))
    for priors in (None, database):
        try:
            result = fill_unchecked(clip, method=method, database=priors)
        except MethodError as error:
            assert "\n" not in str(error)
            continue
        np.testing.assert_array_equal(
            result.clip.positions[~clip.missing], clip.positions[~clip.missing]
        )
        assert all(p.reason for gap in result.gaps for p in gap.unfilled)


@ALL
def test_clips_that_do_not_move(method):
    still = np.repeat(person().positions[:1], 150, axis=0)
    for positions in (still, np.repeat(still[:, :1], 41, axis=1)):
        clip = with_gaps(replace(person(), positions=positions), (50, 80, ARM))
        result = fill_unchecked(clip, method=method)
        assert result.complete
        np.testing.assert_allclose(result.clip.positions, positions, atol=1e-3)


@ALL
def test_filling_moves_with_the_clip(method, database):
    clip = with_gaps(person(), (80, 110, ARM))
    shift = np.array([1500.0, -2600.0, 0.0])
    moved = clip.with_positions(naive.turned(clip.positions, 0.0, shift))
    one = fill_unchecked(clip, method=method, database=database).clip.positions
    two = fill_unchecked(moved, method=method, database=database).clip.positions
    np.testing.assert_allclose(two, naive.turned(one, 0.0, shift), atol=1e-3)


@ALL
def test_it_is_the_same_again(method, database):
    clip = with_gaps(person(), *GAPS["overlapping"])
    one = fill_unchecked(clip, method=method, database=database).clip.positions
    two = fill_unchecked(clip, method=method, database=database).clip.positions
    np.testing.assert_array_equal(one, two)
