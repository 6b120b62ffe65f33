# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of excitations that an export contains, and of the responses to them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.export.cubics import (
    FloatArray,
    Reals,
    extremes,
    joined_cells,
    moved,
    smallest_sizes,
)
from linkage_vibration.mechanics.forces import LEAST_REFERENCE
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.levels import KNOWN, LevelTable
from linkage_vibration.table.table import Table

_SMALL_TERM = 1e-2  # of its largest residue: a smaller term has no relative error of its own
_FORCE_ERROR = 0.01  # of each number of the forces, over its largest value


def orders_of(
    table: Table, levels: LevelTable, excitations: Sequence[Excitation], *, coarse: bool = False
) -> "OrderConstants":
    """Return excitations with the responses to them, as an export contains them.

    Differences of the members of the ensemble have 16 bits, or 8 if they are coarse.
    """
    starts, cubics, t, which = levels.arrays
    i, names = int(which.max()) + 1, [name for name, _ in table.forces if levels.force_places]
    forces, o = None, 1 + len(names)
    ends = np.cumsum([3 * t, 3 * t * o * i, 3 * o * i, i if t else 0])
    at = np.split(np.arange(cubics.shape[2]), ends)  # as `prediction.levels` arranges the values
    above, rest = (part.reshape(-1, o, i) for part in at[1:3])
    if names:
        residues = cubics[:, :, above[:, 1:].reshape(3, -1)]
        others = cubics[:, :, np.append(rest[:, 1:], at[4])]
        components = tuple(names.count(name) for name in levels.force_places)
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
        members=_members_of(table, levels.member_arrays, o, coarse=coarse),
    )


def _forces_of(
    components: tuple[int, ...], ends: FloatArray, residues: FloatArray, others: FloatArray
) -> "ForceConstants":
    """Return forces with few cells: each number may differ by 1 % of its largest value.

    Parameters
    ----------
    components : tuple of int
        Of each pin and cylinder.
    ends : ndarray, (n_cells + 1,)
        Of the cells, rad.
    residues, others : ndarray, (n_cells, 4, 3, k) and (n_cells, 4, n)
        Cubics of both parts and the rates, and what follows them.
    """
    is_complex, n = bool(residues[:, :, 1].any()), len(residues)
    parts = residues if is_complex else residues[:, :, ::2]
    cubics = np.concatenate([parts.reshape(n, 4, -1), others], axis=2)
    sizes = smallest_sizes(cubics, np.diff(ends), 1.0)
    starts, cubics = joined_cells(ends, cubics, _FORCE_ERROR * sizes)
    rounded = starts.astype(np.float32).astype(float)
    cubics = moved(cubics, rounded - starts).astype(np.float32)
    return ForceConstants(components, is_complex, rounded, cubics)


def _members_of(
    table: Table, arrays: tuple[NDArray[Any], ...], n_outputs: int, *, coarse: bool
) -> "MemberConstants | None":
    """Return the members whose numbers are possible, if these are as many as the node needs."""
    if not arrays:
        return None
    nodes, values, places, amplitudes, frequencies = arrays
    possible = np.isfinite(values[:, 1:]).all(axis=(0, 2))
    if possible.mean() < KNOWN:
        return None
    apart = (values[:, 1:] - values[:, :1])[:, possible].swapaxes(1, 2)
    kind = np.int8 if coarse else np.int16
    steps = np.abs(apart).max(axis=2) / np.float32(np.iinfo(kind).max)
    counts = np.round(apart / np.where(steps > 0.0, steps, 1.0)[..., np.newaxis])
    low, high = table.toggles or (0.0, 0.0)
    return MemberConstants(
        n_modes=table.ensemble_poles.shape[-1],
        n_outputs=n_outputs,
        stroke_middle=(low + high) / 2.0,
        stroke_half=(high - low) / 2.0,
        least_share=LEAST_REFERENCE,
        reference=table.reference_force or 0.0,
        nodes=nodes.astype(np.float32),
        places=places.astype(np.uint16),
        nominal=values[:, 0],
        steps=steps,
        values=counts.astype(kind),
        amplitudes=amplitudes[possible].astype(np.float32),
        frequencies=frequencies[possible].astype(np.float32),
    )


@dataclass(frozen=True, eq=False)
class ForceConstants:
    """Responses of forces in pins and cylinders, and their static forces.

    The starts, (n_cells,), rad, are numbers of single precision, and the cubics, (n_cells, 4,
    n_values), are in single precision; these have residues and residuals of
    all components, as `prediction.levels` arranges them, and then the static forces, N. Without
    imaginary parts of residues these are left out.
    """

    components: tuple[int, ...]  # of each pin and cylinder, 1 or 2
    is_complex: bool
    starts: Reals
    cubics: Reals


@dataclass(frozen=True, eq=False)
class MemberConstants:
    """The members of a table's ensemble, by which levels are uncertain.

    Attributes
    ----------
    n_modes, n_outputs : int
    stroke_middle, stroke_half : float
        Of the stroke variable, rad; the half is 0 if it is the angle itself.
    least_share, reference : float
        The share of the largest static force that forces are compared with at least; and what they
        are compared with, N, or 0.
    nodes : ndarray, (n_nodes,)
        Where members are known, in the stroke variable.
    places : ndarray, (n_values,)
        Which numbers of `prediction.ensemble.Members` the values are.
    nominal, steps : ndarray, (n_nodes, n_values)
        Values of the mechanism itself, and the steps of the differences.
    values : ndarray of int, (n_nodes, n_values, n_members)
        How many steps members differ from it.
    amplitudes, frequencies : ndarray, (n_members, n_orders)
        Their factors of loads and frequencies.
    """

    n_modes: int
    n_outputs: int
    stroke_middle: float
    stroke_half: float
    least_share: float
    reference: float
    nodes: Reals
    places: NDArray[np.integer]
    nominal: Reals
    steps: Reals
    values: NDArray[np.integer]
    amplitudes: Reals
    frequencies: Reals


@dataclass(frozen=True, eq=False)
class OrderConstants:
    """Excitations, and the responses of the response point to them.

    Attributes
    ----------
    excitations : tuple of Excitation
    inputs : tuple of int, (n_orders,)
        Which of the inputs of the responses each excitation has.
    n_terms, n_inputs : int
        Numbers of terms and of inputs of the responses; 0 terms if the table has no FRFs.
    starts, cubics : ndarray, (n_cells,) and (n_cells, 4, n_values)
        Cells of poles and residues, as `prediction.levels` arranges them.
    highest_frequency : float
        Up to which responses are known, Hz.
    forces : ForceConstants, optional
        None without load ratios.
    members : MemberConstants, optional
        None without standard deviations of levels.
    """

    excitations: tuple[Excitation, ...]
    inputs: tuple[int, ...]
    n_terms: int
    n_inputs: int
    starts: Reals
    cubics: Reals
    highest_frequency: float
    forces: ForceConstants | None = None
    members: MemberConstants | None = None

    def scales(self, widths: FloatArray) -> FloatArray:
        """Return what errors of the values in cells of widths are relative to, (n_cells, n_values).

        A term (a + i w b) / (k - w^2 + i w c) changes by the sum of the relative errors of k, c, a
        and b at most: those of k over the smallest denominator, and of b over a at the band's end.
        """
        t, n = self.n_terms, len(self.cubics)
        low, _ = extremes(self.cubics, widths)
        k, c = low[:, :t], low[:, 2 * t : 3 * t]
        top = 2.0 * math.pi * self.highest_frequency
        root = np.where(c * c < 2.0 * k, c * np.sqrt(np.maximum(k - 0.25 * c * c, 0.0)), k)
        root = np.where(k - 0.5 * c * c > top * top, k - top * top, root)
        parts = [root, root, np.maximum(c, root / top)]
        above = 3 * t * (1 + self.n_inputs)
        small = smallest_sizes(self.cubics, widths, _SMALL_TERM)
        for values in (small[:, 3 * t : above], small[:, above : above + 3 * self.n_inputs]):
            real, imaginary, _ = values.reshape(n, 3, -1).swapaxes(0, 1)
            size = np.hypot(real, imaginary)
            parts += [size, size, size / top]
        return np.hstack([*parts, small[:, above + 3 * self.n_inputs :]])
