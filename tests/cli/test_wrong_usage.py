"""Wrong usage of any command: status 2, a message without a traceback, and nothing is written."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner
from gappy import person, with_gaps

from priorfill.cli import main
from priorfill.formats import write

_FILL = ("fill", "walk.c3d", "-o", "out.c3d")
_EVALUATE = ("evaluate", "walk.c3d", "-m", "linear")
_REPORT = ("report", "walk.c3d", "walk.c3d", "-o", "out.html")
_ADD = ("db", "add", "-d", "db", "walk.c3d")

WRONG = (
    (("fil", "walk.c3d"), "did you mean fill?"),
    (("db", "verfy", "-d", "db"), "Did you mean 'verify'?"),
    (("fill",), "Missing argument"),
    ((*_FILL, "more.c3d"), "priorfill batch walk.c3d more.c3d -o FOLDER"),
    ((*_FILL, "--metod", "x"), "--method"),
    ((*_FILL, "--method"), "requires an argument"),
    ((*_FILL, "--method", "linaer"), "did you mean linear?"),
    ((*_FILL, "--up", "sideways"), "sideways"),
    ((*_FILL, "--rate", "-5"), "--rate is -5 Hz"),
    ((*_FILL, "--rate", "nan"), "--rate is nan Hz"),
    ((*_FILL, "--rate", "fast"), "--rate"),
    ((*_FILL, "--unit", "parsec"), "parsec"),
    ((*_FILL, "--subject", "nobody"), "nobody"),
    ((*_FILL, "--marker-set", "baumann42"), "did you mean baumann41?"),
    ((*_FILL, "--marker-set", "no.toml"), "no.toml: there is no such marker set"),
    ((*_FILL, "--database", "no"), "no: there is no database; make one"),
    (("fill", "walk.c3d", "-o", "walk.c3d"), "is the file that the clip was read from"),
    (("fill", "walk.c3d", "-o", "./walk.c3d", "--overwrite"), "was read from"),
    ((*_FILL, "--markers", "LKNEE"), "did you mean LKNE"),
    ((*_FILL, "--markers", ","), "--markers"),
    ((*_FILL, "--frames", "20-10"), "--frames"),
    ((*_FILL, "--frames", "-10"), "ambiguous"),
    ((*_FILL, "--frames", "5000-6000"), "none of 5000-6000"),
    ((*_FILL, "--max-gap", "0"), "--max-gap"),
    ((*_FILL, "--max-gap", "long"), "no duration"),
    ((*_FILL, "--threads", "0"), "--threads"),
    ((*_FILL, "--max-error", "-1"), "--max-error is -1 mm; it must be above 0"),
    ((*_FILL, "--set", "sigma"), "NAME=VALUE"),
    ((*_FILL, "--set", "sgima=3", "-m", "r1"), "sigma"),
    ((*_FILL, "--set", "levles=3"), "there is no option 'levles'; see: priorfill methods METHOD"),
    ((*_FILL, "--overrides", "no.toml"), "no.toml"),
    ((*_FILL, "--same-subject", "walk.c3d"), "--same-subject takes another"),
    ((*_FILL, "--add-to-database"), "--database"),
    ((*_FILL, "--only-subject", "me"), "--database"),
    ((*_FILL, "--uncertainty", "out.doc"), "with suffix '.doc'; use .npz or .csv"),
    ((*_FILL, "--uncertainty", "out"), "without a suffix; use"),
    ((*_FILL, "--uncertainty", "out.c3d"), "uncertainty cannot be written"),
    (("fill", "walk.c3d", "-o", "out.tsv"), "a new .tsv file is of Motion-BIDS"),
    (("fill", "walk.c3d", "-o", "out.doc"), "out.doc"),
    (("fill", "walk.c3d", "-o", "out.trc", "--rewrite"), "leave --rewrite out"),
    (("inspect",), "Missing argument"),
    (("inspect", "walk.c3d", "--rate", "0"), "--rate is 0 Hz"),
    (("inspect", "walk.c3d", "--colour"), "--colour"),
    (("methods", "splien"), "did you mean spline?"),
    (("methods", "linear", "spline"), "unexpected extra argument"),
    (("demo", "-m", "nonsense"), "nonsense"),
    (("evaluate",), "Missing argument"),
    (("evaluate", "walk.c3d", "--overwrite"), "--overwrite needs a folder; give one (--output)"),
    (("evaluate", "walk.c3d", "--share", "0"), "--share is 0; give numbers above 0"),
    ((*_EVALUATE, "-p", "rendom"), "did you mean random?"),
    ((*_EVALUATE, "-p", "markers", "--markers", "RNKE"), "did you mean RKNE"),
    ((*_EVALUATE, "-p", "groups", "--groups", "arm"), "did you mean arms"),
    ((*_EVALUATE, "--length", "long"), "no duration"),
    ((*_EVALUATE, "--length", "2-1"), "--length is 2 to 1"),
    ((*_EVALUATE, "--share", "0.9"), "--share"),
    ((*_EVALUATE, "--copies", "0"), "--copies"),
    ((*_EVALUATE, "--seed", "-1"), "--seed"),
    ((*_EVALUATE, "--jobs", "-1"), "--jobs"),
    ((*_EVALUATE, "--plots"), "--output"),
    ((*_EVALUATE, "--exclude-subject", "me"), "--database"),
    ((*_EVALUATE, "-p", "like"), "--like"),
    (("db",), "Usage"),
    (("db", "add", "walk.c3d"), "--database"),
    ((*_ADD, "--up", "sideways"), "sideways"),
    ((*_ADD, "--rate", "0"), "--rate"),
    ((*_ADD, "--unit", "parsec"), "unit 'parsec' is unknown; use one of mm"),
    ((*_ADD, "--unit", "5"), "unit '5' is unknown"),
    (("db", "fetch", "cmu"), "--database"),
    (("db", "fetch", "hmd05", "-d", "db"), "did you mean hdm05?"),
    (("db", "fetch", "cmu", "-d", "db", "--only", "no*", "-y"), "no file matches 'no*'"),
    (("db", "fetch", "cmu", "-d", "db", "--mirror", "host"), "'host' is not a web address"),
    (("db", "export", "-d", "db"), "--output"),
    # names of files that are not there
    (("fill", "no.c3d", "-o", "out.c3d"), "no.c3d: there is no such file; check the name"),
    ((*_FILL, "--same-subject", "no.c3d"), "no.c3d: there is no such file"),
    (("batch", "no.c3d", "walk.c3d", "-o", "out"), "no.c3d: there is no such file or folder"),
    (("batch", "walk.c3d", "-o", "out", "-d", "no"), "no: there is no database"),
    (("batch", "-o", "out"), "out: holds no filled files of a study"),
    (("inspect", "no.c3d"), "no.c3d: there is no such file"),
    (("report", "no.c3d", "walk.c3d", "-o", "out.html"), "no.c3d: there is no such file"),
    (("report", "walk.c3d", "no.c3d", "-o", "out.html"), "no.c3d: there is no such file"),
    ((*_REPORT, "--truth", "no.c3d"), "no.c3d: there is no such file"),
    ((*_REPORT, "--uncertainty", "no.npz"), "no.npz: there is no such file"),
    (("review", "no.c3d"), "no.c3d: there is no such file"),
    (("evaluate", "no.c3d"), "no.c3d: there is no such file"),
    ((*_EVALUATE, "no.c3d", "no.trc"), "no.trc: there is no such file"),
    ((*_EVALUATE, "-p", "like", "--like", "no.c3d"), "no.c3d: there is no such file"),
    ((*_ADD, "no.c3d"), "no.c3d: there is no such file or folder; check the name"),
    ((*_ADD, "no*.c3d"), "no*.c3d: no file or folder matches this pattern"),
    ((*_ADD[:-1], "no.bvh", "--as", "41"), "no.bvh: there is no such file or folder"),
    ((*_ADD, "--as", "41", "--joints", "no.toml"), "no.toml"),
    (("db", "accept", "-d", "db", "no.c3d"), "no.c3d: there is no such file or folder"),
    (("db", "accept", "-d", "db", "walk.c3d", "--original", "no.c3d"), "no.c3d: there is no such"),
    (("db", "fetch", "no.toml", "-d", "db"), "no.toml"),
    # two outputs with one path, and folders that are files
    ((*_FILL, "--report", "o.html", "--plot", "o.html"), "o.html"),
    (("fill", "walk.c3d", "--plot", "out", "--uncertainty", "./out"), "out"),
    (("fill", "walk.c3d", "-o", "o.csv", "--uncertainty", "./o.csv"), "o.csv"),
    (("review", "walk.c3d", "-o", "o.c3d", "--overrides", "./o.c3d"), "o.c3d"),
    (("batch", "walk.c3d", "-o", "walk.c3d"), "walk.c3d: is a file; give a folder"),
)

MALFORMED = (
    (*_FILL, "--marker-set"),
    (*_FILL, "--overrides"),
    ("batch", "walk.c3d", "-o", "out", "--marker-set"),
    ("inspect", "walk.c3d", "--marker-set"),
    ("review", "walk.c3d", "--marker-set"),
    (*_EVALUATE, "--marker-set"),
    (*_ADD, "--as"),
    (*_ADD, "--as", "41", "--joints"),
    ("db", "fetch", "-d", "db"),
)
"""Commands that take a file of settings at their end."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a clip."""
    folder = tmp_path_factory.mktemp("usage")
    write(folder / "walk.c3d", with_gaps(person(seconds=2.0), (20, 30, ["LKNE"])))
    return folder


@pytest.mark.parametrize(("arguments", "message"), WRONG, ids=str)
def test_wrong_usage(
    folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(folder)
    for path in folder.iterdir():
        if path.name != "walk.c3d":  # of a test that failed
            path.unlink()
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit)
    assert message in result.stderr
    assert "`" not in result.stderr
    assert result.stdout == ""
    assert [path.name for path in folder.iterdir()] == ["walk.c3d"]


@pytest.mark.parametrize("text", ["[[gap]\n", "surprise = 1\n"])
@pytest.mark.parametrize("arguments", MALFORMED, ids=str)
def test_malformed_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write("walk.c3d", with_gaps(person(seconds=2.0), (20, 30, ["LKNE"])))
    Path("bad.toml").write_text(text, encoding="utf-8")
    result = CliRunner().invoke(main, [*arguments, "bad.toml"])
    assert result.exit_code == 2, result.output
    assert "bad.toml: " in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.toml", "walk.c3d"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("fill", "bad.c3d", "-o", "out.c3d"),
        ("fill", "walk.c3d", "-o", "out.c3d", "--same-subject", "bad.c3d"),
        ("batch", "bad.c3d", "-o", "out"),
        ("inspect", "bad.c3d"),
        ("report", "walk.c3d", "bad.c3d", "-o", "out.html"),
        ("review", "bad.c3d"),
        ("evaluate", "bad.c3d"),
        ("db", "add", "-d", "db", "bad.c3d"),
        ("db", "accept", "-d", "db", "bad.c3d"),
    ],
    ids=str,
)
def test_wrong_contents_are_no_wrong_usage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    write("walk.c3d", with_gaps(person(seconds=2.0), (20, 30, ["LKNE"])))
    Path("bad.c3d").write_bytes(b"no recording")
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1, result.output
    assert "bad.c3d: " in result.output
