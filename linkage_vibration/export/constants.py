# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What one export contains: a table, its numbers, and how its names begin."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.export.orders import OrderConstants, orders_of
from linkage_vibration.mechanics.arrays import FloatArray, runs
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.table.interpolation import covers_a_turn
from linkage_vibration.table.table import Table, widened

NAME = "linkage_vibration"  # how names begin unless another name is wanted
FARTHEST = 1e6  # rad; a larger angle is too coarse to remove whole turns

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
_VALID_NAME = re.compile(r"[a-z][0-9a-z_]{0,19}")
_EQUAL = "The numbers are those of the table, to the last bit."
_LOAD_RATIOS = (
    " Load ratios come from numbers of their own in single precision, of which each differs by at "
    "most 1 % of its largest value."
)


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
    ends = np.append(starts, table.alpha3_range[1]).tolist()
    gaps = tuple((ends[i], ends[j]) for i, j in runs(np.asarray(without.any(axis=1))))
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
    (low, high), away = table.alpha3_range, table.range_away_from_toggles
    rows = np.hstack(list(table.parameter_stddev))
    noise = np.hstack([table.frequency_stddev, table.damping_ratio_stddev])
    return Constants(
        n_modes=table.n_modes,
        n_peaks=cubics.shape[2] // 2 - table.n_modes,
        alpha3_range=(low, high),
        sound_range=(max(away[0], low), min(away[1], high)),
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


@dataclass(frozen=True, eq=False)
class Export:
    """A table to export."""

    name: str  # begins the names of files and of everything in C
    table: Table
    constants: Constants

    @property
    def mode_labels(self) -> list[str]:
        """How the modes are called, (n_modes,)."""
        return [self.table.mode_label(mode) for mode in range(self.table.n_modes)]

    @property
    def accuracy(self) -> str:
        """Sentences about how the numbers differ from those of the table."""
        orders = self.constants.orders
        return f"{_EQUAL}{_LOAD_RATIOS if orders and orders.forces else ''}"


def export_of(
    table: Table,
    mechanism: Mechanism | None = None,
    excitations: Sequence[Excitation] = (),
    *,
    name: str = NAME,
) -> Export:
    """Return what to export; an ExportError refuses names that C may not tell apart."""
    if not _VALID_NAME.fullmatch(name):
        raise ExportError(
            f"{name!r} cannot begin names in C; give up to 20 lower-case letters, digits and "
            "underscores, of which the first is a letter."
        )
    orders = None
    if mechanism is not None and excitations:
        levels = kept_levels(Predictor(table), mechanism, excitations)
        for each in excitations:
            if each.load is not None and each.load.across:
                problem = f"excitation {each.name} acts across the plane"
                raise ExportError(f"{problem}, which exports leave out; remove its amplitude.")
        orders = orders_of(table, levels, excitations)
    return Export(name, table, constants_of(table, orders))
