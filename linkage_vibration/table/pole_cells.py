# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Looks up values of reduced models: cubic cells between angles at which their poles are found.

A cell is halved until its cubics give the values in its middle. No cubic follows two poles that
meet, so the smallest cells there have none, and a lookup in them finds the poles itself.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.reduced import Modal, ReducedModels

CELL_ERROR = 1e-9
"""Relative error of the values in a cell."""

FIRST_CELLS = 32
"""Cells of a piece before any is halved."""

_HALVINGS = 12
_MOST = 2048  # cells that are halved at once; more would take too long
_NODES = np.array([0.0, 1.0, 2.0, 3.0]) / 3.0  # of a cell, at which its cubics are exact
_MIDDLE = 0.5
_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, 4))  # of values at the nodes
_AHEAD = {1: [1.0], 2: [-1.0, 2.0], 3: [1.0, -3.0, 3.0]}  # weights that extrapolate to a node
_AT_MIDDLE = np.vander([_MIDDLE], 4)[0] @ _COEFFICIENTS
_ROUNDING = 1e-12  # of a pole: a difference that is only rounding
_LOW = 1e-4  # of the highest of some poles: a frequency near 0 Hz
_SAME = 1e-4  # of a pole: two pieces differ by less where they meet


@dataclass(frozen=True, slots=True, eq=False)
class PolePiece:
    """A piece of the stroke in which reduced models can be evaluated."""

    angles: FloatArray  # (FIRST_CELLS + 1,), rad: the ends of its first cells
    modal: Callable[[FloatArray], Modal]  # poles and residues at angles, rad
    drive: int  # index of the place whose highest peak is looked up
    band: tuple[float, float]  # Hz

    def evaluate(self, angles: FloatArray) -> tuple[list[ComplexArray], FloatArray]:
        """Return the oscillating poles (rad/s) at each of some angles, and the peaks, (n, 2)."""
        modal = self.modal(angles)
        return [oscillating(poles) for poles in modal.frequencies], modal.highest(
            self.drive, self.band
        )


def pole_piece(
    alpha3: FloatArray,
    models: ReducedModels,
    toggles: tuple[float, float] | None,
    band: tuple[float, float],
) -> PolePiece:
    """Return what evaluates reduced models anywhere between the angles at which they are known.

    Parameters
    ----------
    alpha3 : ndarray, (n,)
        Angles of the models, rad, ascending.
    models, toggles, band
        The models; rad, or None; Hz.
    """
    variables = stroke_variable(alpha3, toggles)
    angles = stroke_angle(np.linspace(variables[0], variables[-1], FIRST_CELLS + 1), toggles)
    angles[[0, -1]] = alpha3[[0, -1]]

    def modal(at: FloatArray) -> Modal:
        return models.at(variables, stroke_variable(at, toggles)).modal

    return PolePiece(angles, modal, 0, band)


@dataclass(slots=True, eq=False)
class Cell:
    """The poles and the peak between two angles, by cubics where these are accurate."""

    start: float  # rad
    end: float
    first: ComplexArray  # poles at its start, rad/s
    last: ComplexArray  # poles at its end
    follows: dict[int, int]  # which of the last poles each of the first becomes
    # Coefficients of powers of the share of the cell, highest first.
    values: FloatArray | None = None  # (2, 4, n): frequencies (Hz) and ratios of the first poles
    peak: FloatArray | None = None  # (4, 2): Hz and m/N
    branches: dict[int, tuple[int, int]] = field(default_factory=dict)
    """For each branch its index among the first and among the last poles, -1 where it has none."""


def oscillating(poles: ComplexArray) -> ComplexArray:
    """Return the poles that oscillate, of each pair the upper, ascending by magnitude.

    Parameters
    ----------
    poles : ndarray, (n,)
        rad/s.
    """
    found = poles[(poles.imag > 0.0) & (np.abs(poles) >= MECHANISM)]
    return np.asarray(found[np.argsort(np.abs(found))])


def values_of(poles: ComplexArray) -> FloatArray:
    """Return the natural frequencies (Hz) and damping ratios of poles (rad/s), (2, ...)."""
    size = np.abs(poles)
    return np.array([size / (2.0 * math.pi), -poles.real / size])


def make_cells(piece: PolePiece) -> list[Cell]:
    """Divide a piece into cells, ascending."""
    waiting = list(zip(piece.angles[:-1].tolist(), piece.angles[1:].tolist(), strict=True))
    done: list[Cell] = []
    for level in range(_HALVINGS + 1):
        spans = np.array(waiting)
        shares = np.append(_NODES, _MIDDLE)
        at = spans[:, :1] + np.diff(spans, axis=1) * shares
        at[:, 3] = spans[:, 1]
        poles, peaks = piece.evaluate(at.ravel())
        waiting = []
        for i, (start, end) in enumerate(spans.tolist()):
            rows = slice(5 * i, 5 * i + 5)
            cell = _cell(start, end, poles[rows], peaks[rows])
            smallest = level == _HALVINGS or len(spans) > _MOST
            if smallest or (cell.values is not None and cell.peak is not None):
                done.append(cell)
            else:
                middle = (start + end) / 2.0
                waiting += [(start, middle), (middle, end)]
        if not waiting:
            break
    return sorted(done, key=lambda cell: cell.start)


def _cell(start: float, end: float, poles: list[ComplexArray], peaks: FloatArray) -> Cell:
    """Return a cell with its cubics, if they agree with the poles and the peak in the middle."""
    own, middle = poles[:4], poles[4]
    cell = Cell(start, end, own[0], own[3], nearest(own[0], own[3]))
    coefficients = _COEFFICIENTS @ peaks[:4]
    # The peak may be at 0 Hz, so a small part of the highest frequency of poles is its scale.
    scale = np.maximum(peaks[4], [_LOW * np.abs(middle).max(initial=0.0), 0.0])
    if (np.abs(_AT_MIDDLE @ peaks[:4] - peaks[4]) <= CELL_ERROR * scale).all():
        cell.peak = coefficients
    if len({len(each) for each in poles}) > 1:
        return cell
    path, order = [own[0]], cell.follows
    for node in own[1:]:
        expected = np.array(_AHEAD[len(path)]) @ np.array(path)
        order = nearest(expected, node)
        path.append(node[[order[j] for j in range(len(node))]])
    cell.follows = order
    values = values_of(np.array(path))
    found = np.tensordot(_AT_MIDDLE, values, (0, 1))
    imaginary = np.sqrt(np.maximum(1.0 - found[1] ** 2, 0.0))
    there = nearest(2.0 * math.pi * found[0] * (-found[1] + 1j * imaginary), middle)
    exact = values_of(middle[[there[j] for j in range(len(middle))]])
    off, limit = np.abs(found - exact), CELL_ERROR * exact
    limit[1] += _ROUNDING
    if (off <= limit).all():
        cell.values = np.tensordot(_COEFFICIENTS, values, (1, 1)).swapaxes(0, 1)
    return cell


def nearest(one: ComplexArray, other: ComplexArray) -> dict[int, int]:
    """Pair poles so that the sum of the distances is least: index here to index there.

    Parameters
    ----------
    one, other : ndarray, (n,) and (m,)
        rad/s. Where the numbers differ, the farthest remain without a partner.
    """
    pairs = linear_sum_assignment(np.abs(one[:, np.newaxis] - other))
    return dict(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True))


def follow_branches(pieces: Sequence[list[Cell]]) -> tuple[list[float], dict[int, float]]:
    """Follow the poles through all cells, and note in each cell which branch they belong to.

    A branch ends where its pole becomes real, and goes on where a pole oscillates again.

    Parameters
    ----------
    pieces : sequence of list of Cell
        The cells of each piece, ascending.

    Returns
    -------
    begins : list of float
        The frequency at which each branch begins, rad/s.
    left : dict of int to float
        Angles (rad) at which branches leave the poles that a piece holds.
    """
    begins: list[float] = []
    left: dict[int, float] = {}
    ended: dict[int, float] = {}  # where a pole became real: its magnitude there
    now: dict[int, complex] = {}
    for cells in pieces:
        for i, cell in enumerate(cells):
            pairs = nearest(np.array(list(now.values()), dtype=complex), cell.first)
            names = list(now)
            own = {names[k]: j for k, j in pairs.items()}
            if i == 0:  # another set of poles
                own = {b: j for b, j in own.items() if abs(now[b] / cell.first[j] - 1.0) < _SAME}
            for b in now.keys() - own.keys():
                left.setdefault(b, cell.start)
            for j in sorted(set(range(len(cell.first))) - set(own.values())):
                own[_branch(cell.first[j], begins, ended)] = j
            cell.branches = {b: (j, cell.follows.get(j, -1)) for b, j in own.items()}
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


class PoleCells:
    """Natural frequencies, damping ratios and the highest peak at any angle of the stroke.

    Numbers for one angle and for many are equal to the last bit. They are NaN for a mode where it
    does not oscillate.

    Parameters
    ----------
    pieces : sequence of PolePiece
        Each begins where the one before it ends.
    n_modes : int
        Number of modes: those that begin lowest.
    """

    def __init__(self, pieces: Sequence[PolePiece], n_modes: int) -> None:
        cells = [make_cells(piece) for piece in pieces]
        begins, left = follow_branches(cells)
        self._modes = sorted(range(len(begins)), key=lambda b: begins[b])[:n_modes]
        self._n = n_modes
        self.left = {m: left[b] for m, b in enumerate(self._modes) if b in left}
        """Angles (rad) at which modes, by their indices, leave the poles that a piece holds."""
        self._all = [cell for own in cells for cell in own]
        self._pieces = [piece for piece, own in zip(pieces, cells, strict=True) for _ in own]
        self._starts = np.array([cell.start for cell in self._all])
        self._cells = np.array([self._cubics(cell) for cell in self._all])  # (n_cells, 4, k)
        self._direct = np.asarray(np.isposinf(self._cells[:, 3]).any(axis=1))
        self._plain: tuple[list[float], list[list[list[float]] | None]]
        plain = [
            None if d else c.T.tolist() for c, d in zip(self._cells, self._direct, strict=True)
        ]
        self._plain = self._starts.tolist(), plain

    @property
    def n_branches(self) -> int:
        """Number of modes that oscillate somewhere, at most those asked for."""
        return len(self._modes)

    def values(self, alpha3: float) -> list[float]:
        """Return frequencies (Hz), ratios, frequency (Hz) and magnitude (m/N) of the peak."""
        starts, cells = self._plain
        i = bisect_right(starts, alpha3) - 1
        cell = cells[i]
        if cell is None:
            return list(map(float, self._found(i, alpha3)))
        t = alpha3 - starts[i]
        return [((c3 * t + c2) * t + c1) * t + c0 for c3, c2, c1, c0 in cell]

    def slopes(self, alpha3: float) -> list[float]:
        """Return the slopes of the same at an angle in rad, per rad."""
        starts, cells = self._plain
        i = bisect_right(starts, alpha3) - 1
        cell = cells[i]
        if cell is None:
            return list(map(float, self._slope(i, alpha3)))
        t = alpha3 - starts[i]
        return [(3.0 * c3 * t + 2.0 * c2) * t + c1 for c3, c2, c1, _ in cell]

    def many_values(self, alpha3: FloatArray) -> FloatArray:
        """Return the values at angles in rad, (n, k)."""
        i = np.maximum(np.searchsorted(self._starts, alpha3, side="right") - 1, 0)
        cell, t = self._cells[i], (alpha3 - self._starts[i])[:, np.newaxis]
        found = ((cell[:, 0] * t + cell[:, 1]) * t + cell[:, 2]) * t + cell[:, 3]
        for row in np.flatnonzero(self._direct[i]):
            found[row] = self._found(int(i[row]), float(alpha3[row]))
        return np.asarray(found)

    def many_slopes(self, alpha3: FloatArray) -> FloatArray:
        """Return the slopes at angles in rad, (n, k), per rad."""
        i = np.maximum(np.searchsorted(self._starts, alpha3, side="right") - 1, 0)
        cell, t = self._cells[i], (alpha3 - self._starts[i])[:, np.newaxis]
        found = (3.0 * cell[:, 0] * t + 2.0 * cell[:, 1]) * t + cell[:, 2]
        for row in np.flatnonzero(self._direct[i]):
            found[row] = self._slope(int(i[row]), float(alpha3[row]))
        return np.asarray(found)

    def _cubics(self, cell: Cell) -> FloatArray:
        """Return coefficients in rad, (4, 2 n_modes + 2): NaN of absent modes, else infinity."""
        cubics = np.zeros((4, 2 * self._n + 2))
        cubics[3] = math.inf
        if cell.peak is not None:
            cubics[:, -2:] = cell.peak
        for mode in range(self._n):
            at = [mode, self._n + mode]
            own = cell.branches.get(self._modes[mode]) if mode < len(self._modes) else None
            if own is None:
                cubics[:, at] = math.nan
            elif cell.values is not None:
                cubics[:, at] = cell.values[:, :, own[0]].T
        return cubics / (cell.end - cell.start) ** np.arange(3, -1, -1)[:, np.newaxis]

    def _found(self, i: int, alpha3: float) -> FloatArray:
        """Find the values in a cell without cubics."""
        cell = self._all[i]
        poles, peaks = self._pieces[i].evaluate(np.array([alpha3]))
        share = (alpha3 - cell.start) / (cell.end - cell.start)
        names, expected = list(cell.branches), []
        for j, k in cell.branches.values():
            first, last = (
                cell.first[j] if j >= 0 else cell.last[k],
                cell.last[k] if k >= 0 else cell.first[j],
            )
            expected.append((1.0 - share) * first + share * last)
        pairs = nearest(np.array(expected, dtype=complex), poles[0])
        found = np.full(2 * self._n + 2, math.nan)
        for at, j in pairs.items():
            if names[at] in self._modes:
                mode = self._modes.index(names[at])
                found[[mode, self._n + mode]] = values_of(poles[0][j])
        found[-2:] = peaks[0]
        return found

    def _slope(self, i: int, alpha3: float) -> FloatArray:
        """Find the slopes in a cell without cubics, by a difference."""
        cell = self._all[i]
        step = 1e-3 * (cell.end - cell.start)
        before, after = max(alpha3 - step, cell.start), min(alpha3 + step, cell.end)
        low, own, high = (self._found(i, at) for at in (before, alpha3, after))
        # Beside the angle at which a mode vanishes, only the side on which it exists counts.
        low = np.where(np.isnan(low), own, low)
        high = np.where(np.isnan(high), own, high)
        begin = np.where(low == own, alpha3, before)
        end = np.where(high == own, alpha3, after)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(end > begin, (high - low) / (end - begin), 0.0)
        return np.asarray(np.where(np.isnan(own), math.nan, slope))
