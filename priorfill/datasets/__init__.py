"""Free data sets of recordings: which are known, and how to download them.

Only `fetch` uses the network, and only when called.
"""

from __future__ import annotations

from priorfill.datasets.dataset_definitions import (
    Dataset,
    DatasetFile,
    find_dataset,
    known_datasets,
)
from priorfill.datasets.fetch_dataset import FetchOptions, FetchResult, fetch
from priorfill.datasets.retry_policy import RetryPolicy

__all__ = [
    "Dataset",
    "DatasetFile",
    "FetchOptions",
    "FetchResult",
    "RetryPolicy",
    "fetch",
    "find_dataset",
    "known_datasets",
]
