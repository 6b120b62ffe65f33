# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the differences between the numbers of an export and those of its table."""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from linkage_vibration.export.constants import Constants, single
from linkage_vibration.export.cubics import (
    FloatArray,
    Reals,
    extremes,
    moved,
    slopes_of,
    smallest_sizes,
)
from linkage_vibration.export.orders import OrderConstants

_ROUNDINGS = 8  # of the evaluation of a cubic


@dataclass(frozen=True)
class ExportErrors:
    """Bounds of the differences between the numbers of an export and those of its table."""

    frequency: float = 0.0  # relative
    damping_ratio: float = 0.0  # relative
    slope: float = 0.0  # of a natural frequency, over its largest slope
    peak: float = 0.0  # relative, of frequency and magnitude
    response: float = 0.0  # over the sum of the magnitudes of its terms

    @property
    def text(self) -> str:
        """A sentence for people."""
        if self == ExportErrors():
            return "The numbers are those of the table, to the last bit."
        text = (
            "The numbers differ from those of the table by at most: natural frequencies "
            f"{upwards(self.frequency)}, damping ratios {upwards(self.damping_ratio)}, peak "
            f"{upwards(self.peak)} (relative); slopes {upwards(self.slope)} (of their largest "
            "values). Where another peak is as high as the highest one within this error, or the "
            "highest one is within it of an end of the band, the other one may be reported."
        )
        if self.response:
            text += f" Responses to excitations differ by at most {upwards(self.response)} of the "
            text += "sum of the magnitudes of their terms."
        return text


def upwards(error: float) -> str:
    """Return an error with two digits, rounded up.

    >>> upwards(9.71e-7), upwards(2e-8), upwards(0.0)
    ('9.8e-07', '2.0e-08', '0')
    """
    if not error:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(error)) - 1)
    return f"{unit * math.ceil(error / unit * (1.0 - 1e-12)):.1e}"


def chosen_constants(
    constants: Constants, approximate: Constants, *, in_single: bool
) -> tuple[Constants, ExportErrors]:
    """Return the numbers to export with their errors, which are added to those of the pieces.

    The approximate constants have fewer cells than those of the table, or are the same.
    """
    chosen = single(approximate) if in_single else approximate
    if chosen is constants:
        return constants, ExportErrors()
    errors = bounds(constants, chosen)
    wider = constants.piece_errors + max(errors.frequency, errors.damping_ratio)
    real = chosen.starts.dtype.type
    rounded = np.nextafter(wider.astype(real), real(math.inf))
    return replace(chosen, piece_errors=rounded), errors


def bounds(constants: Constants, approximate: Constants) -> ExportErrors:
    """Bound how far approximate numbers are from those of the table in double precision.

    Between two cells the difference is a cubic, whose extremes are known. Beside it there are the
    roundings of an evaluation and, in single precision, those of the angle.
    """
    ends, n = constants.ends, constants.n_modes
    unit, turned = float(np.finfo(approximate.starts.dtype).eps), 0.0
    if approximate.starts.dtype != constants.starts.dtype:
        turned = unit * (approximate.farthest if constants.turns else float(np.abs(ends).max()))
    of_values = partial(_apart, ends, unit, turned, approximate.starts)
    off, slopes = of_values(constants.cubics, approximate.cubics)
    with np.errstate(all="ignore"):
        relative = off / smallest_sizes(constants.cubics, np.diff(ends))
    peaks = relative[:, 2 * n :]
    # The frequency of a peak without a height does not count.
    absent = (constants.cubics[:, :, 2 * n + constants.n_peaks :] == 0.0).all(axis=1)
    peaks[:, : constants.n_peaks][absent] = 0.0
    curved, _ = of_values(slopes_of(constants.cubics), slopes_of(approximate.cubics))
    of_slopes = curved[:, :n] / np.nanmax(slopes[:, :n], axis=0)
    response, orders, near = 0.0, constants.orders, approximate.orders
    if orders is not None and near is not None and orders.n_terms:
        ends = np.append(orders.starts, constants.alpha3_range[1])
        scales = orders.scales(np.diff(ends))
        off, _ = _apart(ends, unit, turned, near.starts, orders.cubics, near.cubics)
        response = _response_bound(orders, off, scales, unit)
    return ExportErrors(
        frequency=float(np.nanmax(relative[:, :n], initial=0.0)),
        damping_ratio=float(np.nanmax(relative[:, n : 2 * n], initial=0.0)),
        slope=float(np.nanmax(of_slopes, initial=0.0)),
        peak=float(np.nanmax(peaks, initial=0.0)),
        response=response,
    )


def _apart(
    ends: FloatArray, unit: float, turned: float, starts: Reals, exact: Reals, near: Reals
) -> tuple[FloatArray, FloatArray]:
    """Return bounds of errors of values in cells, (n_cells, k), and of their slopes.

    The ends, (n_cells + 1,), rad, are those of the exact cells; a number has the relative rounding
    ``unit``, and an angle is rounded by ``turned``, rad.
    """
    widths, starts = np.diff(ends), starts.astype(float)
    other = np.searchsorted(starts, 0.5 * (ends[1:] + ends[:-1]), side="right") - 1
    shifts, near = ends[:-1] - starts[other], near.astype(float)[other]
    slopes = np.maximum(*np.abs(extremes(slopes_of(exact), widths)))
    rounding = np.abs(moved(np.abs(near), np.abs(shifts) + widths)[:, 3])
    low, high = extremes(moved(near, shifts) - exact, widths)
    return np.maximum(-low, high) + _ROUNDINGS * unit * rounding + turned * slopes, slopes


def _response_bound(
    orders: OrderConstants, off: FloatArray, scales: FloatArray, unit: float
) -> float:
    """Return the error of responses, over the sum of the magnitudes of their terms."""
    t, i, n = orders.n_terms, orders.n_inputs, len(off)
    with np.errstate(all="ignore"):
        relative = np.nan_to_num(off / scales, nan=0.0, posinf=math.inf)
        # Frequencies and denominators are rounded, most where these nearly vanish.
        poles = relative[:, : 3 * t].reshape(n, 3, t).sum(axis=1)
        poles += 2 * _ROUNDINGS * unit * (1.0 + 2.0 * orders.cubics[:, 3, :t] / scales[:, :t])
    above = relative[:, 3 * t : 3 * t * (1 + i)].reshape(n, 3, t, i).sum(axis=1)
    others = relative[:, 3 * t * (1 + i) :].reshape(n, 4, i).sum(axis=1)
    terms = (poles[..., np.newaxis] + above).max(axis=1) + others
    error = float(terms.max()) + (2 * t + 4 * _ROUNDINGS) * unit
    return error / (1.0 - error) if error < 1.0 else math.inf
