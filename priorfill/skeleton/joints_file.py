"""Read which joints of a skeleton are which parts of the body, as a user's file names them."""

from __future__ import annotations

from pathlib import Path

from priorfill.errors import MarkerSetError
from priorfill.runtime.toml_file import read_toml
from priorfill.skeleton.part_names import LIMBS, PARTS, SIDES

__all__ = ["read_joint_names"]

_SIDE = "{s}"


def read_joint_names(file: Path) -> dict[str, str]:
    """Return the names of joints by part of the body.

    Parameters
    ----------
    file : Path
        A TOML file with a table ``[parts]``. Its keys are parts (``left_thigh``), or parts of both
        sides (``thigh``), whose names hold ``{s}`` for the two words of ``sides``.

    Raises
    ------
    MarkerSetError
        If the file cannot be read, or is not such a file.
    """
    content = read_toml(file, MarkerSetError)
    table, sides = content.get("parts"), content.get("sides", [])
    if not isinstance(table, dict) or not table:
        raise MarkerSetError(
            f'{file}: has no table [parts] with lines such as left_thigh = "LeftUpLeg"; add it'
        )
    if not isinstance(sides, list) or not all(isinstance(side, str) for side in sides):
        raise MarkerSetError(f'{file}: sides must be two words such as ["Left", "Right"]')
    names: dict[str, str] = {}
    for part, name in table.items():
        if not isinstance(name, str):
            raise MarkerSetError(f"{file}: {part} is not a name in quotes; correct it")
        if part in PARTS:
            names[part] = name
        elif part not in LIMBS:
            raise MarkerSetError(
                f"{file}: part {part!r} is unknown; use some of {', '.join(PARTS)}"
            )
        elif _SIDE not in name or len(sides) != len(SIDES):
            raise MarkerSetError(
                f"{file}: {part} is a part of both sides: write {_SIDE} in its name, and sides = "
                '["Left", "Right"] with the two words for it; or give left_ and right_ parts'
            )
        else:
            for side, word in zip(SIDES, sides, strict=True):
                names[f"{side}_{part}"] = name.replace(_SIDE, word)
    return names
