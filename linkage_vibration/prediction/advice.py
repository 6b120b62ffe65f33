# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Advice: at which permitted height and ground speed the linkage would be loaded less.

The load is the total load ratio of all excitations. How sure a comparison is follows from the
members of the ensemble, each of which has loads of its own. Nothing is commanded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.fields import message_constants, message_fields
from linkage_vibration.messages.topics import ADVICE
from linkage_vibration.prediction.excitation import KMH, Excitation, Source
from linkage_vibration.prediction.levels import LevelTable, spreads
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.severity import ratio_words
from linkage_vibration.prediction.worst_levels import WorstLevels
from linkage_vibration.table.interpolation import angles_in_table

NOW, HEIGHT, SPEED, BOTH = message_constants(ADVICE).values()  # The places of the message

_SHAPE = 91, 17  # heights and speeds of a map
_LIVE_SHAPE = 19, 7  # likewise, while readings wait
_LIVE_SPEEDS = 0.7, 1.3  # of the present speed
_ADVISED = np.arange(4) != NOW  # The present height and speed are those of the question.
_KNOWN = 0.95  # least share of the members whose loads are known where a probability is
_LIKELY = 0.5  # A place is called quieter with at least this probability.
_PERIOD = 10**9  # ns, between two live pieces of advice
_SAME = 1.0 + 1e-6  # Loads that differ by less are the same, and the first one is chosen.
_NOTABLE = 0.8  # A height that leaves more of the load is not worth a change.
_GROUND = Source.GROUND.index
_NO_LOAD = (
    "No excitation with an amplitude is at work here, or the table has no FRFs or no static force "
    "to compare with."
)
_LOST = (
    "The level of an excitation is not known here: its frequency is beyond the band of the table, "
    "or the table is not accurate enough."
)
_OUTSIDE = "The angle is outside the table."
_SHARES = {0.5: "half", 1.0 / 3.0: "a third", 0.25: "a quarter"}


class AdviceError(LinkageVibrationError):
    """A question for advice cannot be answered."""


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What is permitted, and how it is now, NaN if not known; only the ground speed may change."""

    crank_angle: float  # rad
    speeds: FloatArray  # (n_sources,), rpm or m/s of each `Source`
    crank_angles: tuple[float, float] | None = None  # rad; None: all of the table
    ground_speeds: tuple[float, float] | None = None  # m/s; None: the present one


@dataclass(frozen=True, slots=True, eq=False)
class Advice:
    """The answer."""

    # The fields of ``Advice.msg`` but for header and table; beside its places, their columns, (4,).
    message: MessageColumns
    crank_angles: FloatArray  # (n_angles,), rad: rows of the map
    ground_speeds: FloatArray  # (n_speeds,), m/s: columns
    load_ratios: FloatArray  # (n_angles, n_speeds); NaN where refused
    velocities: FloatArray  # likewise, m/s rms at the response point
    reasons: NDArray[np.uint8]  # likewise, which text says why
    reason_texts: tuple[str, ...]  # the first is empty


def advise(
    levels: LevelTable | WorstLevels,
    excitations: Sequence[Excitation],
    question: Question,
    shape: tuple[int, int] = _SHAPE,
    *,
    limit: float = math.nan,
) -> Advice:
    """Return the quietest permitted heights and speeds on a map, and if they exceed a limit."""
    if np.shape(question.speeds) != (len(Source),):
        names = ", ".join(source.value for source in Source)
        raise AdviceError(f"`speeds` is {question.speeds}; give one of each: {names}.")
    # The last row and the last column of the cells are those of the present height and speed.
    angles, speeds = _axes(levels, question, shape)
    cells = np.arange(len(angles) * len(speeds)).reshape(len(angles), len(speeds))
    alpha3 = np.repeat(angles, len(speeds))
    columns = np.repeat(question.speeds[:, np.newaxis], len(speeds), axis=1)
    columns[_GROUND] = speeds
    results, every = levels.at_all_pairs(angles, columns), np.tile(columns, len(angles))
    reasons, texts = _reasons(levels, excitations, results, alpha3, every)
    load, velocity = (
        np.where(reasons, math.nan, total.astype(float))
        for total in (results.total_load_ratio, results.total_velocity)
    )
    permitted = [cells[-1:, -1:], cells[:-1, -1:], cells[-1:, :-1], cells[:-1, :-1]]
    chosen = np.array([smallest(load, among.ravel()) for among in permitted])
    both = levels.member_totals(alpha3[chosen], every[:, chosen])
    members, unknown = np.where(reasons[chosen], math.nan, both[0]), np.isnan(load[chosen])
    factors = np.where(unknown, math.nan, spreads(np.swapaxes(both, 0, 2)).T)
    message = MessageColumns(
        not_counted=_not_counted(excitations, question.speeds),
        crank_angles=np.where(unknown & _ADVISED, math.nan, alpha3[chosen]),
        ground_speeds=np.where(unknown & _ADVISED, math.nan, every[_GROUND, chosen]),
        load_ratios=load[chosen],
        load_ratio_factors=factors[0],
        velocities=velocity[chosen],
        velocity_factors=factors[1],
        probabilities=_probabilities(members),
    )
    message.places = _places(message)
    why = texts[reasons[chosen[NOW]]]
    sentence = advice_sentence(message, limit=limit)
    message.sentence = sentence or _nothing_better(message.load_ratios[NOW], why)
    unsure = ~unknown & np.isnan(message.load_ratio_factors)
    if unsure.any():
        message.sentence += f" {_why_unsure(members[:, unsure])}"
    shown = cells[:-1, :-1]
    maps = load[shown], velocity[shown], reasons[shown]
    return Advice(message, angles[:-1], speeds[:-1], *maps, texts)


def _why_unsure(members: FloatArray) -> str:
    """Return why it is not known how sure loads of members, (n_members, n), are."""
    why = "the table has no ensemble, as no number of the mechanism is uncertain"
    if len(members):
        known = int(np.isfinite(members).sum(axis=0).min())
        why = f"only {known} of {len(members)} members of the ensemble have a load there"
    return f"Not all factors and probabilities are known, as {why}."


def _places(columns: MessageColumns) -> NDArray[np.void]:
    """Return the places as the message has them, (4,)."""
    [kind] = [field.dtype for field in message_fields(ADVICE) if field.count]
    numbers = [columns.crank_angles, columns.ground_speeds, columns.load_ratios]
    numbers += [columns.load_ratio_factors, columns.velocities, columns.velocity_factors]
    return np.rec.fromarrays([*numbers, columns.probabilities], dtype=kind)


def _axes(
    levels: LevelTable | WorstLevels, question: Question, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return the permitted angles, rad, and ground speeds, m/s, each with the present one last."""
    present = abs(float(question.speeds[_GROUND]))  # negative in reverse
    for source, speed in zip(Source, question.speeds.tolist(), strict=True):
        if speed < 0.0 and source is not Source.GROUND:
            hint = "give one of at least 0, or NaN if it is not known"
            raise AdviceError(f"The {source.value} speed is {speed:g} rpm; {hint}.")
        if math.isinf(speed):
            raise AdviceError(f"The {source.value} speed is infinite; give NaN if it is not known.")
    ends, stroke = question.crank_angles or levels.alpha3_range, levels.alpha3_range
    angles = _steps("angles", ends, shape[0], -math.inf, ("rad", math.degrees(1.0), "deg"))
    if not np.isfinite(angles_in_table(np.array(ends), stroke)).all():
        first, last = np.degrees(stroke)
        raise AdviceError(
            f"The permitted angles are {math.degrees(ends[0]):g} to {math.degrees(ends[1]):g} deg, "
            f"but the table has {first:g} to {last:g} deg; give a part of that."
        )
    speeds = np.array([present])
    if question.ground_speeds is not None:
        speeds = _steps(
            "ground speeds", question.ground_speeds, shape[1], 0.0, ("m/s", KMH, "km/h")
        )
    return np.append(angles, question.crank_angle), np.append(speeds, present)


def _nothing_better(load_ratio: float, why: str) -> str:
    """Return the advice where nothing is notably quieter; why the load now is not known, if so."""
    if math.isnan(load_ratio):
        return f"How strongly it is loaded now is not known: {why[0].lower()}{why[1:]}"
    if load_ratio == 0.0:
        return "Nothing that is known loads it now."
    return "Nothing permitted is known to be notably quieter."


def _steps(
    what: str, ends: tuple[float, float], n: int, least: float, units: tuple[str, float, str]
) -> FloatArray:
    """Return n steps of a permitted range, or its only value; errors name it in both units."""
    low, high = ends
    if not least <= low <= high < math.inf or low == -math.inf:
        above = "" if least < 0.0 else " of at least 0"
        unit, factor, typed = units
        raise AdviceError(
            f"The permitted {what} are {low:g} to {high:g} {unit} ({factor * low:g} to "
            f"{factor * high:g} {typed}); give two finite numbers{above}, the smaller one first."
        )
    return np.linspace(low, high, n if low < high else 1)


def _reasons(
    levels: LevelTable | WorstLevels,
    excitations: Sequence[Excitation],
    results: MessageColumns,
    alpha3: FloatArray,
    speeds: FloatArray,
) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
    """Return why levels, (n,), are refused where a load at work is not known, and the texts."""
    loaded = np.array([[excitation.load is not None] for excitation in excitations])
    at_work = loaded & np.isfinite(speeds[[excitation.source.index for excitation in excitations]])
    ground = results.ground_unknown
    inside = np.isfinite(angles_in_table(alpha3, levels.alpha3_range))
    refused = {
        _NO_LOAD: np.isnan(results.total_load_ratio),
        _LOST: (at_work & np.isnan(results.velocities.T)).any(axis=0),
        **{str(text): ground == text for text in np.unique(ground) if text},
        _OUTSIDE: ~inside,
    }
    reasons = np.zeros(alpha3.shape, np.uint8)
    for number, rows in enumerate(refused.values(), 1):
        reasons[rows] = number
    return reasons, ("", *refused)


def _not_counted(excitations: Sequence[Excitation], speeds: FloatArray) -> str:
    """Return the names of the excitations whose load is nowhere known at present speeds."""
    unknown = [math.isnan(speed) for speed in speeds]
    return ", ".join(
        excitation.name
        for excitation in excitations
        if (excitation.load or excitation.terrain) is None or unknown[excitation.source.index]
    )


def smallest(load: FloatArray, rows: IntArray) -> int:
    """Return the first of some rows with the smallest load but for rounding; any without one."""
    values = np.where(np.isnan(load[rows]), math.inf, load[rows])
    return int(rows[(values <= _SAME * values.min()).argmax()])


def _probabilities(members: FloatArray) -> FloatArray:
    """Return the probabilities that loads of members, (n_members, 4), are below that of now."""
    finite = np.isfinite(members) & np.isfinite(members[:, :1])
    n, quieter = finite.sum(axis=0), (finite & (members < members[:, :1])).sum(axis=0)
    known = n >= max(1.0, _KNOWN * len(members))
    # All members may agree and still be wrong, so half of one is added on each side.
    probability = np.where(known, (quieter + 0.5) / (n + 1.0), math.nan)
    probability[NOW] = math.nan
    return np.asarray(probability)


def is_quieter(message: MessageColumns) -> BoolArray:
    """Return which places are known to be quieter than now, (4,), unless they probably are not."""
    quieter = message.load_ratios * _SAME < message.load_ratios[NOW]
    return np.asarray(quieter & ~(message.probabilities < _LIKELY))


def advice_sentence(
    message: MessageColumns,
    would: str = "would be loaded",
    *,
    heights_only: bool = False,
    limit: float = math.nan,
) -> str:
    """Return what is notably quieter than now, and whether it exceeds a limit; empty if nothing."""
    now, texts = float(message.load_ratios[NOW]), []
    angles = [f"{math.degrees(angle):.0f} deg" for angle in message.crank_angles]
    speeds = [f"{KMH * speed:.0f} km/h" for speed in message.ground_speeds]
    moving = "" if math.isnan(message.ground_speeds[NOW]) else f" at {speeds[NOW]}"
    beginnings = {HEIGHT: f"Carried at {angles[HEIGHT]} instead of {angles[NOW]}{moving}"}
    if not heights_only:
        beginnings[SPEED] = f"At {speeds[SPEED]} instead of {speeds[NOW]}"
    quieter = is_quieter(message)
    for place, beginning in beginnings.items():
        ratio = float(message.load_ratios[place])
        share = ratio / max(now, 1e-300)
        if quieter[place] and share <= _NOTABLE:
            probability = 100.0 * float(message.probabilities[place])
            sure = "how probably, is not known"
            if not math.isnan(probability):
                sure = f"less with a probability of {probability:.0f} %"
            near = [text for value, text in _SHARES.items() if abs(share / value - 1.0) < 0.1]
            words = near[0] if near else f"{100.0 * share:.0f} %"
            words = words if share >= 0.005 else "less than 1 %"
            texts.append(f"{beginning} it {would} {words} as much ({sure}).")
            if ratio > limit:
                still = f"{ratio_words(ratio)} of the static force exceeds the limit of {limit:g}"
                texts.append(f"That is not enough: {still}.")
    return " ".join(texts)


class Adviser:
    """Gives advice while the total load ratio exceeds its limit, at most once in a second."""

    def __init__(self, monitor: ResonanceMonitor) -> None:
        self._monitor = monitor
        self._last = -_PERIOD

    def is_due(self, load_ratio: float, stamp: int) -> bool:
        """Return whether advice is due for the next resonance; its stamp is in ns."""
        exceeded = load_ratio > self._monitor.rules.limits.warning
        if not exceeded or 0 <= stamp - self._last < _PERIOD:
            return False
        self._last = stamp
        return True

    def answer(self, resonance: MessageColumns) -> MessageColumns:
        """Return the advice for a resonance of the monitor, as ``Advice.msg``."""
        levels, ground = self._monitor.rules.levels, float(resonance.speeds[_GROUND])
        assert levels is not None  # without levels, no load ratio exceeds a limit
        low, high = _LIVE_SPEEDS
        permitted = None if math.isnan(ground) else (low * ground, high * ground)
        question = Question(resonance.crank_angle, resonance.speeds, None, permitted)
        limit = self._monitor.rules.limits.warning
        advice = advise(levels, self._monitor.rules.excitations, question, _LIVE_SHAPE, limit=limit)
        advice.message.table_id = resonance.table_id
        return advice.message
