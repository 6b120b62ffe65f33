# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a table that its export contains, and how few of them a tolerance needs."""

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.export.cubics import FloatArray, Reals, joined_cells, moved, smallest_sizes
from linkage_vibration.export.orders import OrderConstants
from linkage_vibration.mechanics.arrays import BoolArray
from linkage_vibration.prediction.predictor import covers_a_turn
from linkage_vibration.table.table import Table, widened

Holder = TypeVar("Holder", "Constants", "OrderConstants")

PEAK_TOLERANCE = 100.0
"""Tolerance of the peak over that of natural frequencies, as `linkage-vibration build` has it."""

_FARTHEST, _FARTHEST_SINGLE = 1e6, 64.0  # rad; a larger angle is too coarse to remove whole turns
_LARGEST_TOLERANCE = 1e-3  # that of the peak is a hundred times as large
ROW_ERROR = 0.01
"""Relative error of standard deviations by uncertain numbers with fewer rows."""

_MOST_GAPS = 1e-3  # of the range
_SHARE = 0.3  # of the tolerance of a response, which each of its numbers may use


class ExportError(LinkageVibrationError):
    """A table cannot be exported."""


@dataclass(frozen=True, eq=False)
class Constants:
    """The numbers of an export, which have the precision of the cells in C."""

    n_modes: int
    n_peaks: int
    alpha3_range: tuple[float, float]  # rad
    sound_range: tuple[float, float]  # rad; at least one degree away from the toggles
    peak_band: tuple[float, float]  # where the peak is sought, Hz
    turns: bool  # whole turns are removed
    farthest: float  # rad, up to which they are
    starts: Reals  # (n_cells,), as `table.cells.Cells` takes them
    cubics: Reals  # (n_cells, 4, 2 n_modes + 2 n_peaks)
    piece_starts: Reals  # (n_pieces,), rad
    piece_errors: Reals  # (n_pieces,), bounds, relative
    parameters: Reals  # (n_rows, 2 n_modes), deviations by uncertain numbers, if any
    parameter_step: float  # rad between two rows
    noise_angles: Reals  # (n,), rad
    noise: Reals  # (n, 2 n_modes), deviations by the noise of links
    gaps: tuple[tuple[float, float], ...] = ()  # rad, between which numbers are NaN
    orders: OrderConstants | None = None

    @property
    def ends(self) -> FloatArray:
        """Where cells begin, and where the last one ends, (n_cells + 1,), rad."""
        return np.append(self.starts, self.alpha3_range[1]).astype(float)

    @property
    def gap_text(self) -> str:
        """A sentence about the gaps; empty without any."""
        if not self.gaps:
            return ""
        first, last = (math.degrees(angle) for angle in self.gaps[0])
        width = math.degrees(sum(end - start for start, end in self.gaps))
        count = "1 gap" if len(self.gaps) == 1 else f"{len(self.gaps)} gaps"
        return (
            f"In {count}, the first from {first:.6f} to {last:.6f} deg, of "
            f"{width:.2g} deg together, two poles meet or the highest peak changes; numbers that "
            "only an eigenproblem yields are NaN there."
        )

    @property
    def size(self) -> int:
        """Bytes of all arrays in C, where none is more precise than the cells."""
        orders = self.orders
        holders = [self, orders, orders and orders.forces]
        values = [value for holder in holders if holder for value in vars(holder).values()]
        arrays = [value for value in values if isinstance(value, np.ndarray)]
        return sum(array.size * min(array.itemsize, self.starts.itemsize) for array in arrays)


def constants_of(table: Table, orders: OrderConstants | None = None) -> Constants:
    """Return the numbers of a table, which give the same bits as the table.

    They are NaN in tiny cells, where a lookup of the table solves an eigenproblem as poles meet or
    the highest peak changes. An ExportError says that these cells are not tiny.
    """
    starts, cubics = table.cells.arrays
    without = np.isposinf(cubics[:, 3])
    gaps = _gaps(np.append(starts, table.alpha3_range[1]), np.asarray(without.any(axis=1)))
    width = sum(end - start for start, end in gaps)
    if width > _MOST_GAPS * float(np.ptp(table.alpha3_range)):
        first = math.degrees(gaps[0][0])
        raise ExportError(
            f"The table of {table.mechanism_name} cannot be exported: over "
            f"{math.degrees(width):.3g} deg of its range, from {first:.4f} deg on, poles are so "
            "near to each other that a lookup solves an eigenproblem, which C without dynamic "
            "memory does not do. Change the dampers, or shorten range_deg of the input, so that "
            "no poles meet."
        )
    cubics = np.where(without[:, np.newaxis], math.nan, cubics)
    low, high = table.alpha3_range
    rows = np.hstack(list(table.parameter_stddev))
    noise = np.hstack([table.frequency_stddev, table.damping_ratio_stddev])
    return Constants(
        n_modes=table.n_modes,
        n_peaks=cubics.shape[2] // 2 - table.n_modes,
        alpha3_range=(low, high),
        sound_range=(max(table.sound_range[0], low), min(table.sound_range[1], high)),
        peak_band=widened(table.peak_band),
        turns=covers_a_turn(table.alpha3_range),
        farthest=_FARTHEST,
        starts=starts,
        cubics=cubics,
        piece_starts=table.alpha3[table.pieces[:-1]],
        piece_errors=table.interpolation_error,
        parameters=rows,
        parameter_step=(high - low) / (len(rows) - 1) if len(rows) else 0.0,
        noise_angles=table.alpha3 if table.measured else np.empty(0),
        noise=noise if table.measured else np.empty((0, 2 * table.n_modes)),
        gaps=gaps,
        orders=orders,
    )


def _gaps(ends: FloatArray, without: BoolArray) -> tuple[tuple[float, float], ...]:
    """Return where cells without cubics begin and end; neighbours are one gap."""
    changes = np.flatnonzero(np.diff(without, prepend=False, append=False))
    return tuple((float(a), float(b)) for a, b in ends[changes].reshape(-1, 2))


def single(constants: Constants) -> Constants:
    """Return constants in single precision; cubics are expanded about the rounded starts."""
    orders = constants.orders and _rounded(constants.orders)
    return replace(_rounded(constants), farthest=_FARTHEST_SINGLE, orders=orders)


def _rounded(holder: Holder) -> Holder:
    """Return constants or orders whose cells are in single precision."""
    starts = holder.starts.astype(np.float32)
    cubics = moved(holder.cubics, starts.astype(float) - holder.starts)
    return replace(holder, starts=starts, cubics=cubics.astype(np.float32))


def fewer_cells(constants: Constants, tolerance: float) -> Constants:
    """Return constants with as few cells as a tolerance up to 1e-3 needs, or raise ExportError.

    It bounds relative errors of frequencies and damping ratios; peak and responses may have
    `PEAK_TOLERANCE` times as much. Rows of deviations are left out that change none by 1 %.
    """
    if not 0.0 < tolerance <= _LARGEST_TOLERANCE:
        raise ExportError(f"The tolerance {tolerance:g} is not between 0 and 1e-3; give 1e-6.")
    ends, n, peaks = constants.ends, 2 * constants.n_modes, constants.n_peaks
    allowed = np.full(n + 2 * peaks, tolerance)
    allowed[n:] *= PEAK_TOLERANCE
    limits = allowed * smallest_sizes(constants.cubics, np.diff(ends))
    # The frequency of a peak without a height does not count.
    absent = (constants.cubics[:, :, n + peaks :] == 0.0).all(axis=1)
    limits[:, n : n + peaks][absent] = math.inf
    starts, cubics = joined_cells(ends, constants.cubics, limits)
    every, orders = _kept_rows(constants.parameters), constants.orders
    if orders is not None and orders.n_terms:
        ends = np.append(orders.starts, constants.alpha3_range[1])
        limits = _SHARE * PEAK_TOLERANCE * tolerance * orders.scales(np.diff(ends))
        joined = joined_cells(ends, orders.cubics, limits)
        orders = replace(orders, starts=joined[0], cubics=joined[1])
    return replace(
        constants,
        starts=starts,
        cubics=cubics,
        parameters=constants.parameters[::every],
        parameter_step=every * constants.parameter_step,
        orders=orders,
    )


def _kept_rows(rows: Reals) -> int:
    """Return 1 if all rows are needed, 2 if every second, and so on."""
    every, places = 1, np.arange(len(rows))
    while len(rows) > 2 * every and (len(rows) - 1) % (2 * every) == 0:
        kept = slice(None, None, 2 * every)
        fewer = np.transpose([np.interp(places, places[kept], column[kept]) for column in rows.T])
        good = np.abs(fewer - rows) <= ROW_ERROR * np.abs(rows)
        if not (good | (np.isnan(fewer) & np.isnan(rows))).all():
            break
        every *= 2
    return every
