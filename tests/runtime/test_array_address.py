"""Addresses of arrays, compared with those that NumPy states."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.runtime import array_address

LARGE = np.zeros((4, 6, 3))


@pytest.mark.parametrize(
    "array",
    [
        LARGE,
        LARGE[1:, ::2],
        LARGE[::-1].T,
        np.zeros((0, 3)),
        np.zeros((), dtype=np.float32),
        np.broadcast_to(1.0, (2, 2)),
        np.frombuffer(b"12345678", dtype=np.int16),
    ],
)
def test_same_as_stated_by_numpy(array: np.ndarray) -> None:
    expected = array.__array_interface__["data"][0]
    assert array_address.array_address(array) == expected
    assert array_address._from_attribute(array) == expected


def test_interpreters_in_which_an_id_is_no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(array_address.sys.implementation, "name", "pypy")
    assert array_address._chosen() is array_address._from_attribute
