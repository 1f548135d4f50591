"""The regression problems of the clip's own frames: training poses and lag features."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from gappy import ARM, person, with_gaps

from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods.gpr.ensembles import ModelOptions, lags_of
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.segment_batches import plan_batches
from priorfill.methods.gpr.training.own_clip import OwnClipProblems
from priorfill.methods.task import MIRROR_IMAGE, Task

RATE = 60.0


def test_queries_have_the_positions_measured_before_and_after_them():
    clip = with_gaps(person(seconds=6.0, rate=RATE), (120, 240, ARM), (100, 101, ["RKNE"]))
    groups = tuple(gap_groups(clip.missing))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), groups)
    options = GPROptions()
    problems = OwnClipProblems(task, 8, options.training, options.spline_nodes, options.correlation)
    models = ModelOptions().limb
    batches = plan_batches(groups, task.valid, problems.distance)
    batch = next(one for one in batches if len(one.markers) > 1)
    own = problems.with_lag_features(problems.problem_for(batch, None), models)
    lags = lags_of(models)
    some = np.array([3, 0, 5])
    fewer = own.problem.lag_source.restricted_to(some)
    for part in (slice(0, 30), slice(40, None)):
        query = own.problem.query_batch(part)
        assert set(query.lagged) == set(lags)
        for row, frame in enumerate(own.query_frames[part]):
            now = clip.positions[frame, own.visible]
            np.testing.assert_array_equal(query.visible[row], now)
            for seconds in lags:
                away = round(seconds * RATE)
                before, after = (clip.positions[frame + d, own.visible] for d in (-away, away))
                before = np.where(np.isnan(before), 2 * now - after, before)
                after = np.where(np.isnan(after), 2 * now - before, after)
                np.testing.assert_allclose(query.lagged[seconds][:, row], [before, after])
        again = fewer(replace(query, visible=query.visible[:, some], lagged={})).lagged
        for seconds in lags:
            np.testing.assert_array_equal(again[seconds], query.lagged[seconds][:, :, some])


def test_parts_of_gaps_in_short_clips_are_trained_with_fewer_poses():
    start, stop = 200, 230
    clip = with_gaps(person(seconds=6.0, rate=RATE), (start, stop, ["RKNE"]))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), ())
    options = GPROptions()
    problems = OwnClipProblems(task, 8, options.training, options.spline_nodes, options.correlation)
    knee = np.array([clip.labels.index("RKNE")])
    visible = np.setdiff1d(np.arange(len(clip.labels)), knee)

    def batch(gap_frames: int) -> SegmentBatch:
        return SegmentBatch((GapSegment(knee, start, stop, visible, gap_frames),))

    def poses(gap_frames: int) -> tuple[int, int, int]:
        """Return how many are chosen, and how many of these and of the mirror image remain."""
        own = problems.problem_for(batch(gap_frames), None)
        image = problems.with_mirror_image(own).problem.train.recording == MIRROR_IMAGE
        return len(own.problem.train.time), int((~image).sum()), int(image.sum())

    gap_frames, training = stop - start, options.training
    seconds = (clip.frames - gap_frames) / RATE
    wanted = training.spaced_poses(batch(2 * gap_frames), seconds)
    assert wanted == np.ceil(seconds * training.part_rate)
    for part, whole in zip(poses(2 * gap_frames), poses(gap_frames), strict=True):
        # but for the adjacent ones, which are all used
        assert abs(part - whole * wanted / training.max_poses) < 6
    assert training.spaced_poses(batch(gap_frames), seconds) == training.max_poses
    several = SegmentBatch((GapSegment(visible[:2], start, stop, visible[2:], 2 * gap_frames),))
    assert training.spaced_poses(several, seconds) == training.max_poses
    assert training.spaced_poses(batch(2 * gap_frames), 60.0) == training.max_poses
    assert training.spaced_poses(batch(2 * gap_frames), 1.0) == training.min_part_poses
