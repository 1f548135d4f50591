"""Protocols: which samples are removed from a clip to be filled again.

A protocol makes cases of a clip, each with a mask of the samples to remove. Only measured samples
are removed; the clip's own gaps stay gaps. Random choices depend on the seed, the clip's name and
the case only.

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
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.evaluation.body_parts import LIMBS, SIDES, BodyParts
from priorfill.evaluation.gap_generator import (
    MAX_CLIP_SHARE,
    MAX_TRIES,
    GapGenerator,
    Mask,
    measured_in,
)
from priorfill.filling.gap_filter import matching_markers
from priorfill.gaps import find_gaps
from priorfill.runtime.option_texts import close_or_all, seconds_of

__all__ = [
    "DEFAULT_PROTOCOL",
    "PROTOCOLS",
    "RANDOM_GAP_SECONDS",
    "RANDOM_GAP_SHARE",
    "RANDOM_MAX_MISSING",
    "GapMask",
    "GapProtocol",
    "SkippedCase",
    "at_rate",
    "make_protocol",
    "name_of",
    "settings_of",
]

Range = tuple[float, float]

RANDOM_GAP_SHARE = (0.03, 0.09)
"""Share of missing samples in the 50 patterns published with [G16]: 2.9 to 9.1 %."""

RANDOM_GAP_SECONDS = (0.1, 2.0)
"""s. Length of the gaps in these patterns: nine in ten are between 0.17 and 1.95 s."""

RANDOM_MAX_MISSING = 7
"""Maximum number of markers missing in a frame; 3 to 9 in these patterns."""

MARKER_SECONDS = 1.0
"""s. Length of the gap of each marker in turn."""

GROUP_SECONDS = 3.0
"""s. Length of gaps of arms and legs; half of the clip at most."""

MIN_MEASURED_SHARE = 0.5
"""Share of the frames in which a marker of a group must be measured to be removed with it."""

TRIES_PER_GAP = 20
"""Placements tried per random gap."""


@dataclass(frozen=True, eq=False)
class GapMask:
    """The samples to remove in a case.

    Attributes
    ----------
    name : str
        What is removed: ``random``, a marker, a group of markers.
    copy : int
        Number of the copy, from 1.
    mask : ndarray of bool [shape=(frames, markers)]
        Samples to remove.
    """

    name: str
    copy: int
    mask: Mask


@dataclass(frozen=True)
class SkippedCase:
    """A case that could not be made in a clip, with the reason."""

    name: str
    copy: int
    reason: str


Draw = Callable[[str, int], np.random.Generator]
"""Function of a case's name and copy that returns its random generator."""


class GapProtocol(Protocol):
    """A protocol: options and a function that makes the cases of a clip."""

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        ...


def draw_for(seed: int, protocol: str, clip: str) -> Draw:
    """Return a function that gives each case of a clip its own random generator."""

    def draw(name: str, copy: int) -> np.random.Generator:
        words = [
            zlib.crc32(word.encode("utf-8", "surrogatepass")) for word in (protocol, clip, name)
        ]
        return np.random.default_rng([seed, *words, copy])

    return draw


def _too_short(clip: Clip, seconds: Range) -> str:
    return (
        f"a clip of {clip.duration:.2f} s is too short for gaps of {seconds[0]:g} s, "
        f"which may take {100 * MAX_CLIP_SHARE:.0f} % of it"
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
    """Remove some markers for a random length at a random time inside the clip."""
    generator = GapGenerator(clip, rng, measured_in(clip))
    frames = generator.length(*seconds)
    if frames is None:
        return SkippedCase(name, copy, _too_short(clip, seconds))
    if not generator.remove(markers, frames):
        return SkippedCase(name, copy, _nowhere(frames, clip))
    return GapMask(name, copy, generator.mask)


@dataclass(frozen=True)
class RandomGaps:
    """Gaps of random markers at random times ([G16], fig. 4).

    The paper uses 50 copies of a recording. The defaults follow the 50 patterns published with it,
    except for the number of copies.

    Attributes
    ----------
    copies : int
        Copies of each clip.
    number : (int, int) or None
        Minimum and maximum number of gaps per copy; None: until ``share`` is reached.
    share : (float, float)
        Minimum and maximum share of the samples to remove.
    seconds : (float, float)
        Minimum and maximum length of a gap (s).
    max_missing : int
        Maximum number of markers missing in the same frame.
    """

    copies: int = 10
    number: tuple[int, int] | None = None
    share: Range = RANDOM_GAP_SHARE
    seconds: Range = RANDOM_GAP_SECONDS
    max_missing: int = RANDOM_MAX_MISSING

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts
        for copy in range(1, self.copies + 1):
            rng = draw("random", copy)
            generator = GapGenerator(clip, rng, measured_in(clip))
            if self.number is None:
                share = rng.uniform(*self.share)
                samples = share * generator.mask.size
                expected_gaps = samples / (clip.rate * (self.seconds[0] + self.seconds[1]) / 2)
                max_tries = max(MAX_TRIES, round(TRIES_PER_GAP * expected_gaps))
                found = generator.scatter(share, self.seconds, self.max_missing, max_tries)
            else:
                found = self._some(generator, int(rng.integers(*self.number, endpoint=True)))
            if found:
                yield GapMask("random", copy, generator.mask)
            elif generator.length(*self.seconds) is None:
                yield SkippedCase("random", copy, _too_short(clip, self.seconds))
            else:
                yield SkippedCase(
                    "random", copy, "no place where a gap would be measured throughout"
                )

    def _some(self, generator: GapGenerator, gaps: int) -> bool:
        """Make a number of gaps; return whether any was made."""
        left = gaps
        for _ in range(TRIES_PER_GAP * gaps):
            left -= bool(generator.scatter_one(self.seconds, self.max_missing))
            if not left:
                break
        return left < gaps


@dataclass(frozen=True)
class MarkerGaps:
    """One marker after another is missing alone ([B11], fig. 3).

    Attributes
    ----------
    copies : int
        Gaps of each marker, each a case of its own.
    seconds : (float, float)
        Minimum and maximum length (s).
    markers : tuple of str
        Labels of the markers, or shell patterns of labels, in any case; all of them if empty.
    """

    copies: int = 1
    seconds: Range = (MARKER_SECONDS, MARKER_SECONDS)
    markers: tuple[str, ...] = ()

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts
        found = {pattern: matching_markers(clip, pattern) for pattern in self.markers}
        for pattern, markers in found.items():
            if not markers:
                reason = f"the clip has no such marker; {close_or_all(pattern, clip.labels)}"
                yield SkippedCase(pattern, 1, reason)
        everything = range(len(clip.labels))
        chosen = [i for markers in found.values() for i in markers] if found else everything
        for i in dict.fromkeys(chosen):
            label = clip.labels[i]
            for copy in range(1, self.copies + 1):
                yield _cut_out(clip, [i], self.seconds, draw(label, copy), label, copy)


BOTH = "both"
"""Name of the group of all arms and legs."""


@dataclass(frozen=True)
class GroupGaps:
    """Both arms, both legs, and all limbs are missing ([B11], table 2).

    Where the marker set defines no arms and legs, a group is a segment found from the data,
    extended by its nearest segments to at least four markers.

    Attributes
    ----------
    copies : int
        Gaps of each group, each a case of its own.
    seconds : (float, float)
        Minimum and maximum length (s).
    groups : tuple of str
        ``arms``, ``legs``, ``both``, ``left_arm``, ``right_leg``, ...; if empty, those of the
        paper, or all segments found from the data.
    """

    copies: int = 1
    seconds: Range = (GROUP_SECONDS, GROUP_SECONDS)
    groups: tuple[str, ...] = ()

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        measured = measured_in(clip).mean(axis=0) >= MIN_MEASURED_SHARE
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
        """Return the range of lengths (s), limited so that short clips have gaps of limbs, too."""
        most = MAX_CLIP_SHARE * clip.duration
        return min(self.seconds[0], most), min(self.seconds[1], most)


def groups_of(parts: BodyParts) -> dict[str, list[int]]:
    """Return the markers of each group that can be formed from the limbs of a clip."""
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
    """Some markers are missing periodically (the masks of the program of [L20]).

    Attributes
    ----------
    copies : int
        Copies of each clip, with different markers.
    number : (int, int)
        Minimum and maximum number of markers, which are missing together.
    seconds : (float, float)
        Minimum and maximum length of a gap (s); the same throughout a copy.
    period : float
        Time from the start of a gap to the start of the next (s).
    """

    copies: int = 3
    number: tuple[int, int] = (3, 3)
    seconds: Range = (0.5, 0.5)
    period: float = 2.0

    def __post_init__(self) -> None:
        lengths: tuple[Any, ...] = (self.seconds[1], self.period)
        if any(isinstance(length, str) for length in lengths):
            return  # frames, whose length depends on the clip
        if self.seconds[1] >= self.period:
            raise OptionError(
                f"gaps of {self.seconds[1]:g} s do not fit into a period of {self.period:g} s; "
                "give shorter ones (`seconds`), or a longer period (`period`)"
            )

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts
        for copy in range(1, self.copies + 1):
            rng = draw("periodic", copy)
            generator = GapGenerator(clip, rng, measured_in(clip))
            seen = np.flatnonzero(generator.measured.mean(axis=0) >= MIN_MEASURED_SHARE)
            number = min(int(rng.integers(*self.number, endpoint=True)), len(seen))
            markers = rng.permutation(seen)[:number]
            frames = max(round(rng.uniform(*self.seconds) * clip.rate), 1)
            period = max(round(self.period * clip.rate), frames + 1)
            for start in range(int(rng.integers(1, period - frames + 1)), clip.frames, period):
                stop = start + frames
                if stop < clip.frames and generator.is_free(list(markers), start, stop):
                    generator.mask[start:stop, markers] = True
            if generator.mask.any():
                yield GapMask("periodic", copy, generator.mask)
            else:
                yield SkippedCase("periodic", copy, _nowhere(frames, clip))


@dataclass(frozen=True)
class FrameGaps:
    """Complete frames are missing: every marker at once ([L20], fig. 8).

    Attributes
    ----------
    copies : int
        Copies of each clip.
    number : (int, int)
        Minimum and maximum number of gaps per copy.
    seconds : (float, float)
        Minimum and maximum length of a gap (s).
    """

    copies: int = 5
    number: tuple[int, int] = (1, 1)
    seconds: Range = (0.1, 0.5)

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts
        known = measured_in(clip)
        markers = [int(i) for i in np.flatnonzero(known.any(axis=0))]
        for copy in range(1, self.copies + 1):
            rng = draw("frames", copy)
            # frames in which some markers are missing already may be chosen, too
            shown: Mask = np.repeat(known.any(axis=1, keepdims=True), known.shape[1], axis=1)
            generator = GapGenerator(clip, rng, shown)
            for _ in range(int(rng.integers(*self.number, endpoint=True))):
                generator.remove(markers, generator.length(*self.seconds))
            removed: Mask = np.logical_and(generator.mask, known)
            if removed.any():
                yield GapMask("frames", copy, removed)
            else:
                yield SkippedCase("frames", copy, _too_short(clip, self.seconds))


@dataclass(frozen=True)
class CopiedGaps:
    """The gaps of another file, by label of the marker.

    In the first copy gaps are at the same times as in the file; in further copies all are shifted
    by the same random time. A gap at a place where the clip is not measured is moved to a random
    time. Gaps that fit nowhere are left out.

    Attributes
    ----------
    pattern : Clip
        The clip with the gaps to copy.
    copies : int
        Copies of each clip.
    """

    pattern: Clip
    copies: int = 1

    def __post_init__(self) -> None:
        if not self.pattern.missing.any():
            raise OptionError(f"{self.pattern.name}: has no gaps to be copied; give another file")

    def cases(self, clip: Clip, parts: BodyParts, draw: Draw) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts
        mine = {label.upper(): i for i, label in enumerate(clip.labels)}
        pairs = [
            (mine[label.upper()], i)
            for i, label in enumerate(self.pattern.labels)
            if label.upper() in mine
        ]
        pattern = self._at_rate(clip.rate, [there for _, there in pairs])
        here = np.array([i for i, _ in pairs], dtype=np.intp)
        for copy in range(1, self.copies + 1):
            generator = GapGenerator(clip, draw(self.pattern.name, copy), measured_in(clip))
            if pattern.any():
                self._place(generator, pattern, here, copy)
            if generator.mask.any():
                yield GapMask("like", copy, generator.mask)
            else:
                reason = f"no gap of {self.pattern.name} is of its markers and finds a place"
                yield SkippedCase("like", copy, reason)

    def _at_rate(self, rate: float, markers: list[int]) -> Mask:
        """Return the missing samples of some markers of the pattern at another frame rate."""
        frames = max(round(self.pattern.duration * rate), 1)
        nearest = np.round(np.arange(frames) * self.pattern.rate / rate).astype(np.intp)
        nearest = np.minimum(nearest, self.pattern.frames - 1)
        return self.pattern.missing[nearest][:, markers]

    def _place(
        self, generator: GapGenerator, pattern: Mask, here: NDArray[np.intp], copy: int
    ) -> None:
        """Remove the gaps of the pattern from a clip, at the same times where possible."""
        frames = generator.clip.frames
        never = pattern.all(axis=0)
        generator.mask[:, here[never]] = generator.measured[:, here[never]]
        # the first frames of both coincide in the first copy; later copies have a random offset
        offset = 0 if copy == 1 else int(generator.rng.integers(abs(frames - len(pattern)) + 1))
        longer = len(pattern) > frames
        window = pattern[offset : offset + frames] if longer else pattern
        shift = 0 if longer else offset
        for gap in find_gaps(window & ~never):
            marker, length = [int(here[gap.marker])], gap.frames
            start = gap.start + shift
            if length > MAX_CLIP_SHARE * frames:
                continue
            if generator.is_free(marker, start, start + length):
                generator.mask[start : start + length, marker] = True
            else:
                generator.remove(marker, length)


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
    """Return a protocol with some of its options; those that are None keep their defaults.

    Parameters
    ----------
    name : str
        A name in `PROTOCOLS`.
    **options
        Fields of the protocol's class. Lengths of time are in seconds, or in frames as text
        (``"10f"``); `at_rate` returns them in seconds.

    Returns
    -------
    GapProtocol
        The protocol.

    Raises
    ------
    OptionError
        Where there is no such protocol, it has no such option, or a value is out of range.

    See Also
    --------
    priorfill.evaluate : Evaluate methods by a protocol.

    Examples
    --------
    >>> make_protocol("frames", copies=2)
    FrameGaps(copies=2, number=(1, 1), seconds=(0.1, 0.5))
    """
    if name not in PROTOCOLS:
        raise OptionError(f"there is no protocol {name!r}; {close_or_all(name, [*PROTOCOLS])}")
    given = {key: value for key, value in options.items() if value is not None}
    known = [field.name for field in fields(PROTOCOLS[name])]
    for key in given:
        if key not in known:
            has = " ".join(f"`{option}`" for option in known)
            raise OptionError(f"protocol {name} has no option `{key}`; it has {has}")
    if name == "like" and "pattern" not in given:
        raise OptionError("protocol like copies the gaps of a file; give the file (`pattern`)")
    _check(given)
    return cast(GapProtocol, PROTOCOLS[name](**given))


def at_rate(protocol: GapProtocol, rate: float) -> GapProtocol:
    """Return a protocol whose lengths of time are in seconds, for clips of a frame rate (Hz)."""
    changed: dict[str, Any] = {}
    for key in _TIMES:
        value = getattr(protocol, key, None)
        if isinstance(value, str):
            changed[key] = seconds_of(value, rate)
        elif isinstance(value, tuple) and any(isinstance(one, str) for one in value):
            changed[key] = tuple(seconds_of(one, rate) for one in value)
    return replace(cast(Any, protocol), **changed) if changed else protocol


_TIMES = ("seconds", "period")
"""Options that are lengths of time."""

_MINIMA = {"copies": 1, "max_missing": 1, "number": 1, "seconds": 0, "share": 0, "period": 0}


def _check(given: dict[str, Any]) -> None:
    """Check that ranges are in order and within their limits."""
    for key, least in _MINIMA.items():
        if key not in given:
            continue
        value = given[key]
        low, high = value if isinstance(value, tuple) else (value, value)
        if key in _TIMES:  # frames are compared with frames here, and with seconds in `at_rate`
            if isinstance(low, str) is not isinstance(high, str):
                raise OptionError(f"`{key}` is {low} to {high}; give both in seconds or in frames")
            low, high = seconds_of(low, 1.0), seconds_of(high, 1.0)
        if not (np.isfinite([low, high]).all() and high >= low >= least and high > 0):
            found = f"{low:g} to {high:g}" if high != low else f"{low:g}"
            limit = f"numbers of {least} and more" if least else "numbers above 0"
            order = ", the lower one first" if high < low else ""
            raise OptionError(f"`{key}` is {found}; give {limit}{order}")
    if "share" in given and given["share"][1] > MAX_CLIP_SHARE:
        raise OptionError(
            f"`share` is up to {given['share'][1]:g}; give {MAX_CLIP_SHARE:g} at most"
        )


def name_of(protocol: GapProtocol) -> str:
    """Return the name of a protocol; ``other`` for one that is not in `PROTOCOLS`."""
    return next((n for n, kind in PROTOCOLS.items() if isinstance(protocol, kind)), "other")


def settings_of(protocol: GapProtocol) -> dict[str, Any]:
    """Return a protocol's options for a JSON file; a clip is given by the checksum of its gaps."""
    if isinstance(protocol, CopiedGaps):
        gaps = zlib.crc32(np.packbits(protocol.pattern.missing).tobytes())
        return {"pattern": f"{protocol.pattern.name} ({gaps:08x})", "copies": protocol.copies}
    return asdict(cast(Any, protocol))
