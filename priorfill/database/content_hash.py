"""The hash of a clip's contents, by which a database knows it."""

from __future__ import annotations

import hashlib
import json

import numpy as np

from priorfill.clip import Clip

__all__ = ["content_hash"]

BATCH_FRAMES = 1000
"""Frames whose digest is computed at a time, without copies of the whole clip."""


def content_hash(clip: Clip) -> str:
    """Return the SHA-256 of a clip's labels, rate and positions."""
    digest = hashlib.sha256()
    digest.update(json.dumps([clip.labels, clip.rate]).encode())
    for start in range(0, clip.frames, BATCH_FRAMES):
        positions = clip.positions[start : start + BATCH_FRAMES]
        # NaN has many bit patterns, and they all mean missing
        alike = np.where(np.isnan(positions), np.nan, positions)
        digest.update(np.ascontiguousarray(alike, dtype="<f8").data)
    return digest.hexdigest()
