# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Shows on a terminal how much of a table is built."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LAYOUT = "{desc}: {percentage:3.0f} % of the stroke |{bar}| {elapsed}, {postfix}"


@contextmanager
def table_bar(name: str) -> Iterator[Callable[[float], None]]:
    """Give a function that shows the finished fraction of the stroke, if building takes long.

    It is called after each solution of the model, as `build_table` calls its ``progress``.
    """
    from tqdm import tqdm

    with tqdm(
        disable=None, desc=name, total=1.0, delay=2.0, bar_format=_LAYOUT, leave=False
    ) as bar:
        solutions = 0

        def show(finished: float) -> None:
            nonlocal solutions
            solutions += 1
            bar.set_postfix_str(f"{solutions} solutions", refresh=False)
            bar.update(finished - bar.n)

        yield show
