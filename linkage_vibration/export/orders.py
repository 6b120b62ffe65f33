# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of excitations that an export contains, and of the responses to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.table.table import Table

_FORCE_ERROR = 0.005  # of each number of the forces, over its largest value


def orders_of(
    table: Table, levels: LevelTable, excitations: Sequence[Excitation]
) -> "OrderConstants":
    """Return excitations with the responses to them, as an export contains them."""
    starts, cubics, t, which = levels.arrays
    i, loaded = int(which.max()) + 1, table.load_places if levels.force_places else ()
    names = [name for name, _ in table.forces if name in loaded]
    forces, o = None, 1 + (len(table.forces) if loaded else 0)
    ends = np.cumsum([3 * t, 3 * t * o * i, 3 * o * i, i if t else 0])
    at = np.split(np.arange(cubics.shape[2]), ends)  # as `prediction.levels` arranges the values
    above, rest = (part.reshape(-1, o, i) for part in at[1:3])
    if names:
        of = slice(1, 1 + len(names))  # without tyres
        residues = cubics[:, :, above[:, of].reshape(3, -1)]
        others = cubics[:, :, np.append(rest[:, of], at[4][: len(loaded)])]
        components = tuple(names.count(name) for name in loaded)
        borders = np.append(starts, table.alpha3_range[1])
        forces = _forces_of(components, borders, residues, others)
    of_point = np.concatenate([at[0], above[:, 0].ravel(), rest[:, 0].ravel(), at[3]])
    return OrderConstants(
        excitations=tuple(excitations),
        inputs=tuple(which.tolist()),
        n_terms=t,
        n_inputs=i,
        starts=starts,
        cubics=cubics[:, :, of_point],
        highest_frequency=table.band[1],
        forces=forces,
        excites=() if levels.excites.all() else tuple(map(tuple, levels.excites.tolist())),
    )


def _forces_of(
    components: tuple[int, ...], ends: FloatArray, residues: FloatArray, others: FloatArray
) -> "ForceConstants":
    """Return forces with few cells: each number may differ by 0.5 % of its largest value.

    The components are those of each pin and cylinder, the ends (n_cells + 1,), rad, and the cubics
    of residues (n_cells, 4, 3, k), and of what follows them (n_cells, 4, n).
    """
    is_complex, n = bool(residues[:, :, 1].any()), len(residues)
    parts = residues if is_complex else residues[:, :, ::2]
    cubics = np.concatenate([parts.reshape(n, 4, -1), others], axis=2)
    starts, cubics = joined_cells(ends, cubics, _FORCE_ERROR * largest_sizes(cubics))
    return ForceConstants(components, is_complex, starts, cubics.astype(np.float32))


@dataclass(frozen=True, eq=False)
class ForceConstants:
    """Responses of forces in pins and cylinders, and their static forces, N, last.

    The cubics have single precision, and the arrangement of `prediction.levels`; imaginary parts
    of residues are left out if all are zero.
    """

    components: tuple[int, ...]  # of each pin and cylinder, 1 or 2
    is_complex: bool
    starts: FloatArray  # (n_cells,), rad
    cubics: NDArray[np.float32]  # (n_cells, 4, n_values)


@dataclass(frozen=True, eq=False)
class OrderConstants:
    """Excitations, and the responses of the response point to them."""

    excitations: tuple[Excitation, ...]
    inputs: tuple[int, ...]  # (n_orders,), which input each has
    n_terms: int  # 0 without FRFs
    n_inputs: int
    starts: FloatArray  # (n_cells,), rad
    cubics: FloatArray  # (n_cells, 4, n_values), as `prediction.levels` has them
    highest_frequency: float  # Hz, up to which responses are known
    forces: ForceConstants | None = None  # None without load ratios
    # (n_orders, n_modes), as `LevelTable.excites`; empty if each order excites each mode
    excites: tuple[tuple[bool, ...], ...] = ()


def largest_sizes(cubics: FloatArray) -> FloatArray:
    """Return the largest magnitudes of cubics, (n, 4, k), where cells begin, (k,)."""
    return np.asarray(np.nanmax(np.abs(cubics[:, 3]), axis=0, initial=0.0))


def joined_cells(
    ends: FloatArray, cubics: FloatArray, limits: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the starts and the cubics of few cells that differ from each cell by limits, (k,).

    Neighbours are joined into a cell with their values and slopes at its ends. The ends are
    (n_cells + 1,), rad, and the cubics (n_cells, 4, k).
    """
    widths, first, starts, kept = np.diff(ends), 0, list[float](), list[FloatArray]()
    begin, end = _at(cubics, 0.0 * widths), _at(cubics, widths)
    while first < len(cubics):
        after, cubic = first + 1, cubics[first]
        while after < len(cubics):
            longer = _hermite(float(ends[after + 1] - ends[first]), begin[:, first], end[:, after])
            part, whole = slice(first, after + 1), np.array([longer] * (after + 1 - first))
            at = ends[part] - ends[first]
            off = _at(whole, at) - begin[:, part], _at(whole, at + widths[part]) - end[:, part]
            # A cubic lies within its coefficients in the basis of Bernstein.
            third = widths[part, np.newaxis] / 3.0
            (f0, d0), (f1, d1) = off
            if not (np.abs([f0, f0 + third * d0, f1 - third * d1, f1]) <= limits).all():
                break
            after, cubic = after + 1, longer
        starts.append(float(ends[first]))
        kept.append(cubic)
        first = after
    return np.array(starts), np.array(kept)


def _at(cubics: FloatArray, distances: FloatArray) -> FloatArray:
    """Return values and slopes, (2, n, k), of cubics, (n, 4, k), at distances from their starts."""
    t, (c3, c2, c1, c0) = distances[:, np.newaxis], cubics.swapaxes(0, 1)
    return np.array([((c3 * t + c2) * t + c1) * t + c0, (3.0 * c3 * t + 2.0 * c2) * t + c1])


def _hermite(h: float, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return cubics, (4, k), of a width with values and slopes, (2, k), at both ends."""
    (f0, d0), (f1, d1) = begin, end
    mean = (f1 - f0) / h
    return np.array([(d0 + d1 - 2.0 * mean) / h**2, (3.0 * mean - 2.0 * d0 - d1) / h, d0, f0])
