"""Shared by the tests of ``priorfill db``: small clips as files, and a command runner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from c3d_bytes import C3DFile
from click.testing import CliRunner, Result

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.formats import write

LABELS = ("LASI", "RASI", "SACR", "C7")
HEIGHTS = {"LASI": 950, "RASI": 960, "SACR": 990, "C7": 1480, "T10": 1250, "HEAD": 1700}
MEASURED = 0x0303  # residual and camera bits of a measured sample


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def small_clip(
    name: str = "clip",
    seed: int = 0,
    frames: int = 120,
    amplitude: float = 200.0,
    subject: str = "",
    labels: tuple[str, ...] = LABELS,
    rate: float = 120.0,
) -> Clip:
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / rate
    place = rng.uniform(200, 900, (1, len(labels), 3))
    place[..., 2] = [HEIGHTS[label] for label in labels]
    swing = amplitude * np.sin(2 * np.pi * rng.uniform(0.5, 2, (1, len(labels), 3)) * t)
    positions = (place + swing).astype(np.float32).astype(np.float64)  # rounded as in a file
    return Clip(positions, labels, rate, name=name, subject=subject)


def write_clip(
    path: Path, seed: int = 0, frames: int = 120, amplitude: float = 200.0, subject: str = ""
) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write(path, small_clip(path.stem, seed, frames, amplitude, subject))
    return path


def gappy_and_filled(
    clip: Clip, start: int = 40, stop: int = 80, label: str = "C7"
) -> tuple[Clip, Clip, np.ndarray]:
    """The clip with a gap, the clip with the gap filled (10 mm off), and the mask."""
    mask = np.zeros(clip.missing.shape, dtype=bool)
    mask[start:stop, clip.labels.index(label)] = True
    gappy = clip.with_positions(np.where(mask[..., None], np.nan, clip.positions))
    filled = clip.with_positions(clip.positions + 10 * mask[..., None])
    return gappy, filled, mask


def with_residuals(path: Path, clip: Clip, filled: np.ndarray | None = None) -> Path:
    """Write a clip with residuals: 0 for filled samples."""
    words = np.full((*clip.missing.shape, 1), float(MEASURED))
    if filled is not None:
        words[filled] = 0
    words[clip.missing] = -1
    records = np.concatenate([np.nan_to_num(clip.positions), words], axis=2)
    path.write_bytes(C3DFile(records, list(clip.labels), rate=clip.rate).bytes())
    return path
