# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluates the numbers of an export as the exported C does, in the same order and precision.

The expected values of the generated test come from here, and so do the bounds of the errors.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.export.constants import (
    Constants,
    FloatArray,
    Reals,
    extremes,
    moved,
    single,
    slopes_of,
    smallest_sizes,
)
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.fields import message_constants
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.table.cells import Cells

PER_MODE = (
    "natural_frequencies",
    "frequency_stddev",
    "damping_ratios",
    "damping_ratio_stddev",
    "frequency_slopes",
)
NUMBERS = (*PER_MODE, "frf_peak_frequency", "frf_peak_magnitude", "interpolation_error")
"""The outputs beside the status, in their order in C; `frequency_slopes` are in Hz/rad."""

_ROUNDINGS = 8  # of the evaluation of a cubic


@dataclass(frozen=True)
class ExportErrors:
    """Bounds of the differences between the numbers of an export and those of its table.

    Attributes
    ----------
    frequency, damping_ratio : float
        Relative.
    slope : float
        Of the slopes of natural frequencies, over the largest slope of each.
    peak : float
        Relative, of frequency and magnitude of each candidate for the highest peak.
    """

    frequency: float = 0.0
    damping_ratio: float = 0.0
    slope: float = 0.0
    peak: float = 0.0

    @property
    def text(self) -> str:
        """A sentence for people."""
        if self == ExportErrors():
            return "The numbers are those of the table, to the last bit."
        return (
            "The numbers differ from those of the table by at most: natural frequencies "
            f"{upwards(self.frequency)}, damping ratios {upwards(self.damping_ratio)}, peak "
            f"{upwards(self.peak)} (relative); slopes {upwards(self.slope)} (of their largest "
            "values). Where another peak is as high as the highest one within this error, or the "
            "highest one is within it of an end of the band, the other one may be reported."
        )


def upwards(error: float) -> str:
    """Return an error with two digits, rounded up.

    Examples
    --------
    >>> upwards(9.71e-7), upwards(2e-8), upwards(0.0)
    ('9.8e-07', '2.0e-08', '0')
    """
    if not error:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(error)) - 1)
    return f"{unit * math.ceil(error / unit * (1.0 - 1e-12)):.1e}"


def exported(
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
    widths, starts = np.diff(ends), approximate.starts.astype(float)
    other = np.searchsorted(starts, 0.5 * (ends[1:] + ends[:-1]), side="right") - 1
    shifts, unit = ends[:-1] - starts[other], float(np.finfo(approximate.starts.dtype).eps)
    farthest = approximate.farthest if constants.turns else float(np.abs(ends).max())
    turned = unit * farthest if approximate.starts.dtype != constants.starts.dtype else 0.0

    def apart(exact: Reals, near: Reals) -> tuple[FloatArray, FloatArray]:
        near = near.astype(float)[other]
        slopes = np.maximum(*np.abs(extremes(slopes_of(exact), widths)))
        rounding = np.abs(moved(np.abs(near), shifts + widths)[:, 3])
        low, high = extremes(moved(near, shifts) - exact, widths)
        return np.maximum(-low, high) + _ROUNDINGS * unit * rounding + turned * slopes, slopes

    off, slopes = apart(constants.cubics, approximate.cubics)
    with np.errstate(all="ignore"):
        relative = off / smallest_sizes(constants.cubics, widths)
    peaks = relative[:, 2 * n :]
    # The frequency of a peak without a height does not count.
    absent = (constants.cubics[:, :, 2 * n + constants.n_peaks :] == 0.0).all(axis=1)
    peaks[:, : constants.n_peaks][absent] = 0.0
    curved, _ = apart(slopes_of(constants.cubics), slopes_of(approximate.cubics))
    of_slopes = curved[:, :n] / np.nanmax(slopes[:, :n], axis=0)
    parts = relative[:, :n], relative[:, n : 2 * n], of_slopes, peaks
    return ExportErrors(*(float(np.nanmax(part, initial=0.0)) for part in parts))


def evaluate(constants: Constants, crank_angle: Reals, stddev: Reals) -> MessageColumns:
    """Return what the exported function gives at angles with standard deviations, (n,), rad.

    Both are in the precision of the constants.
    """
    n, cells = constants.n_modes, Cells(constants.starts, constants.cubics)
    with np.errstate(all="ignore"):
        status, angle, has_numbers = _positions(constants, crank_angle)
        values, slopes = cells.many_values(angle), cells.many_slopes(angle)[:, : 2 * n]
        piece = np.searchsorted(constants.piece_starts, angle, side="right") - 1
        error = constants.piece_errors[np.maximum(piece, 0)]
        modal = values[:, : 2 * n]
        parameters, noise = _deviations(constants, angle)
        parameters[:, :n] *= modal[:, :n]
        turned = np.abs(slopes) * stddev[:, np.newaxis]
        missed = error[:, np.newaxis] * modal
        squares = parameters * parameters + turned * turned + noise * noise + missed * missed
        total = np.sqrt(squares)
        frequency, magnitude = _peaks(constants, values[:, 2 * n :])
    per_mode = modal[:, :n], total[:, :n], modal[:, n:], total[:, n:], slopes[:, :n]
    numbers = dict(zip(NUMBERS, (*per_mode, frequency, magnitude, error), strict=True))
    for column in numbers.values():
        column[~has_numbers] = np.nan
    return MessageColumns(status=status, **numbers)


def _positions(
    constants: Constants, crank_angle: Reals
) -> tuple[NDArray[np.int32], Reals, NDArray[np.bool_]]:
    """Return statuses, equivalent angles within the table, rad, and whether there are any."""
    statuses = message_constants(PREDICTION)
    real = constants.starts.dtype.type
    low, high = map(real, constants.alpha3_range)
    angle = crank_angle.copy()
    if constants.turns:
        outside = ((angle < low) | (angle > high)) & (np.abs(angle) < real(constants.farthest))
        turned = low + np.mod(angle[outside] - low, real(2.0 * np.pi))
        angle[outside] = np.minimum(turned, high)
    inside = (angle >= low) & (angle <= high)
    sound_low, sound_high = map(real, constants.sound_range)
    sound = (angle >= sound_low) & (angle <= sound_high)
    known = np.where(sound, statuses["STATUS_OK"], statuses["STATUS_NEAR_TOGGLE"])
    status = np.where(inside, known, statuses["STATUS_OUT_OF_RANGE"])
    status = np.where(np.isfinite(crank_angle), status, statuses["STATUS_INVALID_ANGLE"])
    return status.astype(np.int32), np.where(inside, angle, low), inside


def _deviations(constants: Constants, angle: Reals) -> tuple[Reals, Reals]:
    """Return standard deviations by uncertain numbers and by noise, (n, 2 n_modes) each."""
    real = constants.starts.dtype.type
    parameters: Reals = np.zeros((len(angle), 2 * constants.n_modes), real)
    noise: Reals = np.zeros_like(parameters)
    if len(constants.parameters):
        place = (angle - real(constants.alpha3_range[0])) / real(constants.parameter_step)
        i = np.minimum(place.astype(np.int64), len(constants.parameters) - 2)
        before, after = constants.parameters[i], constants.parameters[i + 1]
        parameters = before + (after - before) * (place - i.astype(real))[:, np.newaxis]
    if len(constants.noise):
        noise = _between(constants.noise_angles, constants.noise, angle)
    return parameters, noise


def _between(points: Reals, values: Reals, angle: Reals) -> Reals:
    """Interpolate values, (n_points, k), linearly, with the arithmetic of `np.interp`."""
    i = np.clip(np.searchsorted(points, angle, side="right") - 1, 0, len(points) - 1)
    j = np.minimum(i + 1, len(points) - 1)
    slope = (values[j] - values[i]) / (points[j] - points[i])[:, np.newaxis]
    between = slope * (angle - points[i])[:, np.newaxis] + values[i]
    return np.where(((i == j) | (points[i] == angle))[:, np.newaxis], values[i], between)


def _peaks(constants: Constants, values: Reals) -> tuple[Reals, Reals]:
    """Return frequency and magnitude of the highest of the candidates, (n, 2 n_peaks)."""
    real = constants.starts.dtype.type
    frequency, magnitude = np.full(len(values), real(np.nan)), np.full(len(values), real(-1.0))
    low, high = map(real, constants.peak_band)
    for at, size in zip(*np.split(values.T, 2), strict=True):
        higher = (size > magnitude) & (at >= low) & (at <= high)
        frequency, magnitude = np.where(higher, at, frequency), np.where(higher, size, magnitude)
    return frequency, np.where(magnitude < 0.0, real(np.nan), magnitude)
