"""Gaussian processes against scikit-learn, with hyper-parameters fixed and alignment by SciPy."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Kernel,
    Matern,
    WhiteKernel,
)

from priorfill.gp import features as gp_features
from priorfill.gp import kernels, linalg
from priorfill.gp.fitted_models import FittedModels, SharedCovariances
from priorfill.gp.kernels import Matern32, Matern52, Matern72
from priorfill.gp.pose_process import PoseProcess
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem
from priorfill.gp.process import FittedGP
from priorfill.methods.gpr.blackout.correction import correct_from_edges
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.windows import BlackoutWindows
from priorfill.methods.gpr.dropout import predict_from_donors
from priorfill.methods.gpr.dropout.donors import Donor
from priorfill.methods.gpr.dropout.marker_coupling import MarkerCoupling
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.training.options import DatabaseTrainingOptions
from priorfill.methods.task import THIS_CLIP
from priorfill.signal.gp_interpolation import interpolate_gap, interpolation_weights

# ---- adapter: only this section uses the names of priorfill --------------------------------------

SUBJECT_OFFSET = DatabaseTrainingOptions().offset_variance
REMEMBERED = 0.5
MIN_ALIGNMENT = gp_features.MIN_ALIGNMENT_WEIGHT
OWN_NOISE = DropoutOptions().own_noise_ratio
SHAPE_SCALE = DropoutOptions().shape_length_scale
SHAPE_SPREAD = DropoutOptions().shape_rigidity_scale
BLACKOUT = BlackoutOptions()
SMOOTHNESS = {Matern32: 1.5, Matern52: 2.5, Matern72: 3.5}
"""Of the covariances in time."""

CORRECTION_SETTINGS = tuple(product((0.4, 0.7), (0.1, 0.5), BLACKOUT.correction_exponents))
"""Length scale, noise and exponent of each correction of a blackout."""

CORRECTION_LINEAR, CORRECTION_CONSTANT = 0.1, 1.0
CORRECTION_SHARPNESS = BLACKOUT.weight_power
MIN_WINDOWS = BLACKOUT.min_windows


@dataclass(frozen=True)
class Alignment:
    """How poses are aligned, and how visible markers are weighted by distance and rigidity."""

    kind: str = "rigid"
    length_scale: float = 220.0
    min_weight: float = 0.005
    rigidity: float | None = 10.0


@dataclass(frozen=True)
class Settings:
    """Hyper-parameters of the kernel of one model."""

    linear: float = 1.0
    rbf: float = 0.5
    length_scale: float = 0.7
    time_variance: float = 0.3
    time_scale: float = 0.15
    smooth: bool = False
    noise: float = 1e-3
    forgetting_time: float | None = None
    lag: tuple[float, float, bool] | None = None  # seconds, weight, as a difference


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of one or several recordings.

    Without subjects all poses are of one; correlations are those with the test subject.
    """

    visible: np.ndarray
    missing: np.ndarray
    time: np.ndarray
    recording: np.ndarray
    subject: np.ndarray | None = None
    correlation: np.ndarray | None = None
    velocity: np.ndarray | None = None
    lagged: dict[float, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Predicted:
    """Positions, then velocities, of test poses, and held-out results of training poses."""

    mean: np.ndarray  # (poses, targets, 3)
    variance: np.ndarray  # (poses, targets)
    relative_std: np.ndarray  # (poses,)
    residuals: np.ndarray  # (held-out poses, targets, 3)
    held_out_variance: np.ndarray  # (held-out poses, targets)


def _alignment(alignment):
    return gp_features.Alignment(
        alignment.kind, alignment.length_scale, alignment.min_weight, alignment.rigidity
    )


def _samples(poses):
    return PoseSamples(
        poses.visible,
        poses.missing,
        poses.time,
        poses.recording,
        poses.correlation,
        poses.subject,
        poses.lagged,
        poses.velocity,
    )


def _process(settings):
    factor = kernels.SubjectCorrelation()
    if settings.forgetting_time is not None:
        factor *= kernels.Forgetting(settings.forgetting_time, REMEMBERED)
    kind = kernels.Matern32 if settings.smooth else kernels.Exponential
    return PoseProcess(
        linear=settings.linear,
        rbf=settings.rbf,
        length_scale=settings.length_scale,
        of_time=settings.time_variance * kind(settings.time_scale),
        noise_variance=settings.noise,
        factor=factor,
    )


def fit_and_predict(train, test, distance, spread, alignment, settings, block_seconds):
    """Results of one model."""
    lag = None if settings.lag is None else gp_features.LagFeature(*settings.lag)
    model, query = GPModel(_alignment(alignment), lag, _process(settings)), _samples(test)
    problem = RegressionProblem(
        _samples(train),
        query,
        distance,
        spread,
        offset_variance=0.0 if train.subject is None else SUBJECT_OFFSET,
    )
    shared = SharedCovariances.of(problem, (model,), block_seconds)
    models = FittedModels.fit(model.alignment, problem, (model,), shared)
    found, (fitted,) = models.predict(query, shared.with_query(query)), models.fitted
    return Predicted(
        found.mean[0],
        found.variance[0],
        found.relative_std[0],
        fitted.residuals,
        fitted.held_out_variance,
    )


def held_out_residuals(covariance_matrix, targets, blocks):
    """Residuals and variances with each block of rows held out, in closed form."""
    root = linalg.inverse_root(covariance_matrix.copy())
    fitted = FittedGP(kernels.Constant(), root, root.T @ (root @ targets))
    return fitted.leave_blocks_out(blocks)


def models_of_donors(donors, query, distance, spread, visible_spread, alignment, calibrated):
    """Kernel and noise, positions, variances and held-out error of each model."""
    options = DropoutOptions()
    coupling = MarkerCoupling(distance, spread, visible_spread)
    training = predict_from_donors._TrainingPoses.of(donors, query, coupling, options)
    found = predict_from_donors._predict_aligned(
        _alignment(alignment), training, query, coupling, options, calibrated
    )
    return list(zip(options.processes, found.positions, found.variance, found.errors, strict=True))


def correct_curve(
    edges, start, source, subject, correlation, errors, scale, weight, scored, min_distance
):
    """Correction of a blackout's curve, what it leaves of errors in windows, and variances."""
    empty = np.zeros((len(edges), 0, 0, 3))
    windows = BlackoutWindows(
        context=empty,
        inside=empty,
        edges=edges,
        rotation=np.broadcast_to(np.eye(3), (len(edges), 3, 3)),
        start=start,
        source=source,
        subject=subject,
        correlation=correlation,
    )
    return correct_from_edges(windows, errors, scale, weight, scored, min_distance, BLACKOUT)


# ---- reference -----------------------------------------------------------------------------------


class On(Kernel):
    """A kernel of some columns of the input."""

    def __init__(self, kernel, start, stop):
        self.kernel = kernel
        self.start = start
        self.stop = stop

    def __call__(self, X, Y=None, eval_gradient=False):
        columns = slice(self.start, self.stop)
        return self.kernel(X[:, columns], None if Y is None else Y[:, columns])

    def diag(self, X):
        return self.kernel.diag(X[:, self.start : self.stop])

    def is_stationary(self):
        return self.kernel.is_stationary()


class Inputs:
    """Named groups of columns of the inputs of a process."""

    def __init__(self, **groups):
        self.matrix = np.column_stack(list(groups.values()))
        ends = np.cumsum([0, *(np.atleast_2d(g.T).shape[0] for g in groups.values())]).tolist()
        self._columns = dict(zip(groups, pairwise(ends), strict=True))

    def on(self, name, kernel):
        return On(kernel, *self._columns[name])


def constant(value):
    return ConstantKernel(value, "fixed")


def dot():
    return DotProduct(0.0, "fixed")


def rbf(length_scale):
    return RBF(length_scale, "fixed")


def matern(time_scale, smoothness):
    return Matern(time_scale, "fixed", nu=smoothness)


def equal():
    """1 for equal labels, 0 for different integers."""
    return RBF(1e-3, "fixed")


def fit(kernel, inputs, targets, noise):
    process = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None)
    return process.fit(inputs, targets)


def predict(process, inputs):
    """Mean [shape=(poses, outputs)] and the variance common to all outputs."""
    mean, std = process.predict(inputs, return_std=True)
    return mean.reshape(len(inputs), -1), std.reshape(len(inputs), -1)[:, 0] ** 2


def hold_out(kernel, inputs, targets, noise, blocks):
    """Residuals and variances, noise included, by fitting again without each block."""
    residuals, variance = np.full(targets.shape, np.nan), np.full(len(targets), np.nan)
    noise = np.broadcast_to(noise, len(targets))
    for block in blocks:
        rest = np.setdiff1d(np.arange(len(targets)), block)
        process = fit(kernel, inputs[rest], targets[rest], noise[rest])
        mean, variance[block] = predict(process, inputs[block])
        residuals[block] = targets[block] - mean
        variance[block] += noise[block]
    return residuals, variance


def kriging(covariance_matrix, cross, basis, basis_requested):
    """Weights and variance of the best linear unbiased prediction, unit variance of the process.

    By Lagrange multipliers: the weights of each prediction reproduce every function of the basis.
    """
    known, functions = basis.shape
    system = np.zeros((known + functions, known + functions))
    system[:known, :known] = covariance_matrix
    system[:known, known:], system[known:, :known] = basis, basis.T
    right = np.concatenate([cross, basis_requested], axis=1)
    solved = np.linalg.solve(system, right.T).T
    return solved[:, :known], 1.0 - (solved * right).sum(axis=1)


def marker_weights(distance, spread, alignment):
    """Weights of visible markers in the alignment, and of their coordinates as features."""
    near = np.exp(-(distance**2) / (2.0 * alignment.length_scale**2))
    rigid = 1.0
    if alignment.rigidity is not None:
        rigid = 1.0 / (1.0 + (spread / alignment.rigidity) ** 2)
    return near * rigid + MIN_ALIGNMENT, near * np.sqrt(rigid) + alignment.min_weight


def root_frames(points, template, weights, kind):
    """Rotations into the root frames, and origins."""
    shape = template - np.average(template, axis=0, weights=weights)
    turns, origins = [], []
    for pose in points:
        origin = np.average(pose, axis=0, weights=weights)
        if kind == "rigid":
            turn, _ = Rotation.align_vectors(shape, pose - origin, weights=weights)
        else:
            here, there = ((p[:, :2] @ [1.0, 1.0j]) for p in (pose - origin, shape))
            turn = Rotation.from_euler("z", -np.angle(weights @ (here * there.conj())))
        turns.append(turn)
        origins.append(origin)
    return turns, origins


def local(frames, points):
    return np.array([t.apply(p - o) for t, o, p in zip(*frames, points, strict=True)])


def upright(frames, points):
    return np.array([t.inv().apply(p) + o for t, o, p in zip(*frames, points, strict=True)])


def turned_back(turns, vectors):
    return np.array([t.inv().apply(v) for t, v in zip(turns, vectors, strict=True)])


def features(poses, frames, weight, lag):
    """Weighted coordinates of the visible markers, and of those some time before and after."""
    parts = [local(frames, poses.visible)]
    if lag is not None:
        seconds, factor, difference = lag
        before, after = (local(frames, side) for side in poses.lagged[seconds])
        parts += [factor * (after - before)] if difference else [factor * before, factor * after]
    return np.concatenate([(p * weight[:, None]).reshape(len(p), -1) for p in parts], axis=1)


def inputs_of(poses, known):
    """Features, times and subjects; recordings are 10^6 s apart."""
    subject = np.zeros(len(poses.time)) if poses.subject is None else poses.subject
    alike = np.ones(len(poses.time)) if poses.correlation is None else poses.correlation
    return Inputs(
        features=known,
        time=poses.time + 1e6 * poses.recording,
        subject=subject,
        # of each subject: its correlation with the test subject, and the remaining deviation
        common=alike,
        rest=np.sqrt(1.0 - alike**2),
    )


def kernel_of(inputs, settings, subjects):
    """The model's kernel without noise."""
    pose = (
        constant(1.0)
        + constant(settings.linear) * inputs.on("features", dot())
        + constant(settings.rbf) * inputs.on("features", rbf(settings.length_scale))
    )
    if settings.forgetting_time is not None:
        memory = constant(1.0 - REMEMBERED) * inputs.on(
            "time", matern(settings.forgetting_time, 0.5)
        )
        pose = pose * (constant(REMEMBERED) + memory)
    same = inputs.on("subject", equal())
    if subjects:
        pose = pose * (inputs.on("common", dot()) + same * inputs.on("rest", dot()))
    in_time = matern(settings.time_scale, 1.5 if settings.smooth else 0.5)
    result = pose + constant(settings.time_variance) * inputs.on("time", in_time)
    return result + constant(SUBJECT_OFFSET) * same if subjects else result


def blocks_of(poses, recording, seconds):
    """Poses of a recording, or of any, by blocks of some length (s)."""
    found = {}
    for i, (of, time) in enumerate(zip(poses.recording, poses.time, strict=True)):
        if recording is None or of == recording:
            found.setdefault((of, int(time // seconds)), []).append(i)
    return [np.array(block) for block in found.values()]


def reference(train, test, distance, spread, alignment, settings, block_seconds):
    """What `fit_and_predict` should return."""
    in_alignment, weight = marker_weights(distance, spread, alignment)
    template = train.visible[len(train.visible) // 2]
    frames, frames_requested = (
        root_frames(p.visible, template, in_alignment, alignment.kind) for p in (train, test)
    )
    known = features(train, frames, weight, settings.lag)
    requested = features(test, frames_requested, weight, settings.lag)
    middle = known.mean(axis=0)
    scale = np.sqrt(((known - middle) ** 2).sum(axis=1).mean())
    inputs = inputs_of(train, (known - middle) / scale)
    inputs_requested = inputs_of(test, (requested - middle) / scale)
    targets = local(frames, train.missing)
    if train.velocity is not None:
        turned = [t.apply(v) for t, v in zip(frames[0], train.velocity, strict=True)]
        targets = np.concatenate([targets, turned], axis=1)
    count = targets.shape[1]
    targets = targets.reshape(len(targets), -1)
    centre = targets.mean(axis=0)

    subjects = train.subject is not None
    kernel = kernel_of(inputs, settings, subjects) + WhiteKernel(settings.noise, "fixed")
    mean, variance = predict(
        fit(kernel, inputs.matrix, targets - centre, 0.0), inputs_requested.matrix
    )
    mean = (mean + centre).reshape(len(mean), count, 3)
    markers = train.missing.shape[1]
    world = [
        upright(frames_requested, mean[:, :markers]),
        turned_back(frames_requested[0], mean[:, markers:]),
    ][: 1 + (train.velocity is not None)]

    blocks = blocks_of(train, test.recording[0] if subjects else None, block_seconds)
    residuals, held_out = hold_out(kernel, inputs.matrix, targets - centre, 0.0, blocks)
    which = np.flatnonzero(~np.isnan(held_out))
    which = which[np.argsort(train.time[which], kind="stable")]
    residuals, held_out = residuals[which].reshape(len(which), count, 3), held_out[which]
    unit = ((residuals**2).sum(axis=2) / held_out[:, None]).mean(axis=0)
    return Predicted(
        np.concatenate(world, axis=1),
        variance[:, None] * unit,
        np.sqrt(variance / held_out.mean()),
        turned_back([frames[0][i] for i in which], residuals),
        held_out[:, None] * unit,
    )


# ---- problems ------------------------------------------------------------------------------------


def movement(seed, frames=70, rate=50.0, markers=7):
    """A group of markers that turns, travels and deforms (frames, markers, 3), and its times."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / rate
    shape = rng.normal(0.0, 100.0, (markers, 3))
    waves = sum(
        rng.normal(0.0, 12.0, (markers, 3))
        * np.sin(rng.uniform(2.0, 9.0) * time[:, None, None] + rng.uniform(0.0, 6.0, (markers, 3)))
        for _ in range(3)
    )
    turn = Rotation.from_euler(
        "zyx",
        np.stack([1.5 * time, 0.6 * np.sin(2.0 * time), 0.4 * np.cos(3.0 * time)], axis=1),
    )
    poses = np.array([r.apply(p) for r, p in zip(turn, shape + waves, strict=True)])
    path = np.stack([700.0 * time, 80.0 * np.sin(3.0 * time), 900.0 + 0.0 * time], axis=1)
    return poses + path[:, None] + rng.normal(0.0, 0.5, poses.shape), time


MISSING, VISIBLE = np.array([0, 4]), np.array([1, 2, 3, 5, 6])
GAP = np.arange(28, 44)
DISTANCE = np.array([90.0, 150.0, 210.0, 120.0, 260.0])
SPREAD = np.array([4.0, 9.0, 20.0, 6.0, 14.0])
LAG = 0.06


def problem(seed, *, subjects=False, velocity=False):
    """Training and test poses of a gap in a recording, with other subjects' poses if wanted."""
    poses, time = movement(seed)
    velocities = np.gradient(poses, time, axis=0)
    steps = round(LAG * 50.0)

    def lagged(at):
        sides = (np.clip(at + d, 0, len(poses) - 1) for d in (-steps, steps))
        return {LAG: np.stack([poses[side][:, VISIBLE] for side in sides])}

    def part(at):
        return Poses(
            poses[at][:, VISIBLE],
            poses[at][:, MISSING],
            time[at],
            np.zeros(len(at), dtype=np.intp),
            velocity=velocities[at][:, MISSING] if velocity else None,
            lagged={} if subjects else lagged(at),
        )

    train = part(np.setdiff1d(np.arange(len(poses)), GAP))
    test = replace(part(GAP), missing=np.empty((len(GAP), 0, 3)), velocity=None)
    if not subjects:
        return train, test
    # another recording of the same subject, and two of others
    parts, donor_of, alike = [train], [0], [1.0]
    for subject, correlation in ((0, 1.0), (5, 0.9), (6, 0.6)):
        more, when = movement(seed, 30) if subject else movement(seed + 100, 25)
        more = more + (subject > 0) * np.random.default_rng(subject).normal(0.0, 15.0, (1, 7, 3))
        number = np.full(len(when), len(parts), dtype=np.intp)
        parts.append(Poses(more[:, VISIBLE], more[:, MISSING], when, number))
        donor_of.append(subject)
        alike.append(correlation)
    count = [len(p.time) for p in parts]
    return Poses(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in ("visible", "missing", "time", "recording")
        ),
        subject=np.repeat(np.array(donor_of, dtype=np.intp), count),
        correlation=np.repeat(alike, count),
    ), test


# ---- tests ---------------------------------------------------------------------------------------


def assert_as_reference(found, expected):
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose(found.variance, expected.variance, rtol=1e-6)
    np.testing.assert_allclose(found.relative_std, expected.relative_std, rtol=1e-6)
    np.testing.assert_allclose(found.residuals, expected.residuals, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.held_out_variance, expected.held_out_variance, rtol=1e-6)


SETTINGS = {
    "linear alone": Settings(rbf=0.0, time_variance=0.0),
    "linear and radial": Settings(time_variance=0.0),
    "radial alone": Settings(linear=0.0, rbf=2.0, time_variance=0.0),
    "exponential in time": Settings(),
    "Matern 3/2 in time": Settings(smooth=True),
    "in time alone": Settings(linear=0.0, rbf=0.0, time_variance=2.0),
    "forgetting": Settings(forgetting_time=0.4),
    "positions before and after": Settings(lag=(LAG, 0.7, False)),
    "difference before and after": Settings(lag=(LAG, 0.7, True)),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_mean_and_variance(name):
    train, test = problem(1)
    arguments = train, test, DISTANCE, SPREAD, Alignment(), SETTINGS[name], 0.25
    assert_as_reference(fit_and_predict(*arguments), reference(*arguments))


@pytest.mark.parametrize(
    "alignment", [Alignment("heading"), Alignment(rigidity=None), Alignment("heading", 90.0, 0.2)]
)
def test_mean_and_variance_in_other_root_frames(alignment):
    train, test = problem(2)
    arguments = train, test, DISTANCE, SPREAD, alignment, Settings(), 0.25
    assert_as_reference(fit_and_predict(*arguments), reference(*arguments))


def test_velocities_are_targets_like_positions():
    train, test = problem(3, velocity=True)
    arguments = train, test, DISTANCE, SPREAD, Alignment(), Settings(), 0.3
    found = fit_and_predict(*arguments)
    assert found.mean.shape == (len(GAP), 4, 3)
    assert_as_reference(found, reference(*arguments))


@pytest.mark.parametrize(("smooth", "forgetting_time"), [(False, None), (True, 0.4)])
def test_subjects_have_offsets_and_are_correlated(smooth, forgetting_time):
    train, test = problem(4, subjects=True)
    settings = Settings(smooth=smooth, forgetting_time=forgetting_time)
    arguments = train, test, DISTANCE, SPREAD, Alignment(), settings, 0.25
    assert_as_reference(fit_and_predict(*arguments), reference(*arguments))


@pytest.mark.parametrize("seed", range(4))
def test_held_out_blocks_of_several_lengths(seed):
    rng = np.random.default_rng(seed)
    inputs, targets = rng.normal(size=(30, 3)), rng.normal(size=(30, 4))
    kernel = constant(0.5) + constant(0.3) * dot() + rbf(1.3) + WhiteKernel(0.05, "fixed")
    order = rng.permutation(30)
    blocks = [np.sort(b) for b in np.split(order, [1, 5, 9, 16, 26])[:-1]]  # the rest stays
    found = held_out_residuals(kernel(inputs), targets, blocks)
    expected = hold_out(kernel, inputs, targets, 0.0, blocks)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10)
    assert np.isnan(found[1][order[26:]]).all()


def gappy_path(seed, holes=()):
    """A marker's path at 100 Hz with a gap from frame 60 to 90 (frames, 3)."""
    rng = np.random.default_rng(seed)
    time = np.arange(150)[:, None] / 100.0
    path = rng.normal(0.0, 500.0, 3) + rng.normal(0.0, 500.0, 3) * time
    for frequency in (0.7, 1.3, 2.9):
        path = path + rng.normal(0.0, 60.0, 3) * np.sin(
            2.0 * np.pi * frequency * time + rng.uniform(0.0, 6.0, 3)
        )
    path += rng.normal(0.0, 0.05, path.shape)
    path[60:90] = path[list(holes)] = np.nan
    return path


TWO_ON_EITHER_SIDE = (*range(20, 58), *range(92, 130))


@pytest.mark.parametrize("holes", [(), (59, 90, 95, 96), range(20, 58), TWO_ON_EITHER_SIDE])
def test_interpolation_is_universal_kriging(holes):
    path = gappy_path(7, holes)
    found, expected_rms = interpolate_gap(path, 60, 90, 100.0)
    known = [t for t in range(30, 120) if not np.isnan(path[t, 0])]  # 0.3 s on either side
    time, requested = (np.array(x)[:, None] / 100.0 - 0.75 for x in (known, range(60, 90)))
    kernel = matern(0.3, 2.5)
    noisy = kernel(time) + 1e-7 * np.eye(len(time))
    basis, basis_requested = (np.hstack([np.ones_like(t), t]) for t in (time, requested))
    weights, variance = kriging(noisy, kernel(requested, time), basis, basis_requested)
    np.testing.assert_allclose(found, weights @ path[known], atol=1e-5)
    # restricted maximum likelihood, from contrasts that annihilate any line
    free = null_space(basis.T)
    rest = free.T @ (path[known] - path[known].mean(axis=0))
    unit = (rest * np.linalg.solve(free.T @ noisy @ free, rest)).sum() / (len(known) - 2)
    np.testing.assert_allclose(expected_rms**2, unit * variance, rtol=1e-5, atol=1e-8 * unit)


def test_interpolation_has_a_line_of_unlimited_variance():
    path = gappy_path(8, TWO_ON_EITHER_SIDE)
    found, expected_rms = interpolate_gap(path, 60, 90, 100.0)
    known = np.array([58, 59, 90, 91])
    time, requested = (np.asarray(x)[:, None] / 100.0 - 0.75 for x in (known, np.arange(60, 90)))
    middle = path[known].mean(axis=0)
    line = constant(1e4) * (constant(1.0) + dot())
    mean, variance = predict(
        fit(line + matern(0.3, 2.5), time, path[known] - middle, 1e-7), requested
    )
    np.testing.assert_allclose(mean + middle, found, atol=0.02)
    inner = slice(3, -3)
    ratio = expected_rms[inner] ** 2 / variance[inner]
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-3)
    # the line's uncertainty adds to the variance
    without = predict(fit(matern(0.3, 2.5), time, path[known] - middle, 1e-7), requested)[1]
    assert variance[15] > 1.02 * without[15]


@pytest.mark.parametrize("process", BLACKOUT.curve_processes)
def test_curves_through_a_blackout_are_universal_kriging(process):
    smoothness, seconds = SMOOTHNESS[type(process.kernel)], process.kernel.time_scale
    noise = process.noise_variance
    known = np.concatenate([np.arange(-8, 0), np.arange(15, 24)]) / 40.0
    requested = np.arange(0, 15) / 40.0
    kernel = matern(seconds, smoothness)
    time, when = known[:, None], requested[:, None]
    expected, _ = kriging(
        kernel(time) + noise * np.eye(len(time)),
        kernel(when, time),
        np.hstack([np.ones_like(time), time]),
        np.hstack([np.ones_like(when), when]),
    )
    found = interpolation_weights(process, known, requested)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


def donors_of(seed, own_poses, own_image):
    """Poses of the clip's subject, perhaps, and of two others; the test poses; spreads."""
    rng = np.random.default_rng(seed)
    poses, _ = movement(seed, 40)
    query = poses[20:, VISIBLE]

    def donor(subject, mirrored, frames):
        off = rng.normal(0.0, 12.0, (1, 7, 3)) * (subject != THIS_CLIP)
        moved, _ = movement(seed, frames)
        moved = moved + off + rng.normal(0.0, 1.0, moved.shape)
        return Donor(subject, mirrored, moved[:, VISIBLE], moved[:, MISSING])

    found = [donor(THIS_CLIP, False, own_poses)] if own_poses else []
    found += [donor(THIS_CLIP, True, 12)] if own_image else []
    found += [donor(3, False, 14), donor(3, True, 11), donor(8, False, 13)]
    inner = rng.uniform(0.5, 9.0, (len(VISIBLE), len(VISIBLE)))
    return found, query, 0.5 * (inner + inner.T)


def shape_of(visible, distance, inner):
    """Mean distances of pairs; differences have the length of their weighted rms."""
    values, weights = [], []
    for i in range(len(distance)):
        for j in range(i):
            values.append(np.linalg.norm(visible[:, i] - visible[:, j], axis=1).mean())
            near = np.exp(-0.25 * (distance[i] ** 2 + distance[j] ** 2) / SHAPE_SCALE**2)
            weights.append(near / (1.0 + (inner[i, j] / SHAPE_SPREAD) ** 2))
    weights = np.array(weights) / np.sum(weights)
    return np.sqrt(weights) * values


@pytest.mark.parametrize("calibrated", [False, True])
@pytest.mark.parametrize(
    ("kind", "own_poses", "own_image"),
    [("rigid", 9, True), ("heading", 9, False), ("rigid", 0, False), ("rigid", 0, True)],
)
def test_donors_of_several_subjects(kind, own_poses, own_image, calibrated):
    donors, query, inner = donors_of(5, own_poses, own_image)
    alignment = Alignment(kind)
    in_alignment, weight = marker_weights(DISTANCE, SPREAD, alignment)
    visible, missing = (
        np.concatenate([getattr(d, name) for d in donors]) for name in ("visible", "missing")
    )
    donor_of = np.repeat(np.arange(len(donors)), [len(d.visible) for d in donors])
    subject = np.array([d.subject for d in donors])[donor_of]
    mirrored = np.array([d.mirrored for d in donors])[donor_of]
    own = (subject == THIS_CLIP) & ~mirrored
    shapes = np.array(
        [
            shape_of(
                query if d.subject == THIS_CLIP and not d.mirrored else d.visible, DISTANCE, inner
            )
            for d in donors
        ]
    )
    template = query[len(query) // 2]
    frames, frames_requested = (
        root_frames(points, template, in_alignment, kind) for points in (visible, query)
    )
    known, requested = (
        (local(f, p) * weight[:, None]).reshape(len(p), -1)
        for f, p in ((frames, visible), (frames_requested, query))
    )
    middle = known.mean(axis=0)
    scale = np.sqrt(((known - middle) ** 2).sum(axis=1).mean())
    inputs = Inputs(
        features=(known - middle) / scale,
        shape=shapes[donor_of],
        subject=subject,
        side=mirrored.astype(float),
    )
    here = np.ones(len(query))
    inputs_requested = Inputs(
        features=(requested - middle) / scale,
        shape=np.outer(here, shape_of(query, DISTANCE, inner)),
        subject=THIS_CLIP * here,
        side=0.0 * here,
    )
    targets = local(frames, missing).reshape(len(donor_of), -1)
    centre = (targets[own] if own.any() else targets).mean(axis=0)
    if own_image:
        blocks = [
            np.flatnonzero(donor_of == i) for i, d in enumerate(donors) if d.subject != THIS_CLIP
        ]
    else:
        blocks = [np.flatnonzero(subject == s) for s in (3, 8)]

    found = models_of_donors(donors, query, DISTANCE, SPREAD, inner, alignment, calibrated)
    assert len(found) > 1
    for model, positions, variance, error in found:
        settings = model.kernel
        pose = constant(settings.linear_variance) * inputs.on("features", dot()) + constant(
            settings.rbf_variance
        ) * inputs.on("features", rbf(settings.length_scale))
        same = inputs.on("subject", equal())
        shared = (
            constant(settings.shape_share) * inputs.on("shape", rbf(settings.shape_scale))
            + constant(settings.image_share) * same
            + constant(1.0 - settings.shape_share - settings.image_share)
            * same
            * inputs.on("side", equal())
        )
        kernel = (
            constant(1.0)
            + pose
            + shared
            * (constant(settings.offset_variance) + constant(settings.movement_ratio) * pose)
        )
        noise = model.noise_variance * np.where(own, OWN_NOISE, 1.0)
        process = fit(kernel, inputs.matrix, targets - centre, noise)
        mean, expected = predict(process, inputs_requested.matrix)
        expected = expected + noise.min()
        unit = np.ones(2)
        if calibrated:
            residuals, held_out = hold_out(kernel, inputs.matrix, targets - centre, noise, blocks)
            which = np.flatnonzero(~np.isnan(held_out))
            square = (residuals[which].reshape(len(which), 2, 3) ** 2).sum(axis=2)
            unit = (square / held_out[which, None]).mean(axis=0)
            assert error == pytest.approx(np.sqrt(square.mean()), rel=1e-8)
        else:
            assert np.isnan(error)
        mean = upright(frames_requested, (mean + centre).reshape(len(mean), 2, 3))
        np.testing.assert_allclose(positions, mean, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(variance, expected[:, None] * unit, rtol=1e-7)


def correction_case(own, noise):
    """Edges and errors of windows: of the clip, of its mirror image, and of other recordings."""
    rng = np.random.default_rng(own)
    source = np.repeat([0, 1, 2, 3], [1 + own, 8, 6, 5])
    start = np.concatenate(
        [[40], 10 * np.arange(own), 10 * np.arange(8), 7 * np.arange(6), np.arange(5)]
    )
    correlation = np.array([1.0, 0.95, 0.8, 0.6])[source]
    edges = rng.normal(0.0, 60.0, (len(source), 5)) + 300.0
    scale = rng.uniform(5.0, 30.0, len(source))
    shape = rng.normal(0.0, 0.3, (5, 6))
    errors = 0.05 * (edges[1:] - 300.0) @ shape * scale[1:, None]
    errors += rng.normal(0.0, noise, errors.shape)
    weight = rng.uniform(0.2, 1.0, len(errors))
    return edges, start, source, correlation, errors, scale, weight


@pytest.mark.parametrize(
    ("own", "noise", "least", "most"),
    [  # mm; bounds of the slope by which the correction is scaled, before it is clipped
        (9, 0.3, 1.0, np.inf),
        (MIN_WINDOWS, 0.3, 1.0, np.inf),
        (MIN_WINDOWS - 1, 0.3, 1.0, np.inf),
        (9, 60.0, 0.0, 1.0),
        (MIN_WINDOWS, 200.0, -np.inf, 0.0),
    ],
)
@pytest.mark.parametrize("min_distance", [1, 25])
def test_correction_of_a_blackout(min_distance, own, noise, least, most):
    edges, start, source, correlation, errors, scale, weight = correction_case(own, noise)
    # of the two takes one is of the clip's subject, or both are of one other subject
    own_subject = own == 9
    subject = np.array([-1, -2, -1 if own_subject else 5, 5])[source]
    features = edges - edges[1:].mean(axis=0)
    features = features / np.sqrt((features[1:] ** 2).sum(axis=1).mean())
    inputs = Inputs(
        edges=features, source=source, common=correlation, rest=np.sqrt(1.0 - correlation**2)
    )
    scored = [w for w in range(len(errors)) if own < MIN_WINDOWS or source[1 + w] == 0]

    def left_out(one, other):
        pair = {int(source[1 + one]), int(source[1 + other])}
        if source[1 + one] < 2:  # of the clip or its mirror image
            return pair <= {0, 1} and abs(start[1 + one] - start[1 + other]) < min_distance
        return min(pair) > 1 and (len(pair) == 1 or not own_subject)

    same = inputs.on("source", equal()) * inputs.on("rest", dot())
    predictions, residuals = [np.zeros(6)], [errors[scored]]
    variances = [np.ones(len(scored))]
    for length_scale, residual_variance, exponent in CORRECTION_SETTINGS:
        kernel = (
            constant(CORRECTION_LINEAR) * inputs.on("edges", dot())
            + inputs.on("edges", rbf(length_scale))
            + constant(CORRECTION_CONSTANT)
        ) * (inputs.on("common", dot()) + same)
        size = scale[:, None] ** exponent
        known, targets = inputs.matrix[1:], errors / size[1:]
        mean, latent = predict(fit(kernel, known, targets, residual_variance), inputs.matrix[:1])
        predictions.append(size[0] * mean[0])
        left, variance = [], []
        for window in scored:
            block = np.array([o for o in range(len(errors)) if left_out(window, o)])
            rest, of_rest = hold_out(kernel, known, targets, residual_variance, [block])
            left.append(size[1 + window] * rest[window])
            variance.append((latent[0] + residual_variance) / of_rest[window])
        residuals.append(np.array(left))
        variances.append(np.array(variance))
    part = weight[scored] ** 2 / (weight[scored] ** 2).sum()
    mean_square = np.array([part @ (r**2).sum(axis=1) for r in residuals])
    share = mean_square ** (-0.5 * CORRECTION_SHARPNESS)
    share /= share.sum()
    predicted = errors[scored] - np.einsum("k,kwv->wv", share, residuals)
    # slope of the least squares of the errors by what is predicted of them
    each = np.sqrt(part)[:, None] * np.stack([predicted, errors[scored]])
    slope = np.linalg.lstsq(each[0].reshape(-1, 1), each[1].ravel(), rcond=None)[0][0]
    assert least < slope < most
    slope = min(max(slope, 0.0), 1.0)

    found, left, variance = correct_curve(
        *(edges, start, source, subject, correlation),
        *(errors, scale, weight, np.array(scored), min_distance),
    )
    np.testing.assert_allclose(found, slope * (share @ predictions), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(left, errors[scored] - slope * predicted, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(variance, share @ variances, rtol=1e-7)
