"""What a lesson of the clip's own frames says of the poses to be predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from gappy import ARM, person, with_gaps

from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods.gpr.ensembles import LIMB_MEMBERS, seconds_of
from priorfill.methods.gpr.gap_segments import pieces_of
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.training.own_clip import OwnLessons
from priorfill.methods.task import Task

RATE = 60.0


def test_queries_are_surrounded_by_what_is_measured_around_them():
    clip = with_gaps(person(seconds=6.0, rate=RATE), (120, 240, ARM), (100, 101, ["RKNE"]))
    groups = tuple(gap_groups(clip.missing))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), groups)
    lessons = OwnLessons(task, 8, GPROptions())
    pieces = [part for group in groups for part in pieces_of(group, task.valid, lessons.distance)]
    piece = next(part for part in pieces if len(part.markers) > 1)
    own = lessons.with_moments(lessons.read(piece, None), LIMB_MEMBERS)
    moments = seconds_of(LIMB_MEMBERS)
    some = np.array([3, 0, 5])
    fewer = own.lesson.surroundings.among(some)
    for part in (slice(0, 30), slice(40, None)):
        asked = own.lesson.asked(part)
        assert set(asked.around) == set(moments)
        for row, frame in enumerate(own.asked[part]):
            now = clip.positions[frame, own.visible]
            np.testing.assert_array_equal(asked.visible[row], now)
            for seconds in moments:
                away = round(seconds * RATE)
                before, after = (clip.positions[frame + d, own.visible] for d in (-away, away))
                before = np.where(np.isnan(before), 2 * now - after, before)
                after = np.where(np.isnan(after), 2 * now - before, after)
                np.testing.assert_allclose(asked.around[seconds][:, row], [before, after])
        again = fewer(replace(asked, visible=asked.visible[:, some], around={})).around
        for seconds in moments:
            np.testing.assert_array_equal(again[seconds], asked.around[seconds][:, :, some])
