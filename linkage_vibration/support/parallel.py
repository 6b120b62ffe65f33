# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Results of functions like `map`, which may be that of a pool or of a cluster."""

from collections.abc import Callable, Iterable
from typing import Any

from tqdm import tqdm

Map = Callable[..., Iterable[Any]]
"""A function like `map`: it may return futures, as that of a Dask client does."""


def gathered(results: Iterable[Any], total: int) -> list[Any]:
    """Return results, of which those of a cluster are futures, and show the progress."""
    bar = tqdm(results, total=total, disable=None, delay=2.0)
    return [each.result() if hasattr(each, "result") else each for each in bar]
