# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Divides pieces of reduced models into cubic cells, and follows modes through them.

A cell is halved until its cubics give the values in its middle. No cubic follows two poles that
meet, so the smallest cells there have none, and a lookup in them finds the poles itself.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray
from linkage_vibration.table.pole_cells import (
    PolePiece,
    nearest,
    nearest_rows,
    oscillating,
    values_of,
)
from linkage_vibration.table.table import TableError

CELL_ROUNDING = 1e-12
"""Further error of a damping ratio in a cell, 1: rounding of a pole, relative to the pole."""

_SMALLEST = 12  # A cell of so many units is not halved.
_UNITS = _SMALLEST * 2**12  # A first cell has so many units.
_MOST = 2048  # More cells are not halved, which would take too long.
_NODES = np.array([0.0, 1.0, 2.0, 3.0]) / 3.0  # Cubics are exact at these shares of a cell.
_SIXTHS = (0, 2, 4, 6, 3)  # These are the nodes and the middle.
_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, 4))  # They turn values into coefficients.
_AHEAD = {1: [1.0], 2: [-1.0, 2.0], 3: [1.0, -3.0, 3.0]}  # They extrapolate to the next node.
_AT_MIDDLE = np.vander([0.5], 4)[0] @ _COEFFICIENTS
_LOW = 1e-4  # A frequency below this share of the highest pole is near 0 Hz.
_SAME = 1e-4  # The poles of two pieces differ by less where they meet.


@dataclass(slots=True, eq=False)
class Cell:
    """The poles and the peak between two angles, by cubics where these are accurate."""

    start: float  # rad
    end: float
    first: ComplexArray  # poles at its start, rad/s
    last: ComplexArray  # poles at its end
    middle: ComplexArray  # and in its middle
    peaks: FloatArray  # (2, 2): Hz and m/N, at its start and in its middle
    follows: dict[int, int]  # which of the last poles each of the first becomes
    # Coefficients of powers of the share of the cell, highest first.
    values: FloatArray | None = None  # (2, 4, n): frequencies (Hz) and ratios of the first poles
    peak: FloatArray | None = None  # (4, 2): Hz and m/N
    # Shares of it at which poles cross, or veer within a shorter step than that to its nodes.
    crossings: list[float] = field(default_factory=list)
    branches: dict[int, tuple[int, int]] = field(default_factory=dict)
    """For each branch its index among the first and among the last poles, -1 where it has none."""


def make_cells(piece: PolePiece, error: float) -> list[Cell]:
    """Divide a piece into cells, ascending, whose values have at most a relative error."""

    def angles(places: FloatArray | list[int]) -> FloatArray:
        """Return the angles of places in units, rad."""
        return np.interp(np.array(places) / _UNITS, np.arange(len(piece.angles)), piece.angles)

    evaluated: dict[int, tuple[ComplexArray, FloatArray]] = {}  # the keys are places in units
    waiting = [(i * _UNITS, (i + 1) * _UNITS) for i in range(len(piece.angles) - 1)]
    done: list[Cell] = []
    while waiting:
        rows = [[s + (e - s) * share // 6 for share in _SIXTHS] for s, e in waiting]
        fresh = sorted({place for row in rows for place in row} - evaluated.keys())
        evaluated.update(zip(fresh, zip(*piece.evaluate(angles(fresh)), strict=True), strict=True))
        smallest = len(waiting) > _MOST or waiting[0][1] - waiting[0][0] == _SMALLEST
        poles = [[evaluated[place][0] for place in row] for row in rows]
        peaks = np.array([[evaluated[place][1] for place in row] for row in rows])
        waiting = []
        for row, cell in zip(
            rows, _cells(angles(np.array(rows)), poles, peaks, error), strict=True
        ):
            _check_crossings(cell, piece, error)
            if smallest or (cell.values is not None and cell.peak is not None):
                done.append(cell)
            else:
                waiting += [(row[0], row[4]), (row[4], row[3])]
    return sorted(done, key=lambda cell: cell.start)


def _cells(
    angles: FloatArray, poles: Sequence[Sequence[ComplexArray]], peaks: FloatArray, error: float
) -> list[Cell]:
    """Return cells with their cubics, where they agree with the poles and the peak in the middle.

    Angles, (n, 5), poles and peaks, (n, 5, 2), are those at the nodes and in the middle of each.
    """
    cells = [
        Cell(start, end, each[0], each[3], each[4], highest[[0, 4]], {})
        for (start, end), each, highest in zip(angles[:, ::3].tolist(), poles, peaks, strict=True)
    ]
    # The peak may be at 0 Hz, so a small part of the highest frequency of poles is its scale.
    highest = [np.abs(middle).max(initial=0.0) for *_, middle in poles]
    limit = error * np.maximum(peaks[:, 4], np.multiply.outer(highest, [_LOW, 0.0]))
    off = np.abs(_AT_MIDDLE @ peaks[:, :4] - peaks[:, 4])
    for i in np.flatnonzero((off <= limit).all(axis=1)).tolist():
        cells[i].peak = _COEFFICIENTS @ peaks[i, :4]
    alike: dict[
        int, list[int]
    ] = {}  # cells by the number of their poles, if it is the same all over
    for i, each in enumerate(poles):
        if len({len(x) for x in each}) > 1:
            cells[i].follows = nearest(each[0], each[3])
        else:
            alike.setdefault(len(each[0]), []).append(i)
    for which in alike.values():
        at = np.array([poles[i] for i in which])
        path, order = at[:, :1], np.zeros((0, 0), dtype=np.intp)
        for node in 1, 2, 3:
            expected = np.tensordot(_AHEAD[node], path, (0, 1))
            order = nearest_rows(expected, at[:, node])
            found = np.take_along_axis(at[:, node], order, 1)
            path = np.concatenate([path, found[:, np.newaxis]], axis=1)
        cubics = _COEFFICIENTS @ values_of(path)
        agree = _agree(0.5, cubics, at[:, 4], error)
        for i, follows, cubic, fits, row in zip(
            which, order, cubics.swapaxes(0, 1), agree, path, strict=True
        ):
            cells[i].follows = dict(enumerate(follows.tolist()))
            if fits:
                cells[i].values, cells[i].crossings = cubic, _crossings(row.imag)
    return cells


def _check_crossings(cell: Cell, piece: PolePiece, error: float) -> None:
    """Remove the cubics of a cell with poles that do not cross where the cubics do."""
    for share in cell.crossings:
        there = piece.drive(np.array([cell.start + share * (cell.end - cell.start)])).frequencies
        poles = oscillating(there[0])[np.newaxis]
        if cell.values is not None and not (
            poles.shape[1] == cell.values.shape[2]
            and _agree(share, cell.values[:, np.newaxis], poles, error).all()
        ):
            cell.values = None


def _agree(share: float, cubics: FloatArray, poles: ComplexArray, error: float) -> BoolArray:
    """Return whether cubics, (2, n, 4, k), give the values of poles, (n, k), at a share."""
    values = np.vander([share], 4)[0] @ cubics
    imaginary = np.sqrt(np.maximum(1.0 - values[1] ** 2, 0.0))
    there = nearest_rows(2.0 * math.pi * values[0] * (-values[1] + 1j * imaginary), poles)
    exact = values_of(np.take_along_axis(poles, there, 1))
    limit = error * exact
    limit[1] += CELL_ROUNDING
    return np.asarray((np.abs(values - exact) <= limit).all(axis=(0, 2)))


def _crossings(path: FloatArray) -> list[float]:
    """Return shares of a cell at which two poles cross, from imaginary parts at its nodes, (4, n).

    Poles that veer within a short step seem to cross too, and only there do they not.
    """
    first, second = np.triu_indices(path.shape[1], 1)
    apart = path[:, first] - path[:, second]
    shares = list[float]()
    for each in apart[:, (apart.min(axis=0) < 0.0) & (apart.max(axis=0) > 0.0)].T:
        roots = np.roots(_COEFFICIENTS @ each)
        real = roots.real[np.abs(roots.imag) < _SAME]
        shares += real[(real > 0.0) & (real < 1.0)].tolist()
    return shares


def follow_branches(pieces: Sequence[list[Cell]]) -> tuple[list[float], dict[int, float]]:
    """Follow the poles through the cells of all pieces, and note the branches in each cell.

    A branch ends where its pole becomes real, and continues where one oscillates again. Returned
    are rad/s at which each begins, and the angles (rad) at which branches leave a piece.
    """
    begins: list[float] = []
    left: dict[int, float] = {}
    ended: dict[int, float] = {}  # where a pole became real: its magnitude there
    now: dict[int, complex] = {}
    for cells in pieces:
        for i, cell in enumerate(cells):
            pairs = nearest(np.array(list(now.values()), dtype=complex), cell.first)
            names = list(now)
            index_of = {names[k]: j for k, j in pairs.items()}
            if i == 0:  # another set of poles
                index_of = {
                    b: j for b, j in index_of.items() if abs(now[b] / cell.first[j] - 1.0) < _SAME
                }
            for b in now.keys() - index_of.keys():
                left.setdefault(b, cell.start)
            for j in sorted(set(range(len(cell.first))) - set(index_of.values())):
                index_of[_branch(cell.first[j], begins, ended)] = j
            cell.branches = {b: (j, cell.follows.get(j, -1)) for b, j in index_of.items()}
            taken = {k for _, k in cell.branches.values()}
            for b, (j, k) in cell.branches.items():
                if k < 0:
                    ended[b] = abs(cell.first[j])
            for k in sorted(set(range(len(cell.last))) - taken):
                cell.branches[_branch(cell.last[k], begins, ended)] = (-1, k)
            now = {b: complex(cell.last[k]) for b, (_, k) in cell.branches.items() if k >= 0}
    return begins, left


def _branch(pole: complex, begins: list[float], ended: dict[int, float]) -> int:
    """Return the branch of a pole that begins to oscillate: one that ended nearby, or another."""
    if ended:
        b = min(ended, key=lambda b: abs(math.log(ended[b] / abs(pole))))
        del ended[b]
        return b
    begins.append(abs(pole))
    return len(begins) - 1


def cell_arrays(pieces: Sequence[list[Cell]], n_modes: int, name: str) -> dict[str, Any]:
    """Follow the lowest modes through the cells of all pieces, and return the arrays of a table.

    The name is that of the linkage. Modes that are missing, or do not exist over the whole stroke,
    are refused.
    """
    begins, left = follow_branches(pieces)
    modes = sorted(range(len(begins)), key=lambda b: begins[b])
    if len(modes) < n_modes:
        problem = f"response.modes is {n_modes}, but only {len(modes)} of {name} oscillate"
        raise TableError(f"{problem}; use fewer.")
    for mode, branch in enumerate(modes[:n_modes]):
        if branch in left:
            raise TableError(
                f"Mode {mode + 1} of {name} leaves the reach of response.band_hz at "
                f"{math.degrees(left[branch]):.3f} deg; widen the band, or use fewer modes in "
                "response.modes."
            )
    cells = [cell for piece in pieces for cell in piece]
    cubics = np.array([_cubics(cell, modes[:n_modes]) for cell in cells])
    direct = np.flatnonzero(np.isposinf(cubics[:, 3]).any(axis=1)).tolist()
    return {
        "cell_starts": np.array([cell.start for cell in cells]),
        "cell_cubics": cubics,
        "cell_poles": np.array([_ends(cells[i], modes) for i in direct]),
    }


def _cubics(cell: Cell, modes: list[int]) -> FloatArray:
    """Return coefficients in rad, (4, 2 n_modes + 2): NaN of absent modes, else infinity."""
    n_modes = len(modes)
    cubics = np.zeros((4, 2 * n_modes + 2))
    cubics[3] = math.inf
    if cell.peak is not None:
        cubics[:, -2:] = cell.peak
    for mode, branch in enumerate(modes):
        at = [mode, n_modes + mode]
        if branch not in cell.branches:
            cubics[:, at] = math.nan
        elif cell.values is not None:
            cubics[:, at] = cell.values[:, :, cell.branches[branch][0]].T
    return cubics / (cell.end - cell.start) ** np.arange(3, -1, -1)[:, np.newaxis]


def _ends(cell: Cell, modes: list[int]) -> ComplexArray:
    """Return the poles of branches at both ends, (2, n_branches); NaN of absent ones."""
    ends = np.full((2, len(modes)), math.nan, dtype=complex)
    for b, (j, k) in cell.branches.items():
        first = cell.first[j] if j >= 0 else cell.last[k]
        ends[:, modes.index(b)] = first, cell.last[k] if k >= 0 else first
    return ends
