# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of flags are found where they are, also at the ends of an array."""

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import runs


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ([True, True, False, True], [(0, 2), (3, 4)]),
        ([False, True, True, False], [(1, 3)]),
        ([False], []),
        ([], []),
    ],
)
def test_runs_of_flags(flags: list[bool], expected: list[tuple[int, int]]) -> None:
    """Each run of true flags is found with its start and its exclusive end."""
    assert runs(np.array(flags, dtype=bool)) == expected


def test_runs_end_where_a_column_changes() -> None:
    """A run ends where one of the columns has another value."""
    actual = runs(
        np.array([True] * 5), np.array(["a", "a", "b", "b", "b"]), np.array([1, 1, 1, 1, 2])
    )
    assert actual == [(0, 2), (2, 4), (4, 5)]
