"""Overrides as entries and as files: what round-trips, and what is refused in one line."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from priorfill.errors import OptionError, OutputError
from priorfill.filling.overrides import GapOverride, MadeFor, Overrides
from priorfill.filling.overrides_file import overrides_text, read_overrides, write_overrides

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
NAMES = st.lists(TEXTS.filter(bool), min_size=1, max_size=6, unique=True).map(tuple)
FRAMES = st.one_of(st.none(), st.integers(-(2**31), 2**31 - 1))
VALUES = st.one_of(
    st.booleans(),
    st.integers(-(2**63) + 1, 2**63 - 1),
    st.floats(allow_nan=False),
    TEXTS,
    st.lists(st.integers(-5, 5), max_size=7).map(tuple),
)


@st.composite
def overrides(draw):
    """An override of any action with texts of any characters."""
    do = draw(st.sampled_from(["accept", "leave", "missing", "swap", "gpr", "linear"]))
    first, last = sorted(
        (draw(FRAMES), draw(FRAMES)), key=lambda frame: (frame is None, frame or 0)
    )
    given = {"subject": draw(TEXTS), "note": draw(TEXTS)}
    if do == "swap":
        return GapOverride(draw(NAMES)[:1], do, first, last, other=draw(NAMES)[0], **given)
    if do in ("gpr", "linear") and draw(st.booleans()):
        given |= {
            "donors": draw(NAMES),
            "sources": ("clip", "database:" + draw(NAMES)[0]),
            "options": draw(st.dictionaries(TEXTS, VALUES, max_size=3)),
        }
    return GapOverride(draw(NAMES), do, first, last, **given)


@given(st.lists(overrides(), max_size=5), TEXTS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow], deadline=None)
def test_files_and_json_round_trip(tmp_path_factory, entries, text):
    path = tmp_path_factory.getbasetemp() / "round_trip.toml"
    made_for = MadeFor(text, text[::-1], "gpr", text)
    written = Overrides(tuple(entries), made_for=made_for)
    write_overrides(path, written, overwrite=True)
    again = read_overrides(path)
    assert again.entries == written.entries
    assert again.made_for == made_for
    from_json = Overrides.from_entries(json.loads(json.dumps(written.to_entries())))
    assert from_json.entries == written.entries


def test_lines_of_many_dots_are_read_again(tmp_path):
    names = tuple("." * 60 + str(number) for number in range(9))
    entries = (
        GapOverride(names, "linear", donors=names, note="..." * 300),
        GapOverride(("C7",), "gpr", options={f"a.{n}.b.c": 0.5 for n in range(60)}),
    )
    write_overrides(tmp_path / "dots.toml", Overrides(entries))
    assert read_overrides(tmp_path / "dots.toml").entries == entries


def test_a_file_for_people(tmp_path):
    entries = (
        GapOverride(("LKNE",), "gpr", 92, 116, donors=("LTHI", "LANK"), sources=("clip",)),
        GapOverride(("A,B", "C7"), "pchip", -3, 4, "Anna", note='taped "over"\n'),
        GapOverride(("LKNE",), "swap", 7, 7, other="RKNE"),
        GapOverride(("C7",), "r1", 5, options={"sigma": 80.0}),
        GapOverride(("C7",), "leave", None, 4),
    )
    text = overrides_text(Overrides(entries, made_for=MadeFor("walk.c3d", "", "gpr")))
    assert text == (
        '[made_for]\nfile = "walk.c3d"\nsha256 = ""\nmethod = "gpr"\n\n'
        '[[gap]]\nmarker = "LKNE"\nframes = "92-116"\ndo = "gpr"\n'
        'donors = ["LTHI", "LANK"]\nsources = ["clip"]\n\n'
        '[[gap]]\nmarker = ["A,B", "C7"]\nframes = "-3:4"\nsubject = "Anna"\ndo = "pchip"\n'
        'note = "taped \\"over\\"\\n"\n\n'
        '[[gap]]\nmarker = "LKNE"\nframes = 7\ndo = "swap"\nwith = "RKNE"\n\n'
        '[[gap]]\nmarker = "C7"\nframes = "5:"\ndo = "r1"\n[gap.options]\nsigma = 80.0\n\n'
        '[[gap]]\nmarker = "C7"\nframes = ":4"\ndo = "leave"\n'
    )


def test_options_in_tables_or_by_dotted_name(tmp_path):
    path = tmp_path / "o.toml"
    path.write_text('[[gap]]\nmarker = "C7"\ndo = "auto"\noptions.training.max_poses = 30\n')
    (entry,) = read_overrides(path).entries
    assert (entry.do, entry.options) == ("gpr", {"training.max_poses": 30})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"do": "swap"}, "swap needs the other marker; give it as `with`"),
        ({"with": "RKNE"}, "`with` applies to swap, not to leave"),
        ({"do": "swap", "with": 5}, "with is 5; give a text"),
        ({"do": "swap", "marker": ["A", "B"], "with": "C"}, "write an entry for each pair"),
        ({"donors": "LTHI"}, "donors applies to a method, not to leave"),
        ({"do": "accept", "sources": ["clip"]}, "sources applies to a method, not to accept"),
        ({"do": "missing", "options": {"a": 1}}, "options applies to a method, not to missing"),
        ({"do": "linear", "donors": []}, "donors is empty; name some, or leave it out"),
        ({"do": "linear", "donors": [1]}, r"donors is \[1\]; give a text or a list of texts"),
        ({"do": "gpr", "sources": ["clips"]}, "there is no source 'clips'; did you mean clip"),
        ({"do": "gpr", "sources": ["database:"]}, "there is no source 'database:'"),
        ({"do": "gpr", "options": 3}, "options is 3; write { name = value }"),
        ({"do": "gpr", "options": {"a": {"b": [[1]]}}}, r"option a\.b is \[\[1\]\]"),
        ({"do": "gpr", "options": {"a.b": 1, "a": {"b": 2}}}, "option a.b is given twice"),
        ({"marker": ["A", {"x": 1}]}, r"marker is \['A', \{'x': 1\}\]; give a text or a list"),
        ({"marker": ", ,"}, "has no marker"),
        ({"marker": "x" * 9999, "do": "y" * 9999}, "do is 'yyy"),
        ({"frames": True}, "frames 'True' are no range"),
        ({"frames": "1" * 9999}, "are no range"),
        ({"note": ["a"]}, r"note is \['a'\]; give a text"),
        ({"action": "leave"}, "unknown key 'action'; use marker, frames, do, with"),
    ],
)
def test_wrong_entries(change, words):
    with pytest.raises(OptionError, match=words) as raised:
        Overrides.from_entries(
            [{"marker": "C7", "do": "leave"}, {"marker": "C7", "do": "leave"} | change]
        )
    assert str(raised.value).startswith("overrides: gap 2: ")
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 400


@pytest.mark.parametrize("entry", [None, 3, "C7", ["C7"], []])
def test_entries_that_are_no_tables(entry):
    with pytest.raises(OptionError, match=r"gap 1: is .*; give a table of marker, frames"):
        Overrides.from_entries([entry])


def test_deep_options_are_refused():
    nested: dict = {}
    for _ in range(5000):
        nested = {"a": nested}
    with pytest.raises(OptionError, match="give a number, a text, true, false or a list"):
        Overrides.from_entries([{"marker": "C7", "do": "gpr", "options": nested}])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("made_for = 3", "made_for is not a table"),
        ("[made_for]\nname = 'a'", "made_for: unknown key 'name'; use file, sha256, method"),
        ("[made_for]\nfile = 3", "made_for: file is 3; give a text"),
        ("[[made_for]]\nfile = 'a'", "made_for is not a table"),
    ],
)
def test_wrong_origins(tmp_path, text, words):
    (tmp_path / "d.toml").write_text(text)
    with pytest.raises(OptionError, match=words):
        read_overrides(tmp_path / "d.toml")


def test_a_file_that_exists_is_kept(tmp_path):
    path = tmp_path / "d.toml"
    path.write_text("old")
    with pytest.raises(OutputError, match="exists already"):
        write_overrides(path, Overrides(()))
    with pytest.raises(OptionError, match=r"gap 1: the character \\ud800 is no Unicode text"):
        write_overrides(path, Overrides((GapOverride(("\ud800",), "leave"),)), overwrite=True)
    with pytest.raises(OptionError, match=r"end its name in \.toml"):
        write_overrides(tmp_path / "d.txt", Overrides(()))
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["d.toml"]
    write_overrides(path, Overrides(()), overwrite=True)
    assert read_overrides(path) == replace(Overrides(()), path=path)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            GapOverride(("A",), "gpr", options={"training.max_poses": 10**30}),
            "gap 1: an integer of more than 64 bits",
        ),
        (GapOverride(("A",), "leave", note="n" * (1 << 22)), "more than 4096 KiB"),
    ],
    ids=["integer", "size"],
)
def test_what_would_not_be_read_is_not_written(tmp_path, override, words):
    with pytest.raises(OptionError, match=words):
        write_overrides(tmp_path / "d.toml", Overrides((override,)))
    assert list(tmp_path.iterdir()) == []
