# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads components from matrices in ``.npz``.

A file holds ``mass``, ``stiffness`` and optionally ``damping``, which are square, real and
symmetric, in kg, m, N, s and rad, and ``dofs``, an array with one text for each row: a point and a
direction (``P1 x``, ``P1 theta``), or ``-`` for an inner coordinate, physical or modal. Rows after
the last entry are inner coordinates too. In the planar model, rows named y are held, as the plane
of motion is a plane of symmetry.

Matrix Market and MATLAB files become such a file by ``scipy.io.mmread``, ``scipy.io.loadmat`` and
``numpy.savez``.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.dofs import Dofs, InterfaceDof
from linkage_vibration.readers.component_files import (
    ComponentFileError,
    FileError,
    choose_rows,
    file_errors,
    load_npz,
    parse_dofs,
)

MAX_ROWS = 3000
"""The most rows of a component."""

# Share of the geometric mean of the diagonal entries; files with seven digits pass.
_ASYMMETRY = 1e-6
# The stiffness of a free body has eigenvalues of zero, which rounding makes slightly negative. They
# are accepted if motion grows by less than this (0.1 Hz, a thousandth per second), or if they are
# no larger than the rounding of the largest eigenvalue.
_ACCEPTED = {"stiffness": (2.0 * math.pi * 0.1) ** 2, "damping": 1e-3}
_ROUNDING = 1e-13

# A free body resists a translation by less than this share of its stiffness, which may be zero, and
# the stiffness of a mode of 0.1 Hz together.
_RESISTS = 1e-4


def read_matrices(path: Path) -> Matrices:
    """Read and check the matrices of a component from ``.npz``; rows named y are held."""
    if path.suffix.lower() != ".npz":
        hint = "give a .npz file, written by `numpy.savez` (`scipy.io.loadmat` reads MATLAB files, "
        hint += "`scipy.io.mmread` Matrix Market)"
        raise ComponentFileError(f"{path}: is not a file of matrices; {hint}.")
    with file_errors(path):
        arrays = load_npz(path, ("dofs", "mass", "stiffness"), ("damping",))
        names = np.ravel(arrays.pop("dofs")).tolist()
        # The mass comes first, with which the others are compared.
        matrices = {"mass": arrays["mass"], **arrays}
        for name, matrix in matrices.items():
            _check_kind(name, matrix, _size(matrices["mass"]))
        dofs, order, labels = _order(names, len(matrices["mass"]))
        for name, matrix in matrices.items():
            matrix = matrix.astype(np.float64)[np.ix_(order, order)]
            _check(labels, name, matrix, matrix if name == "mass" else matrices["mass"])
            matrices[name] = (matrix + matrix.T) / 2.0
        _check_free(dofs, *_condensed(dofs, matrices["mass"], matrices["stiffness"]))
    return Matrices(dofs, matrices["mass"], matrices["stiffness"], matrices.get("damping"))


def _order(names: Sequence[object], n: int) -> tuple[Dofs, NDArray[np.intp], list[str]]:
    """Return the interface DoFs, and the row and the name of each row to keep, theirs first."""
    if len(names) > n:
        raise FileError(f"has {len(names)} entries in dofs for {n} rows; remove some.")
    named = [*parse_dofs(names), *[None] * (n - len(names))]
    held = {row for row, dof in enumerate(named) if dof and dof.direction == "y"}
    dofs, rows = choose_rows([None if row in held else dof for row, dof in enumerate(named)])
    order = np.array(rows + sorted(set(range(n)) - held.union(rows)))
    inner = "(counted from 1, an inner coordinate)"
    labels = [str(named[row] or f"row {row + 1} {inner}") for row in order]
    return dofs, order, labels


def _check_kind(name: str, matrix: NDArray[Any], mass: str) -> None:
    """Raise an error unless a matrix is square and real, and as large as the mass."""
    if matrix.dtype.kind not in "fiu":
        what = "complex" if matrix.dtype.kind == "c" else "not of numbers"
        problem = f"{name} is {what}; write real numbers, and damping as a matrix of its own."
        raise FileError(problem)
    if matrix.ndim != 2 or len(set(matrix.shape)) != 1 or not matrix.size:
        raise FileError(f"{name} is {_size(matrix)}; write a square matrix.")
    if _size(matrix) != mass:
        raise FileError(f"{name} is {_size(matrix)}, but mass is {mass}; correct one.")
    if len(matrix) > MAX_ROWS:
        problem = f"{name} has {len(matrix)} rows, more than {MAX_ROWS}"
        hint = "reduce the component before you write the file (Craig and Bampton)"
        raise FileError(f"{problem}; {hint}.")


def _size(matrix: NDArray[Any]) -> str:
    return " by ".join(map(str, matrix.shape))


def _accepted(name: str, matrix: FloatArray, mass: FloatArray) -> FloatArray:
    """Return the multiple of the mass that makes a matrix positive despite its rounding."""
    largest = float(np.max(matrix.diagonal() / mass.diagonal()))
    with np.errstate(over="ignore"):  # a mass beyond all, which a later check refuses
        return max(_ACCEPTED[name], _ROUNDING * largest) * mass


def _check(labels: Sequence[str], name: str, matrix: FloatArray, mass: FloatArray) -> None:
    """Raise an error unless a matrix is finite, symmetric and positive; check the mass first."""
    if not np.isfinite(matrix).all():
        i, j = np.argwhere(~np.isfinite(matrix))[0]
        raise FileError(f"{name} is not finite at {labels[i]}, {labels[j]}; write it again.")
    whole = matrix if name == "mass" else matrix + _accepted(name, matrix, mass)
    diagonal = whole.diagonal()
    if diagonal.min() <= 0.0:
        raise _not_positive(name, labels[int(diagonal.argmin())])
    with np.errstate(over="ignore"):  # so asymmetric that it is refused
        scale = np.sqrt(diagonal)
        sizes = np.abs(matrix - matrix.T) / scale / scale[:, np.newaxis]
    if sizes.max() > _ASYMMETRY:
        i, j = divmod(int(sizes.argmax()), len(sizes))
        one, other = f"at {labels[i]}, {labels[j]}", f"at {labels[j]}, {labels[i]}"
        both = f"{matrix[i, j]:.6g} {one} and {matrix[j, i]:.6g} {other}"
        problem = f"differ by {sizes[i, j]:.1e} of their diagonal entries"
        raise FileError(f"{name} is not symmetric: {both} {problem}; write it again.")
    _, info = scipy.linalg.lapack.dpotrf(whole)
    if info:
        raise _not_positive(name, labels[info - 1])


def _not_positive(name: str, label: str) -> FileError:
    if name == "mass":
        problem, fix = "definite", "remove massless coordinates, or reduce them statically"
    else:
        problem = "semi-definite"
        fix = "look for a wrong sign or row, and write every digit (%.17g)"
    return FileError(f"{name} is not positive {problem} at {label}; {fix}.")


def _condensed(
    dofs: Sequence[InterfaceDof], mass: FloatArray, stiffness: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what a free component may resist at most, and its condensed stiffness, (n, n)."""
    first, inner = slice(len(dofs)), slice(len(dofs), None)
    held, cross = stiffness[inner, inner], stiffness[inner, first]
    at_most = (_RESISTS * stiffness + _ACCEPTED["stiffness"] * mass).diagonal()[first]
    if not held.size:
        return at_most, stiffness
    try:
        # Rounding may hide that a matrix is singular, so modes below 0.1 Hz count as free.
        scipy.linalg.cho_factor(held - _accepted("stiffness", held, mass[inner, inner]))
        inward = scipy.linalg.cho_solve(scipy.linalg.cho_factor(held), cross)
    except np.linalg.LinAlgError:
        problem = f"can still move when {', '.join(map(str, dofs))} are held"
        hint = "make more rows interface DoFs, or fix them before you write the matrices"
        raise FileError(f"{problem}; {hint}.") from None
    return at_most, stiffness[first, first] - cross.T @ inward


def _check_free(dofs: Sequence[InterfaceDof], at_most: FloatArray, stiffness: FloatArray) -> None:
    """Raise an error if something holds a component, by its condensed stiffness."""
    for direction in ("x", "z"):
        moved = np.array([float(dof.direction == direction) for dof in dofs])
        if moved @ stiffness @ moved > moved @ at_most:
            problem = f"resists a translation along {direction}, as if it were held"
            hint = "write the matrices of the free component, without boundary conditions"
            raise FileError(f"{problem}; {hint}.")
