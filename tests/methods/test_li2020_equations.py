"""The equations of Li et al. 2020 against plain NumPy, written from the paper.

Its misprints are corrected: the factors of Eq. (3) are in the order that solves Eq. (2), with U in
place of U'; Eqs. (15) and (16) have the second W of Eq. (14).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gappy import AS_ESTIMATED, error, person, with_gaps
from scipy.linalg import orthogonal_procrustes

from priorfill.errors import OptionError
from priorfill.filling.fill_clip import fill
from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods.li2020 import (
    Li2020Options,
    eigenspaces,
    frames_fill,
    li2020_fill,
    pca_pieces,
    pieces_fill,
)
from priorfill.methods.li2020.training_windows import choose_windows
from priorfill.methods.task import Task
from priorfill.search.takes import same_subject_take

RANK = 4


def leading(symmetric):
    """Eigenvectors of the largest eigenvalues."""
    return np.linalg.eigh(symmetric)[1][:, ::-1][:, :RANK]


def own(symmetric, common):
    """The same, turned to a common basis: their signs and order are arbitrary."""
    vectors = leading(symmetric)
    return vectors @ orthogonal_procrustes(vectors, common)[0]


def equations_1_to_4(pieces, masked, clip):
    """Eigenvectors over coordinates, of pieces one upon the other."""
    u = leading(sum(a.T @ a for a in pieces))
    u0 = leading(sum(a0.T @ a0 for a0 in masked))
    u_i0 = [own(a0.T @ a0, u0) for a0 in masked]
    squares = sum(ui.T @ a0.T @ a0 @ ui for ui, a0 in zip(u_i0, masked, strict=True))
    products = sum(ui.T @ a0.T @ a @ u for ui, a0, a in zip(u_i0, masked, pieces, strict=True))
    t = np.linalg.inv(squares) @ products
    return clip @ own(clip.T @ clip, u0) @ t @ u.T


def equations_5_to_8(pieces, masked, clip):
    """Eigenvectors over frames, of pieces side by side."""
    v = leading(sum(a @ a.T for a in pieces))
    v0 = leading(sum(a0 @ a0.T for a0 in masked))
    v_i0 = [own(a0 @ a0.T, v0) for a0 in masked]
    squares = sum(vi.T @ a0 @ a0.T @ vi for vi, a0 in zip(v_i0, masked, strict=True))
    products = sum(v.T @ a @ a0.T @ vi for vi, a0, a in zip(v_i0, masked, pieces, strict=True))
    f = products @ np.linalg.inv(squares)
    return v @ f @ own(clip @ clip.T, v0).T @ clip


def filled_by_the_book(piece, training, over, options):
    """A piece with gaps, completed from complete pieces of the same length."""
    missing = np.isnan(piece[..., 0])
    gappy = missing.any(axis=0)
    origins = [p[:, ~gappy].mean(axis=1, keepdims=True) for p in (piece, *training)]
    clip, *rests = [
        (p - o).reshape(len(p), -1) for p, o in zip((piece, *training), origins, strict=True)
    ]
    mean = np.concatenate(rests).mean(axis=0)
    scale = 1.0 / np.concatenate(rests).std(axis=0, ddof=1)
    if over == "coordinates":
        frames = np.concatenate(training)
        apart = np.linalg.norm(frames[:, :, None] - frames[:, None], axis=3).mean(axis=0)
        near = np.exp(-(apart[gappy].min(axis=0) ** 2) / (2.0 * options.sigma**2))
        scale = scale * np.repeat(np.where(gappy, options.gap_weight, near), 3)
    seen = np.repeat(~missing, 3, axis=1)
    a = [(rest - mean) * scale for rest in rests]
    b = np.where(seen, (clip - mean) * scale, 0.0)
    solve = equations_1_to_4 if over == "coordinates" else equations_5_to_8
    completed = solve(a, [one * seen for one in a], b) / scale + mean
    return completed.reshape(piece.shape) + origins[0]


def pieces_of_motion(number=6, frames=30, markers=7):
    """Pieces that share some waves, with noise."""
    rng = np.random.default_rng(5)
    waves = rng.normal(size=(5, markers, 3))
    places = 300.0 * rng.normal(size=(markers, 3))
    t = np.arange(frames)[:, None]
    phases = rng.uniform(0.0, 1.0, size=(number, 1, 5))
    curves = np.sin(0.2 * t * np.arange(1, 6) + phases)
    noise = rng.normal(size=(number, frames, markers, 3))
    return places + 60.0 * np.einsum("nfk,kmc->nfmc", curves, waves) + noise


@pytest.mark.parametrize("over", ["coordinates", "frames"])
def test_pieces_are_completed_as_the_equations_say(over):
    truth, *training = pieces_of_motion()
    piece = truth.copy()
    piece[8:20, 2] = np.nan
    piece[15:30, 5] = np.nan
    options = Li2020Options(rank=RANK, over=over, mask="entries")
    found = pieces_fill._completed(piece, training, li2020_fill._train_pieces, options)
    wanted = filled_by_the_book(piece, training, over, options)
    gaps = np.isnan(piece)
    np.testing.assert_allclose(found[gaps], wanted[gaps], rtol=1e-7)


def test_missing_frames_by_weighted_least_squares():
    """Eq. (16) with both W of Eq. (14): V^ (V~'WV~)^-1 V~'W A~."""
    rng = np.random.default_rng(2)
    vectors = np.linalg.qr(rng.normal(size=(40, 6)))[0]
    shown = np.ones(40, dtype=bool)
    shown[12:25] = False
    visible = rng.normal(size=(27, 9))
    w = np.diag(rng.uniform(0.1, 1.0, size=27))
    space = eigenspaces.TrajectorySpace(vectors, np.zeros(6))
    found = eigenspaces.complete_frames(visible, space, shown, weights=np.diag(w))
    seen, hidden = vectors[shown], vectors[~shown]
    wanted = hidden @ np.linalg.inv(seen.T @ w @ seen) @ seen.T @ w @ visible
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert abs(found - eigenspaces.complete_frames(visible, space, shown)).max() > 1e-3


def test_weights_of_frames_fall_with_the_time_from_the_gap():
    shown = np.array([True, True, False, False, True, True, True])
    weights = frames_fill._frame_weights(shown, Li2020Options(frame_sigma=0.5))
    np.testing.assert_allclose(weights, np.exp(-(np.array([2, 1, 1, 2, 3]) ** 2) / 2.0))
    equal = frames_fill._frame_weights(shown, Li2020Options(frame_sigma=None))
    np.testing.assert_array_equal(equal, 1.0)


# fills


def filled(clip, method, **options):
    given = replace(AS_ESTIMATED, method_options=options, estimate_errors=False)
    return fill(clip, method=method, options=given)


WHOLE_PIECES = pytest.mark.parametrize(
    "options",
    [{"mask": "entries"}, {"over": "frames"}],
    ids=lambda options: " ".join(options.values()),
)


@WHOLE_PIECES
def test_gaps_are_filled_from_whole_pieces(options):
    truth = person()
    clip = with_gaps(truth, (100, 110, ("LKNE",)), (105, 120, ("RELB", "RWRA")), (0, 9, ("C7",)))
    results = [
        filled(clip, method, stride=1.0, **options) for method in ("pca-train", "pca-pieces")
    ]
    for result in results:
        assert result.complete
        assert error(result.clip.positions, truth.positions, result.filled) < 150.0
    one, other = (result.clip.positions for result in results)
    assert abs(one - other).max() > 1e-3


@WHOLE_PIECES
def test_gaps_without_a_whole_piece_stay_missing(options):
    """The clip is too short for another piece as long."""
    clip = with_gaps(person(seconds=2.0), (40, 90, ("LKNE",)))
    result = filled(clip, "pca-pieces", **options)
    assert not result.filled.any()
    assert all("give longer recordings" in p.reason for gap in result.gaps for p in gap.unfilled)


def test_frames_without_a_marker_stay_missing_in_a_piece():
    truth = person()
    clip = with_gaps(truth, (100, 115, ("LKNE",)), (115, 120, truth.labels))
    result = filled(clip, "pca-pieces", mask="entries", stride=1.0)
    reasons = {p.reason for gap in result.gaps for p in gap.unfilled}
    assert reasons == {"no marker is visible; pca-frames fills whole frames"}
    assert result.filled[100:115].any()


@WHOLE_PIECES
def test_only_whole_frames_are_missing_in_a_piece(options):
    truth = person()
    result = filled(with_gaps(truth, (100, 104, truth.labels)), "pca-pieces", stride=1.0, **options)
    reasons = {p.reason for gap in result.gaps for p in gap.unfilled}
    assert reasons == {"no marker is visible; pca-frames fills whole frames"}
    assert not result.filled.any()


def test_no_marker_is_visible_throughout_a_piece():
    """Then the origin of a frame is the mean of the markers that it shows."""
    truth = person()
    gaps = [(90 + i // 2, 96 + i // 2, (label,)) for i, label in enumerate(truth.labels)]
    options = {"stride": 1.0, "min_context_frames": 5, "context": 0.5}
    result = filled(with_gaps(truth, *gaps), "pca-pieces", mask="entries", **options)
    assert result.complete


def test_other_sizes_are_scaled():
    """A recording of a subject larger by a quarter becomes one of the clip's subject."""
    truth = person(seconds=2.0)
    larger = same_subject_take(replace(truth, positions=1.25 * truth.positions), truth.labels)
    everything = np.arange(len(truth.labels))
    for scaled, size in ((False, 1.25), (True, 1.0)):
        options = Li2020Options(scale_sources=scaled)
        [window] = choose_windows(truth.positions, truth.rate, [larger], everything, options)
        np.testing.assert_allclose(window.positions, size * truth.positions, rtol=1e-3)


def test_weights_of_frames_change_missing_frames():
    truth = person(seconds=3.0)
    clip = with_gaps(truth, (80, 90, truth.labels))
    plain, weighted = (filled(clip, "pca-frames", frame_sigma=sigma) for sigma in (None, 0.5))
    assert weighted.complete
    assert error(weighted.clip.positions, plain.clip.positions, plain.filled) > 0.1


@pytest.mark.parametrize(
    ("name", "value"), [("over", "time"), ("mask", "rows"), ("frame_sigma", 0.0)]
)
def test_options_out_of_range_are_refused(name, value):
    with pytest.raises(OptionError, match=f"Li2020Options.{name} is"):
        Li2020Options(**{name: value})


def test_a_marker_that_is_never_visible_has_no_trajectory():
    clip = with_gaps(person(seconds=1.0), (0, 60, ("LKNE",)))
    take = same_subject_take(person(seconds=1.0), clip.labels)
    groups = tuple(gap_groups(clip.missing))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), groups, (take,))
    [note] = pca_pieces(task, options=Li2020Options(over="frames")).notes
    assert (note.filled, note.source.split(";")[0]) == (False, "it is not visible around the gap")
    [note] = pca_pieces(task, options=Li2020Options(mask="entries")).notes
    assert note.filled


@pytest.mark.parametrize("over", ["coordinates", "frames"])
def test_gaps_that_are_not_to_be_filled_stay_missing(over):
    """A task may have fewer gap groups than its clip."""
    clip = with_gaps(person(seconds=3.0), (30, 40, ("LKNE",)), (150, 160, ("C7",)))
    groups = tuple(gap_groups(clip.missing))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), groups[1:])
    found = pca_pieces(task, options=Li2020Options(over=over, mask="entries"))
    assert {note.filled for note in found.notes} == {False, True}
    assert np.isnan(found.positions[30:40]).any() and not np.isnan(found.positions[150:160]).any()
