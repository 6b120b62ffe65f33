# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Answers where, when and how strongly a drive met its resonances, and what to avoid."""

import math
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review.log import Log
from linkage_vibration.review.moments import Moment

_MARGIN = 0.1  # relative, if the log does not hold the warning margin
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)


@dataclass(frozen=True, slots=True)
class Meeting:
    """All moments of one excitation and one mode."""

    excitation: str  # name
    mode: int  # counted from 0
    worst: Moment  # the one with the highest amplification
    strongest: int  # prediction with that amplification
    amplification: float  # of the mode's static response, 1
    amplification_stddev: float  # 1, NaN if it is not known
    dwell: float  # s, in all moments
    count: int  # of moments
    avoid: str  # what to avoid, in words


def meetings(log: Log, all_moments: list[Moment]) -> list[Meeting]:
    """Return the excitations and modes that met, the most severe first."""
    if not all_moments:
        return []
    strength = amplification(log, all_moments)
    groups: dict[tuple[str, int], list[Moment]] = {}
    for moment in all_moments:
        groups.setdefault((moment.excitation, moment.mode), []).append(moment)
    result = []
    for (name, mode), members in groups.items():
        peaks = [_strongest(moment, strength) for moment in members]
        k = max(range(len(members)), key=lambda i: float(strength[peaks[i]]))
        at, dwell = peaks[k], sum(moment.end - moment.start for moment in members)
        stddev = _amplification_stddev(log, at)
        numbers = float(strength[at]), stddev, dwell, len(members)
        result.append(Meeting(name, mode, members[k], at, *numbers, _avoid(log, members[k])))
    return sorted(result, key=lambda meeting: -meeting.amplification)


def amplification(log: Log, all_moments: list[Moment]) -> FloatArray:
    """Return how many times the nearest excitation amplifies its mode's static response, (n,).

    It is 1 / sqrt((1 - r^2)^2 + (2 zeta r)^2), with the ratio r of the frequencies and the damping
    ratio zeta of the mode; 0 where it is not known. Where the frequencies crossed, r was 1.
    """
    if log.resonances is None:
        return np.zeros(len(log.stamps))
    rows = np.arange(len(log.stamps))
    zeta = log.damping_ratios[rows, np.minimum(log.resonances.mode, log.n_modes - 1)]
    ratio = log.resonances.excitation_frequency / log.resonances.natural_frequency
    ratio[[moment.nearest for moment in all_moments if moment.crossed]] = 1.0
    return np.nan_to_num(_amplified(ratio, zeta))


def first_sentence(log: Log, met: list[Meeting]) -> str:
    """Return in words when and how strongly a drive met its worst resonance, and what to avoid."""
    if log.resonances is None:
        return (
            "Whether the drive met a resonance is not known, as the log holds no speed of engine, "
            "PTO or ground."
        )
    assessed = log.resonances.state != ResonanceState.STALE
    if not assessed.any():
        return (
            "Whether the drive met a resonance is not known, as no crank angle was valid while a "
            "speed was known."
        )
    if not met:
        margins = np.where(assessed, np.abs(log.resonances.relative_margin), np.inf)
        at = int(np.nanargmin(margins))
        return (
            f"No excitation came near a natural frequency; the nearest was "
            f"{log.resonances.excitation[at]}, {100.0 * margins[at]:.1f} % from "
            f"{log.mode_label(int(log.resonances.mode[at]))}."
        )
    worst = met[0]
    angle = math.degrees(log.table_angle[worst.strongest])
    return (
        f"The worst moment was at {real_times(log)[worst.strongest]:.2f} s and {angle:.1f} deg: "
        f"{worst.excitation} met {log.mode_label(worst.mode)} for "
        f"{worst.worst.end - worst.worst.start:.2f} s. If this lasts, the response is "
        f"{in_words(worst)} the static one. "
        f"Avoid {worst.avoid}."
    )


def in_words(meeting: Meeting) -> str:
    """Return an amplification with its standard deviation, if that is known."""
    times = f"{meeting.amplification:.3g} times"
    if math.isnan(meeting.amplification_stddev):
        return f"{times} (standard deviation not known)"
    return f"{times} (standard deviation {meeting.amplification_stddev:.2g})"


def real_times(log: Log) -> FloatArray:
    """Return the stamps as seconds since the first one, which jump back where the clock did."""
    return np.asarray((log.stamps - log.stamps[0]) / 1e9)


def limit_margin(log: Log) -> float | None:
    """Return the relative margin below which the log warns; None if the log does not hold it."""
    limit = log.parameters.get("warning_margin")
    return float(limit) if isinstance(limit, int | float) else None


def _strongest(moment: Moment, strength: FloatArray) -> int:
    return moment.first + int(strength[moment.first : moment.last + 1].argmax())


def _amplified(ratio: FloatArray, zeta: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (1.0 - ratio**2) ** 2 + (2.0 * zeta * ratio) ** 2
        return np.asarray(1.0 / np.sqrt(squares))


def _amplification_stddev(log: Log, at: int) -> float:
    """Return the standard deviation by those of frequency and damping ratio; NaN if not known."""
    assert log.resonances is not None
    mode, forced = log.resonances.mode[at], log.resonances.excitation_frequency[at]
    means = log.natural_frequencies[at, mode], log.damping_ratios[at, mode]
    spreads = log.frequency_stddev[at, mode], log.damping_ratio_stddev[at, mode]
    if not np.isfinite([*means, *spreads]).all() or not _states_uncertainty(log):
        return math.nan
    frequency, zeta = (mean + spread * _NODES for mean, spread in zip(means, spreads, strict=True))
    if frequency.min() <= 0.0 or zeta.min() <= 0.0:
        return math.nan
    values = _amplified(forced / frequency[:, np.newaxis], zeta)
    weights = np.outer(_WEIGHTS, _WEIGHTS) / _WEIGHTS.sum() ** 2
    mean = float((weights * values).sum())
    return math.sqrt(float((weights * (values - mean) ** 2).sum()))


def _states_uncertainty(log: Log) -> bool:
    """Return whether the standard deviations have a basis beside the angle and the table."""
    return log.table is not None and (log.table.measured or log.table.uncertain)


def _avoid(log: Log, moment: Moment) -> str:
    """Return the speeds, and the angles of a moment, at which its excitation is near its mode."""
    rows = slice(moment.first, moment.last + 1)
    margin = limit_margin(log) or _MARGIN
    low = float(np.nanmin(log.natural_frequencies[rows, moment.mode])) * (1.0 - margin)
    high = float(np.nanmax(log.natural_frequencies[rows, moment.mode])) * (1.0 + margin)
    # A crank that turns around may pass the end of the table in a moment.
    angles = log.crank_angle[rows] + (log.table_angle - log.crank_angle)[moment.first]
    low_angle, high_angle = np.rad2deg(np.nanmin(angles)), np.rad2deg(np.nanmax(angles))
    where = f"between {math.floor(low_angle)} and {math.ceil(high_angle)} deg"
    if high_angle - low_angle >= 360.0:
        where = "at all angles"
    source = excitation_of(log, moment.excitation)
    if source is None:
        return f"{low:.1f} to {high:.1f} Hz of {moment.excitation} {where}"
    name = {"pto": "PTO", "engine": "engine", "ground": "ground"}[source.source.value]
    low, high, unit = low / source.ratio, high / source.ratio, source.source.unit
    step = 5.0 if unit == "rpm" else 0.1
    low, high = step * math.floor(low / step), step * math.ceil(high / step)
    return f"{name} {low:.4g} to {high:.4g} {unit} {where}"


def excitation_of(log: Log, name: str) -> Excitation | None:
    """Return an excitation, if the log describes it."""
    return next((order for order in log.excitations if order.name == name), None)
