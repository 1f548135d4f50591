"""Free libraries of recordings: which there are, and how to get them.

`fetch` alone asks a network for something, and only when it is called.
"""

from __future__ import annotations

from priorfill.datasets.catalogue import (
    Dataset,
    DatasetFile,
    find_dataset,
    known_datasets,
)
from priorfill.datasets.download import RetryPolicy
from priorfill.datasets.fetch import Fetched, fetch

__all__ = [
    "Dataset",
    "DatasetFile",
    "Fetched",
    "RetryPolicy",
    "fetch",
    "find_dataset",
    "known_datasets",
]
