from __future__ import annotations

import pytest

from priorfill.runtime.windows_names import name_fault

pytestmark = pytest.mark.windows


@pytest.mark.parametrize(
    "path",
    [
        "walk 1.c3d",
        r"C:\Jürgen 1\Läufe\walk.c3d",
        "C:walk.c3d",
        "../clips/./walk.c3d",
        r"\\server\share\walk.c3d",
        r"\\?\C:\clips\walk.c3d",
        ".hidden.c3d",
        "console.c3d",
        "com10.c3d",
        "nullable/aux1/con_trial.c3d",
        "歩行.c3d",
    ],
)
def test_names_that_windows_takes(path):
    assert name_fault(path) == ""


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("nul.c3d", "device"),
        ("clips/AUX/walk.c3d", "device"),
        ("con", "device"),
        ("Com1.tar.gz", "device"),
        ("lpt².c3d", "device"),
        ("con .c3d", "device"),
        ("walk:2.c3d", "':'"),
        ("C:/clips/x:y.c3d", "':'"),
        ("what?.c3d", "'?'"),
        ("a*b.c3d", "'*'"),
        ('a"b.c3d', "'\"'"),
        ("a|b.c3d", "allows in no name"),
        ("a\tb.c3d", "allows in no name"),
        ("walk.c3d.", "removes"),
        ("walk.c3d ", "removes"),
        ("clips /walk.c3d", "removes"),
        (".../walk.c3d", "removes"),
    ],
)
def test_names_that_windows_does_not_take(path, reason):
    assert reason in name_fault(path)
