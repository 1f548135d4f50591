"""Protocols: which samples are removed from a clip, to be filled again.

A protocol makes cases of a clip, each a mask of samples to be removed. All of them are measured;
the clip's own gaps stay gaps. What a protocol draws depends on the seed, the clip's name and the
case, and on nothing else.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011.
.. [G16] Gløersen and Federolf, Predicting missing marker trajectories in human motion data using
   marker intercorrelations, PLoS ONE 11(3), 2016, doi 10.1371/journal.pone.0152616.
.. [L20] Li, Yu, Kieu, Vuong and Zhang, PCA based robust motion data recovery, IEEE Access 8, 2020,
   doi 10.1109/ACCESS.2020.2989744.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.evaluation.body_parts import LIMBS, SIDES, BodyParts
from priorfill.evaluation.gap_generator import (
    MOST,
    TRIES,
    GapGenerator,
    Mask,
    measured_in,
)
from priorfill.gaps import find_gaps

__all__ = [
    "DEFAULT_PROTOCOL",
    "MAX_MISSING_AT_ONCE",
    "PROTOCOLS",
    "RANDOM_GAP_SECONDS",
    "RANDOM_GAP_SHARE",
    "GapMask",
    "GapProtocol",
    "SkippedCase",
    "make_protocol",
    "settings_of",
]

Range = tuple[float, float]

RANDOM_GAP_SHARE = (0.03, 0.09)
"""Share of samples missing in the 50 patterns that [G16] published: 2.9 to 9.1 %."""

RANDOM_GAP_SECONDS = (0.1, 2.0)
"""s. Lengths of the gaps there: nine in ten lie between 0.17 and 1.95 s."""

MAX_MISSING_AT_ONCE = 7
"""Markers missing at once at most. There it is 3 to 9, by pattern."""

MARKER_SECONDS = 1.0
"""s. How long each marker is missing in its turn."""

GROUP_SECONDS = 3.0
"""s. How long arms and legs are missing; half of the clip at most."""

MEASURED = 0.5
"""Share of the frames in which a marker must be measured to be removed with its group."""

TRIES_PER_GAP = 20
"""Placements tried for each gap of a scatter."""


@dataclass(frozen=True, eq=False)
class GapMask:
    """A case: what is removed from a clip.

    Attributes
    ----------
    name : str
        What is removed: ``scatter``, a marker, a group.
    copy : int
        Which of several alike, from 1.
    gone : ndarray of bool [shape=(frames, markers)]
        Samples to be removed.
    """

    name: str
    copy: int
    gone: Mask


@dataclass(frozen=True)
class SkippedCase:
    """A case that could not be made of a clip, and why."""

    name: str
    copy: int
    reason: str


Draw = Callable[[str, int], np.random.Generator]
"""A generator for a case, by its name and copy."""


class GapProtocol(Protocol):
    """A protocol: a function of a clip, with options."""

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        ...


def draw_for(seed: int, protocol: str, clip: str) -> Draw:
    """Return what gives each case of a clip a generator of its own."""

    def draw(name: str, copy: int) -> np.random.Generator:
        words = [zlib.crc32(word.encode()) for word in (protocol, clip, name)]
        return np.random.default_rng([seed, *words, copy])

    return draw


def _too_short(clip: Clip, seconds: Range) -> str:
    return (
        f"a clip of {clip.duration:.2f} s is too short for gaps of {seconds[0]:g} s, "
        f"which may take {MOST:.0%} of it"
    )


def _nowhere(frames: int, clip: Clip) -> str:
    return f"nowhere measured throughout {frames / clip.rate:.2f} s inside the clip"


def _cut_out(
    clip: Clip,
    markers: Sequence[int],
    seconds: Range,
    rng: np.random.Generator,
    name: str,
    copy: int,
) -> GapMask | SkippedCase:
    """Remove some markers for a while, somewhere inside the clip."""
    cutter = GapGenerator(clip, rng, measured_in(clip))
    frames = cutter.length(*seconds)
    if frames is None:
        return SkippedCase(name, copy, _too_short(clip, seconds))
    if not cutter.cut(markers, frames):
        return SkippedCase(name, copy, _nowhere(frames, clip))
    return GapMask(name, copy, cutter.gone)


@dataclass(frozen=True)
class RandomGaps:
    """Gaps of random markers at random times ([G16], fig. 4).

    The paper has 50 copies of a recording, each with gaps at random. The defaults are those of
    the 50 patterns that it published, but for the number of copies.

    Attributes
    ----------
    copies : int
        Copies of each clip.
    number : (int, int) or None
        Least and greatest number of gaps in a copy. None: as many as `share` says.
    share : (float, float)
        Least and greatest share of the samples to be removed.
    seconds : (float, float)
        Least and greatest length of a gap (s).
    at_once : int
        Markers missing at the same time at most.
    """

    copies: int = 10
    number: tuple[int, int] | None = None
    share: Range = RANDOM_GAP_SHARE
    seconds: Range = RANDOM_GAP_SECONDS
    at_once: int = MAX_MISSING_AT_ONCE

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        del parts
        for copy in range(1, self.copies + 1):
            rng = draw("random", copy)
            cutter = GapGenerator(clip, rng, measured_in(clip))
            if self.number is None:
                share = rng.uniform(*self.share)
                samples = share * cutter.gone.size
                likely = samples / (clip.rate * (self.seconds[0] + self.seconds[1]) / 2)
                tries = max(TRIES, round(TRIES_PER_GAP * likely))
                found = cutter.scatter(share, self.seconds, self.at_once, tries)
            else:
                found = self._some(cutter, int(rng.integers(*self.number, endpoint=True)))
            if found:
                yield GapMask("random", copy, cutter.gone)
            elif cutter.length(*self.seconds) is None:
                yield SkippedCase("random", copy, _too_short(clip, self.seconds))
            else:
                yield SkippedCase(
                    "random", copy, "no place where a gap would be measured throughout"
                )

    def _some(self, cutter: GapGenerator, gaps: int) -> bool:
        """Cut a number of gaps."""
        left = gaps
        for _ in range(TRIES_PER_GAP * gaps):
            left -= bool(cutter.scatter_one(self.seconds, self.at_once))
            if not left:
                break
        return left < gaps


@dataclass(frozen=True)
class MarkerGaps:
    """Each marker in turn is missing for a while, alone ([B11], fig. 3).

    Attributes
    ----------
    copies : int
        Gaps of each marker, each a case of its own.
    seconds : (float, float)
        Least and greatest length (s).
    markers : tuple of str
        The markers; all of them if empty.
    """

    copies: int = 1
    seconds: Range = (MARKER_SECONDS, MARKER_SECONDS)
    markers: tuple[str, ...] = ()

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        del parts
        unknown = [label for label in self.markers if label not in clip.labels]
        for label in unknown:
            yield SkippedCase(label, 1, "the clip has no such marker")
        for label in self.markers or clip.labels:
            for copy in range(1, self.copies + 1):
                if label not in unknown:
                    marker = [clip.labels.index(label)]
                    yield _cut_out(clip, marker, self.seconds, draw(label, copy), label, copy)


BOTH = "both"
"""Name of the group of arms and legs."""


@dataclass(frozen=True)
class GroupGaps:
    """Arms, legs, and both are missing for a while ([B11], table 2).

    Where the marker set names no arms and legs, each segment found from the data, with its nearest
    ones until there are four markers.

    Attributes
    ----------
    copies : int
        Gaps of each group, each a case of its own.
    seconds : (float, float)
        Least and greatest length (s).
    groups : tuple of str
        ``arms``, ``legs``, ``both``, ``left_arm``, ``right_leg``, ...; those of the paper, or all
        segments found from the data, if empty.
    """

    copies: int = 1
    seconds: Range = (GROUP_SECONDS, GROUP_SECONDS)
    groups: tuple[str, ...] = ()

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        measured = measured_in(clip).mean(axis=0) >= MEASURED
        known = groups_of(parts)
        usual = ("arms", "legs", BOTH) if parts.known else tuple(known)
        for name in self.groups or usual:
            if name not in known:
                reason = f"the clip has no such group; it has {' '.join(known)}"
                yield SkippedCase(name, 1, reason)
                continue
            markers = [i for i in known[name] if measured[i]]
            for copy in range(1, self.copies + 1):
                yield _cut_out(clip, markers, self._length(clip), draw(name, copy), name, copy)

    def _length(self, clip: Clip) -> Range:
        """Lengths, no longer than the clip has place for: limbs are missing in short clips too."""
        most = MOST * clip.duration
        return min(self.seconds[0], most), min(self.seconds[1], most)


def groups_of(parts: BodyParts) -> dict[str, list[int]]:
    """Return the markers of each group that the parts of a body make."""
    groups = dict(zip(parts.limb_names, parts.limbs, strict=True))
    if parts.known:
        for limb in LIMBS:
            both = [i for side in SIDES for i in groups.get(f"{side}_{limb}", [])]
            if both:
                groups[f"{limb}s"] = both
        groups[BOTH] = [i for limb in parts.limbs for i in limb]
    return groups


@dataclass(frozen=True)
class PeriodicGaps:
    """Some markers are missing again and again, at regular times (the mask of [L20]).

    Attributes
    ----------
    copies : int
        Copies of each clip, with other markers.
    number : (int, int)
        Least and greatest number of markers, which are missing together.
    seconds : (float, float)
        Least and greatest length of a gap (s); the same throughout a copy.
    period : float
        From the beginning of a gap to that of the next (s).
    """

    copies: int = 3
    number: tuple[int, int] = (3, 3)
    seconds: Range = (0.5, 0.5)
    period: float = 2.0

    def __post_init__(self) -> None:
        if self.seconds[1] >= self.period:
            raise OptionError(
                f"gaps of {self.seconds[1]:g} s do not fit into a period of {self.period:g} s; "
                "give shorter ones, or a longer period"
            )

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        del parts
        for copy in range(1, self.copies + 1):
            rng = draw("periodic", copy)
            cutter = GapGenerator(clip, rng, measured_in(clip))
            seen = np.flatnonzero(cutter.known.mean(axis=0) >= MEASURED)
            number = min(int(rng.integers(*self.number, endpoint=True)), len(seen))
            markers = rng.permutation(seen)[:number]
            frames = max(round(rng.uniform(*self.seconds) * clip.rate), 1)
            period = max(round(self.period * clip.rate), frames + 1)
            for start in range(int(rng.integers(1, period - frames + 1)), clip.frames, period):
                stop = start + frames
                if stop < clip.frames and cutter.free(list(markers), start, stop):
                    cutter.gone[start:stop, markers] = True
            if cutter.gone.any():
                yield GapMask("periodic", copy, cutter.gone)
            else:
                yield SkippedCase("periodic", copy, _nowhere(frames, clip))


@dataclass(frozen=True)
class FrameGaps:
    """Whole frames are missing: every marker at once ([L20], fig. 8).

    Attributes
    ----------
    copies : int
        Copies of each clip.
    number : (int, int)
        Least and greatest number of gaps in a copy.
    seconds : (float, float)
        Least and greatest length of a gap (s).
    """

    copies: int = 5
    number: tuple[int, int] = (1, 1)
    seconds: Range = (0.1, 0.5)

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        del parts
        known = measured_in(clip)
        markers = [int(i) for i in np.flatnonzero(known.any(axis=0))]
        for copy in range(1, self.copies + 1):
            rng = draw("frames", copy)
            # a marker's own gap is no reason to find no place: what is measured goes
            shown: Mask = np.repeat(known.any(axis=1, keepdims=True), known.shape[1], axis=1)
            cutter = GapGenerator(clip, rng, shown)
            for _ in range(int(rng.integers(*self.number, endpoint=True))):
                cutter.cut(markers, cutter.length(*self.seconds))
            gone: Mask = np.logical_and(cutter.gone, known)
            if gone.any():
                yield GapMask("frames", copy, gone)
            else:
                yield SkippedCase("frames", copy, _too_short(clip, self.seconds))


@dataclass(frozen=True)
class CopiedGaps:
    """The gaps of another file, placed where the clip is whole.

    In the first copy they are where they are in the file, in others all are moved by the same time.
    A gap that the clip has no whole place for there goes anywhere. Markers are the same by label.
    What finds no place is left out.

    Attributes
    ----------
    pattern : Clip
        With gaps.
    copies : int
        Copies of each clip.
    """

    pattern: Clip
    copies: int = 1

    def __post_init__(self) -> None:
        if not self.pattern.missing.any():
            raise OptionError(f"{self.pattern.name}: has no gaps to be copied; give another file")

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Make the cases of a clip."""
        del parts
        mine = {label.upper(): i for i, label in enumerate(clip.labels)}
        pairs = [
            (mine[label.upper()], i)
            for i, label in enumerate(self.pattern.labels)
            if label.upper() in mine
        ]
        asked = self._at_rate(clip.rate, [there for _, there in pairs])
        here = np.array([i for i, _ in pairs], dtype=np.intp)
        for copy in range(1, self.copies + 1):
            cutter = GapGenerator(clip, draw(self.pattern.name, copy), measured_in(clip))
            if asked.any():
                self._place(cutter, asked, here, copy)
            if cutter.gone.any():
                yield GapMask("like", copy, cutter.gone)
            else:
                reason = f"no gap of {self.pattern.name} is of its markers and finds a place"
                yield SkippedCase("like", copy, reason)

    def _at_rate(self, rate: float, markers: list[int]) -> Mask:
        """Return the pattern of some markers at another frame rate."""
        frames = max(round(self.pattern.duration * rate), 1)
        nearest = np.round(np.arange(frames) * self.pattern.rate / rate).astype(np.intp)
        nearest = np.minimum(nearest, self.pattern.frames - 1)
        return self.pattern.missing[nearest][:, markers]

    def _place(self, cutter: GapGenerator, asked: Mask, here: NDArray[np.intp], copy: int) -> None:
        """Cut the pattern's gaps out of a clip, each where it is in the pattern if it can be."""
        frames = cutter.clip.frames
        never = asked.all(axis=0)
        cutter.gone[:, here[never]] = cutter.known[:, here[never]]
        # the first frames of both come together, or in further copies any
        late = 0 if copy == 1 else int(cutter.rng.integers(abs(frames - len(asked)) + 1))
        seen, moved = (asked[late : late + frames], 0) if len(asked) > frames else (asked, late)
        for gap in find_gaps(seen & ~never):
            marker, length = [int(here[gap.marker])], gap.frames
            start = gap.start + moved
            if length > MOST * frames:
                continue
            if cutter.free(marker, start, start + length):
                cutter.gone[start : start + length, marker] = True
            else:
                cutter.cut(marker, length)


PROTOCOLS: dict[str, type[Any]] = {
    "random": RandomGaps,
    "markers": MarkerGaps,
    "groups": GroupGaps,
    "periodic": PeriodicGaps,
    "frames": FrameGaps,
    "like": CopiedGaps,
}
"""The protocols by name."""

DEFAULT_PROTOCOL = "random"


def make_protocol(name: str, **options: Any) -> GapProtocol:
    """Return a protocol with some of its options; those that are None keep their default.

    Raises
    ------
    OptionError
        Where there is no such protocol, it has no such option, or a value makes no sense.
    """
    if name not in PROTOCOLS:
        raise OptionError(f"there is no protocol {name!r}; use one of {' '.join(PROTOCOLS)}")
    given = {key: value for key, value in options.items() if value is not None}
    known = [field.name for field in fields(PROTOCOLS[name])]
    for key in given:
        if key not in known:
            raise OptionError(f"protocol {name} has no option {key!r}; it has {' '.join(known)}")
    if name == "like" and "pattern" not in given:
        raise OptionError("protocol like copies the gaps of a file; say of which (--like FILE)")
    _check(given)
    return cast(GapProtocol, PROTOCOLS[name](**given))


_LEAST = {"copies": 1, "at_once": 1, "number": 1, "seconds": 0, "share": 0, "period": 0}


def _check(given: dict[str, Any]) -> None:
    """Refuse numbers that make no sense."""
    for key, least in _LEAST.items():
        if key not in given:
            continue
        value = given[key]
        low, high = value if isinstance(value, tuple) else (value, value)
        if not (np.isfinite([low, high]).all() and high >= low >= least and high > 0):
            raise OptionError(
                f"{key} is {low:g} to {high:g}; give numbers of {least} and more, "
                "the lower one first"
            )
    if "share" in given and given["share"][1] > MOST:
        raise OptionError(f"share is up to {given['share'][1]:g}; give {MOST:g} at most")


def settings_of(protocol: GapProtocol) -> dict[str, Any]:
    """Return a protocol's options as they go into a JSON file, for a clip its gaps' checksum."""
    if isinstance(protocol, CopiedGaps):
        gaps = zlib.crc32(np.packbits(protocol.pattern.missing).tobytes())
        return {"pattern": f"{protocol.pattern.name} ({gaps:08x})", "copies": protocol.copies}
    return asdict(cast(Any, protocol))
