# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How bad a vibration is: the states that load ratios have, and the words for them.

The load ratio is the root mean square of the force in a pin or cylinder over the static force
there. At 0.33, three times the root mean square reach the static force: pins and cylinders unload,
and play rattles. A single harmonic unloads at 0.71.
"""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Integers
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import KMH, Excitation, Source
from linkage_vibration.prediction.ground import MAX_OFF_GROUND

GAP = 3.0  # Readings that are farther apart, s, do not belong to the same warning

# A tyre that the ground shakes is off it for half of the time if nothing presses it down.
_HALF = 0.5
_TIPS = (
    "A tyre carries no static load, so that the tractor tips over; check the masses and the "
    "centres of gravity of tractor and implement."
)
_KEPT = f"The warning is kept for up to {GAP:g} s, as it is not known whether it is over."
_ENDLESS = "No single change of speed or height within reach ends it."
_NEVER = 2**62  # ns; a time that has not come
BACK = 1.0  # s; the times of two publishers differ by less, and a clock jumps back by more


class ResonanceState(enum.IntEnum):
    """How bad an excitation is, in ascending order; the constants of ``LoadState``."""

    UNKNOWN = 0
    CLEAR = 1
    NOTE = 2
    WARNING = 3


UNKNOWN, CLEAR, NOTE, WARNING = np.arange(4, dtype=np.uint8)
WINDOW_RANKS = np.array([1, 0, 2, 3], np.uint8)  # of these, in a window


class Unknown(enum.IntFlag):
    """What is not known of the sources of loads; the bits of ``LoadState``."""

    CRANK_ANGLE = 1
    ENGINE_SPEED = 2
    PTO_SPEED = 4
    GROUND_SPEED = 8
    GROUND_LEVEL = 16
    ORDER_LEVEL = 32


SPEED_BITS = {Source.ENGINE: 2, Source.PTO: 4, Source.GROUND: 8}  # of speeds that are not known


def unknown_speeds(unknown: int) -> list[Source]:
    """Return the speeds that are not known, from the bits of a ``LoadState``."""
    return [source for source, bit in SPEED_BITS.items() if unknown & bit]


@dataclass(frozen=True, slots=True)
class WarningLimits:
    """When excitations warn."""

    warning: float = 0.33  # load ratio, 1
    note: float = 0.1  # load ratio, 1
    dwell: float = 1.0  # s, for which a limit is exceeded before, or is not after
    near: float = 0.1  # relative margin of a note if no load ratio is known


DEFAULT_LIMITS = WarningLimits()  # The limits of the default parameters


class WarningTimer:
    """Turns exceeded limits into warnings, which begin and end only after the dwell time.

    A reading at which it is not known whether a limit is exceeded changes nothing. More than 3 s of
    such readings or without one, and a clock that jumps back by a second, end a warning.
    """

    def __init__(self, n: int) -> None:
        self._warns = [False] * n
        self._since = [_NEVER] * n  # ns, since when each limit says otherwise than its warning
        self._known, self._last = [0] * n, 0  # ns, when it was last known, and the last reading

    def follow(
        self, exceeds: BoolArray, known: BoolArray, time: Integers, dwell: float
    ) -> BoolArray:
        """Return which of n_limits warn at n times, ns, after a dwell time, s, (n_limits, n)."""
        warns, least = np.zeros(exceeds.shape, np.bool_), round(1e9 * dwell)
        above = np.logical_or.reduce(exceeds & known)
        lists = (each.tolist() for each in (time, exceeds.T, known.T, above))
        for row, (now, exceeded, here, over) in enumerate(zip(*lists, strict=True)):
            jumps = now <= self._last - 1e9 * BACK
            # Of two publishers whose times differ, the later one's counts.
            latest = self._last = now if jumps else max(now, self._last)
            if not (over or any(self._warns) or min(self._since) < _NEVER):
                continue  # No warning lasts or may begin.
            for i, exceeds_now in enumerate(exceeded):
                if jumps or now - self._known[i] > 1e9 * GAP:
                    self._warns[i], self._since[i], self._known[i] = False, _NEVER, latest
                if here[i]:
                    self._known[i] = latest
                    differs = exceeds_now != self._warns[i]
                    self._since[i] = min(self._since[i], latest) if differs else _NEVER
                    if differs and latest - self._since[i] >= least:
                        self._warns[i], self._since[i] = exceeds_now, _NEVER
            warns[:, row] = self._warns
        return warns


def is_kept(of: MessageColumns) -> BoolArray:
    """Return whether warnings are only kept, as it is not known if they are over, () or (n,)."""
    above = (of.total_load_ratio > of.load_ratio_limit) | (of.off_ground_share > MAX_OFF_GROUND)
    lost = ((of.states == WARNING) & np.isnan(of.load_ratios)).any(axis=-1)
    return np.asarray((of.state == WARNING) & ~above & (lost | (of.unknown_sources != 0)))


def states(
    load_ratio: FloatArray,
    apart: FloatArray,
    known: BoolArray,
    warns: BoolArray,
    limits: WarningLimits,
) -> tuple[NDArray[np.uint8], FloatArray]:
    """Return states, (n_excitations, n), and by what those in the same state are ordered."""
    unknown = np.isnan(load_ratio)
    notable = np.where(unknown, apart < limits.near, load_ratio > limits.note)
    state = np.where(known, np.where(warns, WARNING, np.where(notable, NOTE, CLEAR)), UNKNOWN)
    nearness = limits.near / np.maximum(limits.near + apart, 1e-300)
    return state, np.where(unknown, nearness, 1.0 + load_ratio)


def speed_words(source: Source, value: float) -> str:
    """Return a speed, rad/s or m/s, in the unit that people use: "1850 rpm" or "15.1 km/h"."""
    value /= source.si
    if source is Source.GROUND:
        return f"{KMH * value:.3g} km/h"
    return f"{value:{'.0f' if value < 1e6 else '.3g'}} {source.unit}"


def listing(words: Sequence[str]) -> str:
    """Return words as a sentence lists them: "a, b and c"."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def unknown_speed_words(speeds: Sequence[Source], verbs: tuple[str, str] = ("is", "are")) -> str:
    """Return the subject and verb of a sentence about speeds."""
    words = [source.label for source in speeds]
    end = f"speed {verbs[0]}" if len(words) == 1 else f"speeds {verbs[1]}"
    return f"the {listing(words)} {end}"


def no_load_words(resonance: MessageColumns, excitations: Sequence[Excitation]) -> str:
    """Return why there is no load ratio, from ", as" on; empty if only the ground is the cause."""
    if math.isfinite(resonance.total_velocity):
        return ", as no static force is known to compare with"
    working = at_work(resonance.unknown_sources, excitations)
    if any(excitation.load for excitation in working):
        return ", as the excitations with an amplitude are beyond the frequencies of the table"
    if resonance.ground_unknown and all(excitation.terrain for excitation in working):
        return ""
    what = "order" if resonance.ground_unknown else "excitation"
    return f", as no {what} at work has an amplitude"


def at_work(unknown: int, excitations: Sequence[Excitation]) -> list[Excitation]:
    """Return the excitations whose speed is known, from the bits of a ``LoadState``."""
    return [each for each in excitations if not unknown & SPEED_BITS[each.source]]


def ratio_words(ratio: float) -> str:
    """Return a load ratio with two digits, or without decimals above 10: "0.33" or "207"."""
    return f"{ratio:.0f}" if 10.0 <= ratio < 1e6 else f"{ratio:.2g}"


def load_words(ratio: float, factor: float, place: str, why: str = "") -> str:
    """Return a load ratio, its place and its standard deviation, a factor, or why that is NaN."""
    unknown = f"not known, as {why}" if why else "not known"
    deviation = unknown if math.isnan(factor) else f"a factor of {factor:.3g}"
    return (
        f"{ratio_words(ratio)} of the static force in {place or 'the pins'} "
        f"(standard deviation {deviation})"
    )


def cause_words(resonance: MessageColumns) -> str:
    """Return the excitation of a ``Resonance`` with its frequency; the ground with its speed."""
    if not math.isnan(resonance.excitation_frequency):
        return f"{resonance.excitation} at {resonance.excitation_frequency:.1f} Hz"
    return f"{resonance.excitation} at {speed_words(Source.GROUND, resonance.excitation_speed)}"


def unknown_ground(why: str) -> str:
    """Return a sentence that names why the ground is not counted."""
    return f"The level of the ground is not known: {why[0].lower()}{why[1:]}"


def present_sentence(resonance: MessageColumns, excitations: Sequence[Excitation]) -> str:
    """Return what an assessment of `described` says: the load, and what ends a warning."""
    begin = f"{_KEPT} " * bool(is_kept(resonance))
    speeds = unknown_speeds(resonance.unknown_sources)
    unknown = f"{unknown_speed_words(speeds)} not known or not fresh" if speeds else ""
    working = at_work(resonance.unknown_sources, excitations)
    alone = bool(working) and all(excitation.terrain for excitation in working)
    if resonance.excitation_index < 0 and not alone:
        lost = "all orders are beyond the frequencies of the table"
        if resonance.unknown_sources & Unknown.CRANK_ANGLE:
            lost = "the crank angle is invalid, outside of the table or doubted"
        return f"{begin}No load is known, as {lost if working else unknown}."
    tail = f" {unknown[0].upper()}{unknown[1:]}." if unknown else ""
    if resonance.ground_unknown and Source.GROUND not in speeds:
        tail += f" {unknown_ground(resonance.ground_unknown)}"
    pairs = zip(excitations, resonance.velocities, strict=False)
    beyond = [x.name for x, level in pairs if x in working and x.load and math.isnan(level)]
    if beyond and math.isfinite(resonance.total_velocity):
        tail += f" Beyond the frequencies of the table, and so not known: {listing(beyond)}."
    unknown_load = math.isnan(resonance.total_load_ratio)
    airborne = resonance.off_ground_share > MAX_OFF_GROUND
    warns = resonance.state == ResonanceState.WARNING and not begin
    if warns and (airborne or not unknown_load):
        return f"{_warning(resonance, excitations)}{tail}"
    if unknown_load:
        return f"{begin}No load is known{no_load_words(resonance, excitations)}.{tail}"
    qualifier = "known " if resonance.unknown_sources or beyond else ""
    total = ratio_words(resonance.total_load_ratio)
    return f"{begin}All {qualifier}loads are {total} of the static forces.{tail}"


def _warning(resonance: MessageColumns, excitations: Sequence[Excitation]) -> str:
    """Return what loads the linkage, and what ends this."""
    at = resonance
    load = load_words(at.load_ratio, at.load_ratio_factor, at.load_place, at.unknown_factors)
    does = f"exerts {load}, all excitations together {ratio_words(resonance.total_load_ratio)}"
    if resonance.off_ground_share > _HALF:
        return _TIPS
    off = f"a tyre off the ground for {resonance.off_ground_share:.2g} of the time"
    if math.isnan(resonance.load_ratio):
        does = f"lifts {off}"
    elif resonance.off_ground_share > MAX_OFF_GROUND:
        does += f", and they lift {off}"
    ending = ending_words(resonance, excitations)
    end = f"It ends at {ending}." if ending else _ENDLESS
    return f"{cause_words(resonance)} {does}. {end}"


def ending_words(resonance: MessageColumns, excitations: Sequence[Excitation]) -> str:
    """Return the nearest speed and crank angle that end a warning; empty if there are none."""
    source = next((e.source for e in excitations if e.name == resonance.excitation), None)
    changes = []
    if source is not None and not math.isnan(resonance.quiet_speed):
        speed = speed_words(source, resonance.quiet_speed)
        article = "an" if source is Source.ENGINE else "a"
        changes.append(f"{article} {source.label} speed of {speed}")
    if not math.isnan(resonance.quiet_angle):
        changes.append(f"a crank angle of {math.degrees(resonance.quiet_angle):.1f} deg")
    return " or ".join(changes)
