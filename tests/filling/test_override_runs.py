"""Methods, donors, sources and options of single gaps; what stays as without overrides."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import ARM, person, with_gaps

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import OptionError
from priorfill.filling.check_overrides import check_overrides
from priorfill.filling.fill_cache import FillCache, RunEstimate, digest_of
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.overrides import MadeFor, Overrides
from priorfill.filling.overrides_file import read_overrides, write_overrides
from priorfill.filling.overrides_template import overrides_template
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.filling.provenance import Provenance
from priorfill.filling.result import Result
from priorfill.formats import read, write
from priorfill.methods.task import Estimate, Note

UNBELIEVABLE = FillOptions(plausibility=UNCHECKED)
GAPS = ((60, 90, ARM), (80, 100, ("RKNE", "C7")), (180, 200, ("C7",)))


def clip() -> Clip:
    return with_gaps(person(), *GAPS)


@cache
def filled_by_r2() -> Result:
    """The clip without overrides."""
    return fill(clip(), method="r2", options=UNBELIEVABLE)


def overrides(*entries: dict) -> Overrides:
    return Overrides.from_entries(entries)


def columns(*labels: str) -> list[int]:
    return [person().labels.index(label) for label in labels]


def assert_same(one: Result, two: Result, *but: str) -> None:
    """Two results are the same bit for bit, but for some markers."""
    kept = [k for k, label in enumerate(one.clip.labels) if label not in but]
    for name in ("expected_rms_mm", "error_bound_90_mm", "filled"):
        np.testing.assert_array_equal(getattr(one, name)[:, kept], getattr(two, name)[:, kept])
    np.testing.assert_array_equal(one.clip.positions[:, kept], two.clip.positions[:, kept])
    gaps = [[repr(gap) for gap in each.gaps if gap.label not in but] for each in (one, two)]
    assert gaps[0] == gaps[1]


@pytest.mark.parametrize("method", ["gpr", "r2", "linear"])
def test_gaps_without_an_override_are_filled_as_without_any(method):
    # r2 predicts no errors; they are those of artificial gaps, which depend on all gaps
    gappy = with_gaps(person(), *GAPS[1:]) if method == "gpr" else clip()
    plain = fill(gappy, method=method)
    entries = (
        {"marker": "RKNE", "do": "pchip"},
        {"marker": "LFIN", "do": "leave"},
        {"marker": "C7", "frames": "180-199", "do": "accept", "note": "seen"},
    )
    result = fill(gappy, method=method, overrides=overrides(*entries))
    assert_same(result, plain, "RKNE", "LFIN")
    assert result.method == f"{method} and pchip"
    assert_same(fill(gappy, method=method, overrides=overrides(entries[2])), plain)


def test_a_method_sees_its_donors_only():
    plain = filled_by_r2()
    entry = {"marker": "RKNE", "do": "r2", "donors": ["RTHI", "RSHN", "RANK", "RFWT", "R?WT"]}
    result = fill(clip(), method="r2", overrides=overrides(entry), options=UNBELIEVABLE)
    assert_same(result, plain, "RKNE")
    seen = columns("RTHI", "RSHN", "RANK", "RFWT", "RBWT", "RKNE")
    few = clip()
    few = Clip(few.positions[:, seen], tuple(few.labels[k] for k in seen), few.rate)
    alone = fill(few, method="r2", options=UNBELIEVABLE).clip.positions[80:100, -1]
    knee = result.clip.positions[80:100, columns("RKNE")[0]]
    np.testing.assert_allclose(knee, alone, atol=1e-6)
    assert np.abs(knee - plain.clip.positions[80:100, columns("RKNE")[0]]).max() > 0.1
    # what others show has no influence, nor have their gaps
    moved = clip().positions.copy()
    moved[:, [k for k in range(moved.shape[1]) if k not in seen]] += 37.0
    moved = clip().with_positions(moved)
    again = fill(moved, method="r2", overrides=overrides(entry), options=UNBELIEVABLE)
    np.testing.assert_array_equal(again.clip.positions[80:100, columns("RKNE")[0]], knee)


def test_several_ways_in_one_fill():
    donors = {"marker": "C7", "do": "r2", "donors": ["CLAV", "STRN", "RSHO", "LSHO", "RBHD"]}
    entries = (
        donors | {"frames": "80-99"},
        {"marker": "C7", "frames": "180-199", "do": "r2", "options": {"sigma": 40}},
        {"marker": "RKNE", "do": "linear"},
    )
    result = fill(clip(), method="r2", overrides=overrides(*entries), options=UNBELIEVABLE)
    assert result.method == "r2 and linear"
    alone = [
        fill(clip(), method="r2", overrides=overrides(entry), options=UNBELIEVABLE)
        for entry in entries
    ]
    (neck, knee) = columns("C7", "RKNE")
    for one, frames, marker in zip(
        alone, (slice(80, 100), slice(180, 200), slice(80, 100)), (neck, neck, knee), strict=True
    ):
        np.testing.assert_array_equal(
            result.clip.positions[frames, marker], one.clip.positions[frames, marker]
        )
    plain = filled_by_r2()
    for frames in (slice(80, 100), slice(180, 200)):
        assert np.abs(result.clip.positions - plain.clip.positions)[frames, neck].max() > 1e-3
    assert_same(result, plain, "C7", "RKNE")


def test_options_add_to_those_of_the_fill():
    options = replace(UNBELIEVABLE, method_options={"sigma": 40.0})
    entry = {"marker": "C7", "do": "r2", "options": {"sigma": 40.0}}
    changed = fill(clip(), method="r2", options=options)
    result = fill(clip(), method="r2", options=options, overrides=overrides(entry))
    assert_same(result, changed)  # the same options are the same run
    plain = filled_by_r2()
    result = fill(
        clip(),
        method="r2",
        options=options,
        overrides=overrides(entry | {"options": {"sigma": 200}}),
    )
    assert np.abs(result.clip.positions - plain.clip.positions)[:, columns("C7")].max() < 1.0
    assert_same(result, changed, "C7")


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Path:
    """A database of two other subjects, walking."""
    folder = tmp_path_factory.mktemp("lab") / "priors"
    with PriorDatabase.create(folder) as database:
        for number in (5, 6):
            other = person(seed=number, body=number)
            database.add(replace(other, name=f"walk_{number}", subject=f"s{number}"))
    return folder


def test_sources(lab):
    gappy = with_gaps(person(), (80, 140, ("RKNE",)))
    knee = columns("RKNE")[0]
    results = {}
    for sources in (["clip"], ["database"], ["database:walk_5"], ["database:*_6", "clip"]):
        entry = {"marker": "RKNE", "do": "gpr", "sources": sources}
        results[sources[0]] = fill(gappy, database=lab, overrides=overrides(entry))
    assert results["clip"].gaps[0].source_clips == (gappy.name,)
    found = results["database"].gaps[0]
    assert found.complete
    assert found.sources == ("other subjects of the database",)
    assert set(found.source_clips) == {"walk_5", "walk_6"}
    assert results["database:walk_5"].gaps[0].source_clips == ("walk_5",)
    assert "walk_5" not in results["database:*_6"].gaps[0].source_clips
    # the marker's own frames are not learnt from: they change nothing but for the joins
    moved = gappy.positions.copy()
    moved[:40, knee] = moved[200:, knee] = 0.5 * (moved[:40, knee] + moved[200:, knee])
    entry = {"marker": "RKNE", "do": "gpr", "sources": ["database"]}
    again = fill(
        gappy.with_positions(moved), database=lab, overrides=overrides(entry), options=UNBELIEVABLE
    )
    first = fill(gappy, database=lab, overrides=overrides(entry), options=UNBELIEVABLE)
    difference = again.clip.positions[80:140, knee] - first.clip.positions[80:140, knee]
    assert np.abs(difference).max() < 1e-6


@pytest.mark.parametrize("method", ["neighbours", "baumann2011", "krueger2010"])
def test_methods_that_search_do_without_the_clip(lab, method):
    gappy = with_gaps(person(), (80, 100, ("RKNE",)))
    entry = {"marker": "RKNE", "do": method, "sources": "database:walk_5"}
    result = fill(gappy, database=lab, overrides=overrides(entry), options=UNBELIEVABLE)
    assert result.gaps[0].source_clips == ("walk_5",)
    assert result.complete
    other = replace(person(seed=8), name="static")
    few = {"marker": "RKNE", "do": method, "sources": "same-subject"}
    two = replace(gappy, subject="Ann"), replace(gappy, subject="Ben")
    recorded = replace(other, subject="Ben")
    result = fill(two, same_subject=[recorded], overrides=overrides(few), options=UNBELIEVABLE)
    assert [gap.filled for gap in result.gaps] == [0, 20]
    (span,) = result.gaps[0].unfilled
    assert span.reason == "none of the chosen sources has a recording to learn from"


def test_recordings_of_the_subject_as_the_only_source(lab):
    gappy = with_gaps(person(), (80, 140, ("RKNE",)))
    other = replace(person(seed=8), name="static")
    entry = {"marker": "RKNE", "do": "gpr", "sources": "same-subject"}
    result = fill(gappy, same_subject=[other], database=lab, overrides=overrides(entry))
    assert result.gaps[0].source_clips == ("static",)
    everything = {"marker": "RKNE", "do": "gpr", "sources": "clip,database,same-subject"}
    result = fill(gappy, same_subject=[other], database=lab, overrides=overrides(everything))
    assert_same(result, fill(gappy, same_subject=[other], database=lab))


def test_a_recording_of_the_subject_is_learnt_from_once(tmp_path):
    gappy = with_gaps(person(), (80, 140, ("RKNE",)))
    other = replace(person(seed=8), name="static")
    with PriorDatabase.create(tmp_path / "lab") as database:
        database.add(other)
    alone = fill(gappy, same_subject=[other], method="neighbours")
    assert_same(
        alone, fill(gappy, same_subject=[other], database=tmp_path / "lab", method="neighbours")
    )


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"donors": ["RANKLE"]}, "gap 1: no marker of .* is called 'RANKLE'; did you mean RANK"),
        ({"options": {"sigm": 3}}, "gap 1: there is no option 'sigm'.*sigma"),
        ({"options": {"sigma": "x"}}, "gap 1: sigma cannot be 'x'; it must be a finite number"),
        ({"do": "linear", "options": {"sigma": 3}}, "gap 1: method linear has no option 'sigma'"),
        (
            {"sources": "same-subject"},
            "gap 1: r2 learns from the clip; add it to the sources, or use",
        ),
        ({"do": "gpr", "sources": "database:walk_*"}, "but there is no database; give one"),
        ({"do": "gpr", "sources": "same-subject"}, "there is no other recording of the subject"),
    ],
)
def test_what_there_is_not(entry, words):
    others = [replace(person(seed=8), name="static")] if "do" not in entry else []
    entries = overrides({"marker": "RKNE", "do": "r2"} | entry)
    for attempt in (
        lambda: fill(clip(), method="r2", same_subject=others, overrides=entries),
        lambda: check_overrides(entries, [clip()], method="r2", same_subject=bool(others)),
    ):
        with pytest.raises(OptionError, match=words) as raised:
            attempt()
        assert "\n" not in str(raised.value)


def test_a_clip_that_the_database_does_not_have(lab):
    entries = overrides({"marker": "RKNE", "do": "gpr", "sources": "database:walk_7"})
    with pytest.raises(OptionError, match="no clip of the database is called 'walk_7'; did you"):
        fill(clip(), database=lab, overrides=entries)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"do": "leave"}, r"gaps 1 and 2 contradict each other on C7 in frame 180 \(r2, leave\)"),
        ({"do": "accept"}, r"frame 180 \(r2, accept\)"),
        ({"do": "r2"}, r"frame 180 \(r2 in two ways\)"),
        ({"do": "r2", "donors": ["LSHO", "CLAV"]}, r"frame 180 \(r2 in two ways\)"),
        ({"do": "r2", "donors": ["LSHO"], "options": {"sigma": 3}}, "r2 in two ways"),
    ],
)
def test_contradictions(other, words):
    one = {"marker": "C7", "do": "r2", "donors": ["LSHO"]}
    two = {"marker": "C*", "frames": "150:190"} | other
    with pytest.raises(OptionError, match=words):
        fill(clip(), overrides=overrides(one, two))
    with pytest.raises(OptionError, match=words):
        check_overrides(overrides(one, two), [clip()])
    fill(clip(), method="linear", overrides=overrides(one, one | {"frames": "180:185"}))  # agree


def test_a_cache_changes_nothing_and_spares_what_is_unchanged(lab, tmp_path):
    lab = shutil.copytree(lab, tmp_path / "copy")
    cache = FillCache()
    counted: list[int] = []
    bare = FillOptions(estimate_errors=False)
    options = replace(bare, cache=cache, progress=lambda done, _: counted.append(done))
    for entries, hits in (
        ((), 0),
        (({"marker": "C7", "do": "leave"},), 2),
        (({"marker": "C7", "do": "accept"}, {"marker": "RKNE", "do": "pchip"}), 4),
        (({"marker": "RKNE", "do": "pchip"},), 7),
        (({"marker": "RKNE", "do": "missing", "frames": "20:22"},), 8),
        (({"marker": "RKNE", "do": "swap", "with": "LKNE", "frames": "20:22"},), 8),
        ((), 10),
    ):
        given = overrides(*entries) if entries else None
        counted.clear()
        result = fill(clip(), method="linear", database=lab, overrides=given, options=options)
        without = fill(clip(), method="linear", database=lab, overrides=given, options=bare)
        assert_same(result, without)
        assert cache.hits == hits
        assert counted == sorted(set(counted))
        assert counted[0] == 0
        assert counted[-1] > 0
        assert counted
    for number, other in enumerate(
        (
            {"database": None},
            {"options": replace(options, max_error=5.0)},
            {"gap_filter": GapFilter(markers=("C7",))},
            {"same_subject": [replace(person(seed=8), name="static")]},
            {"method": "spline"},
        ),
        start=11,
    ):
        fill(clip(), **({"method": "linear", "database": lab, "options": options} | other))
        assert cache.hits == number  # the artefacts alone
    with PriorDatabase.open_or_create(lab) as database:
        database.add(replace(person(seed=7, body=7), name="walk_7", subject="s7"))
    fill(clip(), method="linear", database=lab, options=options)
    assert cache.hits == 16


def test_a_cache_forgets_what_was_used_longest_ago():
    cache = FillCache(max_bytes=5000)
    for key in ("a", "b", "a", "c"):
        cache.recall(key, lambda one=key: one, lambda _: 1000)
    assert [cache.holds(key) for key in "abc"] == [True, False, True]
    assert digest_of(1) != digest_of(1.0) != digest_of("1.0")
    small = FillCache(max_bytes=1)  # keeps the last
    assert (small.recall("a", lambda: 1), small.holds("a")) == (1, True)
    one = clip()
    other = [
        replace(one, first_frame=3),
        replace(one, labels=one.labels[::-1]),
        replace(one, rate=50.0),
        replace(one, up="+Y"),
        replace(one, name="other"),
        replace(one, subject="other"),
        one.with_positions(one.positions + 1e-9),
    ]
    assert len({digest_of(each) for each in (one, *other)}) == 1 + len(other)
    numbers = np.arange(6.0)
    assert (
        len({digest_of(each) for each in (numbers, numbers.reshape(2, 3), numbers.view(int))}) == 3
    )


def test_what_a_cache_holds_is_not_changed_through_a_copy():
    estimate = Estimate(*(np.zeros(shape) for shape in ((2, 1, 3), (2, 1))), [], np.zeros((2, 1)))
    held = RunEstimate(estimate, np.zeros((2, 1), dtype=bool), (), ())
    other = held.copy().estimate
    other.positions[:] = 1.0
    other.expected_rms[:] = 1.0
    other.error_bound_90[:] = 1.0
    other.notes.append(Note(0, 0, 2, "other"))
    assert not estimate.positions.any()
    assert not estimate.expected_rms.any()
    assert not estimate.error_bound_90.any()
    assert estimate.notes == []


def test_a_template_gives_the_same_result(tmp_path):
    entries = (
        {"marker": "C7", "frames": "185-189", "do": "spline", "note": "mine"},
        {"marker": "LKNE", "frames": "20-24", "do": "missing"},
    )
    arguments = {
        "method": "linear",
        "gap_filter": GapFilter(markers=("C7", "LKNE", "RKNE", "LFIN"), max_gap=0.4),
        "overrides": overrides(*entries),
    }
    result = fill(clip(), **arguments)
    template = overrides_template(result)
    assert template.to_entries()[:2] == list(entries)
    rest = [(e.markers[0], e.first, e.last, e.do, e.note) for e in template.entries[2:]]
    assert ("C7", 180, 184, "accept") in [one[:4] for one in rest]
    assert ("C7", 190, 199, "accept") in [one[:4] for one in rest]
    assert ("LKNE", 20, 24, "accept") in [one[:4] for one in rest]
    (left,) = [one for one in rest if one[0] == "LFIN"]
    assert left[1:4] == (60, 89, "leave")
    assert left[4].startswith("left alone: longer than 0.4 s")
    assert all(": expected mean error " in note for *_, do, note in rest if do == "accept")
    write_overrides(tmp_path / "t.toml", template)
    again = fill(clip(), method="linear", overrides=tmp_path / "t.toml")
    np.testing.assert_array_equal(again.clip.positions, result.clip.positions)
    np.testing.assert_array_equal(again.expected_rms_mm, result.expected_rms_mm)
    assert again.notes == result.notes


def test_a_template_of_several_subjects():
    two = [replace(clip(), subject=name) for name in ("Anna", "Ben")]
    result = fill(two, method="linear")
    template = overrides_template(result)
    assert {entry.subject for entry in template.entries} == {"Anna", "Ben"}
    assert {entry.markers for entry in template.entries} >= {("C7",), ("RKNE",)}
    assert len(template.entries) == len(result.gaps)
    again = fill(two, method="linear", overrides=template)
    np.testing.assert_array_equal(again.clip.positions, result.clip.positions)


def test_a_difference_from_what_they_were_made_for_is_noted(tmp_path, lab):
    write(tmp_path / "walk.npz", clip())
    path = tmp_path / "d.toml"
    origin = MadeFor("run.c3d", "0" * 64, "gpr", "1" * 64)
    write_overrides(path, Overrides((), made_for=origin))
    one = read(tmp_path / "walk.npz")
    result = fill(one, method="linear", overrides=path)
    assert result.notes == (
        f"{path} was made for another file: the contents of walk.npz are not those of run.c3d",
        f"{path} was made for another method: gpr, not linear",
        f"{path} was made for another database: a database with other clips",
    )
    own = Overrides((), made_for=result.provenance.made_for)
    assert fill(one, method="linear", overrides=own).notes == ()
    with_database = fill(one, method="linear", overrides=own, database=lab)
    assert with_database.notes[0] == "overrides was made for another database: no database"
    unknown = Overrides((), made_for=MadeFor("x"))
    assert fill(one, method="linear", overrides=unknown, database=lab).notes == ()
    again = Provenance.from_dict(result.provenance.to_dict())
    assert again.overrides.made_for == origin
    assert again == result.provenance


def test_the_command_line_writes_overrides(here: Path):
    write("gaps.c3d", clip())

    def run(*arguments: str):
        return CliRunner().invoke(main, ["fill", "gaps.c3d", "-m", "linear", *arguments])

    result = run("--write-overrides", "o.toml", "--max-error", "30")
    assert result.exit_code == 3, result.output
    assert "overrides, an entry for each gap: o.toml" in result.stdout
    assert not Path("out.c3d").exists()
    notes = [entry.note for entry in read_overrides("o.toml").entries]
    assert any("unfilled: its expected mean error exceeds the limit" in note for note in notes)
    assert run("--write-overrides", "o.toml").exit_code == 1
    result = run("--write-overrides", "p.toml", "--overrides", "o.toml", "-o", "out.c3d", "--json")
    assert '"overrides": "p.toml"' in result.stdout
    assert read_overrides("p.toml").to_entries() == read_overrides("o.toml").to_entries()
    assert run("-o", "plain.c3d").exit_code == 0
    assert Path("plain.c3d").read_bytes() == Path("out.c3d").read_bytes()
    # an output that cannot be written takes the overrides with it
    assert run("--write-overrides", "q.toml", "-o", "out.c3d").exit_code == 1
    assert run("--write-overrides", "out.c3d").exit_code == 2
    assert not Path("q.toml").exists()
