# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded drive is judged by the rules of the running node."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.judge import InputJudge

START = 1_767_225_600 * 10**9  # ns
STEP = 20_000_000  # ns, of readings at 50 Hz
RANGE = (1.6, 3.1)  # rad
Angle = Callable[[int], float]


def judged(
    angle: Angle = lambda k: 2.0,
    stamp: Callable[[int], int] = lambda k: START + k * STEP,
    velocity: float = math.nan,
    count: int = 500,
    **options: float,
) -> list[str]:
    """Return what is said of readings for 10 s."""
    judge = InputJudge("the crank angle", RANGE, **options)
    for k in range(count):
        known = RANGE[0] <= angle(k) <= RANGE[1]
        arrived = START + k * STEP
        judge.readings([arrived], [stamp(k)], [angle(k)], [velocity], [known])
    return [fault.sentence for fault in judge.faults()]


def test_sound_readings() -> None:
    """A hitch that swings by 0.3 rad at 0.2 Hz has no fault; nor has a drive without readings."""
    assert judged(lambda k: 2.3 + 0.3 * math.sin(0.4 * math.pi * 0.02 * k)) == []
    assert judged(count=0) == []


@pytest.mark.parametrize(
    ("angle", "stamp", "words"),
    [
        (lambda k: 2.0 * (k % 2), None, "The values of the crank angle go to and fro, as those of"),
        (lambda k: 115.0, None, "are in degrees (115), but radians are expected"),
        (lambda k: -2.0, None, "but they are inside with the other sign"),
        (lambda k: 2.0 + 0.5 * (k == 250), None, "readings of the crank angle jump by up to 0.5"),
        (lambda k: math.nan, None, "No reading of the crank angle is a number"),
        (None, lambda k: 0, "The stamps of 50 of 50 readings are zero"),
        (None, lambda k: START + k // 8 * 8 * STEP, "stamps of readings are those of the reading"),
        (None, lambda k: START + k * STEP + 3600 * 10**9, "are 3600.0 s in the future"),
        (None, lambda k: 10**12 + k * STEP, "The stamps of the readings are 1767224600.0 s old"),
        (None, lambda k: START + k * STEP - 1_100_000_000, "The stamps of the readings are 1.1 s"),
    ],
)
def test_faults_of_readings(
    angle: Angle | None, stamp: Callable[[int], int] | None, words: str
) -> None:
    """Each has one sentence, with when it was first so and for how long."""
    [sentence] = judged(angle or (lambda k: 2.0), stamp or (lambda k: START + k * STEP), offset=0.0)
    assert words in sentence
    assert sentence.endswith(" of 10 seconds).")


def test_a_few_stamps_that_repeat() -> None:
    """One in ten stamps may be that of the reading before, and not more."""
    assert judged(stamp=lambda k: START + (k - (k % 10 == 0)) * STEP) == []
    assert judged(stamp=lambda k: START + (k - (k % 8 == 0)) * STEP)


def test_a_clock_that_jumps_back_is_no_jump_of_the_crank() -> None:
    """After a step back of 5 s at the same angle, no jump is named; one of 0.5 rad later is."""
    for jump, expected in ((0.0, 0), (0.5, 1)):
        judge = InputJudge("the crank angle", RANGE)
        for k in range(500):
            time = START + k * STEP - 5 * 10**9 * (k >= 250)
            judge.readings([time], [time], [2.0 + jump * (k >= 300)], [math.nan], [True])
        assert sum("jump by up to" in fault.sentence for fault in judge.faults()) == expected


@pytest.mark.parametrize(("stands", "expected"), [(51, 0), (52, 1)])
def test_a_time_of_receipt_that_stands_still(stands: int, expected: int) -> None:
    """It is named after more than 1 s of stamps: the 51 readings before are 0 to 1 s apart."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(200):
        arrived = START + max(k - stands + 1, 0) * STEP
        judge.readings([arrived], [START + k * STEP], [2.0], [0.0], [True])
    found = [f for f in judge.faults() if f.sentence.startswith("The time of receipt stood still")]
    assert len(found) == expected


def test_stamps_that_are_nearly_old() -> None:
    """The age of a stamp counts from the limit on."""
    assert judged(stamp=lambda k: START + k * STEP - 900_000_000) == []
    assert judged(stamp=lambda k: START + k * STEP - 900_000_000, stale_after=0.8)


Speeds = Callable[[int], float]


@pytest.mark.parametrize(
    ("speed", "times"),
    [
        (lambda k: 157.0 if 50 <= k < 100 else 1500.0, [[4.9, 10.0]]),  # since the last sound one
        (lambda k: 6000.0 if 50 <= k < 100 else 1500.0, [[-4e9, 4e9]]),  # in another unit
        (lambda k: 157.0 if 50 <= k < 75 else 1500.0, None),  # a starter
        (lambda k: math.nan, []),  # nothing is known, and so nothing doubted
    ],
)
def test_when_speeds_are_doubted(speed: Speeds, times: list[list[float]] | None) -> None:
    """An engine at 157 rpm for 3 s or more is doubted since then, one at 6000 rpm always."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(150):
        judge.speed(Source.ENGINE, START + k * 100_000_000, speed(k), "/engine_speed")
    found = judge.faults()
    assert len(found) == (times is not None)
    doubted = [each for fault in found if fault.doubts for each in fault.times]
    assert doubted == [[START + round(1e9 * t) for t in each] for each in times or []]


@pytest.mark.parametrize("end", [700, 720])
def test_when_a_frozen_angle_is_doubted(end: int) -> None:
    """Noise that ends at 8 s is doubted from then to the end of the second in which it is back."""
    noise = 2.0 + 1e-3 * np.random.default_rng(1).standard_normal(1000)
    noise[401:end] = noise[400]
    judge = InputJudge("the crank angle", RANGE)
    for k, angle in enumerate(noise.tolist()):
        judge.readings([START + k * STEP], [START + k * STEP], [angle], [math.nan], [True])
    [fault] = judge.faults()
    [[first, last]] = fault.times
    assert fault.doubts
    assert first == START + 400 * STEP
    assert last == START + (math.ceil(end / 50) * 50 - 1) * STEP


@pytest.mark.parametrize(("angle", "doubts"), [(1.6 + 57.0, True), (1.6 + 1.6, False)])
def test_degrees_are_doubted_always(angle: float, doubts: bool) -> None:
    """The joint at 57 deg is within the range, at 1.6 rad above it; the other readings are sound.

    No hitch turns by more than pi from the zero of its joint, so 1.6 is not taken for degrees.
    """
    judge = InputJudge("the crank angle", RANGE, offset=1.6)
    for k in range(500):
        now = angle if k < 100 else 2.0
        judge.readings([START + k * STEP], [START + k * STEP], [now], [math.nan], [now < 3.1])
    faults = judge.faults()
    assert any("are in degrees" in fault.sentence for fault in faults) == doubts
    assert [fault.times for fault in faults if "in degrees" in fault.sentence] == [
        [[START - 4 * 10**18, START + 4 * 10**18]]
    ] * doubts


def test_when_and_how_long() -> None:
    """A fault of the seconds from 4 to 6 is said to be of two seconds, first after 4 s."""
    [sentence] = judged(lambda k: 2.0 + 0.5 * (k % 2) * (200 <= k < 299))
    assert sentence.startswith("The values of the crank angle go to and fro")
    assert sentence.endswith("(first after 4 s, in 2 of 10 seconds).")
    [sentence] = judged(lambda k: math.nan, count=10)
    assert sentence.endswith("(first after 0 s, in 1 of 1 seconds).")


def test_a_fault_that_comes_back() -> None:
    """Angles are no numbers at 2 to 4 and 5 to 6 s: the last such readings are 1.02 s apart."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(400):
        angle = math.nan if k // 50 in (2, 3, 5) else 2.0
        judge.readings([START + k * STEP], [START + k * STEP], [angle], [math.nan], [True])
    [fault] = judge.faults()
    times = [[2.0, 3.98], [5.0, 5.98]]
    assert fault.times == [[START + round(1e9 * t) for t in each] for each in times]


def speeds(source: Source, value: Callable[[int], float], step: int = 100_000_000) -> list[str]:
    """Return what is said of 100 speeds."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(100):
        judge.speed(source, START + k * step, value(k), f"/{source.value}_speed")
    return [fault.sentence for fault in judge.faults()]


@pytest.mark.parametrize(
    ("source", "value", "words"),
    [
        (Source.ENGINE, lambda k: 2000.0 if k % 2 else 800.0, "go to and fro, as those of publish"),
        (Source.ENGINE, lambda k: 200.0, "which is not plausible, for"),
        (Source.GROUND, lambda k: 36.0, "is it in km/h?"),
        (Source.PTO, lambda k: -540.0, "is negative"),
        (Source.PTO, lambda k: math.nan, "is nan"),
    ],
)
def test_faults_of_speeds(source: Source, value: Callable[[int], float], words: str) -> None:
    """A speed is judged as the node judges it; 25 m/s is the highest of a tractor."""
    assert any(words in sentence for sentence in speeds(source, value))


@pytest.mark.parametrize(("age", "words"), [(1.0, ""), (1.1, "1.1 s old"), (-1.1, "1.1 s ahead")])
def test_stamps_of_speeds(age: float, words: str) -> None:
    """A speed whose stamps are off by more than `stale_after` is named with what helps."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(100):
        judge.speed(Source.GROUND, START + k * 100_000_000, 5.0, "/speed", age=age)
    found = [fault.sentence for fault in judge.faults()]
    assert [f"on /speed are {words}, so that it is not" in text for text in found] == [True] * bool(
        words
    )


def test_readings_have_seconds_of_their_own() -> None:
    """A second of readings begins with the first, also half a second after the first speed."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(150):
        if not k % 5:
            judge.speed(Source.ENGINE, START + k * STEP, 1800.0, "/engine_speed")
        if k >= 25:
            angle = math.nan if k < 75 else 2.0
            judge.readings([START + k * STEP], [START + k * STEP], [angle], [math.nan], [True])
    [fault] = judge.faults()
    assert fault.sentence == (
        "No reading of the crank angle is a number; check the sensor (first after 0 s, in 1 of 3 "
        "seconds)."
    )


def test_sound_speeds() -> None:
    """Speeds that are possible have no fault."""
    assert speeds(Source.ENGINE, lambda k: 800.0 + 10.0 * k) == []
    assert speeds(Source.GROUND, lambda k: 24.0) == []
    assert speeds(Source.PTO, lambda k: 0.0) == []


def test_a_speed_that_stopped() -> None:
    """One that comes each 0.9 s is fresh; after 1.1 s, the one before is too old."""
    assert speeds(Source.PTO, lambda k: 540.0, 900_000_000) == []
    [sentence] = speeds(Source.PTO, lambda k: 540.0, 1_100_000_000)
    assert "The PTO speed on /pto_speed stopped 1.1 s ago" in sentence


def test_a_speed_that_never_comes_back() -> None:
    """One that ends at 5 s is too old after 6 s: at 7 to 14 s, and at the end."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(741):
        time = START + k * STEP
        judge.readings([time], [time], [2.0], [math.nan], [True])
        if k <= 250:
            judge.speed(Source.GROUND, time, 3.0, "/speed")
    [fault] = judge.faults()
    assert fault.sentence.endswith("(first after 6 s, in 9 of 15 seconds).")


def test_a_speed_that_arrives_after_the_clock_went_back() -> None:
    """It has not stopped: a simulation of 10 s begins again 1000 s earlier, and ends after 3 s."""
    judge = InputJudge("the crank angle", RANGE)
    for k in range(650):
        time = START + k % 500 * STEP - 1000 * 10**9 * (k >= 500)
        judge.readings([time], [time], [2.0], [math.nan], [True])
        judge.speed(Source.GROUND, time, 3.0, "/speed")
    assert judge.faults() == []


def test_a_pto_without_an_engine() -> None:
    """A PTO that turns for more than 10 s beside an engine at rest is named."""
    for seconds, expected in ((9, 0), (13, 1)):
        judge = InputJudge("the crank angle", RANGE)
        for k in range(10 * seconds):
            judge.speed(Source.ENGINE, START + k * 100_000_000, 0.0, "/engine_speed")
            judge.speed(Source.PTO, START + k * 100_000_000, 540.0, "/pto_speed")
        found = [f for f in judge.faults() if "so one of both is wrong" in f.sentence]
        assert len(found) == expected
