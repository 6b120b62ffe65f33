# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The sentence about a drive is true for speeds and loads that nobody expects."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.severity import (
    WarningLimits,
    load_words,
    no_load_words,
    present_sentence,
    speed_words,
)
from linkage_vibration.prediction.verdict import (
    Drive,
    contributions,
    drive_of,
    drive_sentence,
    durations,
    ground_and_orders,
    holding,
)
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table

UNKNOWN, CLEAR, NOTE, WARNING = range(4)
ENGINE_SPEED, PTO_SPEED = 2, 4  # bits of unknown_sources
PER_RPM = math.pi / 30.0  # rad/s
LIMITS = WarningLimits()
RAISED = {"raised": True}
GROWING = {"exponent": 4}
SHAKER = {"speed": "pto", "orders": [1], "force": [9000.0], "at": "E1.z", "at_speed": 540.0}
ENGINE = {"speed": "engine", "orders": [6], "force": [3e4], "at": "E2.x", "at_speed": 2000.0}


@pytest.fixture(scope="module")
def excitations() -> tuple[Excitation, ...]:
    """Return an excitation by the PTO, and one by the engine."""
    return excitations_from_mapping({"shaker": SHAKER | GROWING, "high": ENGINE | GROWING})


def drive(whole: list[int], totals: list[float], step: float = 1.0, **fields: Any) -> Drive:
    """Return a drive at 120 deg, the first of whose two excitations does everything."""
    n, total = len(whole), np.array(totals, np.float32)
    columns: dict[str, Any] = {
        "state": np.array(whole),
        "velocities": np.zeros((n, 2), np.float32),
        "states": np.stack([np.array(whole), np.full(n, UNKNOWN)], axis=1),
        "excitation": np.full(n, "shaker 1"),
        "excitation_frequency": np.full(n, 9.0),
        "mode": np.zeros(n, int),
        "relative_margin": np.full(n, 0.5),
        "total_velocity": np.full(n, math.nan),
        "load_ratio": total.astype(float),
        "load_ratios": np.stack([total, np.full(n, np.nan, np.float32)], axis=1),
        "total_load_ratio": total,
        "total_load_ratio_factor": np.full(n, np.nan, np.float32),
        "unknown_factors": "",
        "total_load_place": np.full(n, "lower_link:V1"),
        "load_place": np.full(n, "lower_link:V1"),
        "unknown_sources": np.full(n, ENGINE_SPEED),
        "excitation_index": np.where(np.array(whole) == UNKNOWN, -1, 0),
        "ground_unknown": np.full(n, ""),
        "off_ground_share": np.full(n, math.nan),
        "load_ratio_limit": np.full(n, LIMITS.warning, np.float32),
        "quiet_speed": np.full(n, math.nan),
        "quiet_angle": np.full(n, math.nan),
    }
    stamps = np.round(np.arange(n) * step * 1e9).astype(np.int64)
    names = ("shaker 1", "high 6")
    messages = MessageColumns(**(columns | fields))
    return drive_of(
        stamps, 0, messages, np.full(n, math.radians(120.0)), names, np.arange(n), int(stamps[-1])
    )


def sentence(actual: Drive, excitations: tuple[Excitation, ...]) -> str:
    """Return the sentence about a drive."""
    return drive_sentence(actual, LIMITS, str, excitations, lambda _: "")


def test_orders_that_are_not_known_are_not_quiet() -> None:
    """Without any known order or total, all orders together are not known, and never 0."""
    ground = {"speed": "ground", "terrain": {"class": "B"}, "raised": True}
    both = excitations_from_mapping({"shaker": SHAKER | GROWING, "ground": ground})
    ratios = np.array([[0.3, 0.4], [math.nan, 0.4], [0.3, math.nan], [math.nan, math.nan]])
    totals = [0.5, 0.4, 0.3, math.nan]
    parts = ground_and_orders(drive([CLEAR] * 4, totals, load_ratios=ratios), both)
    assert parts is not None
    np.testing.assert_array_equal(parts[0], [0.4, 0.4, math.nan, math.nan])
    np.testing.assert_allclose(parts[1], [0.3, math.nan, 0.3, math.nan], rtol=1e-6)
    others = excitations_from_mapping({"ground": ground, "shaker": SHAKER, "high": ENGINE})
    for state, bound in ((CLEAR, 0.3), (NOTE, math.nan), (UNKNOWN, math.nan)):
        ratios, states = np.array([[0.4, 0.3, math.nan]]), np.array([[NOTE, NOTE, state]])
        actual = drive([NOTE], [0.5], load_ratios=ratios, states=states)
        parts = ground_and_orders(replace(actual, names=("ground", "shaker 1", "high 6")), others)
        assert parts is not None
        np.testing.assert_allclose(parts[1], [bound], rtol=1e-6)


@pytest.mark.parametrize(
    ("state", "load", "known"),
    [(CLEAR, math.nan, 1.0), (NOTE, 0.2, 1.0), (NOTE, math.nan, 0.0), (WARNING, math.nan, 0.0)],
)
def test_an_unknown_load_near_a_mode_is_not_calm(state: int, load: float, known: float) -> None:
    """An order whose load is not known is below a limit only if it is near no mode."""
    each = {"states": np.full((3, 2), state), "load_ratios": np.array([[0.1, load]] * 3)}
    actual = drive([NOTE] * 3, [0.1] * 3, unknown_sources=np.zeros(3, int), **each)
    assert durations(actual).known_share == known


def test_the_largest_load_may_be_too_short_to_warn(excitations: tuple[Excitation, ...]) -> None:
    """A load of 7 for one message is the largest, although only a load of 0.4 warned."""
    text = sentence(drive([NOTE, NOTE, WARNING, CLEAR], [7.0, 0.05, 0.4, 0.0]), excitations)
    assert (
        "exceeded 0.33 of the static force for 2.0 s of the 2.0 s that are known, with one "
        "warning of 1.0 s" in text
    )
    assert "The largest that is known was 7 of the static force in lower_link:V1" in text
    assert "at 0.00 s and 120.0 deg" in text


@pytest.mark.parametrize("doubted", [[0, 0, 0], [0, 1, 0], [1, 1, 1]])
def test_what_is_doubted_is_not_the_worst(
    excitations: tuple[Excitation, ...], doubted: list[int]
) -> None:
    """A load of 5 is the worst unless its reading is doubted; if all are, none is named."""
    actual = drive([CLEAR, WARNING, CLEAR], [0.2, 5.0, 0.4])
    actual = replace(actual, doubted=np.array(doubted, bool))
    worst = {0: 5.0, 1: 0.4, 3: math.nan}[sum(doubted)]
    assert contributions(actual)[0].load_ratio == pytest.approx(worst, nan_ok=True)
    text = sentence(actual, excitations)
    assert ("was 5 of the static force" in text) == (sum(doubted) == 0)
    assert ("known and not doubted was 0.4 of" in text) == (sum(doubted) == 1)
    assert ("the worst, as the inputs were doubtful at each" in text) == (sum(doubted) == 3)
    assert text.startswith("Loads exceeded 0.33 of the static force for 2.0 s")


def test_the_main_cause_is_the_largest_load(excitations: tuple[Excitation, ...]) -> None:
    """An excitation that never warns may load most, though the message is about another one."""
    ratios = np.array([[0.4, 5.0]], np.float32)
    actual = drive([WARNING], [5.02], load_ratio=np.array([0.4]), load_ratios=ratios)
    assert sentence(actual, excitations).count("; high 6 is the largest excitation.") == 1


@pytest.mark.parametrize(
    ("ratio", "place", "mostly"),
    [
        (0.72, "lower_link:V1", True),
        (0.70, "lower_link:V1", False),
        (0.99, "lift_cylinders", False),
    ],
)
def test_mostly_is_more_than_half_of_the_square(
    excitations: tuple[Excitation, ...], ratio: float, place: str, mostly: bool
) -> None:
    """An excitation loads a place mostly if it has more than half of the square there."""
    ratios, places = np.array([[ratio, math.nan]], np.float32), np.array([place])
    known = {"load_ratio": np.array([ratio]), "load_ratios": ratios, "load_place": places}
    text = sentence(drive([WARNING], [1.0], **known), excitations)
    assert ("mostly by shaker 1 at 9.0 Hz." in text) == mostly
    assert ("; shaker 1 at 9.0 Hz is the largest excitation." in text) != mostly


@pytest.mark.parametrize(("ground", "said"), [(0.72, True), (0.70, False)])
def test_what_is_left_without_the_ground(ground: float, said: bool) -> None:
    """The other load, 0.3, is named if the ground makes more than half of the square."""
    rough = {"speed": "ground", "terrain": {"class": "B"}, "raised": True}
    both = excitations_from_mapping({"shaker": SHAKER | GROWING, "ground": rough})
    ratios = np.array([[0.3, ground]], np.float32)
    text = sentence(drive([WARNING], [1.0], load_ratios=ratios), both)
    assert ("Without the ground it would have been at most 0.3." in text) == said


def test_what_is_not_counted_is_said(excitations: tuple[Excitation, ...]) -> None:
    """Loads that were never known, and times without a load, are named."""
    text = sentence(drive([CLEAR, UNKNOWN, CLEAR], [0.0, math.nan, 0.0]), excitations)
    assert text == (
        "Whether loads exceeded the limit of 0.33 of the static force is not known; those that are "
        "known did not. All loads that are known were zero. The loads of high 6 are not known and "
        "not counted. No load is known for 1.0 s."
    )
    speeds = np.array([0, ENGINE_SPEED, 0])
    both = np.full((3, 2), 0.1, np.float32)
    actual = drive([CLEAR] * 3, [0.14] * 3, unknown_sources=speeds, load_ratios=both)
    assert sentence(actual, excitations).endswith("The engine speed was not known for 1.0 s.")
    known = {"unknown_sources": np.zeros(3, int), "states": np.full((3, 2), CLEAR)}
    actual = drive([CLEAR] * 3, [0.14] * 3, **known, load_ratios=both)
    assert sentence(actual, excitations).startswith("No load exceeded the limit")
    lost = [0.14, math.nan, 0.14]
    actual = drive([CLEAR, UNKNOWN, CLEAR], lost, unknown_sources=speeds, load_ratios=both)
    missing = "No load is known for 1.0 s. The engine speed was not known for 1.0 s."
    assert sentence(actual, excitations).endswith(missing)


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        (0, "No load exceeded the limit of 0.33"),
        (5, "No load exceeded the limit of 0.33"),
        (6, "Known for 94 % of the drive, where no load exceeded the limit of 0.33"),
        (72, "Known for 28 % of the drive, where no load exceeded the limit of 0.33"),
        (100, "Whether loads exceeded the limit of 0.33 of the static force is not known"),
    ],
)
def test_what_is_known_comes_first(
    excitations: tuple[Excitation, ...], lost: int, words: str
) -> None:
    """The sentence of a drive of which less than 95 % is known begins with what is known.

    Either a speed is lost, or one excitation, or there is no message for that time.
    """
    rows = np.arange(100) < lost
    known = {"unknown_sources": np.zeros(100, int), "states": np.full((100, 2), CLEAR)}
    speed = drive([CLEAR] * 100, [0.14] * 100, **known | {"unknown_sources": rows * PTO_SPEED})
    states = np.stack([np.full(100, CLEAR), np.where(rows, UNKNOWN, CLEAR)], axis=1)
    for each in (speed, drive([CLEAR] * 100, [0.14] * 100, **known | {"states": states})):
        assert sentence(each, excitations).startswith(words)
        assert durations(each).known_share == pytest.approx(0.01 * (100 - lost))
    n = 100 - lost
    if n:
        known = {"unknown_sources": np.zeros(n, int), "states": np.full((n, 2), CLEAR)}
        short = replace(drive([CLEAR] * n, [0.14] * n, **known), missing=float(lost))
        assert sentence(short, excitations).startswith(words)
        assert durations(short).known_share == pytest.approx(0.01 * n)


@pytest.mark.parametrize(("count", "said"), [(0, False), (1, True)])
def test_orders_beyond_the_table_for_a_while(
    excitations: tuple[Excitation, ...], count: int, said: bool
) -> None:
    """An order whose load is known at other times is named, with how long it was not."""
    states, ratios = np.full((3, 2), CLEAR), np.full((3, 2), 0.1, np.float32)
    states[:count, 1], ratios[:count, 1] = UNKNOWN, math.nan
    known = {"unknown_sources": np.zeros(3, int), "states": states, "load_ratios": ratios}
    text = sentence(drive([CLEAR] * 3, [0.14] * 3, **known), excitations)
    assert ("The load of high 6 was not known for 1.0 s." in text) == said
    assert text.startswith("Known for 66 %" if said else "No load exceeded")


@pytest.mark.parametrize(("start", "said"), [(0.9, False), (1.1, True)])
def test_the_time_before_the_first_speed_is_said(
    excitations: tuple[Excitation, ...], start: float, said: bool
) -> None:
    """A log begins with predictions; its messages begin when the first speed is known."""
    actual = drive([NOTE] * 3, [0.14] * 3)
    text = sentence(replace(actual, times=actual.times + start), excitations)
    assert ("No load is known for the first 1.1 s." in text) is said


def test_a_tyre_off_the_ground_is_no_load_that_is_known() -> None:
    """Warnings of tyres are named as such, alone and beside loads, in a drive and live."""
    rolls = excitations_from_mapping({"g": {"speed": "ground", "terrain": {"class": "C"}} | RAISED})
    off = "A tyre is off the ground for more than a fifth of the time."
    hops: dict[str, Any] = {"load_ratios": np.full((4, 2), np.nan, np.float32)}
    hops |= {"velocities": np.zeros((4, 1))}
    hops |= {"excitation": np.full(4, "g (class C)")}
    hops |= {"unknown_sources": np.zeros(4, int), "relative_margin": np.full(4, math.nan)}
    hops |= {"excitation_frequency": np.full(4, math.nan), "excitation_speed": np.full(4, 50.0)}
    hops |= {"load_ratio_factor": np.full(4, math.nan), "load_place": np.full(4, "")}
    share = np.array([0.1, 0.1, 0.3, 0.3])
    reasons = np.where(share > 0.2, off, "")
    hops |= {"ground_unknown": reasons, "off_ground_share": share}
    both = drive([WARNING] * 4, [0.4, 0.4, math.nan, math.nan], **hops)
    assert sentence(both, rolls).startswith(
        "Loads exceeded 0.33 of the static force or tyres were off the ground for more than 0.2 of "
        "the time, for 4.0 s in all, with one warning of 4.0 s. The largest was 0.4 "
    )
    short = hops | {"off_ground_share": np.array([0.1, 0.1, 0.1, 0.21]), "ground_unknown": reasons}
    text = sentence(drive([CLEAR] * 4, [0.33] * 4, step=0.2, **short), rolls)  # at the limit
    assert text.startswith(
        "Tyres were off the ground for more than 0.2 of the time for 0.2 s in all"
    )
    alone = hops | {"ground_unknown": np.full(4, off), "off_ground_share": np.full(4, 0.3)}
    never = drive([WARNING] * 4, [math.nan] * 4, **alone)
    text = sentence(never, rolls)
    assert text.startswith("Tyres were off the ground for more than 0.2 of the time for 4.0 s")
    assert "amplitude" not in text
    assert "natural frequency" not in text
    live = present_sentence(never.resonances.message(0), rolls)
    assert live.startswith("g (class C) at 180 km/h lifts a tyre off the ground for 0.3 of the")
    tips = never.resonances.message(0)
    for value, words in ((0.49, "g (class C) at"), (0.51, "A tyre carries no static load")):
        tips.off_ground_share = value
        assert present_sentence(tips, rolls).startswith(words)
    calm = never.resonances.message(0)
    calm.state = NOTE
    quiet = present_sentence(calm, rolls)
    assert quiet.startswith("No load is known. The level of the ground is not known: ")
    assert quiet.count("is not known") == 1  # the reason stands once


def test_how_long_messages_hold() -> None:
    """Messages of one stamp share its time; one holds for at most 3 s, and the rest is unknown."""
    held, _, missing = holding(np.array([0, 0, 100, 100, 200]) * 10**6)
    assert (held.tolist(), missing) == (pytest.approx([0.05, 0.05, 0.05, 0.05, 0.1]), 0.0)
    for step, holds, lost in ((2.9, 2.9, 0.0), (5.0, 3.0, 4.0)):
        held, _, missing = holding(np.array([0, step, 2.0 * step]) * 1e9)
        assert (held.tolist(), missing) == (pytest.approx([holds] * 3), pytest.approx(lost))
    held, _, missing = holding(np.zeros(3))
    assert (held.tolist(), missing) == ([0.0] * 3, 0.0)


def test_stamps_that_stand_still_hide_no_load(excitations: tuple[Excitation, ...]) -> None:
    """A load above its limit is said where the stamps do not say for how long, and no other."""
    text = sentence(drive([NOTE] * 2, [0.34, 0.32], step=0.0), excitations)
    assert "in 1 of 2 readings; their stamps do not say for how long." in text
    text = sentence(drive([CLEAR] * 2, [0.32, 0.32], step=0.0), excitations)
    assert text.startswith(
        "Whether loads exceeded the limit of 0.33 of the static force is not known;"
    )


def test_sparse_readings_cannot_warn(excitations: tuple[Excitation, ...]) -> None:
    """Readings every 5 s never warn, and the sentence says why."""
    text = sentence(drive([NOTE] * 4, [2.0] * 4, step=5.0), excitations)
    assert text.startswith("Loads exceeded 0.33 of the static force in 4 of 4 readings;")
    assert "more than 3 s apart, they cannot warn." in text
    assert "No message states the load for 6.0 s, as each holds for at most 3 s." in text
    text = sentence(drive([NOTE] * 4, [2.0] * 4, step=0.2), excitations)
    assert "for 0.8 s in all, but never for 1 s, so nothing warned" in text
    assert "No message states" not in text


def test_why_no_load_is_known(excitations: tuple[Excitation, ...]) -> None:
    """The reason is a frequency beyond the table, a missing static force or a missing amplitude."""
    unknown, silent = [math.nan] * 2, excitations_from_mapping({"a": {**SHAKER, "force": [1.0]}})
    beyond = drive([CLEAR] * 2, unknown)
    assert "are beyond the frequencies of the table" in sentence(beyond, excitations)
    moving = drive([CLEAR] * 2, unknown, total_velocity=np.ones(2))
    assert "no static force is known to compare with" in sentence(moving, excitations)
    bare = excitations_from_mapping({"shaker": {"speed": "pto", "orders": [1]}})
    at = drive([CLEAR] * 2, unknown).resonances.message(0)
    assert (
        no_load_words(at, (*bare, excitations[1])) == ", as no excitation at work has an amplitude"
    )
    assert "beyond" in no_load_words(at, silent)
    far = drive([CLEAR] * 2, unknown, relative_margin=np.full(2, 1e300))
    assert sentence(far, excitations).endswith("within 100 % of a natural frequency.")


@pytest.mark.parametrize(
    ("ratio", "text"), [(0.334, "0.33"), (9.94, "9.9"), (207.04, "207"), (1e12, "1e+12")]
)
def test_load_ratios_are_short(ratio: float, text: str) -> None:
    """Large ones have no exponent below a million."""
    assert load_words(ratio, math.nan, "pin").startswith(f"{text} of the static force in pin ")


def test_a_stale_message_says_what_is_missing(excitations: tuple[Excitation, ...]) -> None:
    """It is the speeds if all are missing, and otherwise the prediction."""
    none = drive([UNKNOWN], [math.nan], unknown_sources=np.array([1 | ENGINE_SPEED]))
    first = none.resonances.message(0)
    assert "angle is invalid, outside of the table or doubted" in present_sentence(
        first, excitations
    )
    speeds = np.array([ENGINE_SPEED | PTO_SPEED])
    both = drive([UNKNOWN], [math.nan], unknown_sources=speeds)
    text = "the engine and PTO speeds are not known or not fresh"
    assert text in present_sentence(both.resonances.message(0), excitations)
    assert "the engine and PTO speeds were never known" in sentence(both, excitations)
    lost = drive([UNKNOWN], [math.nan], unknown_sources=np.array([1]))
    assert "as each crank angle was invalid, outside" in sentence(lost, excitations)
    beyond = drive([UNKNOWN], [math.nan], unknown_sources=np.array([32]))
    assert "all orders were beyond the frequencies of the table" in sentence(beyond, excitations)
    live = present_sentence(beyond.resonances.message(0), excitations)
    assert live == "No load is known, as all orders are beyond the frequencies of the table."


@pytest.mark.parametrize("value", [1e6, 1e300])
def test_numbers_are_short(value: float) -> None:
    """No speed has more than seven digits."""
    assert len(speed_words(Source.ENGINE, value * PER_RPM)) < 14
    assert speed_words(Source.PTO, 540.2 * PER_RPM) == "540 rpm"
    assert speed_words(Source.GROUND, 12.34) == "44.4 km/h"


@pytest.mark.parametrize("value", ["a PTO speed of 500 rpm", ""])
def test_the_worst_warning_says_what_would_have_ended_it(
    excitations: tuple[Excitation, ...], value: str
) -> None:
    """It is sought for the worst message that warned, not for the largest load, if it is sure."""
    asked: list[int] = []
    states, totals = [NOTE, WARNING, WARNING, CLEAR], [7.0, 0.4, 0.5, 0.0]

    def ending(row: int) -> str:
        asked.append(row)
        return value

    text = drive_sentence(drive(states, totals), LIMITS, str, excitations, ending)
    head, _, tail = text.partition(" The worst warning would have ended at")
    assert "for 3.0 s of the 3.0 s that are known, with one warning of 2.0 s" in head
    assert tail.startswith(f" {value}.") == bool(value) == bool(tail)
    never = drive_sentence(drive([NOTE], [7.0]), LIMITS, str, excitations, ending)
    assert "ended" not in never
    assert asked == [2]


def test_each_message_has_its_own_limit(excitations: tuple[Excitation, ...]) -> None:
    """A limit that is changed while a drive is recorded counts from then on, and is named."""
    known = {"unknown_sources": np.zeros(4, int), "states": np.full((4, 2), CLEAR)}
    limits = np.array([0.2, 0.2, 0.33, 0.33], np.float32)
    actual = drive([NOTE] * 4, [0.25, 0.1, 0.25, 0.34], **known, load_ratio_limit=limits)
    spent = durations(actual)
    assert (spent.above, spent.below, spent.unknown) == (2.0, 2.0, 0.0)
    assert durations(actual, 0.3).above == 1.0
    assert sentence(actual, excitations).startswith(
        "Loads exceeded 0.2 to 0.33 of the static force (the limit was changed) for 2.0 s in all"
    )


def test_an_unknown_load_is_not_quiet() -> None:
    """Beyond the band of the table the load is not known, which does not end a warning.

    The engine's order is at 199 Hz. From 2000 rpm on, it is above the band of 200 Hz, and the total
    of what is known there is small.
    """
    weak, strong = SHAKER | {"force": [10.0]}, ENGINE | {"force": [1e6]}
    excitations = excitations_from_mapping({"shaker": weak, "high": strong})
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE), mechanism))
    levels = LevelTable(predictor, mechanism, excitations)
    monitor = ResonanceMonitor(excitations, WarningLimits(dwell=0.0), levels=levels)
    monitor.set_fixed(Source.PTO, 540.0)
    for speed, state, known in ((2010.0, UNKNOWN, False), (1990.0, WARNING, True)):
        monitor.set_fixed(Source.ENGINE, speed)
        resonance = monitor.assess(predictor.predict(math.radians(120.0)), 0.0, 0)
        assert (resonance.state, np.isfinite(resonance.load_ratios[1])) == (state, known)
        assert resonance.load_ratios[0] < LIMITS.note
    assert resonance.excitation == "high 6"
    assert not resonance.quiet_speed > 1990.0 * PER_RPM
