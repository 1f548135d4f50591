"""Artefacts: measured samples that cannot belong to the marker they are labelled as."""

from priorfill.artefacts.artefact import KINDS, Artefact
from priorfill.artefacts.artefact_options import ArtefactOptions
from priorfill.artefacts.detect import artefact_samples, find_artefacts, without_artefacts

__all__ = [
    "KINDS",
    "Artefact",
    "ArtefactOptions",
    "artefact_samples",
    "find_artefacts",
    "without_artefacts",
]
