# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluates the numbers of an export as the exported C does, in the same order and precision.

The expected values of the generated test come from here, and so do the bounds of the errors.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.export.constants import (
    Constants,
    FloatArray,
    ForceConstants,
    OrderConstants,
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
    "frequency_stddevs",
    "damping_ratios",
    "damping_ratio_stddevs",
    "frequency_slopes",
)
NUMBERS = (*PER_MODE, "frf_peak_frequency", "frf_peak_magnitude", "interpolation_error")
"""The outputs beside the status, in their order in C; `frequency_slopes` are in Hz/rad."""

ASSESSED = (
    "excitation_frequency",
    "relative_margin",
    "velocities",
    "amplifications",
    "load_ratios",
    "total_velocity",
    "total_load_ratio",
)
"""Numbers about excitations that the generated test compares."""
SOURCES = ("engine", "pto", "ground")
"""The speeds of excitations, in the order of the indices in C."""

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
    response : float
        Of velocities, accelerations and amplifications by excitations, over the sum of the
        magnitudes of the terms of the response.
    """

    frequency: float = 0.0
    damping_ratio: float = 0.0
    slope: float = 0.0
    peak: float = 0.0
    response: float = 0.0

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
        ) + _response_text(self.response)


def _response_text(error: float) -> str:
    """Return a sentence about the error of responses; empty without any."""
    if not error:
        return ""
    return (
        f" Responses to excitations differ by at most {upwards(error)} of the sum of the "
        "magnitudes of their terms."
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
        ends = constants.order_ends
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

    Parameters
    ----------
    ends : ndarray, (n_cells + 1,)
        Of the exact cells, rad.
    unit, turned : float
        The relative rounding of a number, and the rounding of an angle, rad.
    starts, exact, near : ndarray
        Starts of approximate cells, rad, the exact cubics and the approximate ones.
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
    sound_status = np.where(sound, statuses["STATUS_OK"], statuses["STATUS_NEAR_TOGGLE"])
    status = np.where(inside, sound_status, statuses["STATUS_OUT_OF_RANGE"])
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


def assess(
    orders: OrderConstants, outputs: MessageColumns, angle: Reals, speeds: Reals
) -> dict[str, Reals]:
    """Return what excitations do as the exported function gives it, by the names in `ASSESSED`.

    Parameters
    ----------
    orders : OrderConstants
    outputs : MessageColumns
        What `evaluate` returns.
    angle, speeds : ndarray, (n,) and (n, 3)
        Angles in the table, rad, and speeds in the order of `SOURCES`, rpm or m/s, not negative.
    """
    real, t = orders.starts.dtype.type, orders.n_terms
    speed = speeds.T[[SOURCES.index(source) for source in orders.sources]]
    frequency, w = (x.astype(real)[:, np.newaxis] * speed for x in (orders.ratios, orders.omegas))
    with np.errstate(all="ignore"):
        natural = outputs.natural_frequencies.T[:, np.newaxis]
        apart = np.nan_to_num(np.abs(frequency / natural - real(1.0)), nan=math.inf)
        nearest = np.take_along_axis(natural, apart.argmin(axis=0)[np.newaxis], axis=0)[0]
        margin = (frequency - nearest) / nearest
        levels = np.full((3, *speed.shape), real(math.nan))
        total = np.full(len(angle), real(math.nan))
        if t:
            factors = _factors(orders, angle, w)
            magnitude, still = _magnitudes(orders, angle, w, factors)
            amplitude, at, exponent, soil = orders.loads.astype(real).T[..., np.newaxis]
            load = amplitude * (speed / at) ** exponent
            load = np.where(soil != 0.0, load / (w * w), load)
            load = np.where(speed > 0.0, load, real(0.0) * amplitude)
            known = w <= real(2.0 * math.pi * orders.highest_frequency)
            load, still = np.where(known, [load, still], real(math.nan))
            levels[:2] = (magnitude * load) * w, magnitude / still
            if orders.forces is not None:
                squares, lost = _load_ratios(orders, orders.forces, angle, w, factors, load)
                levels[2] = np.sqrt(squares.max(axis=0))
                total = np.add.accumulate(np.fmax(squares, 0.0), axis=1)[:, -1].max(axis=0)
                total = np.sqrt(total) + lost
        squares = np.add.accumulate(np.nan_to_num(levels[0] * levels[0], nan=0.0))[-1]
        unknown = np.isnan(levels[0]).all(axis=0)
        totals = [np.where(unknown, real(math.nan), x) for x in (np.sqrt(squares), total)]
    columns = (frequency.T, margin.T, *levels.swapaxes(1, 2), *totals)
    return dict(zip(ASSESSED, columns, strict=True))


def _factors(orders: OrderConstants, angle: Reals, w: Reals) -> tuple[Reals, Reals]:
    """Return both parts of 1 / (k - w^2 - i w c), (n_terms, n_orders, n)."""
    t = orders.n_terms
    values = Cells(orders.starts, orders.cubics).many_values(angle).T
    k, k_imaginary, c = values[: 3 * t].reshape(3, t, 1, -1)
    d, d_imaginary = k - w * w, c * w + k_imaginary
    size = d * d + d_imaginary * d_imaginary
    return d / size, d_imaginary / size


def _summed(factors: tuple[Reals, Reals], above: Reals, rest: Reals, w: Reals) -> Reals:
    """Return squares of sums of terms over the first axis; the last two are orders and angles.

    Of numerators and rest, (3, ...), there are both parts and the rate.
    """
    (d, d_imaginary), (a, a_imaginary, b) = factors, above
    numerator = a_imaginary + b * w
    parts = a * d + numerator * d_imaginary, numerator * d - a * d_imaginary
    real, imaginary = (np.add.accumulate(part)[-1] for part in parts)
    real, imaginary = real + rest[0], imaginary + rest[1] + rest[2] * w
    return np.asarray(real * real + imaginary * imaginary)


def _magnitudes(
    orders: OrderConstants, angle: Reals, w: Reals, factors: tuple[Reals, Reals]
) -> tuple[Reals, Reals]:
    """Return magnitudes of responses to unit loads at frequencies, and of the static ones.

    Both are (n_orders, n), as the angular frequencies are; angles are (n,).
    """
    t, i, inputs = orders.n_terms, orders.n_inputs, np.array(orders.inputs)
    values = Cells(orders.starts, orders.cubics).many_values(angle).T
    above = 3 * t * (1 + i)
    terms = values[3 * t : above].reshape(3, t, i, -1)[:, :, inputs]
    rest = values[above : above + 3 * i].reshape(3, i, -1)[:, inputs]
    return np.sqrt(_summed(factors, terms, rest, w)), values[above + 3 * i :][inputs]


def _load_ratios(
    orders: OrderConstants,
    forces: ForceConstants,
    angle: Reals,
    w: Reals,
    factors: tuple[Reals, Reals],
    load: Reals,
) -> tuple[Reals, Reals]:
    """Return squares of load ratios, (n_forces, n_orders, n), and NaN without all static forces."""
    real, inputs = orders.starts.dtype.type, np.array(orders.inputs)
    cells = Cells(forces.starts.astype(real), forces.cubics.astype(real))
    values, k, n = cells.many_values(angle).T, sum(forces.components), len(angle)
    size = k * orders.n_inputs
    end = (2 + forces.is_complex) * orders.n_terms * size
    above = values[:end].reshape(-1, orders.n_terms, k, orders.n_inputs, n)[..., inputs, :]
    if not forces.is_complex:
        above = np.stack([above[0], 0.0 * above[1], above[1]])
    rest = values[end : end + 3 * size].reshape(3, k, orders.n_inputs, n)[:, :, inputs]
    each = factors[0][:, np.newaxis], factors[1][:, np.newaxis]
    first = np.cumsum((0, *forces.components[:-1]))
    squares = np.add.reduceat(_summed(each, above, rest, w), first) * (load * load)
    references = values[end + 3 * size :]
    return squares / (references * references)[:, np.newaxis], (0.0 * references).sum(axis=0)
