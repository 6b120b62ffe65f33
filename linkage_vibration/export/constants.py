# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a table that its export contains."""

import math
from dataclasses import dataclass

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.export.orders import OrderConstants
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.table.interpolation import covers_a_turn
from linkage_vibration.table.table import Table, widened

FARTHEST = 1e6
"""A larger angle, rad, is too coarse to remove whole turns."""

PER_MODE = (
    "natural_frequencies",
    "frequency_stddevs",
    "damping_ratios",
    "damping_ratio_stddevs",
    "frequency_slopes",
)
NUMBERS = (*PER_MODE, "frf_peak_frequency", "frf_peak_magnitude", "interpolation_error")
"""The numbers of a prediction beside the status, in their order in C."""

_MOST_GAPS = 1e-3  # of the range


class ExportError(LinkageVibrationError):
    """A table cannot be exported."""


@dataclass(frozen=True, eq=False)
class Constants:
    """The numbers of an export."""

    n_modes: int
    n_peaks: int
    alpha3_range: tuple[float, float]  # rad
    sound_range: tuple[float, float]  # rad; at least one degree away from the toggles
    peak_band: tuple[float, float]  # where the peak is sought, Hz
    turns: bool  # whole turns are removed
    starts: FloatArray  # (n_cells,), as `table.cells.Cells` takes them
    cubics: FloatArray  # (n_cells, 4, 2 n_modes + 2 n_peaks)
    piece_starts: FloatArray  # (n_pieces,), rad
    piece_errors: FloatArray  # (n_pieces,), bounds, relative
    parameters: FloatArray  # (n_rows, 2 n_modes), deviations by uncertain numbers, if any
    parameter_step: float  # rad between two rows
    noise_angles: FloatArray  # (n,), rad
    noise: FloatArray  # (n, 2 n_modes), deviations by the noise of links
    gaps: tuple[tuple[float, float], ...] = ()  # rad, between which numbers are NaN
    orders: OrderConstants | None = None

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
        """Bytes of all arrays in C."""
        orders = self.orders
        holders = [self, orders, orders and orders.forces]
        values = [value for holder in holders if holder for value in vars(holder).values()]
        return sum(value.nbytes for value in values if isinstance(value, np.ndarray))


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
