"""Read C3D files.

The layout is checked by a strict parser, then the points are read from where it says. Both are
ours: ezc3d gives the same positions where it can read a file, in forty times the time, but it
reads a file that is cut short as a shorter one, cannot read others (MIPS, bytes beyond ASCII in
a parameter, more than 65535 frames), and on malformed ones it hangs, or ends the program.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip, Source, blank_partly_known
from priorfill.errors import ClipError, OptionError
from priorfill.formats.c3d.layout import Layout, parse_layout, read_points
from priorfill.formats.c3d.parameters import is_c3d
from priorfill.formats.c3d.point_kinds import find_model_points, split_label
from priorfill.formats.contents import read_contents
from priorfill.formats.subjects import choose_subject
from priorfill.formats.units import find_unit
from priorfill.formats.up_axis import find_up_axis

__all__ = ["read_c3d", "read_c3d_bytes"]

_LARGEST = 4_000_000_000
"""Bytes of a file: 11 hours of 50 markers at 120 Hz. A fill takes ten times as much memory."""

_TELLING_SHARE = 0.1
"""Of the samples that are there, those that must have a residual above 0 for residuals of 0 to
mean anything. Many systems write 0 everywhere; where they write residuals, nearly every
measured sample has one, and nobody fills more than nine tenths of a recording."""


def read_c3d(
    path: Path | str,
    *,
    zeros_missing: bool = True,
    up: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> Clip:
    """Read the markers of a C3D file.

    Parameters
    ----------
    path : Path or str
        The file.
    zeros_missing : bool
        Take samples that are exactly (0, 0, 0) with a valid residual as missing, as several
        programs write them.
    up : str or None
        Which axis points up, one of `priorfill.geometry.axes.UP_AXES`, instead of finding it.
    rate : float or None
        Frames per second (Hz) instead of the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) instead of the file's.
    subject : str or None
        Whose markers to read, where the file holds several subjects.

    Returns
    -------
    Clip
        The markers in mm. Its source says what else the file holds and why it is left out.

    Raises
    ------
    FormatError
        If the file is absent, not C3D, damaged or cut short.
    ClipError
        If its contents make no sense: no points, no frames, no rate, an infinite
        coordinate, no labelled marker, an implausible unit, an unknown subject, or
        several subjects and none chosen.
    OptionError
        If an option is out of range.
    """
    path = Path(path)
    name = path.name
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise OptionError(f"rate {rate:g} Hz is not positive; give the frames per second")
    data = read_c3d_bytes(path)
    layout = parse_layout(data, name)
    positions, residual = read_points(data, layout)
    positions[residual < 0] = np.nan
    blank_partly_known(positions)

    prefixes = layout.parameters.texts("SUBJECTS", "LABEL_PREFIXES")
    split = [split_label(label, prefixes) for label in layout.labels]
    names = [marker for _, marker in split]
    reasons = find_model_points(names, layout.labels, positions, layout.parameters)
    owners = {point: owner for point, (owner, _) in enumerate(split) if point not in reasons}
    declared = [text for text in layout.parameters.texts("SUBJECTS", "NAMES") if text]
    chosen, others = choose_subject(owners, subject, declared, name)
    reasons.update(others)
    points = [point for point in range(layout.points) if point not in reasons]
    if not points:
        raise ClipError(
            f"{name}: none of its {layout.points} points is a labelled marker; "
            "label the markers first"
        )
    if zeros_missing:
        zero = (positions == 0).all(axis=2)
        positions[zero] = np.nan
    else:
        zero = np.zeros(positions.shape[:2], dtype=bool)
    seen = [not np.isnan(positions[:, point, 0]).all() for point in range(layout.points)]
    called, twins, label_notes = _distinct(points, names, seen)
    reasons.update(twins)
    points = list(called)
    labels = tuple(called.values())
    # what most files hold is markers only, of which a copy would do nothing but take memory
    kept = positions if points == list(range(layout.points)) else positions[:, points]
    del positions
    _check_finite(kept, labels, layout, name)
    spelled = next(iter(layout.parameters.texts("POINT", "UNITS")), "")
    _, mm_per_unit, unit_notes = find_unit(kept, spelled, unit, name)
    kept *= mm_per_unit
    kept.setflags(write=False)  # the clip need not copy it
    screen_up = next(iter(layout.parameters.texts("POINT", "Y_SCREEN")), "")
    up_axis, up_found_from, up_notes = find_up_axis(kept, labels, screen_up, up)
    if rate is None and layout.rate == 0:
        raise ClipError(f"{name}: has no frame rate; give the frames per second (--rate)")
    return Clip(
        positions=kept,
        labels=labels,
        rate=layout.rate if rate is None else rate,
        up=up_axis,
        name=path.stem,
        subject=chosen,
        first_frame=layout.first_frame,
        source=Source(
            path=path,
            sha256=hashlib.sha256(data).hexdigest(),
            points=tuple(points),
            point_labels=tuple(layout.labels[point] for point in points),
            unit=spelled,
            mm_per_unit=mm_per_unit,
            up_found_from=up_found_from,
            zero_samples=int(zero[:, points].sum()),
            left_out=_left_out(reasons, layout),
            notes=(*layout.contradictions, *label_notes, *unit_notes, *up_notes),
            interpolated=_interpolated(residual[:, points], ~np.isnan(kept[:, :, 0])),
        ),
    )


def read_c3d_bytes(path: Path) -> bytes:
    """Return a file's contents; its first block alone where that is not the first of a C3D file.

    Raises
    ------
    FormatError
        If there is no such file, it cannot be read, or is larger than any recording.
    """
    return read_contents(path, most=_LARGEST, begins=is_c3d)


def _interpolated(
    words: NDArray[np.float64], present: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """Return which samples the file says are interpolated [shape=(frames, markers)].

    The format's sign for it is a residual of 0 and no cameras. The fourth word, which holds both,
    is looked at as it is: read by the rules, a residual below one step, or one that a program
    wrote as a plain fraction, is 0 too. None where the file does not tell measured samples from
    others.
    """
    there = words[present]
    if there.size == 0 or (there > 0).mean() < _TELLING_SHARE:
        return None
    found: NDArray[np.bool_] = present & (words == 0)
    found.setflags(write=False)
    return found


def _distinct(
    points: Sequence[int], names: Sequence[str], seen: Sequence[bool]
) -> tuple[dict[int, str], dict[int, str], list[str]]:
    """Give markers of the same label different names.

    Which of them is meant cannot be known, so none is dropped that is seen, and none is joined
    with another: the first keeps the name.

    Returns
    -------
    called : dict of int to str
        What each marker's point is called.
    twins : dict of int to str
        Why points are left out: they are never seen, and another of their label is.
    notes : list of str
        What the user should know.
    """
    by_name: dict[str, list[int]] = {}
    for point in points:
        by_name.setdefault(names[point], []).append(point)
    called = {point: names[point] for point in points}
    twins: dict[int, str] = {}
    notes = []
    for name, same in by_name.items():
        some = [point for point in same if seen[point]] or same[:1]
        for point in same:
            if point not in some:
                del called[point]
                twins[point] = f"never seen, and point {some[0] + 1} is labelled {name} too"
        for point in some[1:]:
            other = f"{name}#{point + 1}"
            while other in by_name:
                other += "#"
            called[point] = other
            notes.append(
                f"Points {some[0] + 1} and {point + 1} are both labelled {name}; "
                f"the second is called {other} here. Rename one of them if it is another marker."
            )
    return called, twins, notes


def _check_finite(
    positions: NDArray[np.float64], labels: tuple[str, ...], layout: Layout, name: str
) -> None:
    """Raise ClipError at the first infinite coordinate."""
    infinite = np.isinf(positions).any(axis=2)
    if infinite.any():
        frame, marker = np.argwhere(infinite)[0]
        raise ClipError(
            f"{name}: marker {labels[marker]} has an infinite coordinate in frame "
            f"{layout.first_frame + int(frame)}; mark the sample as missing"
        )


def _left_out(reasons: dict[int, str], layout: Layout) -> dict[str, str]:
    """Return the reasons by label; a label that is empty or taken gets the point's number."""
    left_out: dict[str, str] = {}
    for point in sorted(reasons):
        label = layout.labels[point].strip()
        if not label or label in left_out:
            label = f"{label} (point {point + 1})".strip()
        left_out[label] = reasons[point]
    return left_out
