"""Poses for the search benchmark: variations of recordings, in the root frames of one search.

A set of any size is made from few recordings. Each clip of a minute has its own body size (0.9 to
1.1) and marker placement (up to some 10 mm off). It concatenates stretches of recordings, slower or
faster by up to a quarter, with 0.3 mm of noise. Queries are consecutive frames, at their own rate,
of a recording that is not part of the set.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import priorfill as pf
from priorfill.geometry.axes import to_upright
from priorfill.geometry.root_frames import root_group
from priorfill.markers.definitions import load
from priorfill.signal.resample import resample

FOLDERS = ("hdm05", "cmu", "hdm05_cut_markers")
"""Folders of recordings with the 41 markers of `baumann41`."""

ROOT = ("LFWT", "RFWT", "LBWT", "RBWT")
"""Markers of the pelvis, which define the root frames."""

GONE = ("RFIN", "RWRA")
"""Missing reliable markers; the other 18 are the coordinates of the search (54 dimensions)."""

RATE, MINUTE = 30.0, 60.0
"""Rate (Hz) and clip length (s) of the database."""

STRETCH = 20.0
"""s. Longest stretch of a recording."""

SIZES, PACES = (0.9, 1.1), (0.8, 1.25)
PLACING, NOISE = 10.0, 0.3
"""Ranges of body size and speed; standard deviations of placement and noise, mm."""


def read(file: Path) -> tuple[NDArray[np.float32], float] | None:
    """Return the searched coordinates of a recording and its rate (Hz); None if it has gaps.

    The coordinates have shape (frames, 54), in mm, in root frames of position and heading.
    """
    markers = load("baumann41")
    clip = pf.read(file)
    wanted = [m for m in markers.labels if markers.reliable[m] and m not in GONE]
    if not {*wanted, *ROOT} <= set(clip.labels):
        return None
    order = [clip.labels.index(label) for label in (*ROOT, *wanted)]
    positions = to_upright(clip.positions[:, order], clip.up)
    root = root_group(positions, range(len(ROOT)))
    if root is None or np.isnan(positions).any():
        return None
    # same zero heading in all recordings: from the right hip to the left along y
    shape = root.template[:, :2]
    across = shape[0] + shape[2] - shape[1] - shape[3]
    angle = np.arctan2(-across[0], across[1])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    local = root.frames(positions).to_local(positions)[:, len(ROOT) :]
    local[..., :2] = local[..., :2] @ turn
    return local.reshape(len(local), -1).astype(np.float32), clip.rate


def pieces(data: Path, left_out: str) -> list[NDArray[np.float32]]:
    """Return the recordings of a folder but one, by its file's name, at the database's rate."""
    found = []
    for folder in FOLDERS:
        for file in sorted((data / folder).glob("*.c3d")):
            recording = read(file) if file.stem != left_out else None
            if recording is not None:
                local = recording[0].reshape(len(recording[0]), -1, 3).astype(np.float64)
                local = resample(local, recording[1], RATE)
                found.append(local.reshape(len(local), -1).astype(np.float32))
    return found


def _minutes(
    recordings: list[NDArray[np.float32]], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Yield clips of one minute indefinitely, each with its own body size and placement."""
    frames = round(MINUTE * RATE)
    while True:
        size = np.float32(rng.uniform(*SIZES))
        placing = rng.normal(0.0, PLACING, recordings[0].shape[1]).astype(np.float32)
        clip = np.empty((frames, len(placing)), dtype=np.float32)
        at = 0
        while at < frames:
            piece = recordings[rng.integers(len(recordings))]
            piece = piece[rng.integers(max(1, len(piece) // 2)) :][: round(STRETCH * RATE)]
            time = np.arange(0, len(piece) - 1, rng.uniform(*PACES))[: frames - at]
            before = time.astype(np.intp)
            share = (time - before).astype(np.float32)[:, None]
            clip[at : at + len(time)] = piece[before] * (1 - share) + piece[before + 1] * share
            at += len(time)
        noise = rng.standard_normal(clip.shape, dtype=np.float32) * np.float32(NOISE)
        yield clip * size + placing + noise


def database(
    recordings: list[NDArray[np.float32]], poses: int, seed: int
) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Return a number of poses [shape=(poses, 54), mm], and the first row of each clip."""
    made = np.empty((poses, recordings[0].shape[1]), dtype=np.float32)
    source = _minutes(recordings, np.random.default_rng(seed))
    starts, at = [], 0
    while at < poses:
        clip = next(source)[: poses - at]
        starts.append(at)
        made[at : at + len(clip)] = clip
        at += len(clip)
    return made, np.array(starts, dtype=np.intp)
