"""Which channels of a recording are the coordinates of which marker."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from priorfill.errors import FormatError
from priorfill.formats.bids.side_files import Channel
from priorfill.formats.units import mm_per_unit
from priorfill.runtime.option_texts import first_names

__all__ = ["TrackedPoints", "find_tracked_points"]

_AXES = ("x", "y", "z")

_MAX_NAMED = 5
"""Names in a note; more are counted."""


@dataclass(frozen=True)
class TrackedPoints:
    """The markers of a recording.

    Attributes
    ----------
    labels : tuple of str
        Their names.
    columns : tuple of tuple of int [shape=(points, 3)]
        The channels of X, Y and Z, counted from 0.
    unit : str
        Unit of length as spelled in the file; empty if absent.
    scale : tuple of tuple of float [shape=(points, 3)]
        What the numbers of each channel are multiplied by for that unit.
    frame : str
        The reference frame of most markers.
    left_out : dict of int to str
        Points that are no markers, with the reason.
    notes : tuple of str
        What a user should know.
    """

    labels: tuple[str, ...]
    columns: tuple[tuple[int, ...], ...]
    unit: str
    scale: tuple[tuple[float, ...], ...]
    frame: str
    left_out: dict[int, str]
    notes: tuple[str, ...]


@dataclass
class _Point:
    """A marker whose channels are being collected, by axis."""

    label: str
    frame: str
    channels: dict[str, int] = field(default_factory=dict)


def find_tracked_points(channels: Sequence[Channel], name: str) -> TrackedPoints:
    """Find the channels of each marker: those of type POS with one tracked point.

    They may be in any order. A tracked point that has an axis more than once is several markers of
    one name, in the order of their channels.

    Parameters
    ----------
    channels : sequence of Channel
        All channels.
    name : str
        The name of ``_channels.tsv`` in messages.

    Raises
    ------
    FormatError
        If no tracked point has all three axes, or units cannot be converted to each other.
    """
    points, notes = _collect(channels)
    whole = [point for point in points if len(point.channels) == len(_AXES)]
    if not whole:
        raise FormatError(
            f"{name}: no tracked point has channels of type POS for x, y and z; priorfill fills "
            "positions only"
        )
    partial = [point.label for point in points if len(point.channels) < len(_AXES)]
    if partial:
        notes.append(f"Left out, because they lack an axis: {first_names(partial, _MAX_NAMED)}.")
    columns = tuple(tuple(point.channels[axis] for axis in _AXES) for point in whole)
    frame = Counter(point.frame for point in whole).most_common(1)[0][0]
    left_out = {}
    for number, point in enumerate(whole):
        if point.frame != frame:
            left_out[number] = (
                f"in the reference frame {point.frame or 'n/a'}, not {frame or 'n/a'}"
            )
        elif any(channels[column].status == "bad" for column in columns[number]):
            left_out[number] = "has the status bad"
    unit, scale = _units(channels, columns, name)
    return TrackedPoints(
        tuple(point.label for point in whole),
        columns,
        unit,
        scale,
        frame,
        left_out,
        tuple(notes),
    )


def _collect(channels: Sequence[Channel]) -> tuple[list[_Point], list[str]]:
    """Return tracked points with their channels, and notes on the other channels."""
    points: list[_Point] = []
    same: dict[tuple[str, str], list[_Point]] = {}
    others: Counter[str] = Counter()
    nameless = 0
    for column, channel in enumerate(channels):
        if channel.kind != "POS" or channel.component not in _AXES:
            others[channel.kind or "n/a"] += 1
            continue
        if not channel.tracked_point:
            nameless += 1
            continue
        twins = same.setdefault((channel.tracked_point, channel.frame), [])
        for point in twins:
            if channel.component not in point.channels:
                break
        else:
            point = _Point(channel.tracked_point, channel.frame)
            points.append(point)
            twins.append(point)
        point.channels[channel.component] = column
    notes = []
    if nameless:
        notes.append(f"{nameless} channels of positions have no tracked point; they are left out.")
    if others:
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(others.items())[:_MAX_NAMED])
        notes.append(f"Channels that are no positions stay as they are: {kinds}.")
    return points, notes


def _units(
    channels: Sequence[Channel], columns: Sequence[Sequence[int]], name: str
) -> tuple[str, tuple[tuple[float, ...], ...]]:
    """Return the unit of most coordinates, and the factors of all for that unit."""
    spelled = [[channels[column].units for column in point] for point in columns]
    unit = Counter(text for point in spelled for text in point).most_common(1)[0][0]
    factors: dict[str, float] = {}
    for text in {text for point in spelled for text in point}:
        lengths = mm_per_unit(text), mm_per_unit(unit)
        if text == unit:
            factors[text] = 1.0
        elif lengths[0] is not None and lengths[1] is not None:
            factors[text] = lengths[0] / lengths[1]
        else:
            raise FormatError(
                f"{name}: its positions have the units {unit or 'n/a'} and {text or 'n/a'}, which "
                "cannot be converted; correct the column units"
            )
    return unit, tuple(tuple(factors[text] for text in point) for point in spelled)
