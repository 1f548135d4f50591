"""Trouble: measured samples that cannot be what they are labelled as."""

from priorfill.artefacts.artefact import KINDS, Artefact
from priorfill.artefacts.detect import artefact_samples, find_artefacts, without_artefacts

__all__ = ["KINDS", "Artefact", "artefact_samples", "find_artefacts", "without_artefacts"]
