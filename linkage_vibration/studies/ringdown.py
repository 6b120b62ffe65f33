# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds natural frequencies and damping ratios in recordings of free vibration after blows.

A blow is a hit with a hammer, or the sudden end of a lowering. After it each channel is a sum of
decaying oscillations, exp(s t) with the same poles s. The matrix pencil finds these from all
channels together (Hua and Sarkar, 1990). Several blows at one height tell how sure the result is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import hankel
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.stats import t as student

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray

_SLOW = 1.0  # s, over which a mean is removed: gravity, and the motion of the hitch
_BLOW = 5.0  # times the level between blows: a level that only a blow reaches
_JUMP = 3.0  # times the level in the half second before
_RISE = 0.05  # s that a blow takes
_APART = 0.5  # s from a blow to another
_LONGEST = 4.0  # s of a decay that are fitted
_FEWEST = 40  # samples of a decay
_SLOWEST = 20.0  # Hz: a lower rate shows no blow
_PAUSE = 0.5  # s without samples, which a spline cannot bridge
_OVERLOADED = 20  # samples at the largest value of a channel, which a clipped one has
_FAR = 4.0  # times the median deviation: largest values that are no noise
_LARGEST = 250  # columns of a pencil; more would take long and change little
_CONSTANT = 1e-9  # of the largest value: a channel that varies by less shows rounding alone
_NOISE = 2.858  # medians of the singular values of noise: the optimal threshold of Gavish, Donoho
_STRONG = 100.0  # times the energy that noise gives to an oscillation: weaker ones are left out
_HIGHEST = 0.8  # of half the rate: oscillations above are distorted by the resampling
_MOST_DAMPED = 0.5  # damping ratio; beyond it there is hardly an oscillation
_SAME = 0.05  # relative difference of frequencies of one mode in two decays


class RingdownError(LinkageVibrationError):
    """A recording has no decay from which modes can be found."""


@dataclass(frozen=True, slots=True)
class MeasuredMode:
    """A mode that most of the decays show.

    The standard deviations are those of the means over the decays, enlarged by Student's
    distribution; NaN from less than three decays, which cannot tell.
    """

    frequency: float  # Hz
    ratio: float  # damping ratio, 1
    frequency_stddev: float  # Hz
    ratio_stddev: float
    decays: int  # that show it


def measure_modes(times: FloatArray, signals: FloatArray) -> list[MeasuredMode]:
    """Find the modes in a recording of blows at one height of the hitch, ascending.

    Times ascend, (n,), s. Signals, (n, n_channels), are accelerations, velocities or rates along
    fixed axes of a body, in any unit. A RingdownError is raised if no decay is long enough.
    """
    _refuse_overload(signals)
    rate, signals = _resampled(times, signals)
    # Without the means of a second, among which blows would not stand out.
    window = max(int(_SLOW * rate), 1)
    moving = signals - uniform_filter1d(signals, window, axis=0, mode="nearest", origin=-1)
    # Most of the time nothing but noise is recorded, by which channels of all units compare.
    noise = np.median(np.abs(moving), axis=0)
    alive = noise > _CONSTANT * np.abs(signals).max(axis=0)
    signals, moving = (each[:, alive] / noise[alive] for each in (signals, moving))
    decays = find_decays(moving, rate)
    if not decays:
        raise RingdownError(
            f"No blow stands out of the {len(signals) / rate:.0f} s; hit harder, or leave a second "
            "of rest before and several after each blow."
        )
    return common_modes([fit_decay(signals[part], rate) for part in decays])


def _refuse_overload(signals: FloatArray) -> None:
    """Refuse channels that are clipped: they have the same largest value many times."""
    away = signals - np.median(signals, axis=0)
    typical = np.median(np.abs(away), axis=0)
    for side in (away, -away):
        top = side.max(axis=0)
        count = (side == top).sum(axis=0) * ((top > _FAR * typical) & (typical > 0.0))
        if count.max(initial=0) > _OVERLOADED:
            raise RingdownError(
                f"Channel {int(count.argmax()) + 1} has its largest value {int(count.max())} "
                "times, as an overloaded sensor; hit softer, or set a larger range."
            )


def _resampled(times: FloatArray, signals: FloatArray) -> tuple[float, FloatArray]:
    """Return the rate, Hz, and the signals at even times, (n, n_channels)."""
    kept = np.diff(times, prepend=-math.inf) > 0.0
    times, signals = times[kept], signals[kept]
    if len(times) < _FEWEST:
        raise RingdownError(
            f"The recording has samples at {len(times)} different times; give {_FEWEST} or more."
        )
    steps = np.diff(times)
    step, longest = float(np.median(steps)), int(steps.argmax())
    if step > 1.0 / _SLOWEST:
        raise RingdownError(
            f"The recording has {1.0 / step:.2g} samples a second, too few for a blow; give the "
            "times in seconds, and record at 200 Hz or more."
        )
    if steps[longest] > _PAUSE:
        raise RingdownError(
            f"The recording pauses for {steps[longest]:.3g} s after {times[longest]:.6g} s; give a "
            "recording without pauses."
        )
    even = np.arange(times[0], times[-1], step)
    return 1.0 / step, np.asarray(CubicSpline(times, signals)(even))


def find_decays(signals: FloatArray, rate: float) -> list[slice]:
    """Return the parts of a recording in which a blow decays.

    The signals, (n, n_channels), have no means, and the noise of each channel is their unit.
    """
    level = np.linalg.norm(signals, axis=1)
    quiet = float(np.median(level))
    gap, longest = int(_APART * rate), int(_LONGEST * rate)
    half, rise = gap // 2, max(int(_RISE * rate), 1)
    before = maximum_filter1d(level, 2 * half + 1, origin=half)  # of half a second up to here
    before = np.concatenate([np.full(rise, quiet), before[:-rise]])
    starts: list[int] = []
    for i in np.flatnonzero(level > np.maximum(_BLOW * quiet, _JUMP * before)).tolist():
        if not starts or i - starts[-1] > gap:
            starts.append(i)
    decays = []
    for start, following in pairwise([*starts, len(level)]):
        top = start + int(level[start : min(start + gap, following)].argmax()) + 2
        end = min(top + longest, following - 2)
        ended = np.flatnonzero(level[top:end] > 2.0 * quiet)
        end = top + int(ended[-1]) + 1 if len(ended) else top
        if end - top >= _FEWEST:
            decays.append(slice(top, end))
    return decays


def fit_decay(signals: FloatArray, rate: float) -> ComplexArray:
    """Return the upper pole of each oscillation in a decay, rad/s, ascending.

    The unit of the signals, (n, n_channels), is the noise of each channel.
    """
    signals = signals - signals.mean(axis=0)  # what remains of a constant is a pole at zero
    n = len(signals)
    columns = min(n // 2, _LARGEST)
    stacked = np.vstack(
        [hankel(each[: n - columns], each[n - columns - 1 :]) for each in signals.T]
    )
    _, sizes, right = np.linalg.svd(stacked, full_matrices=False)
    kept = right[sizes > _NOISE * np.median(sizes)].T  # (columns, order)
    if not kept.size:
        return np.zeros(0, dtype=complex)
    shift = np.linalg.lstsq(kept[:-1], kept[1:], rcond=None)[0]
    turns = np.linalg.eigvals(shift)
    turns = turns[np.abs(turns) > 0.0].astype(complex)
    poles = np.log(turns[turns != 1.0]) * rate
    strong = _energies(signals, poles, rate) > _STRONG * signals.shape[1]
    return np.asarray(np.sort_complex(poles[_oscillates(poles, rate) & strong]))


def _oscillates(poles: ComplexArray, rate: float) -> BoolArray:
    """Return which poles are decaying oscillations that the rate resolves."""
    ratios = -poles.real / np.abs(poles)
    high = poles.imag < _HIGHEST * math.pi * rate
    return np.asarray((poles.imag > 0.0) & high & (ratios > 0.0) & (ratios < _MOST_DAMPED))


def _energies(signals: FloatArray, poles: ComplexArray, rate: float) -> FloatArray:
    """Return the energy of each pole in the signals, (n_poles,), in that of a sample of noise."""
    at = np.arange(len(signals)) / rate
    terms = np.exp(np.multiply.outer(at, np.minimum(poles.real, 0.0) + 1j * poles.imag))
    weights = np.linalg.lstsq(terms, signals.astype(complex), rcond=None)[0]
    return np.asarray((np.abs(terms) ** 2).sum(axis=0) * (np.abs(weights) ** 2).sum(axis=1))


def common_modes(decays: Sequence[ComplexArray]) -> list[MeasuredMode]:
    """Return the modes that more than half of the decays show by their poles, rad/s, ascending."""
    left = [list(poles) for poles in decays]
    modes = []
    while any(left):
        every = sorted(abs(pole) for poles in left for pole in poles)
        near = [sum(abs(math.log(a / b)) < _SAME for b in every) for a in every]
        centre = every[int(np.argmax(near))]
        group = []
        for poles in left:
            if not poles:
                continue
            best = min(poles, key=lambda pole: abs(math.log(abs(pole) / centre)))
            if abs(math.log(abs(best) / centre)) < _SAME:
                group.append(best)
                poles.remove(best)
        if 2 * len(group) > len(decays):
            modes.append(_mean(np.array(group)))
    return sorted(modes, key=lambda mode: mode.frequency)


def _mean(poles: ComplexArray) -> MeasuredMode:
    """Return the mode that is the mean of some poles, rad/s."""
    values = np.array([np.abs(poles) / (2.0 * math.pi), -poles.real / np.abs(poles)])
    n = len(poles)
    spread = np.full(2, math.nan)
    if n > 2:
        # So many deviations contain 68 % of the means, as one does of a known distribution.
        spread = values.std(axis=1, ddof=1) / math.sqrt(n) * float(student.ppf(0.8413, n - 1))
    frequency, ratio = values.mean(axis=1).tolist()
    return MeasuredMode(frequency, ratio, float(spread[0]), float(spread[1]), n)
