# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of flags are found also at the ends of an array, and products are those of matrices."""

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import product, runs


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


@pytest.mark.parametrize("factor", [1.0, 1.0 + 0.0j, 1.0 + 1e-9j])
def test_a_product_with_factors_that_are_real_or_not(factor: complex) -> None:
    """It is the sum on paper, of terms that are not contiguous, too."""
    factors, terms = factor * np.array([[1.0, 2.0]]), np.array([[3.0, 4.0j], [5.0, 6.0]])
    assert product(factors, terms).tolist() == [[13.0 * factor, (12.0 + 4.0j) * factor]]
    assert product(factors, terms.T).tolist() == [[(3.0 + 8.0j) * factor, 17.0 * factor]]
