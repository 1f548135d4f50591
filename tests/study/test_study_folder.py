"""The folder of a study: one study at a time, or the tasks of one."""

from __future__ import annotations

from pathlib import Path

import pytest

from priorfill.errors import OptionError, OutputError
from priorfill.study import study_folder
from priorfill.study.study_folder import StudyFolder


@pytest.mark.windows
def test_one_study_at_a_time(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_folder, "_WAIT_SECONDS", 0.0)
    folder = StudyFolder(here / "out")
    held = pytest.raises(OutputError, match="another process fills a study there")
    with folder.locked(), held, folder.locked():
        pass
    held = pytest.raises(OutputError, match="another process")
    with folder.locked(), held, folder.locked(1):
        pass
    with folder.locked(1), folder.locked(2):
        for task in (None, 2):
            held = pytest.raises(OutputError, match="another process")
            with held, folder.locked(task):
                pass
    with folder.locked():
        pass


def test_a_file_is_no_folder(here: Path) -> None:
    Path("out").write_bytes(b"")
    with pytest.raises(OptionError, match="is a file; give a folder"):
        StudyFolder(here / "out").check(0)
