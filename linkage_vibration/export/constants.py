# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a table that its export contains, and how few of them a tolerance needs."""

import math
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.table.table import Table, widened

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Reals = NDArray[Any]
"""Numbers in single or double precision."""
Holder = TypeVar("Holder", "Constants", "OrderConstants")

PEAK_TOLERANCE = 100.0
"""Tolerance of the peak over that of natural frequencies, as `linkage-vibration build` has it."""

_TURN = 2.0 * math.pi
_FARTHEST, _FARTHEST_SINGLE = 1e6, 64.0  # rad; a larger angle is too coarse to remove whole turns
_SAME = 1e-6  # of the largest value: a larger step between two cells is a jump
_ZERO = 1e-4  # of the largest value: smaller values have no relative error of their own
_SMALL_TERM = 1e-2  # of its largest residue: the same of a term of a response
_LARGEST_TOLERANCE = 1e-3  # that of the peak is a hundred times as large
_DEVIATION = 0.01  # relative error of standard deviations with fewer rows, and of forces
_MOST_GAPS = 1e-3  # of the range
_SHARE = 0.3  # of the tolerance of a response, which each of its numbers may use


class ExportError(LinkageVibrationError):
    """A table cannot be exported."""


@dataclass(frozen=True, eq=False)
class ForceConstants:
    """Responses of forces in pins and cylinders, and their static forces.

    The cubics, (n_cells, 4, n_values), are in single precision; they have residues and residuals of
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
    names, sources : tuple of str, (n_orders,)
        Such as "engine 1.5", and the speeds that they follow: "engine", "pto" or "ground".
    ratios : ndarray, (n_orders,)
        Frequency per speed, Hz/rpm or Hz/(m/s).
    loads : ndarray, (n_orders, 4)
        Of each load the amplitude (root mean square over time), the speed at which it has this
        amplitude, the exponent of its growth, and 1 if it is an acceleration of the soil. The
        amplitude is NaN where it is not known.
    inputs : tuple of int, (n_orders,)
        Which of the inputs of the responses each excitation has.
    n_terms, n_inputs : int
        Numbers of terms and of inputs of the responses; 0 terms if the table has no FRFs.
    starts, cubics : ndarray, (n_cells,) and (n_cells, 4, n_values)
        Cells of poles and residues, as `prediction.levels` arranges them.
    highest_frequency : float
        Up to which responses are known, Hz.
    warns : tuple of bool, (n_orders,)
        Whether each excitation may warn.
    limits : tuple of float
        Default limits of warnings and notes, and the margin, 1.
    times : tuple of int
        Default dwell time, and the gap that ends warnings, ns.
    ranks : tuple of int
        How bad each state is.
    forces : ForceConstants, optional
        None without load ratios.
    ensemble : MemberConstants, optional
        None without standard deviations of levels.
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    ratios: Reals
    loads: Reals
    inputs: tuple[int, ...]
    n_terms: int
    n_inputs: int
    starts: Reals
    cubics: Reals
    highest_frequency: float
    warns: tuple[bool, ...]
    limits: tuple[float, float, float]
    times: tuple[int, int]
    ranks: tuple[int, ...]
    forces: ForceConstants | None = None
    ensemble: MemberConstants | None = None

    @property
    def omegas(self) -> Reals:
        """Angular frequency per speed, rad/s per rpm or m/s, (n_orders,)."""
        return np.asarray((2.0 * math.pi * self.ratios).astype(self.starts.dtype))

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


@dataclass(frozen=True, eq=False)
class Constants:
    """The numbers of an export, all of one precision.

    Attributes
    ----------
    n_modes, n_peaks : int
    alpha3_range, sound_range : tuple of float
        rad; the second is at least one degree away from the toggles.
    peak_band : tuple of float
        Where the peak is sought, Hz.
    turns : bool
        Whether the crank turns all the way, so that whole turns are removed.
    farthest : float
        Up to which angle they are removed, rad.
    starts, cubics : ndarray, (n_cells,) and (n_cells, 4, 2 n_modes + 2 n_peaks)
        As `table.cells.Cells` takes them.
    piece_starts, piece_errors : ndarray, (n_pieces,)
        Where the pieces of the table begin, rad, and the bounds of their relative errors.
    parameters : ndarray, (n_rows, 2 n_modes)
        Standard deviations by uncertain numbers, as `Table.parameter_deviations` interpolates
        them; no rows without such numbers.
    parameter_step : float
        Angle between two rows, rad.
    noise_angles, noise : ndarray, (n,) and (n, 2 n_modes)
        Standard deviations by the noise of measured links, and their angles, rad.
    gaps : tuple of (float, float)
        Angles (rad) between which numbers are NaN that a table finds by eigenproblems.
    orders : OrderConstants, optional
        None without excitations.
    """

    n_modes: int
    n_peaks: int
    alpha3_range: tuple[float, float]
    sound_range: tuple[float, float]
    peak_band: tuple[float, float]
    turns: bool
    farthest: float
    starts: Reals
    cubics: Reals
    piece_starts: Reals
    piece_errors: Reals
    parameters: Reals
    parameter_step: float
    noise_angles: Reals
    noise: Reals
    gaps: tuple[tuple[float, float], ...] = ()
    orders: OrderConstants | None = None

    @property
    def ends(self) -> FloatArray:
        """Where cells begin, and where the last one ends, (n_cells + 1,), rad."""
        return np.append(self.starts, self.alpha3_range[1]).astype(float)

    @property
    def order_ends(self) -> FloatArray:
        """The same of the cells of the responses to excitations."""
        assert self.orders is not None
        return np.append(self.orders.starts, self.alpha3_range[1]).astype(float)

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
        """Bytes of all arrays."""
        orders = self.orders
        holders = [self, orders, orders and orders.forces, orders and orders.ensemble]
        values = [value for holder in holders if holder for value in vars(holder).values()]
        return sum(value.nbytes for value in values if isinstance(value, np.ndarray))


def constants_of(table: Table, orders: OrderConstants | None = None) -> Constants:
    """Return the numbers of a table, which give the same bits as the table.

    Where a lookup of the table solves an eigenproblem, in tiny cells around angles at which two
    poles meet or the highest peak changes, they give NaN.

    Raises
    ------
    ExportError
        If these cells are not tiny.
    """
    starts, cubics = table.cells.arrays
    without = np.isposinf(cubics[:, 3])
    gaps = _gaps([*starts.tolist(), table.alpha3_range[1]], np.asarray(without.any(axis=1)))
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
        turns=high - low >= _TURN * (1.0 - 1e-12),
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


def _gaps(ends: list[float], without: BoolArray) -> tuple[tuple[float, float], ...]:
    """Return where cells without cubics begin and end; neighbours are one gap."""
    gaps: list[tuple[float, float]] = []
    for start, end, is_gap in zip(ends, ends[1:], without.tolist(), strict=False):
        if is_gap and gaps and gaps[-1][1] == start:
            gaps[-1] = gaps[-1][0], end
        elif is_gap:
            gaps.append((start, end))
    return tuple(gaps)


def single(constants: Constants) -> Constants:
    """Return constants in single precision; cubics are expanded about the rounded starts."""
    orders = constants.orders
    if orders is not None:
        orders = replace(_rounded(orders), highest_frequency=orders.highest_frequency)
    return replace(_rounded(constants), farthest=_FARTHEST_SINGLE, orders=orders)


def _rounded(holder: Holder) -> Holder:
    """Return constants or orders whose numbers are those of single precision."""
    starts = holder.starts.astype(np.float32)
    cubics = moved(holder.cubics, starts.astype(float) - holder.starts)
    changes: dict[str, Any] = {}
    for name, value in vars(replace(holder, cubics=cubics)).items():
        if isinstance(value, np.ndarray):
            changes[name] = value.astype(np.float32)
        elif isinstance(value, float):
            changes[name] = float(np.float32(value))
        elif name.endswith(("range", "band")):
            changes[name] = float(np.float32(value[0])), float(np.float32(value[1]))
    return replace(holder, **changes)


def moved(cubics: Reals, shifts: Reals) -> FloatArray:
    """Return cubics, (n, 4, k), expanded about starts that are larger by shifts, (n,)."""
    shift = shifts[:, np.newaxis]
    c3, c2, c1, c0 = cubics.astype(float).swapaxes(0, 1)
    slope = c1 + (2.0 * c2 + 3.0 * c3 * shift) * shift
    return np.stack(
        [c3, c2 + 3.0 * c3 * shift, slope, c0 + (c1 + (c2 + c3 * shift) * shift) * shift], axis=1
    )


def slopes_of(cubics: Reals) -> FloatArray:
    """Return the derivatives of cubics, (n, 4, k), as cubics."""
    c3, c2, c1, _ = cubics.astype(float).swapaxes(0, 1)
    return np.stack([0.0 * c3, 3.0 * c3, 2.0 * c2, c1], axis=1)


def extremes(cubics: FloatArray, widths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest value of cubics, (n, 4, k), from 0 to widths, (n,).

    They are at the ends or where the slope is zero.
    """
    c3, c2, c1, _ = cubics.swapaxes(0, 1)
    with np.errstate(all="ignore"):
        root = np.sqrt(c2 * c2 - 3.0 * c3 * c1)
        q = -(c2 + np.copysign(root, c2))
        flat = np.nan_to_num(np.stack([q / (3.0 * c3), c1 / q]), posinf=0.0, neginf=0.0)
    width = widths[:, np.newaxis]
    at = [0.0 * c3, width + 0.0 * c3, *np.clip(flat, 0.0, width)]
    values = np.stack([_value(cubics, t) for t in at])
    return values.min(axis=0), values.max(axis=0)


def smallest_sizes(cubics: FloatArray, widths: FloatArray, share: float = _ZERO) -> FloatArray:
    """Return the smallest magnitudes in cells, (n, k), or a share of the largest of all cells.

    Errors are relative to these.
    """
    low, high = extremes(cubics, widths)
    sizes = np.abs([low, high])
    smallest = np.where(low * high > 0.0, sizes.min(axis=0), 0.0)
    with np.errstate(invalid="ignore"):
        floor = share * np.nanmax(sizes, axis=(0, 1), initial=0.0)
    return np.asarray(np.maximum(smallest, floor))


def fewer_cells(constants: Constants, tolerance: float) -> Constants:
    """Return constants with as few cells as a tolerance needs.

    Neighbouring cells are joined into one that has their values and slopes at its ends, as long as
    it agrees with all of them. The tolerance bounds the relative error of natural frequencies and
    damping ratios against the table; that of the peak is
    `PEAK_TOLERANCE` times as large, as is about that of responses. Of the
    rows of standard deviations by uncertain numbers every second is left out, repeatedly, as long
    as no deviation changes by more than 1 %.

    Raises
    ------
    ExportError
        If the tolerance is not greater than 0 and at most 1e-3.
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
    starts, cubics = _Joiner(ends, constants.cubics, limits).joined()
    every, orders = _kept_rows(constants.parameters), constants.orders
    if orders is not None and orders.n_terms:
        ends = constants.order_ends
        limits = _SHARE * PEAK_TOLERANCE * tolerance * orders.scales(np.diff(ends))
        joined = _Joiner(ends, orders.cubics, limits).joined()
        orders = replace(orders, starts=joined[0], cubics=joined[1])
    return replace(
        constants,
        starts=starts,
        cubics=cubics,
        parameters=constants.parameters[::every],
        parameter_step=every * constants.parameter_step,
        orders=orders,
    )


def forces_of(
    components: tuple[int, ...], ends: FloatArray, residues: FloatArray, others: FloatArray
) -> ForceConstants:
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
    starts, cubics = _Joiner(ends, cubics, _DEVIATION * sizes).joined()
    rounded = starts.astype(np.float32)
    cubics = moved(cubics, rounded.astype(float) - starts).astype(np.float32)
    return ForceConstants(components, is_complex, rounded, cubics)


def _kept_rows(rows: Reals) -> int:
    """Return 1 if all rows are needed, 2 if every second, and so on."""
    every, places = 1, np.arange(len(rows))
    while len(rows) > 2 * every and (len(rows) - 1) % (2 * every) == 0:
        kept = slice(None, None, 2 * every)
        fewer = np.transpose([np.interp(places, places[kept], column[kept]) for column in rows.T])
        good = np.abs(fewer - rows) <= _DEVIATION * np.abs(rows)
        if not (good | (np.isnan(fewer) & np.isnan(rows))).all():
            break
        every *= 2
    return every


class _Joiner:
    """Joins cells that begin at angles and end at the next; the last of these ends the last cell.

    A joined cell may differ from each cell by its limits, (n_cells, k).
    """

    def __init__(self, ends: Reals, cubics: Reals, limits: Reals) -> None:
        self._ends, self._cubics, self._limits = ends, cubics, limits
        self._widths = np.diff(ends)
        self._first = cubics[:, 3], cubics[:, 2]  # values and slopes where each cell begins
        last = moved(cubics, self._widths)
        self._last = last[:, 3], last[:, 2]
        with np.errstate(invalid="ignore"):
            largest = np.nanmax(np.abs(self._first[0]), axis=0, initial=0.0)
            step = np.abs(self._first[0][1:] - self._last[0][:-1])
        unequal = np.isnan(self._first[0][1:]) != np.isnan(self._last[0][:-1])
        self._joins = ~(unequal | (step > _SAME * largest)).any(axis=1)

    def joined(self) -> tuple[FloatArray, FloatArray]:
        """Return the starts and the cubics of as few cells as the limits allow."""
        starts, cubics, first = [], [], 0
        while first < len(self._cubics):
            after = self._longest(first)
            starts.append(self._ends[first])
            single = after == first + 1
            cubics.append(self._cubics[first] if single else self._cubic(first, after))
            first = after
        return np.array(starts), np.array(cubics)

    def _longest(self, first: int) -> int:
        """Return the cell after the longest joined cell that begins with this cell."""
        breaks = np.flatnonzero(~self._joins[first:])
        end = first + 1 + int(breaks[0]) if len(breaks) else len(self._cubics)
        good, step = first + 1, 1
        while good < end and self._holds(first, min(good + step, end)):
            good, step = min(good + step, end), 2 * step
        bad = min(good + step, end + 1)
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if self._holds(first, middle) else (good, middle)
        return good

    def _cubic(self, first: int, after: int) -> FloatArray:
        """Return the cubics, (4, k), with the values and slopes of cells at both ends.

        The cells are those from ``first`` to the one before ``after``.
        """
        h = float(self._ends[after] - self._ends[first])
        f0, d0 = (ends[first] for ends in self._first)
        f1, d1 = (ends[after - 1] for ends in self._last)
        mean = (f1 - f0) / h
        return np.array([(d0 + d1 - 2.0 * mean) / h**2, (3.0 * mean - 2.0 * d0 - d1) / h, d0, f0])

    def _holds(self, first: int, after: int) -> bool:
        """Return whether the joined cell agrees with the cells."""
        shifts = self._ends[first:after] - self._ends[first]
        whole = np.repeat(self._cubic(first, after)[np.newaxis], len(shifts), axis=0)
        off = moved(whole, shifts) - self._cubics[first:after]
        low, high = extremes(off, self._widths[first:after])
        return not (np.maximum(-low, high) > self._limits[first:after]).any()


def _value(cubics: Reals, t: Reals) -> FloatArray:
    """Return the values of cubics, (n, 4, k), at distances from their starts, (n, k)."""
    c3, c2, c1, c0 = cubics.swapaxes(0, 1)
    return np.asarray(((c3 * t + c2) * t + c1) * t + c0)
