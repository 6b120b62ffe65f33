# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Applies the verdict about a drive to a log: limits, speeds and the model come from the log."""

import math
from dataclasses import astuple, replace
from functools import lru_cache, partial

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.advice import (
    HEIGHT,
    Advice,
    Question,
    advice_sentence,
    advise,
    is_quieter,
)
from linkage_vibration.prediction.excitation import KMH, Source
from linkage_vibration.prediction.ground import MAX_OFF_GROUND
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.severity import (
    DEFAULT_LIMITS,
    SPEED_BITS,
    ResonanceState,
    WarningLimits,
    ending_words,
    ratio_words,
    speed_words,
)
from linkage_vibration.prediction.verdict import (
    KNOWN,
    Drive,
    above_and_below,
    all_known,
    drive_sentence,
    durations,
    episodes,
    worst_message,
)
from linkage_vibration.review.log import Log

_HEIGHTS = 91, 1  # heights and speeds that are tried for the sentence
_SAME = 1e-3  # relative: a load that is computed again is that of the message
DOUBTFUL = "The inputs are doubtful, so what follows may be wrong. "
_OUTSIDE = Status.OUT_OF_RANGE, Status.INVALID_ANGLE


def log_limits(log: Log) -> WarningLimits:
    """Return when excitations warned; the defaults where the log does not hold parameters."""
    names = "warning_load_ratio", "note_load_ratio", "warning_dwell", "near_margin"
    usual = zip(names, astuple(DEFAULT_LIMITS), strict=True)
    return WarningLimits(*(number(log, name, value) for name, value in usual))


def never_in_table(log: Log) -> str:
    """Return a sentence if all crank angles are outside the table; empty if one is not."""
    angles = np.degrees(log.crank_angle[np.isfinite(log.crank_angle)])
    if log.table is None or not np.isin(log.status, _OUTSIDE).all() or not len(angles):
        return ""
    low, high = np.degrees(log.table.alpha3_range)
    ends = list(dict.fromkeys(f"{angle:.1f}" for angle in (angles.min(), angles.max())))
    what = "A crank angle of {} deg is" if len(ends) == 1 else "Crank angles of {} deg are"
    outside = f"outside {low:g} to {high:g} deg: check hitch_offset or hitch_sign."
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
    verdict = drive_sentence(
        log.drive, limits, log.mode_label, log.excitations, partial(ending, log)
    )
    return f"{DOUBTFUL * bool(log.input_faults)}{verdict} {advice}".rstrip()


def verdict(log: Log, sentence: str) -> tuple[str, str]:
    """Return the short verdict of a drive with its known share, and the rest of the sentence."""
    first, _, rest = sentence.removeprefix(DOUBTFUL).partition(". ")
    text = f"{DOUBTFUL * bool(log.input_faults)}{first.rstrip('.')}."
    share = 0.0 if log.drive is None else durations(log.drive).known_share
    if share == 0.0 or first.startswith("Known for"):
        return text, rest
    percent = "all" if share == 1.0 else f"{math.floor(100.0 * share)} %"
    return f"{text} It is known for {percent} of the drive whether loads exceeded the limit.", rest


def remedy(log: Log, row: int) -> str:
    """Return what would end the load of a message, and whether that is enough."""
    assert log.drive is not None
    at, known = log.drive.resonances.message(row), all_known(log.drive)[row]
    above, below = (flags[row] for flags in above_and_below(log.drive))
    enough = "this is enough" if known else "this is enough for the loads that are known"
    if not above:
        return "not needed, as nothing was above its limit" if below else "not known"
    if words := ending(log, row):
        return f"{words}; {enough}"
    if (levels := log_levels(log)) is None:
        return "not known, as the log does not hold the model"
    message = drive_advice(log, levels, _HEIGHTS, row=row).message
    if not is_quieter(message)[HEIGHT] or not at.total_load_ratio > at.load_ratio_limit:
        return "no speed or height alone that is known"
    degrees = f"{math.degrees(message.crank_angles[HEIGHT]):.1f}"  # as it is written
    speeds = {source: float(values[row]) for source, values in speeds_at_drive(log).items()}
    there = _assessed(log, at, math.radians(float(degrees)), speeds)
    calm = there.total_load_ratio <= at.load_ratio_limit and there.state != ResonanceState.WARNING
    leaves = f"a crank angle of {degrees} deg would leave {ratio_words(there.total_load_ratio)}"
    return f"{leaves}; {enough if calm else 'this is not enough'}"


def all_counted(drive: Drive) -> BoolArray:
    """Return when the total load has all sources, (n,); a tyre off the ground leaves one out."""
    return np.asarray(all_known(drive) & ~(drive.resonances.off_ground_share > MAX_OFF_GROUND))


def ending(log: Log, row: int) -> str:
    """Return which speed or crank angle ends the warning of a message; empty if none surely does.

    The value in the message may be that of a moment before. So it is sought again for the angle and
    the speeds of the message, and named only if the limit holds at the value as it is written.
    """
    if log.drive is None or log_levels(log) is None:
        return ""
    at, angle = log.drive.resonances.message(row), float(log.drive.angles[row])
    speeds = {source: float(values[row]) for source, values in speeds_at_drive(log).items()}
    source = list(Source)[max(int(at.speed_source), 1) - 1]
    speeds[source] = float(at.excitation_speed) / source.si
    now = _assessed(log, at, angle, speeds)
    totals = now.total_load_ratio, at.total_load_ratio
    if now.speed_source != at.speed_source or not np.isclose(*totals, _SAME, 0.0, equal_nan=True):
        return ""  # The log does not hold all that the message was made of.

    def ends(angle: float, speeds: dict[Source, float]) -> bool:
        there = _assessed(log, at, angle, speeds)
        lost = there.unknown_sources & ~now.unknown_sources or there.known_share < now.known_share
        calm = there.total_load_ratio <= at.load_ratio_limit
        return bool(calm and there.state != ResonanceState.WARNING and not lost)

    written = float(speed_words(source, now.quiet_speed).split()[0])
    if not ends(angle, speeds | {source: written / (KMH if source is Source.GROUND else 1.0)}):
        now.quiet_speed = math.nan
    if not ends(math.radians(round(math.degrees(now.quiet_angle), 1)), speeds):
        now.quiet_angle = math.nan
    return ending_words(now, log.excitations)


def _assessed(
    log: Log, at: MessageColumns, angle: float, speeds: dict[Source, float]
) -> MessageColumns:
    """Return an assessment at an angle, rad, and speeds, rpm or m/s, by the limit of a message."""
    assert log.table is not None
    limits = replace(log_limits(log), warning=float(at.load_ratio_limit), dwell=0.0)
    monitor = ResonanceMonitor(log.excitations, limits, levels=log_levels(log))
    for source, speed in speeds.items():
        monitor.set_fixed(source, speed)
    return monitor.assess(Predictor(log.table).predict(angle), 0.0, 0)


def is_calm(log: Log) -> bool:
    """Return whether nothing exceeded a limit, as far as inputs that are not doubted can say."""
    return not log.input_faults and not load_problems(log)


def load_problems(log: Log) -> list[str]:
    """Return a sentence for warnings or loads above the limit, and one for what is not known."""
    if log.drive is None:
        return [
            "Nothing is known of the loads, as the log holds no speed of engine, PTO or ground."
        ]
    spent, warnings, texts = durations(log.drive), episodes(log.drive), list[str]()
    if spent.above or warnings:
        warned = f"{len(warnings)} with {sum(each.duration for each in warnings):.3g} s"
        texts.append(f"Loads were above the limit for {spent.above:.3g} s; warnings: {warned}.")
    if spent.known_share < KNOWN:
        share = f"{100.0 * spent.known_share:.3g} % of the drive, less than {100.0 * KNOWN:g} %"
        texts.append(f"It is known whether loads were above the limit for {share}.")
    return texts


@lru_cache(maxsize=1)
def log_levels(log: Log) -> LevelTable | None:
    """Return the levels of the model of a log; None if the log lacks what made it."""
    if log.table is None or log.mechanism is None or not log.excitations:
        return None
    try:
        return kept_levels(Predictor(log.table), log.mechanism, log.excitations)
    except LinkageVibrationError:
        return None  # The file in the log describes other excitations than those of its table.


def drive_advice(
    log: Log,
    levels: LevelTable,
    shape: tuple[int, int],
    ground_speeds: tuple[float, float] | None = None,
    row: int | None = None,
) -> Advice:
    """Return advice for a message of a drive, by default the worst, with a map of this shape."""
    assert log.drive is not None
    worst, speeds = worst_message(log.drive) if row is None else row, speeds_at_drive(log)
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
