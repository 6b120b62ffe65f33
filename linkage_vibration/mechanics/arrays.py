# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Types of arrays, runs of flags, and what stacks of matrices need."""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


def symmetric(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return the symmetric part of matrices, (..., n, n), symmetric to the last bit."""
    return np.asarray((matrices + matrices.swapaxes(-1, -2)) / 2.0)


def real_equations(matrix: ComplexArray) -> FloatArray:
    """Return real parts above imaginary parts: complex equations with real unknowns."""
    return np.concatenate([matrix.real, matrix.imag])


def solve_stack(matrices: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve equations, (n, m, m), whose right side is the same for all, (m, k), or not, (n, m, k).

    NumPy 1 takes a right side of two dimensions as one vector for each equation, but NumPy 2 takes
    it as one matrix, so it always gets three dimensions.
    """
    right = np.broadcast_to(right, (len(matrices), *right.shape[-2:]))
    return np.asarray(np.linalg.solve(matrices, right))


def runs(flags: BoolArray, *columns: NDArray[Any]) -> list[tuple[int, int]]:
    """Return the start and the end (exclusive) of each run of true flags, (n,).

    A run also ends where the value of a column, (n,), changes.
    """
    changed = np.ones(len(flags) + 1, dtype=bool)
    changed[1:-1] = np.any([c[1:] != c[:-1] for c in (flags, *columns)], axis=0)
    edges = np.flatnonzero(changed).tolist()
    return [(i, j) for i, j in itertools.pairwise(edges) if flags[i]]
