"""Trouble: measured samples that cannot be what they are labelled as."""

from priorfill.trouble.find import find_trouble, troubled_samples, without_trouble
from priorfill.trouble.kinds import KINDS, Trouble

__all__ = ["KINDS", "Trouble", "find_trouble", "troubled_samples", "without_trouble"]
