# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What limits concern in a log: where each is exceeded, and for how long that is known."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from linkage_vibration.bags.blocks import Integers
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.severity import ResonanceState, Unknown
from linkage_vibration.prediction.verdict import (
    Drive,
    Durations,
    above_and_below,
    holding,
    not_counted,
    sources_known,
)
from linkage_vibration.review.findings import first_sentence
from linkage_vibration.review.log import Log, doubted_between
from linkage_vibration.testing.limits import OF_LOADS, Limits, Range, TestKitError

NOTHING = -1.0  # the known share of a quantity that is never known, not even in part


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """Messages in the windows of limits, or all messages without windows."""

    rows: Integers  # (n,)
    predictions: Integers  # (n,), of the log
    held: FloatArray  # (n,), s, for which each holds
    missing: float  # s, for which none does


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """What a limit concerns, at n messages."""

    limit: str  # a field of `Limits`
    span: Span
    exceeded: BoolArray  # (n,)
    size: FloatArray  # (n,), largest where it is exceeded most; NaN if not known
    words: Callable[[int], str]  # what happens at one of the messages
    known: BoolArray | None = None  # (n,): it is known whether it is exceeded; None for always
    why: str = ""  # it is not known

    @property
    def known_share(self) -> float:
        """The share of the time for which it is known whether the limit is exceeded."""
        if self.known is None or not np.isfinite(self.size).any():
            return 1.0 if self.known is None else NOTHING
        spent = float(self.span.held[self.known].sum())
        lost = float(self.span.held[~self.known].sum()) + self.span.missing
        return round(Durations(spent, 0.0, lost).known_share, 9)


def quantities(log: Log, limits: Limits, latency: FloatArray) -> Iterator[Quantity]:
    """Yield what limits concern, the causes of other failures first."""
    held, _, missing = holding(log.stamps)
    span = _span(log.times, np.arange(len(held)), held, missing, limits)
    yield from _of_the_bag(log, limits, span)
    yield from _of_predictions(log, limits, span)
    if limits.input_faults is not None:
        yield from _faults(log, limits, span)
    yield from _of_loads(log, limits)
    if (most := limits.latency) is not None:
        text = "a prediction took {:.5f} s"
        yield _within("latency", span, latency[span.rows], (-math.inf, most), text)


def total_words(drive: Drive, row: int) -> str:
    """Return the load ratio of an assessment in words, with its place and its main cause."""
    of = drive.resonances.message(row)
    ratio = f"the load ratio in {of.total_load_place or 'the pins'} is {of.total_load_ratio:.2g}"
    return f"{ratio} (most severe: {of.excitation})"


def _span(
    times: FloatArray, predictions: Integers, held: FloatArray, missing: float, limits: Limits
) -> Span:
    """Return which messages at times, s, hold in the windows of limits, and for how long."""
    rows = np.arange(len(times))
    if limits.windows is None:
        return Span(rows, predictions, held, missing)
    starts, ends = np.array(limits.windows, float).T[..., np.newaxis]
    time = np.minimum(times + held, ends) - np.maximum(times, starts)
    inside = ((time > 0.0) | ((starts <= times) & (times < ends))).any(axis=0)
    time = np.maximum(time, 0.0).sum(axis=0)
    missing = float((ends - starts).sum() - time.sum())
    return Span(rows[inside], predictions[inside], time[inside], missing)


def _within(
    limit: str,
    span: Span,
    values: FloatArray,
    allowed: Range,
    words: str,
    known: BoolArray | bool = True,
    why: str = "",
) -> Quantity:
    """Return the quantity of values, (n,), which have to be within a range."""
    low, high = allowed
    bound = f"more than {high:g}" if low == -math.inf else f"not from {low:g} to {high:g}"
    exceeded, text = (values < low) | (values > high), f"{words}, {bound},"
    known = exceeded | (known & np.isfinite(values))
    why = why or f"{int((~known).sum())} of {len(known)} messages do not have it"
    size = np.maximum(low - values, values - high)
    return Quantity(limit, span, exceeded, size, lambda i: text.format(values[i]), known, why)


def _at(
    limit: str, rows: Integers, exceeded: BoolArray, words: str, size: FloatArray | None = None
) -> Quantity:
    """Return a quantity at predictions that always have it, (n,), in the same words for each."""
    size = np.zeros(len(rows)) if size is None else size
    span = Span(rows, rows, np.zeros(len(rows)), 0.0)
    return Quantity(limit, span, exceeded, size, _always(words))


def _always(text: str) -> Callable[[int], str]:
    """Return a function that returns the same words for each message."""
    return lambda _: text


def _of_the_bag(log: Log, limits: Limits, span: Span) -> Iterator[Quantity]:
    """Yield what limits of the clock and of the length of a bag concern."""
    times, steps, last = log.times, np.diff(log.times), np.array([len(log.times) - 1])
    if (least := limits.duration) is not None:
        text = f"the bag lasts {times[-1]:.3f} s, less than {least:g}, and ends"
        yield _at("duration", last, times[-1:] < least, text)
    for begin, end in limits.windows or ():
        step = float(np.median(steps)) if len(steps) else 0.0
        there = ((times >= begin) & (times <= end)).any() and times[-1] + 1.5 * step >= end
        text = f"predictions do not cover the window from {begin:g} to {end:g} s; the bag ends"
        yield _at("windows", last, np.array([not there]), text)
    if (most := limits.clock_jumps) is not None:
        jumps = log.passes[np.isin(log.passes, span.rows)]
        numbers = np.arange(1.0, len(jumps) + 1.0)
        text = f"there are more jumps of the clock to an earlier time than {most:g},"
        yield _at("clock_jumps", jumps, numbers > most, text, -numbers)
    if (most := limits.gap) is not None:
        gaps = _span(times[:-1], np.arange(len(steps)), steps, 0.0, limits)
        text = "no prediction for {:.3f} s"
        yield _within("gap", gaps, steps[gaps.rows], (-math.inf, most), text)


def _faults(log: Log, limits: Limits, span: Span) -> Iterator[Quantity]:
    """Yield the faults of the inputs, within windows if there are any."""
    times, found = log.received[span.rows], list[tuple[str, int]]()
    for fault in log.faults:
        inside = [(times >= begin) & (times <= end) for begin, end in fault.times]
        there = np.any(inside, axis=0)
        if limits.windows is None or there.any():
            found.append((fault.sentence.rstrip("."), int(span.predictions[there.argmax()])))
    for sentence, row in found or [("", 0)]:
        exceeded = np.array([len(found) > (limits.input_faults or 0)])
        yield _at("input_faults", np.array([row]), exceeded, sentence)


def _of_predictions(log: Log, limits: Limits, span: Span) -> Iterator[Quantity]:
    """Yield what limits of predictions concern."""
    rows, angles = span.rows, np.degrees(log.crank_angle[span.rows])
    if limits.statuses is not None:
        other = ~np.isin(log.status[rows], [int(status) for status in limits.statuses])

        def status(i: int) -> str:
            name = Status(int(log.status[rows[i]])).name
            return f"the status is {name} at a crank angle of {angles[i]:.2f} deg"

        yield Quantity("statuses", span, other, np.zeros(len(rows)), status)
    times = log.received[rows]
    sure = ~doubted_between(log, times - 1, times)  # others are named first
    if (allowed := limits.crank_angle_deg) is not None:
        each = _within("crank_angle_deg", span, angles, allowed, "the crank angle is {:.2f} deg")
        yield replace(each, size=each.size * sure)
    for mode, allowed in (limits.frequencies or {}).items():
        if mode > log.n_modes:
            raise TestKitError(f"frequencies has mode {mode}; {log.path} has {log.n_modes} modes.")
        words = f"the natural frequency of {log.mode_label(mode - 1)} is {{:.4g}} Hz"
        values = log.natural_frequencies[rows, mode - 1]
        each = _within("frequencies", span, values, allowed, words)
        yield replace(each, size=each.size * sure)


def _of_loads(log: Log, limits: Limits) -> Iterator[Quantity]:
    """Yield what limits of loads, velocities and states concern."""
    given = [(name, most) for name in OF_LOADS if (most := getattr(limits, name)) is not None]
    drive = None if log.drive is None else _drive_within(log, log.drive, limits)
    why = _why(log, drive)
    if drive is None:
        row, never = np.zeros(1, np.int64), np.zeros(1, np.bool_)
        nothing = Span(row, row, np.zeros(1), 0.0)
        nan = np.full(1, math.nan)
        yield from (Quantity(limit, nothing, never, nan, str, never, why) for limit, _ in given)
        return
    of, name = drive.resonances, limits.excitation
    span = Span(np.arange(len(of)), drive.predictions, drive.held, drive.missing)
    known, ratio, velocity = sources_known(drive), of.total_load_ratio, of.total_velocity
    state, whose = of.state, ""
    if name is not None:
        i, whose = _excitation(log, drive, name), f" of {name}"
        ratio, velocity, state = of.load_ratios[:, i], of.velocities[:, i], of.states[:, i]
        known = state != ResonanceState.UNKNOWN
    for limit, most in given:
        if limit == "load_ratio":
            each = _load_ratio(log, drive, span, limits, known, why)
        elif limit == "velocity":
            words = f"the velocity of the response point{whose} is {{:.3g}} m/s"
            allowed, values = (-math.inf, most), velocity.astype(float)
            each = _within(limit, span, values, allowed, words, known, why)
        else:
            least, sure = ResonanceState.NOTE, known
            if limit == "warning_time":  # without a load, nothing can warn
                least, sure = ResonanceState.WARNING, known & np.isfinite(ratio)
            there = state >= least
            spent = np.cumsum(np.where(there, span.held, 0.0))
            over = there & (spent > most + 1e-9) & (spent - span.held <= most + 1e-9)
            text = f"the {limit.replace('_', ' ')}{whose} is {spent[-1]:.3f} s, more than {most:g},"
            size = np.where(state == ResonanceState.UNKNOWN, math.nan, 0.0)
            each = Quantity(limit, span, over, size, _always(text), there | sure, why)
        # A moment that is doubted is not named where another one exceeds the limit, too.
        yield replace(each, size=each.size * ~drive.doubted)


def _load_ratio(
    log: Log, drive: Drive, span: Span, limits: Limits, known: BoolArray, why: str
) -> Quantity:
    """Return what the limit of the load ratio concerns: all loads, one excitation, or one place."""
    of, name, most = drive.resonances, limits.excitation, limits.load_ratio
    assert most is not None
    ratio, place = of.total_load_ratio.astype(float), of.total_load_place
    above, below = above_and_below(drive, most)

    def words(i: int) -> str:
        what = total_words(drive, i)
        if name is not None:
            where = f" in {place[i]}" if place[i] else ""
            what = f"the load ratio of {name}{where} is {ratio[i]:.2g}"
        elif not ratio[i] > most:
            return f"a tyre is off the ground for {of.off_ground_share[i]:.2g} of the time"
        return f"{what}, more than {most:g},"

    if name is not None:
        i = _excitation(log, drive, name)
        ratio = of.load_ratios[:, i].astype(float)
        place = np.where(of.excitation_index == i, of.load_place, "")
        above, below = ratio > most, known & (ratio <= most)
    if limits.place is not None:
        if log.table is not None and limits.place not in log.table.load_places:
            every = ", ".join(log.table.load_places)
            raise TestKitError(f"place is {limits.place!r}; {log.path} has only {every}.")
        # While another place is loaded more, only a bound is known of the load here.
        above = (ratio > most) & (place == limits.place)
    return Quantity("load_ratio", span, above, ratio, words, above | below, why)


def _excitation(log: Log, drive: Drive, name: str) -> int:
    """Return the index of an excitation."""
    if name not in drive.names:
        raise TestKitError(f"excitation is {name!r}; {log.path} has only {', '.join(drive.names)}.")
    return drive.names.index(name)


def _drive_within(log: Log, drive: Drive, limits: Limits) -> Drive | None:
    """Return the assessments in the windows of limits; None if there are none."""
    times = log.times[drive.predictions]
    span = _span(times, drive.predictions, drive.held, drive.missing, limits)
    if not len(span.rows):
        return None
    parts = {name: getattr(drive, name)[span.rows] for name in ("broken", "angles", "doubted")}
    parts |= {name: getattr(span, name) for name in ("held", "predictions", "missing")}
    times = times[span.rows] - (limits.windows[0][0] if limits.windows else 0.0)
    return replace(drive, times=times, resonances=drive.resonances.rows(span.rows), **parts)


def _why(log: Log, drive: Drive | None) -> str:
    """Return why loads are not known, in sentences without the last point."""
    if drive is None and log.drive is not None:
        return "no load was assessed within the windows"
    if drive is None or not np.isfinite(drive.resonances.total_load_ratio).any():
        return first_sentence(replace(log, drive=drive)).rstrip(".")
    angle = drive.time_in(drive.resonances.unknown_sources & Unknown.CRANK_ANGLE != 0)
    text = f"The crank angle was not within the table for {angle:.1f} s. " if angle else ""
    text += not_counted(drive, log.excitations)
    return text.strip().rstrip(".") or "messages are missing"
