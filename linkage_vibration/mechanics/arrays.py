# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Types of arrays, runs of flags, and what stacks of matrices need."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from linkage_vibration.errors import LinkageVibrationError

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Reals = Sequence[float] | FloatArray  # what `real_numbers` takes
T = TypeVar("T", bound=Any)
_ERFC = np.frompyfunc(math.erfc, 1, 1)  # SciPy's takes long to import


def real_numbers(value: object, name: str) -> FloatArray:
    """Return one real number, or an array of them with one axis; refuse anything else."""
    try:
        numbers = np.asanyarray(value)
    except ValueError:  # lists of different lengths
        numbers = np.array(None)
    masked = isinstance(numbers, np.ma.MaskedArray)
    if masked or numbers.dtype.kind not in "iuf" or numbers.ndim > 1:
        text = " ".join(repr(value).split())
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise LinkageVibrationError(
            f"`{name}` is {shown}; give a real number, or a list or an array of them with one axis."
        )
    return numbers.astype(float)


def real_number(value: object, name: str, hint: str = "call it for each of them") -> float:
    """Return one real number; refuse anything else, an array with a hint."""
    if isinstance(value, float):
        return value
    numbers = real_numbers(value, name)
    if numbers.ndim:
        raise LinkageVibrationError(f"`{name}` is an array in place of one number; {hint}.")
    return float(numbers)


def side_by_side(parts: Sequence[ArrayLike], shape: tuple[int, ...], axis: int) -> FloatArray:
    """Return parts, each broadcast to a shape, along a further axis."""
    both = np.empty((len(parts), *shape))
    for i, part in enumerate(parts):
        both[i] = part
    return np.ascontiguousarray(np.moveaxis(both, 0, axis))


def rows_of(stack: T) -> list[T]:
    """Return the rows of a dataclass all of whose arrays have an axis before."""
    given = {f.name: getattr(stack, f.name) for f in fields(stack)}
    arrays = {name: value for name, value in given.items() if isinstance(value, np.ndarray)}
    rows = zip(*arrays.values(), strict=True)
    return [type(stack)(**given | dict(zip(arrays, row, strict=True))) for row in rows]


def symmetric(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return the symmetric part of matrices, (..., n, n), symmetric to the last bit."""
    return np.asarray((matrices + matrices.swapaxes(-1, -2)) / 2.0)


def real_equations(matrix: ComplexArray) -> FloatArray:
    """Return real parts above imaginary parts: complex equations with real unknowns."""
    return np.concatenate([matrix.real, matrix.imag])


def normal_share(values: FloatArray) -> FloatArray:
    """Return the probability that a standard normal number is below each of the values."""
    return np.asarray(_ERFC(-values / math.sqrt(2.0)), float) / 2.0


def product(factors: NDArray[Any], terms: ComplexArray) -> ComplexArray:
    """Return factors @ terms; if no factor has an imaginary part, that takes half of the time."""
    if np.iscomplexobj(factors) and factors.imag.any():
        return np.asarray(factors @ terms)
    return np.asarray((factors.real @ np.ascontiguousarray(terms).view(float)).view(complex))


def solve_stack(matrices: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve equations, (n, m, m), whose right side is the same for all, (m, k), or not, (n, m, k).

    NumPy 1 would take a right side of two dimensions as one vector for each equation.
    """
    right = np.broadcast_to(right, (len(matrices), *right.shape[-2:]))
    return np.asarray(np.linalg.solve(matrices, right))


def runs(flags: BoolArray, *columns: NDArray[Any]) -> list[tuple[int, int]]:
    """Return start and end (exclusive) of runs of true flags, (n,), in which no column changes."""
    changed = np.ones(len(flags) + 1, dtype=bool)
    changed[1:-1] = np.any([c[1:] != c[:-1] for c in (flags, *columns)], axis=0)
    edges = np.flatnonzero(changed).tolist()
    return [(i, j) for i, j in itertools.pairwise(edges) if flags[i]]
