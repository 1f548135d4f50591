"""`fill`: what holds for every method."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import ARM, FOOT, error, person, straight, with_gaps

import priorfill as pf
from priorfill.clip import Clip
from priorfill.database import ClipOrigin, PriorDatabase
from priorfill.errors import DatabaseCorruptError, DatabaseNotFoundError, OptionError
from priorfill.filling.assemble import FilledSamples, sum_up_gaps
from priorfill.filling.database_takes import DatabaseTakes
from priorfill.filling.fill_clip import fill
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.filling.result import FilledGap, Result, UnfilledSpan
from priorfill.gp.calibration import BOUND_FACTOR, MEAN_FACTOR
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.methods.task import Estimate, Note
from priorfill.runtime.threads import VARIABLE, thread_count

METHOD = pytest.mark.parametrize("method", ["baumann2011", "neighbours", "gpr"])
UNBELIEVABLE = pf.FillOptions(plausibility=UNCHECKED)
"""Options under which positions are kept that nobody would believe."""

GAPS = ((60, 90, ARM), (75, 105, FOOT), (200, 220, ("LKNE",)), (0, 240, ("C7",)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of one walk of another subject."""
    place = tmp_path_factory.mktemp("filling") / "db"
    with PriorDatabase.create(place) as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    return place


@pytest.fixture(scope="module")
def filled(folder: Path) -> Result:
    """All gaps filled with the database, for several tests."""
    return pf.fill(with_gaps(person(), *GAPS), database=folder)


@METHOD
def test_measured_samples_are_the_same_bits(method):
    clip = with_gaps(person(), *(GAPS if method == "gpr" else GAPS[2:]))
    before = clip.positions.copy()
    result = fill(clip, method=method)
    measured = ~clip.missing
    assert result.clip.positions[measured].tobytes() == clip.positions[measured].tobytes()
    np.testing.assert_array_equal(clip.positions, before)


def test_fields_of_the_result(folder, filled):
    clip = with_gaps(person(), *GAPS)
    result = filled
    assert isinstance(result, pf.Result)
    assert result.method == "gpr"
    assert result.database == folder
    assert result.marker_set.name == "baumann41"
    assert result.complete
    np.testing.assert_array_equal(result.filled, clip.missing)
    assert not result.clip.missing.any()
    assert (result.clip.labels, result.clip.rate, result.clip.up, result.clip.name) == (
        (clip.labels, clip.rate, clip.up, clip.name)
    )
    assert np.isnan(result.expected_rms_mm[~clip.missing]).all()
    assert (result.expected_rms_mm[clip.missing] > 0).all()
    assert np.isnan(result.error_bound_90_mm[~clip.missing]).all()
    assert [(g.start, g.stop, g.label) for g in result.gaps] == [
        (g.start, g.stop, clip.labels[g.marker]) for g in pf.find_gaps(clip.missing)
    ]
    for gap in result.gaps:
        assert isinstance(gap, FilledGap)
        assert gap.complete
        assert gap.filled == gap.frames == gap.stop - gap.start
        assert gap.unfilled == ()
        inside = result.expected_rms_mm[gap.start : gap.stop, clip.labels.index(gap.label)]
        assert gap.expected_rms_mm == pytest.approx(np.sqrt((inside**2).mean()))
        assert gap.expected_mean_error_mm == pytest.approx(MEAN_FACTOR * inside.mean())
        bounds = result.error_bound_90_mm[gap.start : gap.stop, clip.labels.index(gap.label)]
        assert (bounds > inside).all()
        assert bounds.min() < gap.error_bound_90_mm < bounds.max()
        assert gap.method == "gpr"
        if gap.label == "C7":
            # never visible in the clip, so predicted from the one person in the database
            assert gap.training_poses == DropoutOptions().poses_per_subject
            assert gap.sources == ("other subjects of the database",)
            assert gap.source_clips == ("synthetic_walking_011",)
            continue
        assert gap.training_poses > 50
        if gap.label in (*ARM, *FOOT):
            assert gap.sources == ("the clip's own frames and the database's",)
            assert gap.source_clips == (clip.name, "synthetic_walking_011")
        else:
            assert gap.sources == ("the clip's own frames",)
            assert gap.source_clips == (clip.name,)


def test_unfilled_gaps_have_a_reason():
    clip = with_gaps(person(), *GAPS)
    result = fill(clip)
    assert not result.complete
    assert result.database is None
    (gap,) = [g for g in result.gaps if not g.complete]
    assert (gap.label, gap.filled, gap.sources, gap.source_clips) == ("C7", 0, (), ())
    assert np.isnan([gap.expected_rms_mm, gap.expected_mean_error_mm, gap.error_bound_90_mm]).all()
    assert gap.training_poses == 0
    (left,) = gap.unfilled
    assert isinstance(left, UnfilledSpan)
    assert (left.start, left.stop) == (0, 240)
    assert "no database" in left.reason
    missing = result.clip.missing
    assert missing.sum() == 240
    assert missing[:, clip.labels.index("C7")].all()


def test_expected_error_has_the_magnitude_of_the_error(filled):
    off = np.linalg.norm(filled.clip.positions - person().positions, axis=2)
    for gap in filled.gaps:
        marker = person().labels.index(gap.label)
        real = np.sqrt((off[gap.start : gap.stop, marker] ** 2).mean())
        assert 0.1 < gap.expected_rms_mm / real < 10, gap.label


def test_about_nine_of_ten_errors_are_below_the_bound(filled):
    """Over gaps of all sizes; synthetic motion is easy to predict, so more may be."""
    off = np.linalg.norm(filled.clip.positions - person().positions, axis=2)
    assert 0.6 < (off < filled.error_bound_90_mm)[filled.filled].mean() <= 1.0


def constant_method(bound):
    """A method that expects an error of 2 mm for each sample, and gives a bound."""

    def method(task, progress):
        shape = task.positions.shape
        notes = [
            Note(0, 60, 80, "one", training_poses=12),
            Note(0, 80, 90, "two", training_poses=30, relative_error=0.5),
        ]
        return Estimate(np.full(shape, 7.0), np.full(shape[:2], 2.0), notes, bound)

    return method


def test_a_method_may_give_bounds_or_not(monkeypatch):
    clip = with_gaps(person(), (60, 90, person().labels[:1]))
    own = np.full(clip.missing.shape, 9.0)
    own[60:70] = np.nan
    for bound, expected in ((None, 2.0 * BOUND_FACTOR), (own, 9.0)):
        method = constant_method(bound)
        monkeypatch.setattr("priorfill.filling.run_settings.get_method", lambda _, m=method: m)
        result = fill(clip, method="gpr", options=UNBELIEVABLE)
        (gap,) = result.gaps
        assert gap.error_bound_90_mm == pytest.approx(expected)
        assert gap.expected_mean_error_mm == pytest.approx(2.0 * MEAN_FACTOR)
        without = (20 * 2.0 + 10 * 4.0) / 30
        assert gap.expected_mean_error_without_database_mm == pytest.approx(without * MEAN_FACTOR)
        assert (gap.method, gap.training_poses) == ("gpr", 30)
        assert (result.error_bound_90_mm[70:90, 0] == expected).all()
        assert (
            np.isnan(result.error_bound_90_mm[:60]).all()
            and np.isnan(result.error_bound_90_mm[:, 1:]).all()
        )
        assert np.isnan(result.error_bound_90_mm[60:70, 0]).all() == (bound is not None)


def test_the_factor_of_a_prediction_is_the_bound(monkeypatch, folder):
    """Each part of a clip has the factor that its own regression estimated."""
    original = SegmentPrediction.__init__

    def calibrated(self, *arguments, **keywords):
        original(self, *arguments, **keywords)
        object.__setattr__(self, "bound_factor", 2.0 if len(self.segment.markers) > 1 else 3.0)

    monkeypatch.setattr(SegmentPrediction, "__init__", calibrated)
    clip = with_gaps(person(), *GAPS)
    result = fill(clip, database=folder)
    ratio = (result.error_bound_90_mm / result.expected_rms_mm)[result.filled]
    assert set(np.round(ratio, 9)) == {2.0, 3.0}
    knee = clip.labels.index("LKNE")
    np.testing.assert_allclose(
        result.error_bound_90_mm[200:220, knee], 3.0 * result.expected_rms_mm[200:220, knee]
    )


@pytest.mark.parametrize(("method", "poses"), [("baumann2011", 256), ("neighbours", 64)])
def test_poses_of_the_searching_methods_are_k(method, poses, folder):
    clip = with_gaps(person(), (60, 90, ("LKNE",)))
    options = pf.FillOptions(method_options={"neighbours": poses})
    (gap,) = fill(clip, method=method, database=folder, options=options).gaps
    # the database holds only 180 poses at its rate
    assert gap.training_poses == min(poses, 178)
    (gap,) = fill(clip, method=method, options=options).gaps
    assert 16 <= gap.training_poses <= poses


def test_a_blackout_learns_from_windows():
    clip = with_gaps(person(), (100, 110, person().labels))
    result = fill(clip)
    assert {gap.sources for gap in result.gaps} == {("similar movements of the clip",)}
    assert min(gap.training_poses for gap in result.gaps) > 10


def test_interpolation_learns_from_no_poses():
    """A second of a clip is too short for windows."""
    short = person(seconds=1.0)
    result = fill(with_gaps(short, (25, 35, short.labels)))
    assert {gap.training_poses for gap in result.gaps} == {0}
    assert {gap.sources for gap in result.gaps} == {("interpolation over time",)}
    np.testing.assert_allclose(
        result.error_bound_90_mm[result.filled],
        BOUND_FACTOR * result.expected_rms_mm[result.filled],
    )


def test_a_gap_has_the_sources_of_the_notes_that_overlap_it():
    whole = person(seconds=1.0)
    clip = with_gaps(whole, (10, 20, whole.labels[:1]))
    errors = np.zeros(clip.missing.shape)
    samples = FilledSamples(whole.positions, clip.missing, errors, errors)
    notes = [
        Note(0, start, stop, f"{start} to {stop}")
        for start, stop in ((0, 10), (0, 11), (12, 15), (19, 30), (20, 30))
    ]
    (gap,) = sum_up_gaps(clip, samples, "linear", [*notes, Note(1, 10, 20, "other")], [])
    assert gap.sources == ("0 to 11", "12 to 15", "19 to 30")


def test_the_error_across_subjects_is_estimated_from_whole_subjects(tmp_path):
    """Two takes of a subject agree about a marker better than takes of two subjects."""
    whole = person()

    def errors(name, subjects):
        """Expected and real errors by marker, each missing throughout."""
        with PriorDatabase.create(tmp_path / name) as made:
            for seed, subject in enumerate(subjects):
                take = person(seconds=5.0, seed=30 + seed, body=20 + seed // 2)
                made.add(replace(take, name=f"take{seed}"), ClipOrigin(subject=subject))
        found = []
        for label in ("C7", "RELB", "LKNE"):
            clip = replace(with_gaps(whole, (0, 240, (label,))), subject="anna")
            result = fill(clip, database=tmp_path / name)
            off = np.linalg.norm(result.clip.positions - whole.positions, axis=2)
            found.append((result.gaps[0].expected_rms_mm, np.sqrt((off[clip.missing] ** 2).mean())))
        return np.transpose(found)

    expected, real = errors("others", ["ben", "ben", "cleo", "cleo", "dan", "dan"])
    assert (real < 1.5 * expected).all()
    assert (expected > 1.2 * errors("unknown", [""] * 6)[0]).all()  # any two may be of one subject
    # a subject of the clip's name but of another shape counts as another subject
    np.testing.assert_array_equal(
        errors("own", ["ben", "ben", "anna", "anna", "dan", "dan"]), [expected, real]
    )
    # a single other subject cannot be left out: the visible markers give the error
    expected, real = errors("one", ["ben"] * 6)
    assert (real < 1.5 * expected).all()


@METHOD
def test_a_database_as_path_or_as_object(method, folder):
    clip = with_gaps(person(), (60, 90, ("LKNE",)), (0, 240, ("C7",)))
    by_path = fill(clip, method=method, database=folder)
    by_text = fill(clip, method=method, database=str(folder))
    with PriorDatabase.open(folder) as database:
        by_object = fill(clip, method=method, database=database)
        assert len(list(database.clips())) == 1  # still open
    for other in (by_text, by_object):
        assert other.clip.positions.tobytes() == by_path.clip.positions.tobytes()
        assert other.database == by_path.database == folder


def test_a_database_without_a_common_marker(tmp_path):
    with PriorDatabase.create(tmp_path / "db") as database:
        names = tuple(f"X{i}" for i in range(41))
        database.add(Clip(person(seed=9).positions, names, 60.0, name="strange"))
    clip = with_gaps(person(), (60, 90, ("LKNE",)))
    result = fill(clip, database=tmp_path / "db")
    (note,) = result.notes
    assert "no marker in common with synthetic_walking_003" in note
    assert result.clip.positions.tobytes() == fill(clip).clip.positions.tobytes()


def test_an_empty_database(tmp_path):
    PriorDatabase.create(tmp_path / "db").close()
    clip = with_gaps(person(), (60, 90, ("LKNE",)))
    result = fill(clip, database=tmp_path / "db")
    assert result.notes == (f"{tmp_path / 'db'}: the database is empty",)
    assert result.clip.positions.tobytes() == fill(clip).clip.positions.tobytes()


def test_no_database_there(tmp_path):
    with pytest.raises(DatabaseNotFoundError):
        fill(with_gaps(person(), (60, 90, ("LKNE",))), database=tmp_path / "db")


def test_no_such_method():
    with pytest.raises(OptionError, match=r"no method 'splien'; did you mean spline\?$"):
        fill(person(), method="splien")


@METHOD
def test_no_gaps(method):
    result = fill(person(), method=method)
    assert result.complete
    assert result.gaps == ()
    assert not result.filled.any()
    assert result.clip.positions.tobytes() == person().positions.tobytes()


@pytest.mark.parametrize("method", ["gpr", "r2", "linear"])
def test_progress_counts_samples(method):
    clip = with_gaps(person(), (20, 30, ("LKNE",)), (60, 70, ("RKNE",)), (65, 90, ("C7",)))
    calls = []
    options = pf.FillOptions(progress=lambda done, total: calls.append((done, total)))
    fill(clip, method=method, options=options)
    done = [done for done, _ in calls]
    assert {total for _, total in calls} == {45}
    assert done[0] == 0
    assert done[-1] == 45
    assert done == sorted(set(done))
    assert len(calls) > 3  # more steps than gap groups


def test_progress_does_not_fall_when_a_clip_is_found_damaged(monkeypatch):
    class DamagedOnce(DatabaseTakes):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            if not arguments[-1]:  # no clip is known to be damaged
                self.withdrawn["a clip"] = DatabaseCorruptError("damaged")

    monkeypatch.setattr("priorfill.filling.fill_clip.DatabaseTakes", DamagedOnce)
    calls = []
    options = pf.FillOptions(progress=lambda done, total: calls.append((done, total)))
    fill(with_gaps(person(), (20, 30, ("LKNE",))), method="rigid", options=options)
    assert calls == [(0, 10), (3, 10), (10, 10)]  # the second time begins where the first did


def test_estimates_of_measured_samples_are_ignored(monkeypatch):
    """A method that changes everything, and gives no note on part of a gap."""

    def wild(task, progress):
        estimate = Estimate(
            np.full_like(task.positions, 7.0), np.full(task.positions.shape[:2], 1.0)
        )
        estimate.positions[60:65, 0, 1] = np.inf
        estimate.positions[65:70, :2] = np.nan
        estimate.notes.append(Note(0, 60, 65, "too wild", filled=False))
        estimate.notes.append(Note(0, 70, 90, "out of thin air"))
        estimate.notes.append(Note(1, 65, 70, "nothing", training_poses=9))
        return estimate

    monkeypatch.setattr("priorfill.filling.run_settings.get_method", lambda name: wild)
    clip = with_gaps(person(), (60, 90, person().labels[:1]), (65, 70, person().labels[1:2]))
    result = fill(clip, method="gpr", options=UNBELIEVABLE)
    measured = ~clip.missing
    assert result.clip.positions[measured].tobytes() == clip.positions[measured].tobytes()
    gap, other = result.gaps
    assert (other.filled, other.sources, other.training_poses) == (0, (), 0)  # despite the note
    assert gap.filled == 20
    assert gap.sources == ("out of thin air",)
    assert [left.reason for left in gap.unfilled] == ["too wild"]
    assert [(left.start, left.stop) for left in gap.unfilled] == [(60, 70)]
    assert np.isnan(result.expected_rms_mm[60:70, 0]).all()
    assert (result.clip.positions[70:90, 0] == 7).all()


PROGRAM = """
import hashlib, sys
sys.path.insert(0, {tests!r})
from gappy import person, with_gaps
from priorfill.filling.fill_clip import fill
for method, gaps in (("baumann2011", {some!r}), ("gpr", {gaps!r})):
    result = fill(with_gaps(person(), *gaps), method=method, database={database!r})
    print(method, hashlib.sha256(result.clip.positions.tobytes()).hexdigest())
"""


def test_the_same_bits_from_run_to_run_and_for_any_number_of_threads(folder, filled):
    program = PROGRAM.format(
        tests=str(Path(__file__).parents[1] / "support"),
        gaps=GAPS,
        some=GAPS[2:],
        database=str(folder),
    )
    published = fill(with_gaps(person(), *GAPS[2:]), method="baumann2011", database=folder)
    here = [
        f"{result.method} {hashlib.sha256(result.clip.positions.tobytes()).hexdigest()}"
        for result in (published, filled)
    ]
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    threads = "2" if thread_count() == 1 else "1"  # other than here
    environment = os.environ | dict.fromkeys((VARIABLE, *names), threads)
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    assert done.stdout.splitlines() == here


@pytest.mark.realdata
def test_a_limb_of_a_recording(data):
    """The left arm is gone for a second of walking."""
    whole = pf.read(data / "hdm05" / "HDM_bd_01-02_01_120.c3d")
    truth = Clip(whole.positions[500:1500], whole.labels, whole.rate, whole.up)
    clip = with_gaps(truth, (400, 520, ARM))
    result = fill(clip)
    assert result.complete
    found = error(result.clip.positions, truth.positions, result.filled)
    assert found < 0.5 * error(straight(clip), truth.positions, result.filled)
