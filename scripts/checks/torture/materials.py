"""What all rounds share: clips in files, and two databases of them."""

from __future__ import annotations

from pathlib import Path

from priorfill.database import PriorDatabase
from torture.clips import Stored, fill_of, make_clip, must_be

PLAN_CLIPS = 24
"""Number of clips a driver starts with; every other one has gaps to fill."""

OTHER_CLIPS = 10
"""Number of clips in the database that is merged; three are in both."""


class Materials:
    """Files of clips, a database of some, and another one to merge.

    Parameters
    ----------
    work : Path
        An empty folder, or one to be made.
    files : int
        Number of clips.

    Attributes
    ----------
    files, start, to_merge : Path
        The folders.
    paths : list of Path
        The files.
    known : dict
        Expected contents of each version, by clip name.
    own, other : dict
        The versions of the clips in the two databases.
    """

    def __init__(self, work: Path, files: int) -> None:
        from priorfill import formats

        self.known: dict[str, dict[str, Stored]] = {}
        self.files = work / "files"
        self.files.mkdir(parents=True)
        self.paths: list[Path] = []
        plan_clips = min(PLAN_CLIPS, files * 2 // 3)
        other_clips = min(OTHER_CLIPS, files - plan_clips)
        for number in range(files):
            path = self.files / f"clip{number:03d}.c3d"
            formats.write(path, make_clip(number, gappy=number % 2 == 1))
            clip = formats.read(path)
            self.known[path.stem] = {"gappy" if number % 2 else "whole": must_be(clip)}
            if number % 2:
                self.known[path.stem]["filled"] = must_be(*fill_of(clip))
            self.paths.append(path)
        names = [path.stem for path in self.paths]
        self.own = {name: next(iter(self.known[name])) for name in names[:plan_clips]}
        others = names[plan_clips - 3 : plan_clips - 3 + other_clips]
        self.other = {name: next(iter(self.known[name])) for name in others}
        self.start, self.to_merge = work / "start", work / "other"
        for folder, clips in ((self.start, self.own), (self.to_merge, self.other)):
            with PriorDatabase.create(folder) as database:
                for name in clips:
                    database.add(formats.read(self.files / f"{name}.c3d"))
