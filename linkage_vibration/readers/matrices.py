# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads components from matrices in ``.npz``.

A file holds ``mass``, ``stiffness`` and optionally ``damping``, which are square, real and
symmetric, in kg, m, N, s and rad, and ``dofs``, an array with one text for each row: a point and a
direction (``P1 x``, ``P1 theta``), or ``-`` for an inner coordinate, physical or modal. Rows after
the last entry, and named rows that are not wanted, are inner coordinates too and move freely. In
the planar model, however, rows named y are held, as the plane of motion is a plane of symmetry.

A matrix is one array, or a sparse one the three arrays of its compressed rows or columns:
``mass_data``, ``mass_indices``, ``mass_indptr``. Matrix Market and MATLAB files become such a file
by ``scipy.io.mmread`` or ``scipy.io.loadmat``, and ``numpy.savez``.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor
from scipy.linalg.lapack import dpotrf
from scipy.sparse.linalg import splu

from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.reduction import ReductionError
from linkage_vibration.mechanics.solids import sparse_craig_bampton
from linkage_vibration.readers.component_files import (
    ComponentFileError,
    FileError,
    choose_rows,
    compressed_columns,
    file_errors,
    load_npz,
    parse_dofs,
)

FloatArray = NDArray[np.float64]

MAX_WHOLE = 3000
"""The most rows of a component that is used as it is; larger ones are reduced while sparse."""
MAX_ROWS = 1_000_000

_NAMES = ("mass", "stiffness", "damping")
_PARTS = ("data", "indices", "indptr")
_KNOWN = ("dofs", *_NAMES, *(f"{name}_{part}" for name in _NAMES for part in _PARTS))

_ASYMMETRY = (
    1e-6  # share of the geometric mean of the diagonal entries; files with seven digits pass
)
# The stiffness of a free body has eigenvalues of zero, which rounding makes slightly negative. They
# are accepted if motion grows by less than this (0.1 Hz, a thousandth per second), or if they are
# no larger than the rounding of the largest eigenvalue.
_ACCEPTED = {"stiffness": (2.0 * math.pi * 0.1) ** 2, "damping": 1e-3}
_ROUNDING = 1e-13

_FASTEST = 1e30  # 1/s2 or 1/s, greatest plausible ratio to the mass


def read_matrices(
    path: Path, dofs: Sequence[InterfaceDof] | None = None, modes: int | None = None
) -> Matrices:
    """Read and check the matrices of a component from ``.npz``.

    The interface DoFs are in the order given (by default all of the file). A component with more
    than `MAX_WHOLE` rows keeps some fixed-interface modes (Craig-Bampton). Rows named y are held.
    A ComponentFileError names the file and the fix.
    """
    if path.suffix.lower() != ".npz":
        raise ComponentFileError(
            f"{path}: is not a file of matrices; give a .npz file, written by `numpy.savez` "
            "(`scipy.io.loadmat` reads MATLAB files, `scipy.io.mmread` Matrix Market)."
        )
    with file_errors(path):
        matrices, names = _read(path)
        matrices = _plain_matrices(matrices)
        dofs, order, labels = _order(names, dofs, matrices["mass"].shape[0])
        for name, matrix in matrices.items():
            matrix = matrix[order][:, order]
            _check(labels, name, matrix, matrices["mass"])
            matrices[name] = (matrix + matrix.T) / 2.0
        if sparse.issparse(matrices["mass"]):
            matrices = _reduce(matrices, len(dofs), modes)
        if len(matrices["mass"]) > len(dofs):
            _check_held(dofs, matrices["mass"], matrices["stiffness"])
    return Matrices(dofs, matrices["mass"], matrices["stiffness"], matrices.get("damping"))


def _plain_matrices(matrices: dict[str, Any]) -> dict[str, Any]:
    """Return mass, stiffness and perhaps damping as matrices of floats of one size."""
    for name in ("mass", "stiffness"):
        if name not in matrices:
            raise FileError(f"has no {name}; add it.")
    matrices = {name: _plain(name, matrices[name]) for name in _NAMES if name in matrices}
    size = _size(matrices["mass"])
    for name, matrix in matrices.items():
        if _size(matrix) != size:
            raise FileError(f"{name} is {_size(matrix)}, but mass is {size}; correct one.")
    return matrices


def _order(
    names: Sequence[object], wanted: Sequence[InterfaceDof] | None, n: int
) -> tuple[tuple[InterfaceDof, ...], NDArray[np.intp], list[str]]:
    """Return the interface DoFs, and the row and the name of each row to keep, theirs first."""
    if len(names) > n:
        raise FileError(f"has {len(names)} entries in dofs for {n} rows; remove some.")
    named = parse_dofs(names)
    held = {row for row, dof in enumerate(named) if dof and dof.direction == "y"}
    there = [None if row in held else dof for row, dof in enumerate(named)]
    dofs, rows = choose_rows(there, wanted)
    order = np.array(rows + sorted(set(range(n)) - held.union(rows)))
    labels = [
        str(named[row])
        if row < len(named) and named[row] is not None
        else f"row {row + 1} (counted from 1, an inner coordinate)"
        for row in order
    ]
    return dofs, order, labels


def _read(path: Path) -> tuple[dict[str, Any], list[object]]:
    arrays = load_npz(path, _KNOWN)
    matrices: dict[str, Any] = {}
    for name in _NAMES:
        parts = [f"{name}_{part}" for part in _PARTS]
        there = [part for part in parts if part in arrays]
        if name in arrays and there:
            raise FileError(f"has both {name} and {there[0]}; remove one.")
        if name in arrays:
            matrices[name] = arrays[name]
        elif there:
            if there != parts:
                raise FileError(f"has a sparse {name} without all of {', '.join(parts)}; add them.")
            data, indices, indptr = (arrays[part] for part in parts)
            n = indptr.size - 1
            if n > MAX_ROWS:
                raise FileError(f"{name} has {n} rows; reduce it to {MAX_ROWS} or fewer.")
            try:
                matrices[name] = compressed_columns(data, indices, indptr, n)
            except ValueError as error:
                raise FileError(f"{name} is invalid, as {error}; write it again.") from None
    if "dofs" not in arrays:
        raise FileError("has no dofs; add one for each row.")
    return matrices, np.ravel(arrays["dofs"]).tolist()


def _plain(name: str, matrix: Any) -> Any:
    """Return a matrix of floats, sparse if it is too large to be used as it is."""
    if matrix.dtype.kind not in "fiu":
        what = "complex" if matrix.dtype.kind == "c" else "not of numbers"
        raise FileError(
            f"{name} is {what}; write real numbers, and damping as a matrix of its own."
        )
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.shape[0] == 0:
        raise FileError(f"{name} is {_size(matrix)}; write a square matrix.")
    if matrix.shape[0] > MAX_WHOLE:
        return sparse.csc_array(matrix, dtype=np.float64)
    whole = matrix.toarray() if sparse.issparse(matrix) else matrix
    return np.asarray(whole, dtype=np.float64)


def _size(matrix: Any) -> str:
    return " by ".join(map(str, matrix.shape))


def _accepted(name: str, matrix: Any, mass: Any) -> Any:
    """Return the multiple of the mass that makes a matrix positive despite its rounding."""
    largest = float(np.max(matrix.diagonal() / mass.diagonal()))
    return max(_ACCEPTED[name], _ROUNDING * largest) * mass


def _check(labels: Sequence[str], name: str, matrix: Any, mass: Any) -> None:
    """Raise an error unless a matrix is finite, symmetric and positive; check the mass first."""
    entries = sparse.coo_array(matrix)
    wrong = np.flatnonzero(~np.isfinite(entries.data))
    if wrong.size:
        i, j = entries.row[wrong[0]], entries.col[wrong[0]]
        raise FileError(f"{name} is not finite at {labels[i]}, {labels[j]}; write it again.")

    if name != "mass":
        with np.errstate(over="ignore"):
            rates = matrix.diagonal() / mass.diagonal()
        if rates.max() > _FASTEST:
            label = labels[int(rates.argmax())]
            raise FileError(
                f"{name} is {rates.max():.1g} times the mass at {label}, which is implausible; "
                "write both in kg, m, N, s."
            )
    whole = matrix if name == "mass" else matrix + _accepted(name, matrix, mass)
    diagonal = whole.diagonal()
    _check_positive(labels, name, diagonal)
    odd = sparse.coo_array(matrix - matrix.T)
    with np.errstate(over="ignore"):
        sizes = np.abs(odd.data) / np.sqrt(diagonal[odd.row]) / np.sqrt(diagonal[odd.col])
    if sizes.max(initial=0.0) > _ASYMMETRY:
        worst = int(sizes.argmax())
        i, j = odd.row[worst], odd.col[worst]
        raise FileError(
            f"{name} is not symmetric: {matrix[i, j]:.6g} at {labels[i]}, {labels[j]} and "
            f"{matrix[j, i]:.6g} at {labels[j]}, {labels[i]} differ by {sizes[worst]:.1e} of "
            "their diagonal entries; write it again."
        )

    if sparse.issparse(whole):
        try:
            factor = splu(
                whole.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:
            raise _not_positive(name, "some DoF") from None
        # SuperLU has its pivots in the order of perm_c.
        _check_positive(labels, name, factor.U.diagonal()[factor.perm_c])
    else:
        _, info = dpotrf(whole)
        if info:
            raise _not_positive(name, labels[info - 1])


def _check_positive(labels: Sequence[str], name: str, pivots: FloatArray) -> None:
    worst = int(pivots.argmin())
    if pivots[worst] <= 0.0:
        raise _not_positive(name, labels[worst])


def _not_positive(name: str, label: str) -> FileError:
    if name == "mass":
        problem, fix = "definite", "remove massless coordinates, or reduce them statically"
    else:
        problem = "semi-definite"
        fix = "look for a wrong sign or row, and write every digit (%.17g)"
    return FileError(f"{name} is not positive {problem} at {label}; {fix}.")


def _reduce(matrices: dict[str, Any], n_interface: int, modes: int | None) -> dict[str, Any]:
    if modes is None:
        raise FileError(
            f"has {matrices['mass'].shape[0]} rows, more than {MAX_WHOLE}; set the number of "
            "fixed-interface modes to keep."
        )
    try:
        reduction = sparse_craig_bampton(
            matrices["mass"], matrices["stiffness"], n_interface, modes
        )
    except ReductionError as error:
        raise FileError(str(error)) from None
    reduced = {"mass": reduction.mass, "stiffness": reduction.stiffness}
    if "damping" in matrices:
        damping = reduction.transformation.T @ (matrices["damping"] @ reduction.transformation)
        reduced["damping"] = (damping + damping.T) / 2.0
    return reduced


def _check_held(dofs: Sequence[InterfaceDof], mass: FloatArray, stiffness: FloatArray) -> None:
    """Raise an error if a component can still move when its interface DoFs are held."""
    inner = slice(len(dofs), None)
    held = stiffness[inner, inner]
    try:
        # Rounding may hide that a matrix is singular, so modes below 0.1 Hz count as free.
        cho_factor(held - _accepted("stiffness", held, mass[inner, inner]))
    except np.linalg.LinAlgError:
        raise FileError(
            f"can still move when {', '.join(map(str, dofs))} are held; make more rows "
            "interface DoFs, or fix them before you write the matrices."
        ) from None
