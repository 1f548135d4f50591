"""Overrides that exchange the measured samples of two markers before anything is filled."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import person, with_gaps

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import OptionError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_file import FileOptions, fill_file
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.multi_subject import read_subjects
from priorfill.filling.overrides import GapOverride, Overrides
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.filling.provenance import Provenance
from priorfill.formats import read, write
from priorfill.geometry.axes import to_upright
from priorfill.report.facts import facts_of
from priorfill.report.report_data import EXCHANGED, sample_states

FIRST = 101
GAP = (60, 90)
SWAPPED = (40, 80)
"""Frames in which two markers have each other's label; they overlap a gap of one of them."""

LINES = {"method": "linear", "options": FillOptions(plausibility=UNCHECKED)}


def right() -> Clip:
    """A clip whose labels are right, with a gap of the left knee."""
    clip = replace(person(), first_frame=FIRST, subject="Anna")
    return with_gaps(clip, (*GAP, ("LKNE",)), (150, 170, ("C7",)))


def mislabelled(clip: Clip, one: str = "LKNE", two: str = "RKNE") -> Clip:
    """The clip with two labels exchanged for a while."""
    positions = clip.positions.copy()
    pair = [clip.labels.index(one), clip.labels.index(two)]
    positions[slice(*SWAPPED), pair] = positions[slice(*SWAPPED), pair[::-1]]
    return clip.with_positions(positions)


def swap(one: str = "LKNE", two: str = "RKNE", **more) -> GapOverride:
    first, last = FIRST + SWAPPED[0], FIRST + SWAPPED[1] - 1
    return GapOverride((one,), "swap", **({"first": first, "last": last, "other": two} | more))


def test_a_fill_of_wrong_labels_is_that_of_the_right_ones():
    result = fill(mislabelled(right()), overrides=Overrides((swap(),)), **LINES)
    plain = fill(right(), **LINES)
    np.testing.assert_array_equal(result.clip.positions, plain.clip.positions)
    np.testing.assert_array_equal(result.filled, plain.filled)
    np.testing.assert_array_equal(result.expected_rms_mm, plain.expected_rms_mm)
    assert repr(result.gaps) == repr(plain.gaps)  # NaN is not NaN
    labels = right().labels
    expected = np.zeros_like(result.filled)
    expected[slice(*SWAPPED), [labels.index("LKNE"), labels.index("RKNE")]] = True
    np.testing.assert_array_equal(result.swapped, expected & ~plain.filled)
    assert result.notes[0] == "swapped: 60 measured samples of LKNE and RKNE in frames 141-180"
    states = sample_states(result, to_upright(result.clip.positions, result.clip.up))
    np.testing.assert_array_equal(states == EXCHANGED, result.swapped)
    assert plain.swapped is None
    assert result.provenance.clips[0].content != plain.provenance.clips[0].content
    again = Provenance.from_dict(result.provenance.to_dict())
    assert again.overrides.entries == (swap(),)


def test_swaps_come_before_other_overrides_and_follow_one_another():
    wrong = mislabelled(mislabelled(right(), "RKNE", "C7"))
    entries = (
        GapOverride(("LKNE",), "spline"),
        swap(),
        GapOverride(("C7",), "missing", FIRST + 45, FIRST + 49),
        swap("RKNE", "C7"),
    )
    result = fill(wrong, overrides=Overrides(entries), **LINES)
    plain = fill(right(), overrides=Overrides((entries[0], entries[2])), **LINES)
    np.testing.assert_array_equal(result.clip.positions, plain.clip.positions)
    assert not (result.swapped & result.filled).any()


def test_artefacts_are_searched_for_afterwards():
    options = replace(LINES["options"], plausibility=replace(UNCHECKED, hide_doubtful=True))
    wrong = mislabelled(right(), "LKNE", "RANK")
    plain = fill(wrong, method="linear", options=options)
    assert {marker for artefact in plain.artefacts for marker in artefact.markers} >= {"RANK"}
    entries = Overrides((swap(two="RANK"),))
    assert fill(wrong, method="linear", overrides=entries, options=options).artefacts == ()


def test_swapped_samples_in_doubt_show_as_exchanged_and_count_as_in_doubt():
    result = fill(mislabelled(right()), overrides=Overrides((swap(),)), **LINES)
    result = replace(result, doubtful=result.swapped.copy())
    states = sample_states(result, to_upright(result.clip.positions, result.clip.up))
    np.testing.assert_array_equal(states == EXCHANGED, result.swapped)
    (fill_rows,) = (table["rows"] for table in facts_of(result) if table["title"] == "Fill")
    assert dict(fill_rows)["In doubt"].startswith(f"{result.swapped.sum()} measured samples")


def test_a_swap_without_effect_is_noted():
    clip = with_gaps(right(), (*SWAPPED, ("LKNE", "RKNE")))
    result = fill(clip, overrides=Overrides((swap(),)), **LINES)
    assert result.notes[0] == "overrides: gap 1 has no effect: no sample there is measured"
    assert result.swapped is None


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ((swap(two="LKNE"),), "gap 1: swaps LKNE with itself; give two markers"),
        ((swap(two="lkne"),), "gap 1: swaps LKNE with itself"),
        ((swap(two="RKNEE"),), "gap 1: no marker of .* is called 'RKNEE'; did you mean RKNE"),
        ((swap("LKNEE"),), "gap 1: no marker of .* is called 'LKNEE'; did you mean LKNE"),
        ((swap(two="R*"),), r"gap 1: 'R\*' matches \d+ markers \(RFHD, .*\); swap exchanges one"),
        ((swap(subject="Ben"),), "there is no subject 'Ben'"),
        ((swap(first=3, last=200),), "gap 1: frames 3-200 are not all in .* which has 101-340"),
        (
            (swap(), swap("C7"), swap("RKNE", "LKNE", first=FIRST + 70, last=None)),
            "gaps 1 and 3 both swap RKNE and LKNE in frame 171; remove one",
        ),
    ],
)
def test_wrong_swaps(entries, words):
    with pytest.raises(OptionError, match=words) as raised:
        fill(right(), overrides=Overrides(entries), **LINES)
    assert "\n" not in str(raised.value)


def test_a_file_the_same_bytes_twice_and_a_database(here: Path):
    write("in.c3d", replace(mislabelled(right()), first_frame=1))
    entries = [{"marker": "LKNE", "with": "RKNE", "do": "swap", "frames": "41-80"}]
    arguments = {"overrides": Overrides.from_entries(entries), **LINES}
    adding = FileOptions(add_to_database=True)
    done = fill_file("in.c3d", "out.c3d", database="lab", files=adding, **arguments)
    assert done.not_added is None
    fill_file("in.c3d", "again.c3d", **arguments)
    assert Path("out.c3d").read_bytes() == Path("again.c3d").read_bytes()
    filled, wanted = read("out.c3d"), fill(right(), **LINES).clip
    np.testing.assert_allclose(filled.positions, wanted.positions, rtol=0, atol=1e-3)
    with PriorDatabase.open("lab") as database:
        (record,) = database.clips()
        measured = np.array(record.present) - np.array(record.measured)
        # the gaps were filled; exchanged samples count as measured
        assert {record.labels[k] for k in np.flatnonzero(measured)} == {"LKNE", "C7"}
    # the clip is not learnt from, although its samples have other labels there
    again = fill(read("in.c3d"), database="lab", **arguments)
    assert any(note.startswith("not learnt from out:") for note in again.notes)


def test_one_subject_of_several(here: Path):
    clips = [replace(mislabelled(right()), subject=name) for name in ("Anna", "Ben")]
    both = Clip(
        np.concatenate([clip.positions for clip in clips], axis=1),
        tuple(f"{clip.subject}:{label}" for clip in clips for label in clip.labels),
        60.0,
        first_frame=FIRST,
    )
    write("two.npz", both)
    subjects = read_subjects("two.npz")
    for entry, words in (
        (swap(), "gap 1: LKNE and RKNE are markers of Anna and Ben; give the subject"),
        (swap("Anna:LKNE", "Ben:RKNE"), "are markers of different subjects; swap exchanges two"),
    ):
        with pytest.raises(OptionError, match=words):
            fill(subjects, overrides=Overrides((entry,)), **LINES)
    ways = (swap(subject="Ben"), swap("Ben:LKNE", "Ben:RKNE"), swap("Ben:LKNE"))
    results = [fill(subjects, overrides=Overrides((way,)), **LINES) for way in ways]
    for result in results:
        np.testing.assert_array_equal(result.clip.positions, results[0].clip.positions)
        assert not result.swapped[:, : len(right().labels)].any()
    ben = results[0].by_subject[1]
    np.testing.assert_array_equal(ben.clip.positions, fill(right(), **LINES).clip.positions)
    wrong = fill(clips[0], **LINES).clip.positions
    np.testing.assert_array_equal(results[0].by_subject[0].clip.positions, wrong)


def test_the_command_line(here: Path):
    write("in.c3d", replace(mislabelled(right()), first_frame=1))
    Path("d.toml").write_text(
        '[[gap]]\nmarker = "LKNE"\nwith = "RKNE"\ndo = "swap"\nframes = "41-80"\n'
        '[[gap]]\nmarker = "*"\ndo = "leave"\n'
    )
    run = ["fill", "in.c3d", "-o", "out.c3d", "--overrides", "d.toml", "-m", "linear", "--json"]
    result = CliRunner().invoke(main, run)
    assert result.exit_code == 0, result.output
    assert '"swapped_samples": 60' in result.stdout
    assert "note: swapped: 60 measured samples of LKNE and RKNE in frames 41-80\n" in result.stderr
    np.testing.assert_allclose(
        read("out.c3d").positions, right().positions.astype(np.float32), rtol=0, atol=0
    )
