# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Applies the verdict about a drive to a log: limits, speeds and the model come from the log."""

import math
from functools import lru_cache

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.advice import Advice, Question, advice_sentence, advise
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.prediction.severity import SPEED_BITS, WarningLimits
from linkage_vibration.prediction.verdict import drive_sentence, worst_message
from linkage_vibration.review.log import Log

_HEIGHTS = 91, 1  # heights and speeds that are tried for the sentence
_OUTSIDE = Status.OUT_OF_RANGE, Status.INVALID_ANGLE


def log_limits(log: Log) -> WarningLimits:
    """Return when excitations warned; the defaults where the log does not hold parameters."""
    usual = WarningLimits()
    return WarningLimits(
        warning=number(log, "warning_load_ratio", usual.warning),
        note=number(log, "note_load_ratio", usual.note),
        dwell=number(log, "warning_dwell", usual.dwell),
        near=number(log, "near_margin", usual.near),
    )


def never_in_table(log: Log) -> str:
    """Return a sentence if all crank angles are outside the table; empty if one is not."""
    angles = np.degrees(log.crank_angle[np.isfinite(log.crank_angle)])
    if log.table is None or not np.isin(log.status, _OUTSIDE).all() or not len(angles):
        return ""
    low, high = np.degrees(log.table.alpha3_range)
    ends = list(dict.fromkeys(f"{angle:.1f}" for angle in (angles.min(), angles.max())))
    what = "A crank angle of {} deg is" if len(ends) == 1 else "Crank angles of {} deg are"
    outside = f"outside {low:g} to {high:g} deg: check offset or sign."
    return f"{what.format(' to '.join(ends))} {outside}"


def first_sentence(log: Log) -> str:
    """Return what a drive did to the linkage, in words, and what would be better."""
    if outside := never_in_table(log):
        return f"{outside} What the drive did to the linkage is not known."
    if log.drive is None:
        return (
            "What the drive did to the linkage is not known, as the log holds no speed of engine, "
            "PTO or ground."
        )
    limits, advice = log_limits(log), ""
    if (
        log.drive.severity().max() > min(limits.note, limits.warning)
        and (levels := log_levels(log)) is not None
    ):
        message = drive_advice(log, levels, _HEIGHTS).message
        would, limit = "would have been loaded", limits.warning
        advice = advice_sentence(message, would, heights_only=True, limit=limit)
    verdict = drive_sentence(log.drive, limits, log.mode_label, log.excitations)
    return f"{verdict} {advice}".rstrip()


@lru_cache(maxsize=1)
def log_levels(log: Log) -> LevelTable | None:
    """Return the levels of the model of a log; None if the log lacks what made it."""
    if log.table is None or log.mechanism is None or not log.excitations:
        return None
    try:
        return LevelTable(Predictor(log.table), log.mechanism, log.excitations)
    except LinkageVibrationError:
        return None  # The file in the log describes other excitations than those of its table.


def drive_advice(
    log: Log,
    levels: LevelTable,
    shape: tuple[int, int],
    ground_speeds: tuple[float, float] | None = None,
) -> Advice:
    """Return advice for the worst moment of a drive, with a map of this shape."""
    assert log.drive is not None
    worst, speeds = worst_message(log.drive), speeds_at_drive(log)
    present = np.array([speeds[s][worst] if s in speeds else math.nan for s in Source])
    question = Question(float(log.drive.angles[worst]), present, None, ground_speeds)
    return advise(levels, log.excitations, question, shape)


def all_speeds(log: Log) -> dict[Source, tuple[FloatArray, FloatArray]]:
    """Return times, s, and values of all speeds, also of those that a parameter fixed."""
    speeds = dict(log.speeds)
    for source in Source:
        fixed = number(log, f"{source.value}_speed", -1.0)
        if fixed >= 0.0:
            speeds[source] = np.array([0.0, log.times[-1]]), np.array([fixed, fixed])
    return speeds


def speeds_at_drive(log: Log) -> dict[Source, FloatArray]:
    """Return the magnitude of each speed at each resonance, (n,), rpm or m/s; NaN if not known."""
    assert log.drive is not None
    unknown = log.drive.resonances.unknown_sources
    speeds = {}
    for source, (times, values) in all_speeds(log).items():
        rows = np.searchsorted(times, log.times[log.drive.predictions], side="right") - 1
        latest = values[np.maximum(rows, 0)]
        if source is Source.GROUND:  # negative in reverse
            latest = np.abs(latest)
        used = (rows >= 0) & (latest >= 0.0) & (latest < np.inf)
        used &= unknown & SPEED_BITS[source] == 0
        speeds[source] = np.where(used, latest, np.nan)
    return speeds


def real_times(log: Log) -> FloatArray:
    """Return the stamps as seconds since the first one, which jump back where the clock did."""
    return np.asarray((log.stamps - log.stamps[0]) / 1e9)


def number(log: Log, name: str, default: float) -> float:
    """Return a number among the parameters of a log."""
    value = log.parameters.get(name, default)
    return float(value) if isinstance(value, int | float) else default


def excitation_of(log: Log, name: str) -> Excitation | None:
    """Return an excitation, if the log describes it."""
    return next((order for order in log.excitations if order.name == name), None)
