"""Check fills: floor, lengths within rigid segments, speeds, and jumps.

All limits follow from the measured samples of the clip (`PlausibilityOptions`). Positions are
upright (+Z up).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.gaps import runs
from priorfill.geometry.distances import distances_of, norms
from priorfill.geometry.floor_heights import is_stood_on
from priorfill.geometry.step_lengths import MIN_STEPS, greatest_step, step_lengths
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.runtime.threads import map_in_threads
from priorfill.signal.running import running_maximum

__all__ = ["CRITERIA", "FLOOR", "JUMP", "LENGTH", "SPEED", "PlausibilityCheck"]

FLOOR, SPEED, LENGTH, JUMP = "floor", "speed", "length", "jump"

CRITERIA = {
    FLOOR: "not believed: below the floor",
    SPEED: "not believed: much faster than the measured motion",
    LENGTH: "not believed: not where markers of the same rigid segment are",
    JUMP: "not believed: jumps more than the measured motion",
}
"""Every criterion, with the reason given for samples that fail it. Earlier ones take precedence."""

MIN_NEIGHBOURS = 2
"""Nearby markers that show how fast a part of the body moves."""

MAX_STEP_MULTIPLE = 10
"""Time steps that a measured step may last where no shorter one is measured."""

MIN_COMMON = 30
"""Frames that must show both markers of a rigid pair."""

MAX_PARTNERS = 8
"""Markers of the same segment that a marker is compared with, the most rigid ones; some segments of
facial marker sets have a hundred."""

LOW_PERCENTILE = 0.1
"""Percentile of all heights taken as the lowest one: single samples may be wrong."""

MAX_HEIGHT_FRAMES = 10_000
"""Evenly spaced frames, at least, whose heights are compared: of more, the percentile is the same
within a millimetre."""

MAX_SAMPLED = 200
"""Frames from which the distance of neighbours is found."""

_Float = NDArray[np.float64]
_Bool = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PlausibilityCheck:
    """What the measured samples of a clip allow.

    Attributes
    ----------
    geometry : ClipGeometry
        Of the measured samples that are trusted.
    rate : float
        Hz.
    options : PlausibilityOptions
        The limits.
    """

    geometry: ClipGeometry
    rate: float
    options: PlausibilityOptions

    def failures(self, positions: _Float, expected_rms: _Float, bound: _Float) -> dict[str, _Bool]:
        """Return the filled samples that fail each criterion.

        Parameters
        ----------
        positions : ndarray [shape=(frames, markers, 3), mm]
            Measured and filled samples; NaN where missing.
        expected_rms, bound : ndarray [shape=(frames, markers), mm]
            Expected error of each filled sample and its 90 % bound; NaN where unknown.

        Returns
        -------
        dict of str to ndarray of bool [shape=(frames, markers)]
            A mask for each of `CRITERIA` that some sample fails.
        """
        # marker by marker: masks of all samples of a long clip are large
        limit = self._lowest - self.options.max_below_floor

        def failures_of(marker: int) -> tuple[_Bool, dict[str, _Bool]]:
            path = np.ascontiguousarray(positions[:, marker])  # far apart in memory
            filled = ~(np.isnan(path[:, 0]) | self.geometry.valid[:, marker])
            if not filled.any():
                return filled, {}
            sure = bound[:, marker] < self.options.certain_error
            return filled, {
                # a foot deep below the floor stands on something else, such as a stair, if this is
                # certain
                FLOOR: (path[:, 2] < limit) & filled & ~sure,
                SPEED: self._too_fast(marker, path, filled, bound[:, marker]) & ~sure,
                JUMP: self._jumps(marker, path, filled, bound[:, marker]),
            }

        incomplete = np.flatnonzero(~self.geometry.valid.all(axis=0)).tolist()
        with map_in_threads(positions.size) as mapped:
            each = zip(incomplete, mapped(failures_of, incomplete), strict=True)
            found = {marker: failing for marker, failing in each if failing[1]}
            filled = {marker: of_marker for marker, (of_marker, _) in found.items()}
            partners = mapped(lambda marker: list(self._partners(marker)), filled)
            of_segment = zip(filled, partners, strict=True)
            wrong = self._wrong_lengths(positions, filled, expected_rms, of_segment)
        columns = {
            name: {marker: failing[name] for marker, (_, failing) in found.items()}
            for name in (FLOOR, SPEED, JUMP)
        }
        columns[LENGTH] = wrong
        masks = {}
        for name in CRITERIA:
            some = [marker for marker, column in columns[name].items() if column.any()]
            if some:
                masks[name] = np.zeros(self.geometry.valid.shape, dtype=bool)
                masks[name][:, some] = np.stack([columns[name][one] for one in some], axis=1)
        return masks

    def next_to_doubtful(self, positions: _Float, doubtful: _Float) -> _Bool:
        """Return the filled samples from which the next sample in doubt is too far away.

        Parameters
        ----------
        positions : ndarray [shape=(frames, markers, 3), mm]
            Measured and filled samples; NaN where missing.
        doubtful : ndarray [shape=(frames, markers, 3), mm]
            Measured samples that methods do not see; NaN elsewhere.

        Returns
        -------
        ndarray of bool [shape=(frames, markers)]
        """
        filled = ~self.geometry.valid & ~np.isnan(positions[..., 0])
        found = np.zeros_like(filled)
        least = 1000.0 * self.options.min_speed / self.rate
        for marker in np.flatnonzero(~np.isnan(doubtful[..., 0]).all(axis=0)):
            greatest = self._of_marker(int(marker), 1) or self._greatest(int(marker), 1)
            limit = max(self.options.max_speed_ratio * greatest / self._step, least)
            path, other = positions[:, marker], doubtful[:, marker]
            found[:-1, marker] |= norms(other[1:] - path[:-1]) > limit
            found[1:, marker] |= norms(other[:-1] - path[1:]) > limit
        return found & filled

    def around(self, failing: _Bool, filled: _Bool) -> _Bool:
        """Return the samples of fills that are not believed because a failing one is near.

        Parameters
        ----------
        failing, filled : ndarray of bool [shape=(frames, markers)]
            Samples that fail, and all filled ones.
        """
        reach = max(round(self.options.around_seconds * self.rate), 1)
        wider = np.zeros_like(failing)
        for marker in np.flatnonzero(failing.any(axis=0)):
            for start, stop in runs(filled[:, marker]):
                inside = failing[start:stop, marker]
                if inside.any():
                    wider[start:stop, marker] = running_maximum(inside, reach)
        return wider

    def suspects(self, failing: _Bool, edges: _Bool) -> _Bool:
        """Return measured samples next to failed fills that may have caused the failure.

        Parameters
        ----------
        failing : ndarray of bool [shape=(frames, markers)]
            Samples that fail.
        edges : ndarray of bool [shape=(frames, markers)]
            Those of them that are too fast or jump.

        Returns
        -------
        ndarray of bool [shape=(frames, markers)]
            Samples that are far from their rigid segment, short runs between gaps, and the last
            samples before a jump.
        """
        reach = max(round(self.options.suspect_seconds * self.rate), 1)
        valid = self.geometry.valid
        found = np.zeros_like(valid)
        for marker in np.flatnonzero(failing.any(axis=0)):
            measured = valid[:, marker]
            wrong = self._measured_far_from_segment(int(marker))
            for start, stop in runs(~measured):
                if not failing[start:stop, marker].any():
                    continue
                near = np.zeros_like(measured)
                near[max(start - reach, 0) : start] = near[stop : stop + reach] = True
                found[:, marker] |= near & wrong
                for edge in (start, stop - 1):
                    if edges[edge, marker]:
                        found[max(edge - self._step, 0) : edge + self._step + 1, marker] = True
                for first, last in runs(measured & near):
                    whole = (first == 0 or not measured[first - 1]) and (
                        last == len(measured) or not measured[last]
                    )
                    found[first:last, marker] |= whole
        return found & valid

    @property
    def _step(self) -> int:
        """Frames of a time step."""
        return max(round(self.options.step_seconds * self.rate), 1)

    @cached_property
    def _lowest(self) -> float:
        """Height of the floor (mm); minus infinity where there is none."""
        floor = self.geometry.floor
        if not is_stood_on(self.geometry.positions, floor, self.rate):
            return -np.inf
        frames = len(self.geometry.positions)
        heights = self.geometry.positions[:: max(1, frames // MAX_HEIGHT_FRAMES), :, 2]
        lowest = np.percentile(heights[~np.isnan(heights)], LOW_PERCENTILE)
        return float(min(floor[np.isfinite(floor)].min(), lowest))

    def _too_fast(self, marker: int, path: _Float, filled: _Bool, bound: _Float) -> _Bool:
        """Return the filled samples of a marker that are too fast [shape=(frames,)].

        The other side and markers nearby show how fast a marker may be, but not where its own
        motion is all that a vague fill can be compared with.
        """
        least = 1000.0 * self.options.min_speed * self._step / self.rate
        ratio = self.options.max_speed_ratio
        steps = step_lengths(path, self._step, 1)
        limit = max(ratio * self._greatest(marker, 1), least)
        failing = steps > limit
        if failing.any():
            failing = steps > np.maximum(limit, ratio * self._of_neighbours(marker, 1))
        found = _ends(failing, self._step, 1, len(filled))
        vague = filled & (bound > self.options.vague_error)
        own = self._of_marker(marker, 1)
        if own and vague.any():
            found |= vague & _ends(steps > max(ratio * own, least), self._step, 1, len(filled))
        return filled & found

    def _jumps(self, marker: int, path: _Float, filled: _Bool, bound: _Float) -> _Bool:
        """Return the filled samples of a marker that jump [shape=(frames,)]."""
        ratio = self.options.max_jump_ratio
        changes = step_lengths(path, self._step, 2)
        limit = max(ratio * self._greatest(marker, 2), self.options.min_jump)
        failing = changes > limit
        if failing.any():
            stated = np.where(np.isnan(bound), self.options.max_length_error, bound)
            stated = _over_steps(stated, self._step)
            several = np.maximum(ratio * self._of_neighbours(marker, 2), stated)
            failing = changes > np.maximum(limit, several)
        return filled & _ends(failing, self._step, 2, len(filled))

    def _greatest(self, marker: int, order: int) -> float:
        """Return the greatest measured step (order 1) or change of it (2) of a marker (mm)."""
        pair = [marker, int(self.geometry.contralateral[marker])]
        known = max(self._of_marker(one, order) for one in pair if one >= 0)
        # of a marker that is hardly seen nothing is known, and of a very short clip nothing at all
        return known or self._of_body[order] or math.inf

    @cached_property
    def _of_body(self) -> dict[int, float]:
        """The greatest measured step, and change of it, of all markers (mm)."""
        markers = range(len(self.geometry.labels))
        return {order: max(self._of_marker(one, order) for one in markers) for order in (1, 2)}

    def _of_marker(self, marker: int, order: int) -> float:
        if (marker, order) not in self._greatest_steps:
            path = self._path(marker)
            for each in (1, 2):  # both are needed, and the path is far apart in memory
                greatest = greatest_step(self._known_steps(path, each))
                self._greatest_steps[marker, each] = 0.0 if math.isnan(greatest) else greatest
        return self._greatest_steps[marker, order]

    def _path(self, marker: int) -> _Float:
        return np.ascontiguousarray(self.geometry.positions[:, marker])

    @cached_property
    def _greatest_steps(self) -> dict[tuple[int, int], float]:
        """The greatest step or change of it, by marker and order (mm), as far as needed so far."""
        return {}

    def _known_steps(self, path: _Float, order: int) -> _Float:
        """Return the measured steps of a path (order 1), or the changes of them (2), in mm.

        Where hardly any are measured (every second frame is blank), longer ones are scaled.
        """
        known = np.full(max(len(path) - order * self._step, 0), np.nan)
        for times in range(1, MAX_STEP_MULTIPLE + 1):
            step = times * self._step
            found = step_lengths(path, step, order)
            if (~np.isnan(found)).sum() >= MIN_STEPS:
                known[: len(found)] = found / times**order
                break
        return known

    def _of_neighbours(self, marker: int, order: int) -> _Float:
        """Return the median step of nearby markers at each step (mm), the greatest one around it.

        The fastest of them may have a wrong label, and so may a single one: where fewer than two
        are measured, the step is 0.
        """
        neighbours = self._neighbours(marker)
        known = np.full(
            (max(len(neighbours), 1), max(len(self.geometry.positions) - order * self._step, 0)),
            np.nan,
        )
        for row, other in enumerate(neighbours):
            known[row] = self._known_steps(self._path(int(other)), order)
        count = (~np.isnan(known)).sum(axis=0)
        if not count.any():
            return np.zeros(known.shape[1])
        known.sort(axis=0)  # NaN last
        lower = np.maximum(count - 1, 0) // 2  # of two markers, the slower one
        middle = np.take_along_axis(known, lower[None], axis=0)[0]
        middle[count < MIN_NEIGHBOURS] = 0.0
        reach = max(round(self.options.around_seconds * self.rate), 1)
        return running_maximum(middle, reach)

    def _neighbours(self, marker: int) -> NDArray[np.intp]:
        """Return the markers near a marker."""
        sample, low, high = self._places
        # nowhere nearer than this
        least = np.maximum(low - high[marker], low[marker] - high).max(axis=1)
        some = np.flatnonzero(least < self.options.neighbour_distance)
        apart = norms(sample[some] - sample[marker])
        seen = ~np.isnan(apart)
        total = np.where(seen, apart, 0.0).sum(axis=1)
        count = seen.sum(axis=1)
        near = (count > 0) & (total < self.options.neighbour_distance * count) & (some != marker)
        found: NDArray[np.intp] = some[near]
        return found

    @cached_property
    def _places(self) -> tuple[_Float, _Float, _Float]:
        """Evenly spaced frames, and the lowest and highest coordinates of each marker in them.

        Of shape (markers, frames, 3) and (markers, 3), in mm.
        """
        sample = self.geometry.positions[:: max(1, len(self.geometry.positions) // MAX_SAMPLED)]
        sample = np.ascontiguousarray(sample.transpose(1, 0, 2))
        low = np.fmin.reduce(sample, axis=1, initial=np.inf)
        high = np.fmax.reduce(sample, axis=1, initial=-np.inf)
        return sample, low, high

    @cached_property
    def _segments(self) -> dict[str, list[int]]:
        """Markers of each segment."""
        segment = self.geometry.marker_set.segment
        found: dict[str, list[int]] = {}
        for marker, label in enumerate(self.geometry.labels):
            if label in segment:
                found.setdefault(segment[label], []).append(marker)
        return found

    def _partners(self, marker: int) -> Iterator[tuple[int, float, float]]:
        """Yield the markers at a constant distance from a marker, and the range of it (mm)."""
        label = self.geometry.labels[marker]
        segment = self.geometry.marker_set.segment.get(label)
        if segment is None:
            return
        path = self._path(marker)
        found = []
        for other in self._segments[segment]:
            if other == marker:
                continue
            length = distances_of(path, self.geometry.positions[:, other])
            length = length[~np.isnan(length)]
            if len(length) >= MIN_COMMON:
                spread = float(length.std())
                if spread < self.options.max_length_spread:
                    found.append((spread, other, float(length.min()), float(length.max())))
        for _, other, low, high in sorted(found)[:MAX_PARTNERS]:
            yield other, low, high

    def _measured_far_from_segment(self, marker: int) -> _Bool:
        """Return which measured samples of a marker are far from its segment [shape=(frames,)].

        The range of the distance is that between its outer percentiles, since the samples in
        question are part of it.
        """
        positions = self.geometry.positions
        far = np.zeros(len(positions), dtype=bool)
        segment = self.geometry.marker_set.segment.get(self.geometry.labels[marker])
        for other in self._segments.get(segment or "", ()):
            if other == marker:
                continue
            length = distances_of(positions[:, marker], positions[:, other])
            known = length[~np.isnan(length)]
            if len(known) >= MIN_COMMON:
                low, middle, high = np.percentile(known, (25.0, 50.0, 75.0))
                if high - low < self.options.max_length_spread:
                    far |= np.abs(length - middle) > self.options.max_length_error
        return far

    def _wrong_lengths(
        self,
        positions: _Float,
        filled: dict[int, _Bool],
        expected_rms: _Float,
        partners: Iterable[tuple[int, Sequence[tuple[int, float, float]]]],
    ) -> dict[int, _Bool]:
        """Return the filled samples whose distances from their segment are wrong.

        Parameters
        ----------
        positions, expected_rms : ndarray
            As of `failures`.
        filled : dict of int to ndarray of bool [shape=(frames,)]
            The filled samples of each marker that has some.
        partners : iterable of (int, sequence)
            The filled markers, and what `_partners` yields for each.

        Returns
        -------
        dict of int to ndarray of bool [shape=(frames,)]
            For each of these markers.
        """
        found: dict[int, _Bool] = {}
        both: list[tuple[int, int, _Bool]] = []
        for marker, of_marker in partners:
            found[marker] = np.zeros(len(positions), dtype=bool)
            frames = np.flatnonzero(filled[marker])
            path, own_rms = positions[frames, marker], expected_rms[frames, marker]
            for other, low, high in of_marker:
                length = norms(path - positions[frames, other])
                with np.errstate(invalid="ignore"):
                    off = np.maximum(length - high, low - length)
                    too_far = off > self._length_tolerance(own_rms, expected_rms[frames, other])
                wrong = np.zeros(len(positions), dtype=bool)
                wrong[frames] = too_far
                together = wrong & filled[other] if other in filled else wrong & False
                if wrong.any():
                    found[marker] |= wrong & ~together
                if other > marker and together.any():
                    both.append((marker, other, together))
        for one, other, together in both:  # the one that is wrong anyway explains it
            open_ = together & ~found[one] & ~found[other]
            first, second = expected_rms[:, one], expected_rms[:, other]
            found[one] |= open_ & ~(first < second)
            found[other] |= open_ & ~(second < first)
        return found

    def _length_tolerance(self, *expected_rms: _Float) -> _Float:
        """Return the tolerance of a distance (mm) from the expected errors of its markers."""
        options = self.options
        variance = sum(np.where(np.isnan(rms), 0.0, rms) ** 2 for rms in expected_rms) / 3.0
        tolerance = options.max_length_error + options.length_std * np.sqrt(variance)
        return np.minimum(tolerance, max(options.max_length_error, options.max_stated_error))


def _over_steps(values: _Float, step: int) -> _Float:
    """Return the greatest value at the three ends of two steps [shape=(frames - 2 step,)]."""
    outer = np.maximum(values[2 * step :], values[: -2 * step])
    return np.maximum(outer, values[step:-step])


def _ends(failing: _Bool, step: int, order: int, frames: int) -> _Bool:
    """Return the samples at the ends of failing steps [shape=(frames,)]."""
    ends = np.zeros(frames, dtype=bool)
    if len(failing) == 0:
        return ends
    for number in range(order + 1):
        ends[number * step : number * step + len(failing)] |= failing
    return ends
