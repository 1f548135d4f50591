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
)


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
