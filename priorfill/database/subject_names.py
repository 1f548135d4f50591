"""Tell names of subjects from words that programs put in their place."""

from __future__ import annotations

import re

__all__ = ["subject_name"]

_WORDS = """
actor athlete character child default demo dummy female figure human kid male man mocap model na new
noname none null participant patient performer person player skeleton subj subject test tester trial
undefined unknown unnamed untitled user volunteer woman xxx
"""
_PLACEHOLDERS = frozenset(_WORDS.split())
"""Words that are no names: in files of the CMU and other libraries, and by default in programs."""


def subject_name(text: str) -> str:
    """Return the name of a subject that a file states; empty if the text is no name.

    Two files with the subject ``male`` need not be of one person, while ``subject 7`` or ``S07``
    may be how a laboratory numbers its subjects.

    Parameters
    ----------
    text : str
        The subject according to the file.
    """
    words = [word for word in re.split(r"[\s_\-.<>()\[\]]+", text.casefold()) if word]
    return "" if all(word in _PLACEHOLDERS for word in words) else text.strip()
