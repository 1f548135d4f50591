"""Provenance: enough to compute a result again, bit for bit."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import ARM, person, with_gaps

import priorfill as pf
from priorfill.cli import main
from priorfill.database import PriorDatabase
from priorfill.errors import FormatError, MarkerSetError, OptionError
from priorfill.filling.provenance import DatabaseState, database_state, identify
from priorfill.formats import read, write
from priorfill.markers.definitions import load
from priorfill.methods import get_options

GAPS = ((60, 90, ARM), (200, 240, ("LKNE",)), (0, 240, ("C7",)))


@pytest.fixture
def database(here: Path) -> Path:
    """A database of one other subject, with terms of use."""
    with PriorDatabase.create("db") as made:
        made.add(
            replace(person(seconds=6.0, seed=11, body=11), subject="ben"),
            pf.ClipOrigin(licence="CC0", credit="a laboratory"),
        )
    return Path("db")


def test_a_fill_is_made_again_from_its_json(database):
    write("walk.c3d", with_gaps(person(), *GAPS))
    write("static.c3d", replace(person(seconds=1.0, seed=9), subject="anna"))
    Path("gaps.toml").write_text('[[gap]]\nmarker = "LFIN"\ndo = "spline"\n')
    line = [
        *("fill", "walk.c3d", "-o", "out.npz", "-d", "db", "--same-subject", "static.c3d"),
        *("--overrides", "gaps.toml", "--markers", "L*", "--markers", "C7", "--max-gap", "5"),
        *("-m", "baumann2011", "--set", "neighbours=20", "--exclude-subject", "anna"),
        *("--reject-artefacts", "--trust-filled", "--json", "--uncertainty", "how.npz"),
    ]
    done = CliRunner().invoke(main, line)
    assert done.exit_code == 0, done.output
    recorded = json.loads(done.stdout)["provenance"]
    with np.load("how.npz") as archive:
        assert json.loads(str(archive["provenance"])) == recorded
    Path("gaps.toml").unlink()  # the overrides themselves are in the provenance

    provenance = pf.Provenance.from_dict(recorded)
    assert provenance.to_dict() == recorded
    assert provenance.options == {"neighbours": 20}
    clip = read("walk.c3d", **provenance.reading)
    assert identify(clip) == provenance.clips[0]
    same = [read("static.c3d")]
    assert (identify(same[0]),) == provenance.same_subject
    again = pf.fill(clip, same_subject=same, **provenance.fill_arguments())
    with np.load("out.npz") as archive:
        np.testing.assert_array_equal(archive["filled"], again.filled)
    write("again.npz", again.clip, again.filled)
    assert Path("again.npz").read_bytes() == Path("out.npz").read_bytes()
    assert again.provenance == replace(provenance, reading={})


def test_what_it_records(database):
    write("walk.c3d", with_gaps(person(), GAPS[1]))
    clip = read("walk.c3d", rate=50.0)
    provenance = pf.fill(clip, method="baumann2011", database=database).provenance
    assert provenance.versions["numpy"] == np.__version__
    assert provenance.versions["priorfill"] == pf.__version__
    assert set(provenance.versions) == {"python", "priorfill", "numpy", "scipy", "numba"}
    assert (provenance.method, provenance.options) == ("baumann2011", {})
    (identity,) = provenance.clips
    assert clip.source is not None
    assert (identity.file, identity.sha256) == ("walk.c3d", clip.source.sha256)
    (source,) = provenance.source_clips
    assert (source.name, source.subject) == ("synthetic_walking_011", "ben")
    assert (source.licence, source.credit) == ("CC0", "a laboratory")
    assert provenance.database is not None
    assert (provenance.database.path, provenance.database.clips) == ("db", 1)
    assert provenance.marker_set is None
    assert pf.fill(clip, method="linear").provenance.database is None


def test_source_clips_of_all_methods_and_subjects(database):
    clip = replace(with_gaps(person(), GAPS[1], (100, 110, ("RKNE",))), subject="anna")
    overrides = pf.Overrides((pf.GapOverride(("RKNE",), "baumann2011"),))
    result = pf.fill(clip, method="linear", database=database, overrides=overrides)
    assert [one.name for one in result.provenance.source_clips] == ["synthetic_walking_011"]
    other = replace(person(), subject="carl")  # without gaps, so without source clips
    merged = pf.fill([other, clip], method="linear", database=database, overrides=overrides)
    assert merged.subjects[0].provenance.source_clips == ()
    assert merged.provenance.source_clips == result.provenance.source_clips


def test_the_state_of_a_database_is_that_of_its_clips(database):
    def state(path: str) -> DatabaseState:
        with PriorDatabase.open(path) as opened:
            return database_state(opened)

    one, other = person(seconds=2.0, seed=5), person(seconds=2.0, seed=6)
    for path, clips in (("ab", (one, other)), ("ba", (other, one)), ("a", (one,))):
        with PriorDatabase.create(path) as made:
            for clip in clips:
                made.add(clip)
    assert replace(state("ab"), path="") == replace(state("ba"), path="")
    assert state("ab").content != state("a").content
    with PriorDatabase.open("a", write=True) as opened:
        mask = np.zeros(other.missing.shape, dtype=bool)
        mask[:, 0] = True
        opened.accept(other, mask, filled_by="linear")
    assert state("a").content != state("ab").content  # the same clips, but one has filled samples


def test_a_marker_set_from_a_file():
    """A set of the same name with another definition gives another fill, so it is refused."""
    shipped = load("baumann41")
    lumped = replace(shipped, segment=shipped.segment | {"LKNE": "left_forearm"})
    clip = with_gaps(person(), GAPS[1])
    options = pf.FillOptions(marker_set=lumped)
    recorded = pf.fill(clip, method="linear", options=options).provenance
    assert recorded.marker_set == "baumann41"
    provenance = pf.Provenance.from_dict(json.loads(json.dumps(recorded.to_dict())))
    assert provenance == recorded
    for wrong in ({}, {"marker_set": shipped}):
        with pytest.raises(MarkerSetError, match="baumann41 differs from that of the fill"):
            provenance.fill_arguments(**wrong)
    titled = replace(lumped, title="another title", source="another source")
    assert provenance.fill_arguments(titled)["options"].marker_set is titled

    options = pf.FillOptions(marker_set=replace(lumped, name="elsewhere"))
    provenance = pf.fill(clip, method="linear", options=options).provenance
    with pytest.raises(OptionError, match="elsewhere is unknown"):
        provenance.fill_arguments()
    again = pf.fill(clip, **provenance.fill_arguments(options.marker_set))
    assert again.provenance == provenance


def test_a_damaged_provenance_is_refused():
    sound = pf.fill(with_gaps(person(), GAPS[1]), method="linear").provenance.to_dict()
    for name in sound:
        with pytest.raises(FormatError, match="the provenance cannot be used"):
            pf.Provenance.from_dict({**sound, name: [5]})
    damaged = (
        *({name: None} for name in ("versions", "method", "clips", "reading", "plausibility")),
        {"max_error": "x"},
        {"trust_filled": 1},
        {"clips": []},
        {"clips": [sound["clips"][0] | {"name": 5}]},
        {"selection": {"names": [5]}},
        {"plausibility": {"unknown": 1.0}},
        {"unknown": 1},
    )
    for changed in damaged:
        with pytest.raises(FormatError, match="the provenance cannot be used"):
            pf.Provenance.from_dict(sound | changed)
    with pytest.raises(FormatError, match="it lacks 'options'"):
        pf.Provenance.from_dict({name: sound[name] for name in sound if name != "options"})


def test_options_of_the_method():
    clip = with_gaps(person(), GAPS[1])
    changed = pf.FillOptions(method_options={"sigma": "100"})
    result = pf.fill(clip, method="r1", options=changed)
    assert result.provenance.options == {"sigma": 100.0}
    assert (result.clip.positions != pf.fill(clip, method="r1").clip.positions).any()
    same = pf.fill(clip, method="r1", options=pf.FillOptions(method_options={"sigma": 200.0}))
    assert same.provenance.options == {}
    with pytest.raises(OptionError, match="there is no option 'sigmas'; did you mean sigma"):
        pf.fill(clip, method="r1", options=pf.FillOptions(method_options={"sigmas": 1}))
    with pytest.raises(OptionError, match="method linear has no option 'sigma'"):
        pf.fill(clip, method="linear", options=pf.FillOptions(method_options={"sigma": 1}))
    other = get_options("gpr")
    for method, own in (("r1", f"{type(get_options('r1')).__name__} or"), ("linear", "no options")):
        with pytest.raises(OptionError, match=f"{type(other).__name__} .*{method} takes {own}"):
            pf.fill(clip, method=method, options=pf.FillOptions(method_options=other))


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *((pf.Selection, field.name) for field in fields(pf.Selection)),
        (pf.GapFilter, "markers"),
        (partial(pf.GapOverride, do="leave"), "markers"),
    ],
)
def test_a_text_is_no_list_of_patterns(kind, name):
    kind(**{name: ("anna",)})
    with pytest.raises(OptionError, match=rf"{name} is 'anna'; it must be a tuple, as \('anna',\)"):
        kind(**{name: "anna"})


def test_options_on_the_command_line(here):
    write("walk.c3d", with_gaps(person(), GAPS[1]))
    line = ["fill", "walk.c3d", "-o", "out.c3d", "-m", "r1"]
    for value in ("sigma", "=3"):
        done = CliRunner().invoke(main, [*line, "--set", value])
        assert done.exit_code == 2
        assert f"'{value}' is not of the form NAME=VALUE" in done.stderr
    done = CliRunner().invoke(main, [*line, "--set", "sigma=wide"])
    assert done.exit_code == 2
    assert "sigma" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not Path("out.c3d").exists()
    assert CliRunner().invoke(main, [*line, "--set", "sigma = 100"]).exit_code == 0
