# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Shows on a terminal how much of a table, a file or a list of results is done, if that is slow."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

Map = Callable[..., Iterable[Any]]
"""A function like `map`: it may return futures, as that of a Dask client does."""

_LAYOUT = "{desc}: {percentage:3.0f} % of the table |{bar}| {elapsed}, {postfix}"


class Progress:
    """Shows the finished fraction of a table after each solution of a model."""

    def __init__(self, bar: Any) -> None:
        self.solutions, self._bar = 0, bar

    def __call__(self, finished: float) -> None:
        """Show a fraction, as `build_table` calls its ``progress``."""
        self.solutions += 1
        self._bar.set_postfix_str(f"{self.solutions} solutions", refresh=False)
        self._bar.update(finished - self._bar.n)


@contextmanager
def table_bar(name: str) -> Iterator[Progress]:
    """Give what shows the progress of building a table."""
    from tqdm import tqdm

    with tqdm(
        disable=None, desc=name, total=1.0, delay=2.0, bar_format=_LAYOUT, leave=False
    ) as bar:
        yield Progress(bar)


@contextmanager
def shown_bar(path: Path, total: int, unit: str = "B") -> Iterator[Any]:
    """Give a bar of what is read of a file, or written to it, in bytes or another unit."""
    from tqdm import tqdm

    about: dict[str, Any] = {"desc": path.name, "total": total, "unit": unit, "unit_scale": True}
    with tqdm(disable=None, delay=2.0, leave=False, **about) as bar:
        yield bar


@contextmanager
def read_with_bar(path: Path) -> Iterator[Any]:
    """Open a file that is read as a whole, with a bar."""
    from tqdm.utils import CallbackIOWrapper

    with path.open("rb") as file, shown_bar(path, path.stat().st_size) as bar:
        yield CallbackIOWrapper(bar.update, file, "read")


def gathered(results: Iterable[Any], total: int) -> list[Any]:
    """Return results, of which those of a cluster are futures."""
    from tqdm import tqdm

    bar = tqdm(results, total=total, disable=None, delay=2.0)
    return [each.result() if hasattr(each, "result") else each for each in bar]
