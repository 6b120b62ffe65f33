# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a drive did to the linkage: its warnings, its excitations by load, and the words for them.

A message holds until the next one, and messages of one stamp share this time. If the next one is
more than `severity.GAP` later, or earlier, then a message holds for a median step, but not longer
than this gap. A warning ends there too, unless the next one is less than `BACK` earlier.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, runs
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.ground import MAX_OFF_GROUND
from linkage_vibration.prediction.severity import (
    BACK,
    GAP,
    SPEED_BITS,
    ResonanceState,
    Unknown,
    WarningLimits,
    at_work,
    cause_words,
    listing,
    load_words,
    no_load_words,
    ratio_words,
    unknown_ground,
    unknown_speed_words,
    unknown_speeds,
)

_MOST_NAMES = 3  # in a list
_SHORT = 0.1  # s, that is not worth a sentence
KNOWN = 0.95  # least share of a drive that has to be known before it is called calm
_LATE = 1.0  # s without a message at the start of a log that are worth one


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The assessments of a drive, as of `described`, in the order in which they were written."""

    times: FloatArray  # (n,), s since the start of the log
    held: FloatArray  # (n,), s for which each holds
    broken: BoolArray  # (n,): a gap or a jump of the clock precedes
    resonances: MessageColumns
    angles: FloatArray  # (n,), rad
    names: tuple[str, ...]  # of the excitations, in the order of the sequences
    predictions: NDArray[np.int64]  # (n,), of the log
    missing: float  # s of the log, for which none holds
    doubted: BoolArray  # (n,): of readings or speeds that are doubted

    @property
    def passes(self) -> NDArray[np.int64]:
        """Number of the messages between two gaps or jumps of the clock to which each belongs."""
        return np.cumsum(self.broken)

    def severity(self) -> FloatArray:
        """Return the total load ratio, (n,), which orders moments; 0 if not known, or doubted."""
        return np.where(self.may_be_worst, self.resonances.total_load_ratio.astype(float), 0.0)

    @property
    def may_be_worst(self) -> BoolArray:
        """Whether a load is known and not doubted, (n,)."""
        return np.asarray(~np.isnan(self.resonances.total_load_ratio) & ~self.doubted)

    def time_in(self, flags: BoolArray) -> float:
        """Return how long flags, (n,), are true, s."""
        return float(self.held[flags].sum())


@dataclass(frozen=True, slots=True)
class Durations:
    """How long the load was above its limit, was not, and was not known whether it was, s."""

    above: float
    below: float
    unknown: float

    @property
    def known_share(self) -> float:
        """The share of the drive for which the answer is known, 0 to 1."""
        known = self.above + self.below
        return known / (known + self.unknown) if known else 0.0


@dataclass(frozen=True, slots=True)
class Episode:
    """One warning."""

    start: float  # s, as `Drive.times`
    duration: float  # s
    worst: int  # the message with the largest total load ratio in it


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one excitation did in a drive."""

    name: str
    load_ratio: float  # the largest; NaN if it was never known without a doubt
    worst: int  # message with that load ratio
    warning_time: float  # s
    note_time: float  # s
    warnings: int
    known: bool  # at some time


def holding(stamps: NDArray[np.int64]) -> tuple[FloatArray, BoolArray, float]:
    """Return how long messages hold, s, whether a gap or jump precedes, and the time without."""
    steps = np.diff(stamps) / 1e9
    broken = (steps < 0.0) | (steps > GAP)
    usual = steps[(steps > 0.0) & (broken.all() | ~broken)]
    median = min(float(np.median(usual)), GAP) if len(usual) else 0.0
    group = np.cumsum(np.append(0, steps != 0.0))  # messages of one stamp, which share its time
    held = np.bincount(group, np.append(np.where(broken, median, steps), median))
    held = (held / np.bincount(group))[group]
    missing = float((steps - median)[steps > GAP].sum())
    return held, np.concatenate([[True], (steps <= -BACK) | (steps > GAP)]), missing


def drive_of(
    stamps: NDArray[np.int64],
    start: int,
    resonances: MessageColumns,
    angles: FloatArray,
    names: Sequence[str],
    predictions: NDArray[np.int64],
    end: int,
) -> Drive:
    """Return a drive from the stamps of its messages, ns, (n,); the log has a start and an end."""
    held, broken, missing = holding(stamps)
    first, last = int(stamps.min()), int(stamps.max())
    missing += 1e-9 * (max(0, first - start) + max(0, end - last))
    n_names = resonances.states.shape[1]
    all_names = [*names, *(f"excitation {i + 1}" for i in range(len(names), n_names))]
    return Drive(
        (stamps - start) / 1e9,
        held,
        broken,
        resonances,
        angles,
        tuple(all_names[:n_names]),
        predictions,
        missing,
        np.zeros(len(stamps), np.bool_),
    )


def above_and_below(drive: Drive, limit: float | None = None) -> tuple[BoolArray, BoolArray]:
    """Return when a limit, or that of each message, was exceeded, and when surely not, (n,)."""
    of = drive.resonances
    limits = of.load_ratio_limit if limit is None else np.float32(limit)
    above = np.asarray((of.total_load_ratio > limits) | (of.off_ground_share > MAX_OFF_GROUND))
    return above, np.asarray(all_known(drive) & np.isfinite(limits) & ~above)


def all_known(drive: Drive) -> BoolArray:
    """Return when the total load ratio has all of its sources, and not a part of them, (n,)."""
    return np.asarray(np.isfinite(drive.resonances.total_load_ratio) & sources_known(drive))


def sources_known(drive: Drive) -> BoolArray:
    """Return when each source is known, (n,), also where no static force is to compare with."""
    of = drive.resonances
    return np.asarray((of.unknown_sources == 0) & ~_may_be_high(of).any(axis=1))


def _may_be_high(of: MessageColumns) -> BoolArray:
    """Return which loads are not known, and not small as an order is near no mode, (n, n_names)."""
    silent = (of.states >= ResonanceState.NOTE) & np.isnan(of.load_ratios)
    return np.asarray(silent | (of.states == ResonanceState.UNKNOWN))


def durations(drive: Drive, limit: float | None = None) -> Durations:
    """Return how long the load was above a limit, as in `above_and_below`, was not, and unknown."""
    above, below = above_and_below(drive, limit)
    unknown = drive.time_in(~(above | below)) + drive.missing
    return Durations(drive.time_in(above), drive.time_in(below), unknown)


def episodes(drive: Drive) -> list[Episode]:
    """Return the warnings in the order in which they were written."""
    severity, warnings = drive.severity(), []
    for first, last in runs(drive.resonances.state == ResonanceState.WARNING, drive.passes):
        worst = first + int(severity[first:last].argmax())
        duration = float(drive.held[first:last].sum())
        warnings.append(Episode(float(drive.times[first]), duration, worst))
    return warnings


def worst_message(drive: Drive) -> int:
    """Return the message with the largest total load ratio, of those that may be the worst."""
    return int(drive.severity().argmax())


def main_cause(drive: Drive, row: int) -> str:
    """Return the excitation with the largest load ratio in a message, also in `no_warning`."""
    at, ratios = drive.resonances.message(row), drive.resonances.load_ratios[row].astype(float)
    if not np.isfinite(ratios).any() or at.load_ratio >= (1.0 - 1e-6) * np.nanmax(ratios):
        return cause_words(at)
    return drive.names[int(np.nanargmax(ratios))]


def ground_and_orders(
    drive: Drive, excitations: Sequence[Excitation]
) -> tuple[FloatArray, FloatArray] | None:
    """Return load ratios of the ground, and bounds of all orders, (n,); None without terrain."""
    rolls = np.array([excitation.terrain is not None for excitation in excitations], np.bool_)
    if len(rolls) != len(drive.names) or not rolls.any():
        return None
    ratios = drive.resonances.load_ratios.astype(float)
    squares = np.fmax.reduce(ratios[:, ~rolls], axis=1, initial=math.nan) * 0.0
    orders = np.sqrt(squares + np.nansum(ratios[:, ~rolls] ** 2, axis=1))
    orders[_may_be_high(drive.resonances)[:, ~rolls].any(axis=1)] = math.nan  # there is no bound
    total = drive.resonances.total_load_ratio.astype(float)
    return ratios[:, rolls][:, 0], np.minimum(orders, total)


def contributions(drive: Drive) -> list[Contribution]:
    """Return what each excitation did, the largest load ratio first, then the longest note."""
    every = []
    for i, name in enumerate(drive.names):
        state, ratio = drive.resonances.states[:, i], drive.resonances.load_ratios[:, i]
        warning = state == ResonanceState.WARNING
        finite = np.isfinite(ratio) & ~drive.doubted
        worst = int(np.where(finite, ratio, -1.0).argmax())
        every.append(
            Contribution(
                name,
                float(ratio[worst]) if finite.any() else math.nan,
                worst,
                drive.time_in(warning),
                drive.time_in(state == ResonanceState.NOTE),
                len(runs(warning, drive.passes)),
                bool((state != ResonanceState.UNKNOWN).any()),
            )
        )
    return sorted(every, key=_rank)


def _rank(part: Contribution) -> tuple[float, float]:
    """Return by what excitations are sorted: known load ratios first, the largest before others."""
    note_time = round(part.note_time, 9)  # Rounding does not order equal times.
    return -1.0 if math.isnan(part.load_ratio) else -2.0 - part.load_ratio, -note_time


def drive_sentence(
    drive: Drive,
    limits: WarningLimits,
    mode_label: Callable[[int], str],
    excitations: Sequence[Excitation],
    ending: Callable[[int], str],
) -> str:
    """Return what a drive did to the linkage, how bad and how sure that is, and what to do."""
    resonances = drive.resonances
    if (resonances.excitation_index < 0).all():
        unknown = max(resonances.unknown_sources.tolist(), key=int.bit_count)
        speeds, working = unknown_speeds(unknown), at_work(unknown, excitations)
        blind = bool(speeds) and not working
        why = "all orders were beyond the frequencies of the table"
        if (resonances.unknown_sources & Unknown.CRANK_ANGLE != 0).all():
            why = "each crank angle was invalid, outside of the table or doubted"
        if blind:
            why = f"{unknown_speed_words(speeds, ('was', 'were'))} never known"
        if blind or not all(excitation.terrain for excitation in working):
            return f"What the drive did to the linkage is not known, as {why}."
    if not np.isfinite(resonances.total_load_ratio).any():
        off = f"{_exceeded(drive)}." if episodes(drive) else ""
        near = _nearest(drive, mode_label, excitations)
        return " ".join(filter(None, [off, near, _no_ground(drive)]))
    loads = _loads(drive, limits, excitations, ending)
    return " ".join(filter(None, [loads, not_counted(drive, excitations)]))


def _loads(
    drive: Drive,
    limits: WarningLimits,
    excitations: Sequence[Excitation],
    ending: Callable[[int], str],
) -> str:
    """Return whether loads exceeded the limit, how large they were, and what would end that."""
    warnings, worst = episodes(drive), worst_message(drive)
    largest = drive.severity()[worst]
    known = ["known"] * (durations(drive).known_share < KNOWN)
    sure = known + ["not doubted"] * bool(drive.doubted.any())
    those = listing(sure) if sure else ""
    what = f"The largest{' that is ' * bool(sure)}{those} was {_load_at(drive, worst)}."
    if not largest:
        what = f"All loads{' that are ' * bool(sure)}{those} were zero."
    if not drive.may_be_worst.any():
        what = "No moment is named as the worst, as the inputs were doubtful at each known load."
    parts = ground_and_orders(drive, excitations) if largest else None
    if parts is not None and parts[0][worst] ** 2 > 0.5 * largest**2 and parts[1][worst] > 0.0:
        what += f" Without the ground it would have been at most {ratio_words(parts[1][worst])}."
    if not warnings:
        return f"{_without_warning(drive, limits)} {what}"
    loudest = max((episode.worst for episode in warnings), key=lambda row: drive.severity()[row])
    value = "" if drive.doubted[loudest] else ending(loudest)
    end = f"The worst warning would have ended at {value}." if value else ""
    return f"{_exceeded(drive)}. {what} {end}".rstrip()


def _exceeded(drive: Drive) -> str:
    """Return what exceeded its limit in a drive, for how long, and with how many warnings."""
    warnings = episodes(drive)
    warned = sum(episode.duration for episode in warnings)
    often = f"{len(warnings)} warnings of {warned:.1f} s together"
    often = f"one warning of {warned:.1f} s" if len(warnings) == 1 else often
    spent = durations(drive)
    above = f"{spent.above:.1f} s in all"
    if spent.known_share < KNOWN:
        above = f"{spent.above:.1f} s of the {spent.above + spent.below:.1f} s that are known"
    which = drive.resonances.state == ResonanceState.WARNING
    return f"{_excess(drive, which)} for {above}, with {often}"


def _excess(drive: Drive, rows: BoolArray) -> str:
    """Return the beginning of a sentence: whether loads or tyres exceeded a limit in messages."""
    parts = []
    if (drive.resonances.total_load_ratio > drive.resonances.load_ratio_limit).any():
        parts.append(f"loads exceeded {_limit_words(drive)}")
    if not parts or (drive.resonances.off_ground_share[rows] > MAX_OFF_GROUND).any():
        parts.append(f"tyres were off the ground for more than {MAX_OFF_GROUND:g} of the time,")
    text = " or ".join(parts).rstrip("," if len(parts) == 1 else "")
    return f"{text[0].upper()}{text[1:]}"


def _limit_words(drive: Drive) -> str:
    """Return the limits of the messages of a drive in words."""
    every = np.unique(drive.resonances.load_ratio_limit)
    if len(every) == 1:
        return f"{every[0]:g} of the static force"
    return f"{every[0]:g} to {every[-1]:g} of the static force (the limit was changed)"


def _without_warning(drive: Drive, limits: WarningLimits) -> str:
    """Return for how much of a drive without warnings its loads are known, and their verdict."""
    spent = durations(drive)
    limit = f"the limit of {_limit_words(drive)}"
    above, _ = above_and_below(drive)
    what = _excess(drive, above)
    if above.any() and (drive.broken[1:].all() or not spent.above):
        often = f"in {int(above.sum())} of {len(above)} readings"
        why = f"more than {GAP:g} s apart, they cannot warn"
        return f"{what} {often}; {why if spent.above else 'their stamps do not say for how long'}."
    if spent.above:
        never = f"never for {limits.dwell:g} s, so nothing warned"
        return f"{what} for {spent.above:.1f} s in all, but {never}."
    if spent.known_share >= KNOWN:
        return f"No load exceeded {limit}."
    if not spent.known_share:
        return f"Whether loads exceeded {limit} is not known; those that are known did not."
    share = f"{max(1, math.floor(100.0 * spent.known_share))} %"
    return f"Known for {share} of the drive, where no load exceeded {limit}."


def not_counted(drive: Drive, excitations: Sequence[Excitation]) -> str:
    """Return whose loads are not in the total, and for how long no load is known."""
    resonances, texts = drive.resonances, []
    if drive.times.min() >= _LATE:
        late = f"{drive.times.min():.1f} s"
        texts.append(f"No load is known for the first {late}.")
    unsaid = drive.missing - max(float(drive.times.min()), 0.0)
    if unsaid >= _LATE:
        texts.append(
            f"No message states the load for {unsaid:.1f} s, as each holds for at most {GAP:g} s."
        )
    has_load = np.isfinite(resonances.load_ratios).any(axis=0)
    silent = [name for name, its in zip(drive.names, has_load, strict=True) if not its]
    if silent:
        texts.append(f"The loads of {_some(silent)} are not known and not counted.")
    texts += _partly_unknown(drive, excitations, has_load)
    lost = drive.time_in(~np.isfinite(resonances.total_load_ratio))
    if lost >= _SHORT:
        texts.append(f"No load is known for {lost:.1f} s.")
    for source in Source:
        without = _without(drive, source)
        lost = drive.time_in(without)
        if lost >= _SHORT and not without.all():
            texts.append(f"The {source.label} speed was not known for {lost:.1f} s.")
    return " ".join(filter(None, [*texts, _no_ground(drive)]))


def _some(names: list[str]) -> str:
    """Return the first names as a list in a sentence, and how many more there are."""
    more = len(names) - _MOST_NAMES
    return listing([*names[:_MOST_NAMES], f"{more} more"] if more > 1 else names)


def _partly_unknown(
    drive: Drive, excitations: Sequence[Excitation], has_load: BoolArray
) -> list[str]:
    """Return a sentence about orders with loads that are not known at times, although they turn."""
    lost = dict[str, float]()
    others = np.isfinite(drive.resonances.total_load_ratio)
    for i, excitation in enumerate(excitations[: len(drive.names)]):
        unknown = drive.resonances.states[:, i] == ResonanceState.UNKNOWN
        time = drive.time_in(unknown & others & ~_without(drive, excitation.source))
        if has_load[i] and excitation.is_order and time >= _SHORT:
            lost[drive.names[i]] = time
    if not lost:
        return []
    upto = "for" if len(lost) == 1 else "for up to"
    return [f"The load of {_some(list(lost))} was not known {upto} {max(lost.values()):.1f} s."]


def _without(drive: Drive, source: Source) -> BoolArray:
    """Return when a speed was not known, (n,)."""
    return np.asarray(drive.resonances.unknown_sources & SPEED_BITS[source] != 0)


def _no_ground(drive: Drive) -> str:
    """Return for how long the level of the ground was not known, and why; empty if it was."""
    reasons, rolls, texts = drive.resonances.ground_unknown, ~_without(drive, Source.GROUND), []
    for why in np.unique(reasons[rolls]).tolist():
        lost = drive.time_in(rolls & (reasons == why))
        if why and lost >= _SHORT:
            texts.append(f"{unknown_ground(why).rstrip('.')} (for {lost:.1f} s).")
    return " ".join(texts)


def _cause_at(drive: Drive, row: int) -> str:
    """Return what loads most in a message; "mostly" is more than half of the square."""
    at, cause = drive.resonances.message(row), main_cause(drive, row)
    mostly = cause == cause_words(at) and at.load_place == at.total_load_place
    mostly &= bool(at.load_ratio**2 > 0.5 * at.total_load_ratio**2)
    return f", mostly by {cause}" if mostly else f"; {cause} is the largest excitation"


def _load_at(drive: Drive, row: int) -> str:
    """Return the load at a message in words: how much, where, when, and by what."""
    at = drive.resonances.message(row)
    factor, why = at.total_load_ratio_factor, at.unknown_factors
    total = load_words(at.total_load_ratio, factor, at.total_load_place, why)
    angle = math.degrees(drive.angles[row])
    return f"{total} at {drive.times[row]:.2f} s and {angle:.1f} deg{_cause_at(drive, row)}"


def _nearest(
    drive: Drive, mode_label: Callable[[int], str], excitations: Sequence[Excitation]
) -> str:
    """Return what came nearest to a mode, where no load is known."""
    margins = np.where(drive.doubted, math.nan, np.abs(drive.resonances.relative_margin))
    row = int(np.nanargmin(np.where(np.isfinite(margins), margins, np.inf)))
    at = drive.resonances.message(row)
    text = f"How large the loads were is not known{no_load_words(at, excitations)}."
    if not np.isfinite(margins).any():
        return text
    if not margins[row] < 1.0:
        return f"{text} No excitation came within 100 % of a natural frequency."
    near = drive.time_in(drive.resonances.state == ResonanceState.NOTE)
    return (
        f"{text} {at.excitation} came nearest to a natural frequency: {100.0 * margins[row]:.2g} % "
        f"from {mode_label(int(at.mode))} at {drive.times[row]:.2f} s. Excitations were near a "
        f"mode for {near:.1f} s."
    )
