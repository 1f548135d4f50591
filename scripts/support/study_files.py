"""Recordings with gaps made in them, for benchmarks and checks of studies."""

from __future__ import annotations

import hashlib
import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import psutil

import priorfill as pf
from priorfill.evaluation.gap_generator import GapGenerator, measured_in
from priorfill.formats.c3d.encoding import encode_floats, encode_integers
from priorfill.formats.c3d.layout import parse_layout

GAPS = 4
"""Gaps made in each recording, of a marker each."""

SECONDS = (0.1, 0.8)
"""s. Shortest and longest gap."""

INVALID = (0.0, 0.0, 0.0, -1.0)
"""Coordinates and residual of a missing sample."""

CHILD_SECONDS = 30.0
"""s. Time within which processes end after their parent was killed; a second on an idle computer,
and longer for workers of Dask."""

STATE = ".priorfill"
"""Beginning of the names of the folder with the records of a study, and of unfinished files."""


def make_study(data: Path, folder: Path, count: int | None = None) -> int:
    """Copy the C3D files below a folder, with gaps made in each.

    The copies keep names, folders and all other bytes. The gaps depend on the name only.

    Parameters
    ----------
    data : Path
        Folder of recordings.
    folder : Path
        Folder of the copies.
    count : int, optional
        Number of files, spread over those found; all if not given.

    Returns
    -------
    int
        The number of samples removed.
    """
    found = sorted(data.rglob("*.c3d"))
    if not found:
        raise SystemExit(f"{data}: no C3D files; use --data FOLDER")
    if count is not None and count < len(found):
        found = [found[len(found) * i // count] for i in range(count)]
    removed = 0
    for path in found:
        name = path.relative_to(data)
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        seed = int.from_bytes(hashlib.sha256(name.as_posix().encode()).digest()[:8], "big")
        contents, samples = with_gaps(path, seed)
        target.write_bytes(contents)
        removed += samples
    return removed


def with_gaps(path: Path, seed: int) -> tuple[bytes, int]:
    """Return the bytes of a C3D file with samples marked as missing, and their number."""
    clip, data = pf.read(path), path.read_bytes()
    assert clip.source is not None
    generator = GapGenerator(clip, np.random.default_rng(seed), measured_in(clip))
    for _ in range(GAPS):
        generator.remove(generator.marker(), generator.length(*SECONDS))
    frames, markers = np.nonzero(generator.mask)
    layout = parse_layout(data, path.name)
    points = np.asarray(clip.source.points, dtype=np.intp)[markers]
    offsets = layout.record_offsets(frames.astype(np.intp), points)
    words = np.tile(INVALID, (len(frames), 1))
    contents = np.frombuffer(data, np.uint8).copy()
    contents[offsets[:, None] + np.arange(layout.record_bytes)] = (
        encode_floats(words, layout.processor)
        if layout.is_float
        else encode_integers(words.astype(np.int16), layout.processor)
    )
    return contents.tobytes(), len(frames)


def outputs(folder: Path) -> dict[str, bytes]:
    """Return what the filled files of a study hold, by their names; without records and summary."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in _files(folder)
        if not path.relative_to(folder).as_posix().startswith("summary")
    }


def count_files(folder: Path) -> int:
    """Return how many files a study has filled, also while it goes on."""
    return sum(1 for _ in _files(folder))


def _files(folder: Path) -> Iterator[Path]:
    """Yield the finished files below a folder, in which other processes may write."""
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith(STATE))
        yield from (Path(here, name) for name in sorted(names) if not name.startswith(STATE))


def kill_half_way(command: Sequence[str], sources: Path, output: Path) -> int:
    """Start a command that fills a study, and kill it once half of the files are filled.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    sources, output : Path
        Folders of the files with gaps, and of the filled ones.

    Returns
    -------
    int
        The number of files that were filled.
    """
    half = len(outputs(sources)) // 2
    process = psutil.Popen([*command], stdout=subprocess.DEVNULL)
    while process.poll() is None and count_files(output) < half:
        time.sleep(0.05)
    children = process.children(recursive=True)
    process.kill()
    process.wait()
    psutil.wait_procs(children, timeout=CHILD_SECONDS)
    left = [child for child in children if child.is_running()]
    assert not left, f"processes go on after their parent was killed: {left}"
    return len(outputs(output))
