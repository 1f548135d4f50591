"""Overrides of single gaps: what a file of them does, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from gappy import ARM, person, with_gaps

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.overrides import GapOverride, Overrides
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.filling.result import Result as Filled
from priorfill.formats import read, write

GAPS = ((60, 150, ARM), (80, 90, ("RKNE", "C7")), (230, 240, ("C7",)))
FIRST = 101
"""Number of the first frame, so that frames of the file differ from indices of the clip."""


def clip() -> Clip:
    return replace(with_gaps(person(), *GAPS), first_frame=FIRST)


UNBELIEVABLE = FillOptions(plausibility=UNCHECKED)
"""Options under which straight lines through strides are kept."""


def column(label: str) -> int:
    return person().labels.index(label)


def overridden(tmp_path: Path, text: str, **options) -> Filled:
    path = tmp_path / "d.toml"
    path.write_text(text)
    return fill(clip(), overrides=path, **{"method": "linear", "options": UNBELIEVABLE} | options)


def test_no_override_is_a_plain_fill(tmp_path):
    result, plain = overridden(tmp_path, ""), fill(clip(), method="linear", options=UNBELIEVABLE)
    np.testing.assert_array_equal(result.clip.positions, plain.clip.positions)
    assert repr(result.gaps) == repr(plain.gaps)  # NaN is not NaN
    assert (result.method, result.complete) == ("linear", True)


def test_each_gap_by_its_method(tmp_path):
    text = f"""
        [[gap]]
        marker = ["R*", "C7"]
        frames = "{FIRST + 80}:{FIRST + 89}"
        do = "spline"
        note = "short"
        [[gap]]
        marker = "LFIN"
        do = "leave"
        [[gap]]
        marker = "LWRA"
        frames = "{FIRST + 100}:"
        do = "pchip"
    """
    result = overridden(tmp_path, text)
    by = {
        name: fill(clip(), method=name, options=UNBELIEVABLE).clip.positions
        for name in ("linear", "spline", "pchip")
    }
    expected = by["linear"].copy()
    two = [column("RKNE"), column("C7")]
    expected[80:90, two] = by["spline"][80:90, two]
    expected[100:, column("LWRA")] = by["pchip"][100:, column("LWRA")]
    expected[60:150, column("LFIN")] = np.nan
    np.testing.assert_array_equal(result.clip.positions, expected)
    assert not np.array_equal(by["linear"][80:90], by["spline"][80:90], equal_nan=True)
    np.testing.assert_array_equal(result.filled, clip().missing & ~np.isnan(expected[..., 0]))
    gaps = {(gap.label, gap.start): gap for gap in result.gaps}
    assert len(gaps) == len(result.gaps) == len(fill(clip(), method="linear").gaps)
    assert gaps["RKNE", 80].method == "spline"
    assert gaps["LWRA", 60].method == "linear and pchip"
    assert gaps["LWRA", 60].filled == 90
    (left,) = gaps["LFIN", 60].unfilled
    assert (left.start, left.stop, left.requested) == (60, 150, False)
    assert left.reason.startswith("left alone by ")
    assert all(not gap.unfilled for key, gap in gaps.items() if key != ("LFIN", 60))
    assert result.complete
    assert result.method == "linear and spline and pchip"


def test_measured_samples_as_missing(tmp_path):
    text = f"""
        [[gap]]
        marker = "RKNE"
        frames = "{FIRST + 20}:{FIRST + 29}"
        do = "missing"
        [[gap]]
        marker = "RKNE"
        frames = {FIRST + 25}
        do = "pchip"
    """
    result = overridden(tmp_path, text)
    knee = column("RKNE")
    new = result.filled & ~clip().missing
    assert (np.argwhere(new) == [[frame, knee] for frame in range(20, 30)]).all()
    assert np.abs(result.clip.positions[20:30, knee] - clip().positions[20:30, knee]).max() > 0.01
    others = ~clip().missing & ~new
    np.testing.assert_array_equal(result.clip.positions[others], clip().positions[others])
    assert result.notes == ("treated as missing: 10 measured samples of RKNE in frames 121-130",)
    # what cannot be filled again keeps its measured position
    text = f'[[gap]]\nmarker = "C7"\ndo = "missing"\nframes = "{FIRST}:"'
    result = overridden(tmp_path, text)
    seen = ~clip().missing[:, column("C7")]
    np.testing.assert_array_equal(
        result.clip.positions[seen, column("C7")], clip().positions[seen, column("C7")]
    )
    assert not result.complete
    assert "220 samples of C7 that were treated as missing could not be filled" in result.notes[1]


def test_what_the_gap_filter_leaves_alone_stays_alone(tmp_path):
    text = '[[gap]]\nmarker = "*"\ndo = "spline"'
    for options in (
        {"markers": ("C7",)},
        {"max_gap": 0.5},
        {"skip_edges": True},
        {"frames": (190, 195)},
    ):
        gap_filter = GapFilter(**options)
        result = overridden(tmp_path, text, gap_filter=gap_filter)
        plain = fill(clip(), method="spline", gap_filter=gap_filter, options=UNBELIEVABLE)
        np.testing.assert_array_equal(result.clip.positions, plain.clip.positions)
        assert repr(result.gaps) == repr(plain.gaps)  # NaN is not NaN


def test_overrides_from_python():
    entries = (GapOverride(("LFIN",), "leave"), GapOverride(("R*",), "spline", last=FIRST + 89))
    result = fill(clip(), method="linear", overrides=Overrides(entries))
    gaps = {gap.label: gap for gap in result.gaps}
    assert gaps["LFIN"].unfilled[0].reason == "left alone by overrides"
    assert (gaps["RKNE"].method, gaps["LWRA"].method) == ("spline", "linear")
    with pytest.raises(OptionError, match="no method 'splien'"):
        GapOverride(("C7",), "splien")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[gap]]\nmarker = "HIP"\ndo = "leave"', "gap 1: no marker of .* is called 'HIP'"),
        ('[[gap]]\nmarker = "C7"\nframes = "90:120"\ndo = "leave"', r"90-120 .* has 101-340"),
        ('[[gap]]\nmarker = "C7"\nframes = "120:110"\ndo = "leave"', "first is after the last"),
        ('[[gap]]\nmarker = "C7"\nframes = "120-130-140"\ndo = "leave"', "write 92-116"),
        ('[[gap]]\nmarker = "C7"\nframes = 1.5\ndo = "leave"', "write 92-116"),
        (
            '[[gap]]\nmarker = "C7"\ndo = "guess"',
            "do is 'guess'; use one of accept, leave, missing, swap, auto, gpr",
        ),
        ('[[gap]]\nmarker = "C7"', "has no do; use one of"),
        ('[[gap]]\ndo = "leave"', "has no marker"),
        ('[[gap]]\nmarker = "C7"\ndo = "leave"\nframe = 3', "unknown key 'frame'"),
        ('[gap]\nmarker = "C7"', "not a list of tables"),
        ("odd = 1", "unknown key 'odd'"),
        ("gap = ", "is not valid TOML"),
        (
            '[[gap]]\nmarker = "C*"\ndo = "leave"\n'
            '[[gap]]\nmarker = "C7"\nframes = "181:"\ndo = "li"',
            r"gaps 1 and 2 contradict each other on C7 in frame 181 \(leave, li\)",
        ),
        (
            '[[gap]]\nmarker = "C7"\ndo = "leave"\n'
            '[[gap]]\nmarker = "C7"\nframes = 150\ndo = "missing"',
            "C7 in frame 150 is to be treated as missing and left alone",
        ),
        ('[[gap]]\nmarker = "C7"\nsubject = "Ben"\ndo = "leave"', "there is no subject 'Ben'"),
    ],
)
def test_invalid_overrides(tmp_path, text, words):
    with pytest.raises(OptionError, match=words) as raised:
        overridden(tmp_path, text)
    assert "\n" not in str(raised.value)


def test_an_override_without_effect_is_noted(tmp_path):
    text = (
        '[[gap]]\nmarker = "LKNE"\ndo = "leave"\n[[gap]]\nmarker = "C7"\nframes=181\ndo = "missing"'
    )
    notes = overridden(tmp_path, text).notes
    assert [note.partition(": ")[2] for note in notes] == [
        "gap 2 has no effect: no sample there is measured",
        "gap 1 has no effect: no sample there is missing",
    ]


def test_the_command_line(here):
    def run(*arguments: str) -> Result:
        return CliRunner().invoke(main, ["fill", "gaps.c3d", "-o", "out.c3d", *arguments])

    write("gaps.c3d", replace(clip(), first_frame=1))
    Path("d.toml").write_text(
        '[[gap]]\nmarker = "LFIN"\ndo = "leave"\n'
        '[[gap]]\nmarker = "LKNE"\nframes = "11:20"\ndo = "missing"\n'
        '[[gap]]\nmarker = "C7"\nframes = "81:90"\ndo = "spline"\n'
    )
    result = run("-m", "linear", "--overrides", "d.toml", "--skip-edges", "--json")
    assert result.exit_code == 0, result.output
    assert (
        "note: treated as missing: 10 measured samples of LKNE in frames 11-20\n" in result.stderr
    )
    assert "left alone: 90 samples of 1 marker (LFIN) within frames 61-150" in result.stderr
    gaps = {(g["marker"], g["first_frame"]): g for g in json.loads(result.stdout)["gaps"]}
    assert gaps["C7", 81]["method"] == "spline"
    assert gaps["LKNE", 11]["filled"] == 10
    assert gaps["C7", 231]["unfilled"][0]["requested"] is False
    before, after = read("gaps.c3d"), read("out.c3d")
    changed = (before.positions != after.positions).any(axis=2) & ~before.missing
    assert set(map(tuple, np.argwhere(changed))) == {(f, column("LKNE")) for f in range(10, 20)}
    Path("d.toml").write_text('[[gap]]\nmarker = "X"\ndo = "leave"')
    result = run("--overrides", "d.toml", "--overwrite")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "cannot be read" in run("--overrides", "no.toml", "--overwrite").stderr
