"""``priorfill methods``."""

from __future__ import annotations

import json

from click.testing import CliRunner

from priorfill.cli import main
from priorfill.methods import METHODS, get_options
from priorfill.methods.options import differing, with_values


def test_methods() -> None:
    result = CliRunner().invoke(main, ["methods"])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["method", "what", "it", "does", "source"]
    assert [line.split()[0] for line in lines[1:-1] if line[0] != " "] == list(METHODS)
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "auto is gpr."


def test_methods_as_json() -> None:
    listed = json.loads(CliRunner().invoke(main, ["methods", "--json"]).stdout)
    assert listed["linear"] == {"summary": "linear interpolation over time", "source": "SciPy"}
    assert list(listed) == list(METHODS)


def test_options_of_a_method() -> None:
    result = CliRunner().invoke(main, ["methods", "r1"])
    assert result.exit_code == 0, result.output
    lines = [line.split() for line in result.stdout.splitlines()]
    assert lines[0] == ["option", "default"]
    assert ["sigma", "200"] in lines
    assert json.loads(CliRunner().invoke(main, ["methods", "r1", "--json"]).stdout)["sigma"] == 200
    assert CliRunner().invoke(main, ["methods", "linear"]).stdout == "linear has no options.\n"
    refused = CliRunner().invoke(main, ["methods", "splien"])
    assert refused.exit_code == 2
    assert "there is no method 'splien'; did you mean spline?" in refused.stderr


def test_listed_defaults_can_be_set() -> None:
    """Every option is printed in the form in which it is read, without loss."""
    for method, entry in METHODS.items():
        if entry.options_class is None:
            continue
        listed = CliRunner().invoke(main, ["methods", method]).stdout.splitlines()[1:]
        values = dict(line.split(maxsplit=1) for line in listed if len(line.split()) > 1)
        default = get_options(method)
        assert differing(with_values(default, values)) == {}, method
