# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluates the numbers of an export as the exported C does, in the same order and precision.

The expected values of the generated test come from here, and so do the measured errors.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.export.constants import Constants, Reals, single
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

_SAMPLES = 20_001  # angles at which errors are measured
_SEED = 1
_OTHER = 1e-3  # relative: frequencies that differ by more are those of two different peaks
_ROOM = 1.25  # errors at other angles may be so much larger than those measured


@dataclass(frozen=True)
class ExportErrors:
    """The largest differences between two exports, at angles at which both have numbers.

    Attributes
    ----------
    frequency, damping_ratio : float
        Relative.
    slope, stddev : float
        Of slopes and standard deviations of frequencies, over their largest values.
    peak : float
        Relative, of the frequency and the magnitude.
    other_peaks : int
        At how many angles two peaks are so equally high that another one is the highest.
    samples : int
        Number of angles.
    """

    frequency: float
    damping_ratio: float
    slope: float
    stddev: float
    peak: float
    other_peaks: int
    samples: int

    @property
    def text(self) -> str:
        """A sentence for people."""
        errors = self.frequency, self.damping_ratio, self.slope, self.stddev, self.peak
        if not any(errors) and not self.other_peaks:
            return f"The numbers at {self.samples} angles are those of the table, to the last bit."
        text = (
            f"The largest differences from the table at {self.samples} angles: natural frequencies "
            f"{self.frequency:.1e}, damping ratios {self.damping_ratio:.1e}, peak {self.peak:.1e} "
            f"(relative); slopes {self.slope:.1e} and standard deviations {self.stddev:.1e} (of "
            "their largest values)."
        )
        if self.other_peaks:
            text += f" At {self.other_peaks} of them another of two equally high peaks is reported."
        return text


def exported(
    constants: Constants, approximate: Constants, *, in_single: bool
) -> tuple[Constants, ExportErrors]:
    """Return the numbers to export with their errors, which are added to those of the pieces.

    The approximate constants have fewer cells than those of the table, or are the same.
    """
    chosen = single(approximate) if in_single else approximate
    errors = compare(constants, chosen)
    more = _ROOM * max(errors.frequency, errors.damping_ratio)
    if more > 0.0:
        wider = (chosen.piece_errors + more).astype(chosen.piece_errors.dtype)
        chosen = replace(chosen, piece_errors=wider)
    return chosen, errors


def compare(constants: Constants, approximate: Constants) -> ExportErrors:
    """Measure how far approximate numbers are from those of the table in double precision."""
    dtype = approximate.starts.dtype
    low, high = constants.alpha3_range
    angles = np.random.default_rng(_SEED).uniform(low, high, _SAMPLES)
    angles[: len(constants.starts)] = constants.starts[:_SAMPLES]
    angles[-1] = high
    if constants.turns:  # a quarter of them anywhere
        far = approximate.farthest
        angles[::4] = np.random.default_rng(_SEED).uniform(-far, far, len(angles[::4]))
    rounded = angles.astype(dtype)
    same = rounded.astype(float)
    if not constants.turns:
        same = np.clip(same, low, high)  # the ends of the range are rounded, too
    exact = evaluate(constants, same, np.zeros(len(same)))
    other = evaluate(approximate, rounded, np.zeros(len(same), dtype))

    def relative(name: str) -> Reals:
        true, value = getattr(exact, name), getattr(other, name).astype(float)
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.where(true == value, 0.0, np.abs(value / true - 1.0)), nan=0.0)

    def absolute(name: str) -> float:
        true, value = getattr(exact, name), getattr(other, name).astype(float)
        with np.errstate(all="ignore"):
            largest = np.nanmax(np.abs(true), initial=0.0)
            return float(np.nanmax(np.abs(value - true), initial=0.0) / (largest or 1.0))

    peak = relative("frf_peak_frequency")
    other_peak = peak > _OTHER
    heights = relative("frf_peak_magnitude")
    return ExportErrors(
        frequency=float(relative("natural_frequencies").max(initial=0.0)),
        damping_ratio=float(relative("damping_ratios").max(initial=0.0)),
        slope=absolute("frequency_slopes"),
        stddev=absolute("frequency_stddev"),
        peak=float(max(peak[~other_peak].max(initial=0.0), heights.max(initial=0.0))),
        other_peaks=int(other_peak.sum()),
        samples=len(same),
    )


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
