"""Covariance functions against scikit-learn's, and the cache of their matrices."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.gaussian_process import kernels as sk

from priorfill.gp import kernels
from priorfill.gp.kernels import (
    RBF,
    Constant,
    Exponential,
    Forgetting,
    Linear,
    Matern32,
    Matern52,
    Matern72,
    On,
    Pairs,
    SameRecording,
    SameSubject,
    SubjectCorrelation,
)

TIME_KERNELS = (Exponential(0.3), Matern32(0.3), Matern52(0.3), Matern72(0.3), Forgetting(0.3, 0.2))


def features(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(7, 3)), rng.normal(size=(5, 3))


@pytest.mark.parametrize(
    ("kernel", "reference"),
    [
        (Linear(), sk.DotProduct(0.0)),
        (RBF(0.7), sk.RBF(0.7)),
        (
            Constant() + 3.0 * Linear() + RBF(0.6) * 2.0,
            sk.ConstantKernel(1.0) + 3.0 * sk.DotProduct(0.0) + 2.0 * sk.RBF(0.6),
        ),
        (Linear() * RBF(2.0), sk.DotProduct(0.0) * sk.RBF(2.0)),
    ],
    ids=str,
)
def test_kernels_of_features(kernel: kernels.Kernel, reference: sk.Kernel) -> None:
    one, other = features()
    pairs = Pairs.of_features(one, other)
    np.testing.assert_allclose(kernel(pairs), reference(one, other), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        np.broadcast_to(kernel.variance(pairs), len(one)), reference.diag(one), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("kernel", "smoothness"),
    [(Exponential(0.3), 0.5), (Matern32(0.3), 1.5), (Matern52(0.3), 2.5), (Matern72(0.3), 3.5)],
)
def test_kernels_of_time(kernel: kernels.Kernel, smoothness: float) -> None:
    one, other = np.linspace(0.0, 2.0, 9), np.array([0.1, 0.25, 5.0])
    reference = sk.Matern(0.3, nu=smoothness)(one[:, None], other[:, None])
    np.testing.assert_allclose(kernel(Pairs.of_times(one, other)), reference, rtol=1e-9, atol=1e-12)
    assert kernel.variance(Pairs.of_times(one, other)) == 1.0


def test_forgetting_falls_to_its_limit() -> None:
    lag = np.array([[0.0, 3.0, np.inf]])
    found = Forgetting(3.0, limit=0.5)(Pairs((1, 3), time_lags=lag))
    np.testing.assert_allclose(found, [[1.0, 0.5 + 0.5 * np.exp(-1.0), 0.5]])


@pytest.mark.parametrize("kernel", TIME_KERNELS, ids=str)
def test_recordings_are_infinitely_far_apart(kernel: kernels.Kernel) -> None:
    found = kernel(Pairs((1, 2), time_lags=np.array([[0.0, np.inf]])))
    np.testing.assert_allclose(found, [[1.0, getattr(kernel, "limit", 0.0)]], atol=1e-290)


def test_labels_of_points() -> None:
    subject = np.array([[True, False]])
    recording = np.array([[False, True]])
    correlation = np.array([[0.9, 0.8]])
    pairs = Pairs((1, 2), same_subject=subject, same_recording=recording, correlation=correlation)
    kernel = 2.0 * Constant() * SubjectCorrelation() + 10.0 * SameSubject() + SameRecording()
    np.testing.assert_allclose(kernel(pairs), [[11.8, 2.6]])
    np.testing.assert_allclose(kernel(Pairs((1, 2))), 13.0)
    assert kernel.variance(pairs) == 13.0


def test_other_spaces() -> None:
    one, other = features()
    shapes = Pairs.of_features(one[:, :1], other[:, :1])
    pairs = Pairs((7, 5), spaces={"shape": shapes}).with_features(
        one @ other.T, (one**2).sum(axis=1), (other**2).sum(axis=1)
    )
    kernel = Linear() * On("shape", RBF(2.0)) + On("shape", Linear())
    expected = sk.DotProduct(0.0)(one, other) * sk.RBF(2.0)(one[:, :1], other[:, :1])
    expected += one[:, :1] @ other[:, :1].T
    np.testing.assert_allclose(kernel(pairs), expected, rtol=1e-12)
    variance = (one**2).sum(axis=1) + one[:, 0] ** 2
    np.testing.assert_allclose(kernel.variance(pairs), variance)


def test_matrices_are_remembered_and_never_overwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    computed = []
    for kind in (RBF, Matern32):
        original = kind.evaluate

        def counted(self, pairs, original=original):
            computed.append(self)
            return original(self, pairs)

        monkeypatch.setattr(kind, "evaluate", counted)
    one, other = features()
    time = Pairs.of_times(np.arange(7.0), np.arange(5.0))
    in_time = 0.1 * Matern32(2.0) + 10.0 * SameSubject()
    ensemble = [a * Linear() + b * RBF(0.7) + in_time for a in (1.0, 2.0) for b in (1.0, 3.0)]
    for _ in ensemble:
        time.value(in_time)
    assert computed == [Matern32(2.0)]
    for scale in (1.0, 2.0):
        pairs = time.with_features(
            scale**2 * one @ other.T,
            scale**2 * (one**2).sum(axis=1),
            scale**2 * (other**2).sum(axis=1),
        )
        for _ in range(2):
            for kernel in ensemble:
                found = kernel(pairs)
                fresh = kernel(
                    Pairs.of_times(np.arange(7.0), np.arange(5.0)).with_features(
                        pairs.product, *pairs.squared_norms
                    )
                )
                np.testing.assert_array_equal(found, fresh)
                found[:] = np.nan  # callers may overwrite what they are given
    # besides the references: once for both scales, and once for each
    assert computed.count(Matern32(2.0)) - 16 == 1
    assert computed.count(RBF(0.7)) - 16 == 2


def test_missing_inputs_are_refused() -> None:
    with pytest.raises(ValueError, match="no features"):
        Linear()(Pairs((1, 1)))
    with pytest.raises(ValueError, match="no features"):
        RBF(1.0)(Pairs((1, 1)))
    with pytest.raises(ValueError, match="no times"):
        Matern52(1.0)(Pairs((1, 1)))
