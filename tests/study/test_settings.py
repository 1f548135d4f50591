"""Options of fills as JSON: what comes back is what was given."""

from __future__ import annotations

import json
import math

import pytest

from priorfill.database import Selection
from priorfill.errors import OptionError
from priorfill.filling.fill_file import FileOptions
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.markers.definitions import load
from priorfill.methods import get_options
from priorfill.methods.options import with_values
from priorfill.study.settings import FillSettings

SETTINGS = FillSettings(
    "gpr",
    GapFilter(("L*",), (3, None), "10f", skip_edges=True),
    True,
    FileOptions(up="+Y", rate=100.0, zeros_missing=False),
    FillOptions(
        {"max_expected_error": 50.0},
        Selection(not_subjects=("anna",)),
        True,
        load("plug-in-gait"),
        math.inf,
        12.0,
        PlausibilityOptions(max_speed_ratio=math.inf),
        estimate_errors=False,
    ),
)


def test_settings_survive_json() -> None:
    text = json.dumps(SETTINGS.to_json() | {"of_a_later_version": 1})
    assert FillSettings.from_json(json.loads(text)) == SETTINGS


def test_the_same_options_are_the_same_settings_however_they_are_given() -> None:
    by_text = FillSettings("auto", options=FillOptions({"max_expected_error": "50"}))
    as_class = with_values(get_options("gpr"), {"max_expected_error": 50.0})
    by_class = FillSettings("gpr", options=FillOptions(as_class))
    assert by_text.to_json() == by_class.to_json()


@pytest.mark.parametrize(
    ("files", "match"),
    [
        (FileOptions(report="a.html"), r"`report`.*StudyOptions\(report=True\)"),
        (FileOptions(plot="a.png"), "`plot` is an option of one file"),
    ],
)
def test_options_of_one_file_are_refused(files: FileOptions, match: str) -> None:
    with pytest.raises(OptionError, match=match):
        FillSettings(files=files)


def test_wrong_options_of_methods_are_refused() -> None:
    with pytest.raises(OptionError, match="did you mean"):
        FillSettings(options=FillOptions({"max_expected_eror": 50.0}))
    with pytest.raises(OptionError, match="there is no method"):
        FillSettings("grp")
