# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds natural frequencies and damping ratios in recordings of free vibration after blows.

A blow is a hit with a hammer, or the sudden end of a lowering. After it each channel is a sum of
decaying oscillations, exp(s t) with the same poles s, which are fitted to all blows together. How
sure they are follows from the noise, from leaving out one blow after another, and from other
windows and numbers of poles.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.special import chdtri, stdtrit

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.uncertainty import INTERVAL
from linkage_vibration.studies.decay_fit import (
    MOST_DAMPED,
    DecayFit,
    Decays,
    energies,
    fit_decays,
    gains,
    refined,
    variance,
    without_faint,
)

_SLOW = 1.0  # s, over which a mean is removed: gravity, and the motion of the hitch
_BLOW = 5.0  # times the level between blows: a level that only a blow reaches
_JUMP = 3.0  # times the level in the half second before
_RISE = 0.05  # s that a blow takes
_APART = 0.5  # s from a blow to another
_LONGEST = 4.0  # s of a decay that are fitted
_FEWEST = 40  # samples of a decay
_SLOWEST = 20.0  # Hz: a lower rate shows no blow
_BURSTS = 2.0  # usual steps: a longer mean step leaves most even samples unknown
_PAUSE = 0.5  # s without samples, which a spline cannot bridge
_OVERLOADED = 20  # samples at the largest value of a channel, which a clipped one has
_RAIL = 0.03  # of the largest value: a band below it that holds the rail of a clipped channel
_ABRUPT = 8.0  # times the samples of the next band; a sine has 2.4 times as many
_FAR = 4.0  # times the median deviation: largest values that are no noise
_CONSTANT = 1e-9  # of the largest value: a channel that varies by less shows rounding alone
_FORCED = 0.04  # s after the largest value that are not fitted: the blow, and what decays at once
_EARLIER = 0.6  # share of a decay that a shorter window keeps
_RARE = 1e-6  # probability that noise makes a mode that a fit of fewer poles keeps
_SHOWN = 1e-3  # the same in a single decay that shows a mode
_MOVES = 0.03  # relative: a frequency that a window changes by more is not reported
_UNSURE = 0.02  # relative deviation of a frequency that is not reported
_ALIKE = 0.3  # share of the energy of a mode that those beside it cannot replace: less is one line
_BESIDE = 1.25  # ratio of frequencies up to which modes may be parts of one that is not linear
_FOLDED = 0.9  # of half of the sampling rate: above it, modes meet those that are folded
_DRIFT = 0.005  # relative change of a frequency with time or strength that a mode may have
_CERTAIN = 4.0  # deviations of such a change that noise does not explain
_STRONGER = 1.5  # ratio of the strengths of blows that are compared


class RingdownError(LinkageVibrationError):
    """A recording has no decay from which modes can be found."""


@dataclass(frozen=True, slots=True)
class MeasuredMode:
    """A mode of decays; deviations are NaN from less than three, and do not hold with a doubt."""

    frequency: float  # Hz
    ratio: float  # damping ratio, 1
    frequency_stddev: float  # Hz
    ratio_stddev: float
    decays: int  # number of blows that show it
    doubt: str = ""  # why it is not reported, such as "1 of 5 blows show it"


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
        hint = "hit harder, or leave a second of rest before and several after each blow"
        raise RingdownError(f"No blow stands out of the {len(signals) / rate:.0f} s; {hint}.")
    return modes_of_decays([signals[part] for part in decays], rate)


def _refuse_overload(signals: FloatArray) -> None:
    """Refuse channels that are clipped: many values equal the largest, or are abruptly near it."""
    away = signals - np.median(signals, axis=0)
    typical = np.median(np.abs(away), axis=0)
    for side in (away, -away):
        top = side.max(axis=0)
        equal, rail, wider = ((side >= (1.0 - i * _RAIL) * top).sum(axis=0) for i in range(3))
        count = np.where(rail > _ABRUPT * (wider - rail), rail, equal)
        count *= (top > _FAR * typical) & (typical > 0.0)
        if count.max(initial=0) > _OVERLOADED:
            channel = f"Channel {int(count.argmax()) + 1} has its largest value {count.max()} times"
            hint = "hit softer, or set a larger range"
            raise RingdownError(f"{channel}, as an overloaded sensor; {hint}.")


def sampling_rate(times: FloatArray) -> float:
    """Return how many samples there are in a second; times ascend, s."""
    return 1.0 / float(np.median(np.diff(times)))


def _resampled(times: FloatArray, signals: FloatArray) -> tuple[float, FloatArray]:
    """Return the rate, Hz, and the signals at even times, (n, n_channels)."""
    if len(times) < _FEWEST:
        raise RingdownError(f"The recording has {len(times)} samples; give {_FEWEST} or more.")
    steps = np.diff(times)
    step, longest = 1.0 / sampling_rate(times), int(steps.argmax())
    if step > 1.0 / _SLOWEST:
        problem = f"The recording has {1.0 / step:.2g} samples a second, too few for a blow"
        raise RingdownError(f"{problem}; give times in seconds, and record at 200 Hz or more.")
    if steps[longest] > _PAUSE:
        pause = f"{steps[longest]:.3g} s after {times[longest]:.6g} s"
        raise RingdownError(f"The recording pauses for {pause}; give one without pauses.")
    if steps.mean() > _BURSTS * step:
        raise RingdownError("Its samples come in bursts; stamp each sample when it is taken.")
    even = np.arange(times[0], times[-1], step)
    return 1.0 / step, np.asarray(CubicSpline(times, signals)(even))


def find_decays(signals: FloatArray, rate: float) -> list[slice]:
    """Return the parts in which blows decay, of signals in units of noise, (n, n_channels)."""
    level = np.linalg.norm(signals, axis=1)
    quiet = float(np.median(level))
    gap, longest, forced = (int(each * rate) for each in (_APART, _LONGEST, _FORCED))
    half, rise = gap // 2, max(int(_RISE * rate), 1)
    before = maximum_filter1d(level, 2 * half + 1, origin=half)  # of half a second up to here
    before = np.concatenate([np.full(rise, quiet), before[:-rise]])
    starts: list[int] = []
    for i in np.flatnonzero(level > np.maximum(_BLOW * quiet, _JUMP * before)).tolist():
        if not starts or i - starts[-1] > gap:
            starts.append(i)
    decays = []
    for start, following in pairwise([*starts, len(level)]):
        top = start + int(level[start : min(start + gap, following)].argmax()) + max(forced, 2)
        end = min(top + longest, following - 2)
        ended = np.flatnonzero(level[top:end] > 2.0 * quiet)
        end = top + int(ended[-1]) + 1 if len(ended) else top
        if end - top >= _FEWEST:
            decays.append(slice(top, end))
    return decays


def modes_of_decays(decays: Decays, rate: float) -> list[MeasuredMode]:
    """Return the modes of decays, (n_samples, n_channels) each, at a rate in Hz, ascending."""
    fit = fit_decays(decays, rate)
    if not len(fit.poles):
        return []
    fit = refined(decays, fit.poles[np.argsort(np.abs(fit.poles))], rate)
    values, channels = _values(fit.poles), decays[0].shape[1]
    shown = (gains(decays, fit, rate) > chdtri(2 * channels, _SHOWN)).sum(axis=0)
    changes = _changes(decays, fit, rate)
    stddevs = np.maximum(_stddevs(decays, fit), np.sqrt((changes**2).mean(axis=0)))
    modes, poles = list[MeasuredMode](), list[complex]()
    for i, (frequency, ratio) in enumerate(values.T.tolist()):
        moved = np.abs(changes[:, 0, i]).max() / frequency
        unsure = stddevs[0, i] / frequency
        doubt = ""
        if math.isnan(moved):
            continue  # It may be noise.
        if 2 * shown[i] <= len(decays):
            doubt = f"{shown[i]} of {len(decays)} blows show it"
        elif moved > _MOVES:
            doubt = f"it changes by {100.0 * moved:.2g} % with the window or order of the fit"
        elif unsure > _UNSURE:
            doubt = f"its deviation is {100.0 * unsure:.2g} %"
        elif ratio < INTERVAL * stddevs[1, i]:
            doubt = "its damping ratio may be 0, as that of a steady tone"
        first, second = stddevs[:, i].tolist() if len(decays) > 2 else (math.nan, math.nan)
        modes.append(MeasuredMode(frequency, ratio, first, second, int(shown[i]), doubt))
        poles.append(fit.poles[i])
    return _without_nonlinear(modes, np.array(poles), decays, rate)


def _without_nonlinear(
    modes: list[MeasuredMode], poles: ComplexArray, decays: Decays, rate: float
) -> list[MeasuredMode]:
    """Return modes with a doubt where their decays are not those of a linear hitch.

    An oscillation whose frequency or damping depends on its amplitude appears as several modes that
    can replace each other, or as one that changes. The strongest one is named.
    """
    doubts = dict[int, str]()
    sure = np.array([i for i, mode in enumerate(modes) if not mode.doubt], dtype=int)
    often = np.array([2 * mode.decays > len(decays) for mode in modes], dtype=bool)
    energy, alone = energies(decays, poles[sure], rate)
    hertz = np.abs(poles[sure])
    alike = alone < _ALIKE * energy
    beside = np.abs(np.log(hertz / hertz[:, np.newaxis])) < math.log(_BESIDE)
    for i in np.argsort(-energy).tolist():
        line = np.arange(len(sure)) == i
        for _ in range(len(sure) * alike[i]):
            line = line | beside[line & alike].any(axis=0)
        order = [sure[i], *np.setdiff1d(np.flatnonzero(often), sure[line])]
        change = _change(decays, poles[order], rate)
        if alike[i] or change:
            own = f"not linear: {change or 'its decay is not exponential'}"
            # Two modes of which one is folded look alike, too.
            if hertz[i] > _FOLDED * math.pi * rate and not change:
                doubts[sure[i]] = own
                continue
            # Friction damps other modes, too, and stiffens them by the same share in all of their
            # decay, so that nothing shows by how much.
            at = f"the mode at {modes[sure[i]].frequency:.4g} Hz"
            doubts = dict.fromkeys(sure.tolist(), f"{at} is not linear, which may move this one")
            doubts[sure[i]] = own
            break
    return [replace(mode, doubt=doubts.get(j, mode.doubt)) for j, mode in enumerate(modes)]


def _change(decays: Decays, poles: ComplexArray, rate: float) -> str:
    """Return how the frequency of the first pole changes with time or strength; "" if it does not.

    Parts of the decays before and after it has lost two thirds of its amplitude are compared, and
    blows of two strengths. The other poles are held.
    """
    shortest = min(map(len, decays))
    cut = int(np.clip(rate / max(-poles[0].real, 1e-3), min(_FEWEST // 2, shortest), shortest // 2))
    parts = {"as the decay goes on": ([d[:cut] for d in decays], [d[cut:] for d in decays])}
    sizes = [float(np.linalg.norm(each[:cut])) for each in decays]
    half, order = len(decays) // 2, np.argsort(sizes)
    weak, strong = ([decays[i] for i in which] for which in (order[:half], order[-half:]))
    if half > 1 and sizes[order[-half]] > _STRONGER * sizes[order[half - 1]]:
        parts["with stronger blows"] = weak, strong
    for how, both in parts.items():
        found = []
        for each in both:
            fit, at = refined(each, poles, rate, free=1), [0, len(poles)]
            curvatures = fit.curvatures[:, at][:, :, at]
            fit = DecayFit(fit.poles[:1], fit.squares, curvatures, fit.gradients[:, at])
            found.append((_values(fit.poles)[:, 0], _stddevs(each, fit)[0, 0]))
        ((a, ratio), sigma), ((b, other), tau) = found
        certain = abs(b - a) > max(_CERTAIN * math.hypot(sigma, tau), _DRIFT * a)
        same = max(a, b) < _BESIDE * min(a, b)  # not another mode that the other poles lack
        if certain and same and max(ratio, other) < MOST_DAMPED:
            return f"the frequency {'falls' if b < a else 'rises'} from {a:.4g} to {b:.4g} Hz {how}"
    return ""


def _values(poles: ComplexArray) -> FloatArray:
    """Return the frequencies, Hz, and damping ratios of poles, (2, n_poles)."""
    with np.errstate(invalid="ignore"):  # a pole at zero has no damping ratio
        return np.array([np.abs(poles) / (2.0 * math.pi), -poles.real / np.abs(poles)])


def _changes(decays: Decays, fit: DecayFit, rate: float) -> FloatArray:
    """Return how other windows and fewer poles move values, (n_variants, 2, n_poles); NaN: lost."""
    late = min(int(_FORCED * rate), min(map(len, decays)) // 4)
    early = [each[: int(_EARLIER * len(each))] for each in decays]
    windows = [each[late:] for each in decays], early
    fewer = without_faint(decays, fit, rate, _RARE).poles
    refits = [refined(window, fit.poles, rate).poles for window in windows]
    same = np.full(len(fit.poles), math.nan, dtype=complex)
    if len(fewer):
        apart = np.abs(np.log(fewer / fit.poles[:, np.newaxis]))
        nearest = apart.argmin(axis=1)
        mutual = apart.argmin(axis=0)[nearest] == np.arange(len(same))
        same[mutual] = fewer[nearest[mutual]]
    refits.append(same)
    return np.asarray(np.array([_values(poles) for poles in refits]) - _values(fit.poles))


def _stddevs(decays: Decays, fit: DecayFit) -> FloatArray:
    """Return deviations of Hz and damping ratios, (2, n_poles), by noise or a larger jackknife."""
    n, count, size = len(decays), len(fit.poles), np.abs(fit.poles)
    curvature = fit.curvatures.sum(axis=0)
    with np.errstate(invalid="ignore"):  # a pole at zero has neither
        along, across = fit.poles.real / size, fit.poles.imag / size
        slopes = np.array([[along, across], [-(across**2), along * across] / size])
    slopes[0] /= 2.0 * math.pi  # of frequency and damping ratio, to real and imaginary parts
    parts = np.linalg.pinv(curvature).reshape(2, count, 2, count).diagonal(axis1=1, axis2=3)
    white = np.einsum("vai,abi,vbi->vi", slopes, parts, slopes) * variance(decays, fit)
    if n < 2:
        return np.asarray(np.sqrt(white))
    steps = np.linalg.pinv(curvature - fit.curvatures) @ fit.gradients[:, :, np.newaxis]
    without = np.einsum("vai,nai->nvi", slopes, steps.reshape(n, 2, count))
    widened = float(stdtrit(n - 1, 0.975)) / INTERVAL  # few decays do not tell their spread
    jackknife = (n - 1) / n * ((without - without.mean(axis=0)) ** 2).sum(axis=0)
    return np.asarray(np.sqrt(np.maximum(white, widened**2 * jackknife)))
