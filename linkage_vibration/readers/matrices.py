# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Components from matrices in files: ``.npz``, MATLAB ``.mat`` and Matrix Market ``.mtx``.

Every kind holds ``mass``, ``stiffness``, perhaps ``damping``, all square, real and symmetric, in
kg, m, N, s and rad, and ``dofs``, which says which row is which. ``dofs`` is a list of texts, the
first for the first row: a point and a direction (``P1 x``, ``P1 theta``), or ``-`` for an inner
coordinate, physical or modal. Rows after the last entry are inner coordinates too, and so are named
rows that are not asked for: they move freely. But in the planar model rows named y are held: the
plane of motion is taken as a plane of symmetry.

``.npz``
    The matrices as arrays, or a sparse matrix as the three arrays of its compressed rows or
    columns: ``mass_data``, ``mass_indices``, ``mass_indptr``. ``dofs``: an array of text.
``.mat``
    Of version 6 or 7 (``save -v7``), matrices full or sparse; ``dofs``: a cell array of character
    vectors, or a character matrix.
``.mtx``
    ``NAME_mass.mtx``, which is the path to give, and beside it ``NAME_stiffness.mtx``, perhaps
    ``NAME_damping.mtx``, and ``NAME_dofs.txt`` with one entry a line.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, eigvalsh
from scipy.linalg.lapack import dpotrf
from scipy.sparse.linalg import splu

from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.reduction import ReductionError
from linkage_vibration.mechanics.solids import sparse_craig_bampton
from linkage_vibration.readers.component_files import (
    ComponentFileError,
    check_file,
    check_known,
    choose_rows,
    compressed_columns,
    damaged,
    load_npz,
    parse_dofs,
)
from linkage_vibration.readers.matlab import read_matlab

FloatArray = NDArray[np.float64]

MAX_WHOLE = 3000
"""Rows that are handed on as they are; more have to be reduced while they are sparse."""
MAX_ROWS = 1_000_000

_NAMES = ("mass", "stiffness", "damping")
_PARTS = ("data", "indices", "indptr")
_KNOWN = ("dofs", *_NAMES, *(f"{name}_{part}" for name in _NAMES for part in _PARTS))

_ASYMMETRY = 1e-6  # of the geometric mean of the two diagonal entries: seven digits in a file
# A free body's stiffness has eigenvalues of zero, which rounding makes slightly negative. They are
# forgiven where motion would grow by less than these (0.1 Hz, a thousandth a second), or where
# they are no more than rounding of the largest ones.
_FORGIVEN = {"stiffness": (2.0 * math.pi * 0.1) ** 2, "damping": 1e-3}
_ROUNDING = 1e-13

_FASTEST = 1e30  # 1/s2 or 1/s: nothing moves so fast
_LONGITUDINAL_SPEED = 5100.0  # m/s, of steel and of aluminium


def read_matrices(
    path: Path,
    dofs: Sequence[InterfaceDof] | None = None,
    modes: int | None = None,
    *,
    spatial: bool = False,
) -> Matrices:
    """Read and check the matrices of a component.

    Parameters
    ----------
    path : Path
        ``.npz``, ``.mat``, or the ``NAME_mass.mtx`` of a set; the module tells the layouts.
    dofs : sequence of InterfaceDof, optional
        The interface DoFs, in the order wanted; all that the file names by default.
    modes : int, optional
        Fixed-interface modes to keep (Craig-Bampton) of a component of more than `MAX_WHOLE` rows,
        which is too large to be handed on as it is; smaller ones are not reduced here.
    spatial : bool
        Keep rows named y rather than hold them.

    Returns
    -------
    Matrices
        Interface DoFs first; made symmetric to the last bit.

    Raises
    ------
    ComponentFileError
        If a file is missing, damaged, too large or holds pickles; if a DoF is missing or named
        twice; if a matrix is not square, of the size of the others, real, finite, symmetric or
        positive (semi-)definite; or if the mass and stiffness cannot be in kg and N/m.
    """
    readers: dict[str, Callable[[Path], tuple[dict[str, Any], list[object]]]] = {
        ".npz": _read_npz,
        ".mat": _read_mat,
        ".mtx": _read_mtx,
    }
    if path.suffix.lower() not in readers:
        raise ComponentFileError(path, "is no file of matrices; give a .npz, .mat or .mtx.")
    matrices, names = readers[path.suffix.lower()](path)
    for name in ("mass", "stiffness"):
        if name not in matrices:
            raise ComponentFileError(path, f"holds no {name}; add it.")
    matrices = {name: _plain(path, name, matrices[name]) for name in _NAMES if name in matrices}

    n = matrices["mass"].shape[0]
    for name, matrix in matrices.items():
        if matrix.shape != (n, n):
            raise ComponentFileError(
                path, f"{name} is {_size(matrix)} where mass is {_size(matrices['mass'])}."
            )
    if len(names) > n:
        raise ComponentFileError(path, f"dofs names {len(names)} rows of matrices that have {n}.")
    found = parse_dofs(path, names)
    out_of_plane = [row for row, dof in enumerate(found) if dof and dof.direction == "y"]
    held = set() if spatial else set(out_of_plane)
    there = [None if row in held else dof for row, dof in enumerate(found)]
    dofs, rows = choose_rows(path, there, dofs)
    order = np.array(rows + sorted(set(range(n)) - held.union(rows)))
    labels = [
        str(found[row])
        if row < len(found) and found[row] is not None
        else f"row {row + 1} (counted from 1, an inner coordinate)"
        for row in order
    ]
    matrices = {name: matrix[order][:, order] for name, matrix in matrices.items()}
    for name, matrix in matrices.items():
        _check(path, labels, name, matrix, matrices["mass"])
        matrices[name] = (matrix + matrix.T) / 2.0
    if sparse.issparse(matrices["mass"]):
        matrices = _reduce(path, matrices, len(dofs), modes)
    _check_units(path, dofs, matrices["mass"], matrices["stiffness"])
    return Matrices(dofs, matrices["mass"], matrices["stiffness"], matrices.get("damping"))


def _read_npz(path: Path) -> tuple[dict[str, Any], list[object]]:
    arrays = load_npz(path, _KNOWN)
    matrices: dict[str, Any] = {}
    for name in _NAMES:
        parts = [f"{name}_{part}" for part in _PARTS]
        there = [part for part in parts if part in arrays]
        if name in arrays and there:
            raise ComponentFileError(path, f"holds both {name} and {there[0]}; keep one of them.")
        if name in arrays:
            matrices[name] = arrays[name]
        elif there:
            if there != parts:
                raise ComponentFileError(path, f"a sparse {name} needs {', '.join(parts)}.")
            data, indices, indptr = (arrays[part] for part in parts)
            n = indptr.size - 1
            if n > MAX_ROWS:
                raise ComponentFileError(path, f"{name} has {n} rows; {MAX_ROWS} are allowed.")
            try:
                matrices[name] = compressed_columns(data, indices, indptr, n)
            except ValueError as error:
                raise ComponentFileError(path, f"{name} cannot be put together: {error}.") from None
    return matrices, np.ravel(_dofs(path, arrays)).tolist()


def _read_mat(path: Path) -> tuple[dict[str, Any], list[object]]:
    arrays = read_matlab(path)
    check_known(path, arrays, ("dofs", *_NAMES))
    names = _dofs(path, arrays)
    if not isinstance(names, list):
        raise ComponentFileError(path, "dofs is no cell array or character matrix; write 'P1 x'.")
    # A cell holds the rows of a character matrix, of which there is one.
    cells = [cell[0] if isinstance(cell, list) and len(cell) == 1 else cell for cell in names]
    matrices = {name: arrays[name] for name in _NAMES if name in arrays}
    for name, matrix in matrices.items():
        if isinstance(matrix, list):
            raise ComponentFileError(path, f"{name} is not of numbers.")
    return matrices, cells


def _read_mtx(path: Path) -> tuple[dict[str, Any], list[object]]:
    if not path.stem.endswith("_mass"):
        raise ComponentFileError(path, "give the path of the mass matrix, NAME_mass.mtx.")
    start = path.stem.removesuffix("mass")
    matrices = {}
    for name in _NAMES:
        beside = path.with_name(f"{start}{name}{path.suffix}")
        if name != "damping" or beside.exists():
            matrices[name] = _read_matrix_market(beside)
    names = _text(path.with_name(f"{start}dofs.txt")).splitlines()
    return matrices, [name for name in names if name.strip()]


def _read_matrix_market(path: Path) -> Any:
    """Read a real matrix; `scipy.io.mmread` is faster, but a damaged file can crash it."""
    check_file(path)
    try:
        with path.open(encoding="utf-8") as file:
            layout, symmetry = _market_kind(path, file.readline())
            lines = (line for line in file if line.strip() and not line.startswith("%"))
            size = [int(number) for number in next(lines, "").split()]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of no entries at all, which is a zero matrix
                values = np.loadtxt(file, comments="%", ndmin=2)
        if layout == "array":
            return _filled(size, values.ravel(), symmetry)
        rows, columns, count = size
        if max(rows, columns) > MAX_ROWS:
            raise ComponentFileError(
                path, f"has {rows} rows and {columns} columns; reduce it to {MAX_ROWS} or fewer."
            )
        entries = values.reshape(count, 3)
        whole = np.rint(entries[:, :2])
        if not (np.array_equal(entries[:, :2], whole) and (np.abs(whole) <= MAX_ROWS).all()):
            raise ValueError("an index is not a whole number, or is too large")
        places = entries[:, :2].astype(np.int64).T - 1
        matrix = sparse.coo_array((entries[:, 2], tuple(places)), shape=(rows, columns)).tocsc()
        if symmetry == "symmetric":
            matrix = matrix + matrix.T - sparse.diags(matrix.diagonal())
        return sparse.csc_array(matrix)
    except (OSError, ValueError, OverflowError) as error:
        raise damaged(path, error) from None


def _market_kind(path: Path, line: str) -> tuple[str, str]:
    """Return the layout and the symmetry that the first line of a file states."""
    words = line.lower().split()
    if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"]:
        raise ComponentFileError(
            path, "does not begin with %%MatrixMarket; give a Matrix Market file."
        )
    layout, field, symmetry = words[2:]
    if (
        layout not in ("coordinate", "array")
        or field not in ("real", "integer", "double")
        or symmetry not in ("general", "symmetric")
    ):
        raise ComponentFileError(
            path, f"is {' '.join(words[2:])}; write it as real, general or symmetric."
        )
    return layout, symmetry


def _filled(size: list[int], values: FloatArray, symmetry: str) -> FloatArray:
    """Return a full matrix from its columns, or from the lower half of each."""
    rows, columns = size
    if symmetry == "general":
        return values.reshape(columns, rows).T
    if rows != columns or values.size != rows * (rows + 1) // 2:
        raise ValueError(f"{values.size} entries for the lower half of {rows} by {columns}")
    matrix = np.zeros((rows, rows))
    matrix[np.triu_indices(rows)] = values  # by columns, which are the rows of the upper half
    return np.asarray(matrix + np.triu(matrix, 1).T)


def _text(path: Path) -> str:
    check_file(path)
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ComponentFileError(path, "is not text in UTF-8; write it anew.") from None
    except OSError as error:
        raise ComponentFileError(path, f"cannot be read ({error.strerror}).") from None


def _dofs(path: Path, arrays: dict[str, Any]) -> Any:
    if "dofs" not in arrays:
        raise ComponentFileError(path, "holds no dofs, which say which row is which; add them.")
    return arrays["dofs"]


def _plain(path: Path, name: str, matrix: Any) -> Any:
    """Return a matrix as floats, sparse where it is too large to be handed on whole."""
    if matrix.dtype.kind not in "fiu":
        what = "complex; give damping apart" if matrix.dtype.kind == "c" else "not of numbers"
        raise ComponentFileError(path, f"{name} is {what}.")
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.shape[0] == 0:
        raise ComponentFileError(path, f"{name} is {_size(matrix)}; it has to be square.")
    if matrix.shape[0] > MAX_WHOLE:
        return sparse.csc_array(matrix, dtype=np.float64)
    whole = matrix.toarray() if sparse.issparse(matrix) else matrix
    return np.asarray(whole, dtype=np.float64)


def _size(matrix: Any) -> str:
    return " by ".join(map(str, matrix.shape))


def _forgiven(name: str, matrix: Any, mass: Any) -> Any:
    """Return the multiple of the mass that a matrix may lack of being positive."""
    largest = float(np.max(matrix.diagonal() / mass.diagonal()))
    return max(_FORGIVEN[name], _ROUNDING * largest) * mass


def _check(path: Path, labels: Sequence[str], name: str, matrix: Any, mass: Any) -> None:
    """Refuse what is not finite, symmetric and positive; the mass comes first."""
    entries = sparse.coo_array(matrix)
    wrong = np.flatnonzero(~np.isfinite(entries.data))
    if wrong.size:
        i, j = entries.row[wrong[0]], entries.col[wrong[0]]
        raise ComponentFileError(
            path, f"{name} is not a finite number at {labels[i]}, {labels[j]}; write it anew."
        )

    if name != "mass":
        with np.errstate(over="ignore"):
            rates = matrix.diagonal() / mass.diagonal()
        if rates.max() > _FASTEST:
            label = labels[int(rates.argmax())]
            raise ComponentFileError(
                path,
                f"{name} is {rates.max():.1g} times the mass at {label}, which no part has; write "
                "both in kg, m, N, s.",
            )
    whole = matrix if name == "mass" else matrix + _forgiven(name, matrix, mass)
    diagonal = whole.diagonal()
    _refuse_negative(path, labels, name, diagonal)
    odd = sparse.coo_array(matrix - matrix.T)
    with np.errstate(over="ignore"):
        sizes = np.abs(odd.data) / np.sqrt(diagonal[odd.row]) / np.sqrt(diagonal[odd.col])
    if sizes.max(initial=0.0) > _ASYMMETRY:
        worst = int(sizes.argmax())
        i, j = odd.row[worst], odd.col[worst]
        raise ComponentFileError(
            path,
            f"{name} is not symmetric: {matrix[i, j]:.6g} at {labels[i]}, {labels[j]} and "
            f"{matrix[j, i]:.6g} at {labels[j]}, {labels[i]}, which differ by {sizes[worst]:.1e} "
            "of their diagonal entries; write it anew.",
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
            raise _not_positive(path, name, "some DoF") from None
        # SuperLU numbers its columns by where each went.
        _refuse_negative(path, labels, name, factor.U.diagonal()[factor.perm_c])
    else:
        _, info = dpotrf(whole)
        if info:
            raise _not_positive(path, name, labels[info - 1])


def _refuse_negative(path: Path, labels: Sequence[str], name: str, pivots: FloatArray) -> None:
    worst = int(pivots.argmin())
    if pivots[worst] <= 0.0:
        raise _not_positive(path, name, labels[worst])


def _not_positive(path: Path, name: str, label: str) -> ComponentFileError:
    if name == "mass":
        problem = "is not positive definite: no inertia is left"
        mend = "leave massless coordinates out, or reduce them statically"
    else:
        problem = "is not positive semi-definite: there is less than none left"
        mend = "look for a wrong sign or row, and write every digit (%.17g)"
    return ComponentFileError(path, f"{name} {problem} at {label}; {mend}.")


def _reduce(
    path: Path, matrices: dict[str, Any], n_interface: int, modes: int | None
) -> dict[str, Any]:
    if modes is None:
        raise ComponentFileError(
            path,
            f"has {matrices['mass'].shape[0]} rows, more than {MAX_WHOLE}; tell how many "
            "fixed-interface modes to keep.",
        )
    try:
        reduction = sparse_craig_bampton(
            matrices["mass"], matrices["stiffness"], n_interface, modes
        )
    except ReductionError as error:
        raise ComponentFileError(path, str(error)) from None
    reduced = {"mass": reduction.mass, "stiffness": reduction.stiffness}
    if "damping" in matrices:
        damping = reduction.transformation.T @ (matrices["damping"] @ reduction.transformation)
        reduced["damping"] = (damping + damping.T) / 2.0
    return reduced


def _check_units(
    path: Path, dofs: Sequence[InterfaceDof], mass: FloatArray, stiffness: FloatArray
) -> None:
    """Refuse a rigid mass and a stiffness between the points that no part has in SI.

    Millimetres and tonnes leave the natural frequencies as they are but divide mass and stiffness
    by a thousand. What tells them from a small part is L = c / sqrt(k / m), about the length of a
    metal part of mass m and axial stiffness k: m / L^3 would then be less than that of air.
    """
    b, i = slice(0, len(dofs)), slice(len(dofs), None)
    extension = np.zeros((len(mass), len(dofs)))
    extension[b] = np.eye(len(dofs))
    if len(mass) > len(dofs):
        inner = stiffness[i, i]
        try:
            # Rounding may make a singular matrix a regular one: ask for modes below 0.1 Hz.
            cho_factor(inner - _forgiven("stiffness", inner, mass[i, i]))
            extension[i] = -cho_solve(cho_factor(inner), stiffness[i, b])
        except np.linalg.LinAlgError:
            raise ComponentFileError(
                path,
                f"with {', '.join(map(str, dofs))} held the component can still move; make "
                "more of its rows interface DoFs, or fix them before the matrices are written.",
            ) from None
    rigid, static = extension.T @ mass @ extension, extension.T @ stiffness @ extension
    along = [[float(dof.direction == direction) for dof in dofs] for direction in ("x", "y", "z")]
    m = max(float(np.array(row) @ rigid @ np.array(row)) for row in along)
    moves = [k for k, dof in enumerate(dofs) if dof.direction != "theta"]
    if not moves:
        return
    k = max(0.0, float(eigvalsh(static[np.ix_(moves, moves)])[-1]))
    length = _LONGITUDINAL_SPEED * math.sqrt(m / k) if k > 0.0 else 0.0
    frequency = math.sqrt(k / m) / (2.0 * math.pi)
    told = f"a rigid mass of {m:.3g} kg and a stiffness of {k:.3g} N/m between its points"
    suspicion = None
    if m < 1e-3 or (m < 0.1 and frequency > 1.0 and m < 0.1 * length**3):
        suspicion = "tonnes and N/mm"
    elif m > 1e6:
        suspicion = "grams, or a density in kg/m3 with lengths in millimetres"
    elif frequency > 1e6:
        suspicion = "an elastic modulus in Pa with lengths in millimetres"
    if suspicion:
        raise ComponentFileError(
            path, f"has {told}, which no link has; is it in {suspicion}? Write it in kg, m, N."
        )
