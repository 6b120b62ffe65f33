# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Faults that are found in numbers, and healthy drives in which none is found."""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.messages.definitions import message_text
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.health import (
    Fault,
    Level,
    ReadingExpectation,
    ReadingWatch,
    SpeedWatch,
    missing_speeds,
    overall,
    turns_without_engine,
)
from test.support.drive import engine_and_pto_speed, hitch_duty_cycle
from test.support.motions import STROKE

SECOND = 10**9  # ns
START = 1_700_000_000 * SECOND
EXPECTED = ReadingExpectation(
    name="joint hitch on /joint_states",
    remedy="Its topic has no publisher.",
    others=False,
    first=math.pi / 2.0,
    last=math.pi,
    offset=0.0,
    stale_after=1.0,
    since=0.0,
    publishers=lambda: ["a", "b"],
)
ALONE = replace(EXPECTED, publishers=lambda: ["a"])


def judged(
    times: Iterable[float],
    angles: Iterable[float],
    expected: ReadingExpectation = EXPECTED,
    *,
    velocity: float | Sequence[float] = math.nan,
    age: float = 0.0,
    watch: ReadingWatch | None = None,
) -> list[list[Fault]]:
    """Return the faults of each second of readings, whose stamps have an age (s)."""
    watch = watch or ReadingWatch()
    actual, due = [], 1.0
    rates = iter(velocity) if isinstance(velocity, Sequence) else itertools.repeat(velocity)
    for now, angle in zip(times, angles, strict=True):
        while now >= due:
            actual.append(watch.judge(due, 1.0, expected))
            due += 1.0
        received = START + round(1e9 * now)
        stamp = received - round(1e9 * age) if age < math.inf else 0
        known = not math.isfinite(angle) or expected.contains(angle)
        watch.take(now, stamp, received, angle, next(rates), known=known)
    return [*actual, watch.judge(due, 1.0, expected)]


def seconds(rate: float, duration: float) -> "list[float]":
    """Return times at a rate, Hz, for a duration, s."""
    return (np.arange(round(rate * duration)) / rate).tolist()


def percent(angles: np.ndarray) -> list[float]:
    """Return angles in steps of 0.4 % of the stroke."""
    return (0.004 * STROKE * np.rint(angles / (0.004 * STROKE))).tolist()


def still(resolution: float, noise: float, count: int) -> list[float]:
    """Return readings of a hitch that stands still."""
    angles = 2.2 + noise * np.random.default_rng(1).normal(size=count)
    return (resolution * np.rint(angles / resolution)).tolist()


HEALTHY: dict[str, Callable[[], tuple[Sequence[float], Sequence[float]]]] = {
    "the shipped drive": lambda: tuple(c.tolist() for c in hitch_duty_cycle()),  # type: ignore[return-value]
    "the shipped drive in percent at 10 Hz": lambda: (
        hitch_duty_cycle()[0][::10].tolist(),
        percent(hitch_duty_cycle()[1][::10]),
    ),
    "ten minutes at rest in percent": lambda: (seconds(10, 600), still(0.0063, 0.0, 6000)),
    "at rest between two steps": lambda: (seconds(10, 300), still(0.0063, 0.001, 3000)),
    "rest after a noisy drive in percent": lambda: (
        seconds(10, 400),
        [*still(0.0063, 0.01, 1000), *[2.2] * 3000],
    ),
    "rest of an encoder after vibration": lambda: (
        seconds(100, 70),
        [*still(3.8e-4, 4e-4, 2000), *[2.2] * 5000],
    ),
    "noise of 0.5 deg at 1 kHz": lambda: (seconds(1000, 5), still(1e-9, 8.7e-3, 5000)),
}


@pytest.mark.parametrize("name", HEALTHY)
def test_healthy_readings_have_no_fault(name: str) -> None:
    """A sensor with steps, with noise or at rest is not at fault."""
    times, angles = HEALTHY[name]()
    assert not any(judged(times, angles))


def test_velocities_of_a_healthy_drive() -> None:
    """The velocities of the shipped drive agree with its positions."""
    times, angles = hitch_duty_cycle()
    velocities = np.gradient(angles, times).tolist()
    assert not any(judged(times.tolist(), angles.tolist(), velocity=velocities))


def test_stamps() -> None:
    """A stamp earlier than the one before is counted; the age is that of the last stamp."""
    watch = ReadingWatch(stamps_back=3)
    for i, stamp in enumerate((-5.0, 5.0, 5.1, 5.1, 4.9, 6.5)):
        watch.take(0.1 * i, round(1e9 * stamp), 6 * SECOND, 2.0, math.nan, known=True)
    assert math.isnan(watch.last)
    watch.judge(1.0, 1.0, EXPECTED)
    assert (watch.last, watch.stamps_back) == (0.5, 4)
    assert watch.stamp_age == pytest.approx(-0.5)


@pytest.mark.parametrize(("repeats", "faulty"), [(1, False), (2, True)])
def test_stamps_that_are_repeated(repeats: int, faulty: bool) -> None:
    """One of ten readings may have the stamp of the one before."""
    watch = ReadingWatch()
    for i in range(10):
        stamp = START + max(i - repeats, 0) * SECOND // 10
        watch.take(0.1 * i, stamp, START + i * SECOND // 10, 2.0, math.nan, known=True)
    sentences = [fault.sentence for fault in watch.judge(1.0, 1.0, EXPECTED)]
    assert any("are those of the reading before" in each for each in sentences) == faulty


def test_healthy_speeds_have_no_fault() -> None:
    """The speeds of the shipped drive, a start of the engine, and reverse are no faults."""
    times, engine, pto = engine_and_pto_speed()
    for source, values in ((Source.ENGINE, engine), (Source.PTO, pto)):
        watch = SpeedWatch(source, "/speed")
        for now, value in zip(times.tolist(), values.tolist(), strict=True):
            watch.take(now, value)
            assert watch.judge(now, 1.0, list) == []
    starting, reverse = SpeedWatch(Source.ENGINE, "/speed"), SpeedWatch(Source.GROUND, "/speed")
    for i in range(100):
        starting.take(0.1 * i, 0.0 if i < 20 else 200.0 if i < 40 else 850.0)
        reverse.take(0.1 * i, -2.0)
        assert starting.judge(0.1 * i, 1.0, list) == []
        assert reverse.judge(0.1 * i, 1.0, list) == []
    assert SpeedWatch(Source.PTO, "/speed").judge(100.0, 1.0, list) == []  # there is none
    stamped = SpeedWatch(Source.ENGINE, "/speed")
    for age, words in ((0.9, ""), (-0.9, ""), (1.1, "are 1.1 s old"), (-3600.0, "3.6e+03 s ahead")):
        stamped.take(1.0, 1500.0, age=age)
        sentences = [fault.sentence for fault in stamped.judge(1.1, 1.0, list)]
        assert [words in sentence for sentence in sentences] == [True] * bool(words)
        assert all("set engine_time to receipt" in sentence for sentence in sentences)


LIFT = (1.6 + 0.3 / 50.0 * np.arange(200)).tolist()
FAULTS = [
    ("degrees", [130.0], {}, EXPECTED, Level.ERROR, "are in degrees (130)"),
    ("degrees with an offset", [30.0], {}, replace(EXPECTED, offset=1.5), Level.ERROR, "degrees"),
    ("sign", [-2.0], {}, EXPECTED, Level.ERROR, "inside with the other sign"),
    ("one side", [0.38, 0.4], {}, ALONE, Level.ERROR, "are below the table's 90 to 180 deg"),
    ("other side", [4.0, 4.02], {}, ALONE, Level.ERROR, "are above"),
    ("no number", [math.nan], {}, EXPECTED, Level.ERROR, "is a number"),
    ("zero stamps", [2.0], {"age": math.inf}, EXPECTED, Level.WARN, "are zero"),
    ("old", [2.0], {"age": 3.0}, EXPECTED, Level.WARN, "3.0 s old"),
    ("future", [2.0], {"age": -0.5}, EXPECTED, Level.WARN, "0.5 s in the future"),
    ("spike", [2.0] * 9 + [2.5], {}, ALONE, Level.WARN, "jump by up to 0.5 rad"),
    ("velocity", [2.0], {"velocity": 0.2}, EXPECTED, Level.WARN, "the sensor is frozen"),
    ("velocity of zero", LIFT, {"velocity": 0.0}, EXPECTED, Level.WARN, "its velocity is wrong"),
]


@pytest.mark.parametrize(
    ("angles", "how", "expected", "level", "words"),
    [case[1:] for case in FAULTS],
    ids=[case[0] for case in FAULTS],
)
def test_fault(
    angles: list[float],
    how: dict[str, float],
    expected: ReadingExpectation,
    level: Level,
    words: str,
) -> None:
    """Each fault has a level and a sentence, in the last second of some seconds."""
    times = seconds(50, 4)
    faults = judged(times, (angles * 200)[: len(times)], expected, **how)[-1]  # type: ignore[arg-type]
    assert [fault.level for fault in faults] == [level]
    assert words in faults[0].sentence


def test_frozen_noise() -> None:
    """A value that stays the same is a fault after noise that never repeated a value."""
    noisy = still(1e-12, 1e-3, 300)
    frozen = judged(seconds(100, 8), noisy + noisy[-1:] * 500)
    assert not any(frozen[:4])
    assert "never free of noise before" in frozen[-1][0].sentence
    # Noise that repeats values may be vibration, which ends with the engine.
    coarse = still(3.8e-4, 3.6e-4, 2000)
    assert not any(judged(seconds(100, 60), coarse + coarse[-1:] * 4000))


def test_publishers_that_disagree() -> None:
    """Angles that go to and fro are those of two publishers; two that move fast agree."""
    times, n = seconds(100, 3), 300
    angles = [2.0 + 0.05 * (i % 2) for i in range(n)]
    faults = judged(times, angles)[-1]
    assert [fault.level for fault in faults] == [Level.ERROR]
    assert "disagree (a, b)" in faults[0].sentence
    same = [2.0 + 0.005 * (i // 2) for i in range(n)]  # 0.5 rad/s, from both
    assert not any(judged(times, [min(angle, 3.1) for angle in same]))
    assert not any(judged(times, [2.0] * n))
    slower = [2.0 + 0.05 * (i % 10 == 0) for i in range(n)]  # one of them at a tenth of the rate
    assert "disagree" in judged(times, slower)[-1][0].sentence
    # No load is known at angles of a sensor that is as noisy as that.
    assert "go to and fro" in judged(times, angles, ALONE)[-1][0].sentence
    assert not any(judged(times, [2.0 + 0.02 * (i % 2) for i in range(n)], ALONE))


def test_missing_readings() -> None:
    """What arrives instead of the joint, and what cannot be read, is an error; silence is stale."""
    watch = ReadingWatch()
    assert [fault.level for fault in watch.judge(0.1, 0.1, EXPECTED)] == [Level.STALE]
    [nothing] = watch.judge(1.1, 0.1, EXPECTED)
    words = f"The node has not received {EXPECTED.name} for 1.1 s. Its topic has no publisher."
    assert nothing == Fault(Level.STALE, words)
    [others] = watch.judge(2.0, 1.0, replace(EXPECTED, remedy="It has boom.", others=True))
    assert (others.level, others.sentence.endswith("It has boom.")) == (Level.ERROR, True)
    watch.refuse("A joint state has 1 names but 0 positions.")
    assert watch.judge(3.0, 1.0, EXPECTED)[0].level is Level.ERROR
    for now in (12.5, 13.5):
        stamp = START + round(now * SECOND)
        watch.take(now, stamp, stamp, 2.0, 0.0, known=True)
    assert "This was 10 s ago" in watch.judge(12.9, 1.0, EXPECTED)[0].sentence
    assert watch.judge(14.0, 1.0, EXPECTED) == []
    assert watch.judge(14.4, 1.0, EXPECTED) == []
    assert "for 2.5 s" in watch.judge(16.0, 1.0, EXPECTED)[0].sentence


def rate_alarms(*parts: tuple[float, float]) -> list[bool]:
    """Return in which seconds readings at rates (Hz) for durations (s) have a fault of the rate."""
    times, begin = [], 0.0
    for rate, duration in parts:
        times += [begin + time + 1e-6 for time in seconds(rate, duration)] if rate else []
        begin += duration
    actual = judged(times, [2.0] * len(times))
    return [any("instead of" in fault.sentence for fault in faults) for faults in actual]


def test_falling_rate() -> None:
    """A rate below half of the usual one is a fault until it has recovered."""
    times = [
        *seconds(100, 5),
        *(5.0 + t for t in seconds(20, 4)),
        *(9.0 + t for t in seconds(90, 3)),
    ]
    actual = judged(times, [2.0] * len(times))
    assert [bool(faults) for faults in actual] == [False] * 6 + [True] * 3 + [False] * 3
    assert "20.0 Hz instead of 100.0 Hz" in actual[7][0].sentence


@pytest.mark.parametrize(
    ("source", "values", "words"),
    [
        (Source.ENGINE, [200.0] * 50, "200 rpm, which is not plausible, for 5 s; is it in rad/s"),
        (Source.ENGINE, [7000.0] * 50, "not plausible"),
        (Source.GROUND, [36.0] * 50, "is it in km/h"),
        (Source.PTO, [56.5] * 50, "56.5 rpm, which is not plausible, for 5 s; is it in rad/s or"),
        (Source.PTO, [540.0, math.nan], "PTO speed on /speed is nan"),
        (Source.ENGINE, [-100.0], "is negative"),
        (Source.ENGINE, [1500.0], "stopped"),
    ],
)
def test_fault_of_a_speed(source: Source, values: list[float], words: str) -> None:
    """A speed in another unit, without a value or without an end is a fault."""
    watch = SpeedWatch(source, "/speed")
    for i, value in enumerate(values):
        watch.take(0.1 * i, value)
    now = 0.1 * len(values) + 2.0 * (words == "stopped")
    [fault] = watch.judge(now, 1.0, list)
    assert fault.level is Level.WARN
    assert words in fault.sentence


def test_speeds_of_two_publishers() -> None:
    """Two engines on one topic disagree."""
    watch = SpeedWatch(Source.ENGINE, "/speed")
    for i in range(10):
        watch.take(0.1 * i, 1500.0)
        watch.take(0.1 * i, 1900.0)
    [fault] = watch.judge(1.0, 1.0, lambda: ["one", "two"])
    assert "engine speed on /speed disagree (one, two)" in fault.sentence


def test_a_value_between_the_clock_and_the_judgement() -> None:
    """A ground speed that is not a number is said to be unknown, not to be in km/h."""
    watch = SpeedWatch(Source.GROUND, "/speed")
    for now in (0.0, 2.0, 4.0, 6.0):
        watch.take(now, math.nan)
    [fault] = watch.judge(5.9, 1.0, list)
    assert "ground speed on /speed is nan, so that it is not known" in fault.sentence


@pytest.mark.parametrize("n_senders", [1, 2])
def test_senders_on_a_bus(n_senders: int) -> None:
    """Two senders of one node that disagree are named with the field that chooses each."""
    speeds, readings = SpeedWatch(Source.ENGINE, "/can"), ReadingWatch()
    for i in range(20):
        speeds.take(0.05 * i, 1500.0 * (i % 2), f"engine_speed@0x{i % n_senders:02X}")
        sender, stamp = f"hitch@0x{0x26 + i % n_senders:02X}", START + round(5e7 * i)
        angle = 2.0 + 0.377 * (i % 2)
        readings.take(0.05 * i, stamp, stamp, angle, math.nan, known=True, sender=sender)
    faults = speeds.judge(1.0, 1.0, lambda: ["can"])
    assert [fault.level for fault in faults] == [Level.WARN if n_senders == 1 else Level.ERROR]
    [angles] = readings.judge(1.0, 1.0, ALONE)
    if n_senders == 1:
        assert "jump by up to 0.377 rad" in angles.sentence
        return
    assert faults[0].sentence == (
        "The senders of the engine speed on /can disagree (engine_speed@0x00: 0 rpm, "
        "engine_speed@0x01: 1500 rpm); set engine_field to one of them."
    )
    assert "disagree (hitch@0x26: 2 rad, hitch@0x27: 2.377 rad); set hitch_f" in angles.sentence


@pytest.mark.parametrize("n_senders", [1, 2])
def test_sender_that_is_not_available(n_senders: int) -> None:
    """One that sends no values beside another one is named; alone, its values are not available."""
    speeds, readings = SpeedWatch(Source.PTO, "/can"), ReadingWatch()
    for i in range(20):
        which = i % n_senders
        speeds.take(0.05 * i, (540.0, math.nan)[1 - which], f"pto@0x0{which}")
        angle, stamp = (2.0, math.nan)[1 - which], START + round(5e7 * i)
        values = angle, math.nan
        readings.take(0.05 * i, stamp, stamp, *values, known=True, sender=f"hitch@0x0{which}")
    sentences = [f.sentence for f in speeds.judge(1.0, 1.0, list)]
    sentences += [f.sentence for f in readings.judge(1.0, 1.0, ALONE)]
    named = ("(pto@0x00: not available, pto@0x01: 540 rpm)", "(hitch@0x00: not available, ")
    assert [any(name in s for s in sentences) for name in named] == [n_senders == 2] * 2


def test_speeds_that_never_arrived() -> None:
    """One sentence names the speeds that did not arrive; without any, there is none."""
    [fault] = missing_speeds(
        ["engine speed on /enigne_speed", "PTO speed on /pto"], 12.0, Level.WARN
    )
    assert fault.level is Level.WARN
    words = "The engine speed on /enigne_speed, PTO speed on /pto did not arrive in the 12 s since"
    assert fault.sentence.startswith(words)
    assert missing_speeds([], 12.0, Level.STALE) == []


def to_and_fro(source: Source, low: float, high: float, period: float, rate: float) -> list[Fault]:
    """Return the faults of the third second of a speed that changes once in each period (s)."""
    watch = SpeedWatch(source, "/speed")
    for i in range(round(3.0 * rate)):
        now = i / rate
        watch.take(now, high if int(now / period + 1e-9) % 2 else low)
        if now == 2.0:
            watch.judge(now, 1.0, lambda: ["one"])
    return watch.judge(3.0, 1.0, lambda: ["one"])


@pytest.mark.parametrize(
    ("source", "low", "high", "period", "rate", "faulty"),
    [
        (Source.PTO, 0.0, 540.0, 0.1, 10.0, True),
        (Source.PTO, 0.0, 540.0, 0.1, 100.0, True),
        (Source.PTO, 0.0, 540.0, 0.3, 10.0, True),
        (Source.PTO, 0.0, 540.0, 0.5, 10.0, False),  # slow enough for a clutch
        (Source.PTO, 540.0, 661.0, 0.1, 10.0, True),
        (Source.PTO, 540.0, 659.0, 0.1, 10.0, False),  # noise
        (Source.ENGINE, 1000.0, 1401.0, 0.1, 10.0, True),
        (Source.ENGINE, 1000.0, 1399.0, 0.1, 10.0, False),
        (Source.GROUND, 2.0, 4.1, 0.1, 10.0, True),
        (Source.GROUND, 2.0, 3.9, 0.1, 10.0, False),
    ],
)
def test_limits_of_a_speed_that_goes_to_and_fro(
    source: Source, low: float, high: float, period: float, rate: float, faulty: bool
) -> None:
    """Nothing changes by 120 rpm of a PTO, 400 rpm of an engine or 2 m/s and back in 0.8 s.

    Smaller changes look like those of publishers that disagree, unless they are slow.
    """
    faults = to_and_fro(source, low, high, period, rate)
    by = f"changed to and fro by {high - low:.4g} {source.unit}"
    assert [by in fault.sentence for fault in faults if fault.level is Level.WARN] == [
        True
    ] * faulty
    other = [fault for fault in faults if fault.level is Level.ERROR]
    assert [f"{source.label} speed on /speed go to and fro" in f.sentence for f in other] == (
        [True] * (not faulty and period < 0.5)
    )


def test_two_changes_are_not_to_and_fro() -> None:
    """A PTO that is switched on and off and on at once has three; what waited has none."""
    for changes, delay, faulty in ((3, "", False), (4, "", True), (4, "messages wait", False)):
        watch = SpeedWatch(Source.PTO, "/speed")
        for i in range(10):
            watch.take(0.1 * i, 540.0 * (min(i, changes) % 2))
        faults = watch.judge(1.0, 1.0, lambda: ["one"], delay)
        assert any("to and fro" in fault.sentence for fault in faults) == faulty


@pytest.mark.parametrize(
    ("engine", "pto", "duration", "faulty"),
    [
        (0.0, 540.0, 10.2, True),
        (0.0, 540.0, 9.8, False),  # it runs out
        (49.0, 540.0, 12.0, True),
        (51.0, 540.0, 12.0, False),
        (0.0, 21.0, 12.0, True),
        (0.0, 19.0, 12.0, False),
        (math.nan, 540.0, 12.0, False),
        (0.0, math.nan, 12.0, False),
    ],
)
def test_limits_of_a_pto_without_engine(
    engine: float, pto: float, duration: float, faulty: bool
) -> None:
    """A PTO turns for at most 10 s without the engine; an old engine speed says nothing."""
    engines, ptos = SpeedWatch(Source.ENGINE, "/engine"), SpeedWatch(Source.PTO, "/pto")
    assert turns_without_engine(ptos, engines, 0.0) == []
    for i in range(40):
        engines.take(0.1 * i, 1800.0)
        ptos.take(0.1 * i, 540.0)
    for now in (4.0 + 0.1 * i for i in range(round(10.0 * duration) + 1)):
        engines.take(now, engine)
        ptos.take(now, pto)
    faults = turns_without_engine(ptos, engines, now)
    assert bool(faults) == faulty
    if faulty:
        words = "although the engine speed on /engine has been 0 for 1"
        assert words in faults[0].sentence
    for i in range(1, 12):
        ptos.take(now + 0.1 * i, pto)
    assert bool(turns_without_engine(ptos, engines, now + 0.95)) == (faulty or duration == 9.8)
    assert turns_without_engine(ptos, engines, now + 1.05) == []


def test_most_serious_first() -> None:
    """The level is the highest, and every fault has its sentence."""
    faults = [Fault(Level.WARN, "B."), Fault(Level.ERROR, "A.")]
    assert overall(faults, "Sound.") == (Level.ERROR, "A. B.")
    assert overall([], "Sound.") == (Level.OK, "Sound.")


def noise_then_still(
    repeats: int,
    *,
    before: int = 0,
    since: int = 9,
    changes: int = 400,
    last_rate: float = 100.0,
    rising: float = 0.0,
) -> list[Fault]:
    """Return the faults of a sensor that shakes by 1 mrad and then repeats its value.

    It repeats it before `since` values follow, and did so `before` times. It changes at 100 Hz; the
    first changes, a share `rising`, do not turn back. `last_rate` is that of repeated readings, Hz.
    """
    angles = [2.0 + (1e-3 * (i % 2) if i >= rising * changes else 1e-5 * i) for i in range(changes)]
    angles = [*angles[:-since], *angles[-since - 1 : -since] * before, *angles[-since:]]
    times = (np.arange(len(angles)) / 100.0).tolist()
    times += [times[-1] + (i + 1) / last_rate for i in range(repeats)]
    watch = ReadingWatch()
    for now, angle in zip(times, angles + angles[-1:] * repeats, strict=True):
        stamp = START + round(now * SECOND)
        watch.take(now, stamp, stamp, angle, math.nan, known=True)
    return watch.judge(times[-1], times[-1], EXPECTED)


@pytest.mark.parametrize(
    ("frozen", "sound"),
    [
        # It lasts 2 s, with 20 readings.
        ({"repeats": 201}, {"repeats": 199}),
        ({"repeats": 20, "last_rate": 5.0}, {"repeats": 19, "last_rate": 5.0}),
        # Before, there were 100 changes, in which no value was repeated.
        ({"repeats": 300, "changes": 100}, {"repeats": 300, "changes": 99}),
        ({"repeats": 300, "before": 1, "since": 100}, {"repeats": 300, "before": 1, "since": 99}),
        # At least 0.3 of the changes turned back.
        ({"repeats": 300, "rising": 0.69}, {"repeats": 300, "rising": 0.71}),
    ],
)
def test_limits_of_frozen_noise(frozen: dict[str, float], sound: dict[str, float]) -> None:
    """On one side of each limit the sensor is frozen, and on the other it need not be."""
    [fault] = noise_then_still(**frozen)  # type: ignore[arg-type]
    assert "was never free of noise before; the sensor is frozen" in fault.sentence
    assert noise_then_still(**sound) == []  # type: ignore[arg-type]


def speed_faults(source: Source, value: float, seconds_of_it: float = 4.0) -> list[Fault]:
    """Return the faults of a speed that keeps a value for a time at 10 Hz."""
    watch = SpeedWatch(source, "/speed")
    times = np.arange(0.0, seconds_of_it, 0.1).tolist()
    for now in times:
        watch.take(now, value)
    return watch.judge(times[-1], 1.0, list)


@pytest.mark.parametrize(
    ("source", "plausible", "implausible"),
    [
        (Source.ENGINE, (400.0, 5000.0, 0.0), (399.5, 5000.5)),
        (Source.PTO, (0.0, 120.0, 1500.0), (119.5, 1500.5)),
        (Source.GROUND, (0.1, 25.0, -25.0), (25.1, -25.1)),
    ],
)
def test_limits_of_plausible_speeds(
    source: Source, plausible: tuple[float, ...], implausible: tuple[float, ...]
) -> None:
    """An engine has 400 to 5000 rpm, a PTO 120 to 1500 rpm, a tractor up to 25 m/s, or rests."""
    for value in plausible:
        assert speed_faults(source, value) == []
    for value in implausible:
        [fault] = speed_faults(source, value)
        assert "which is not plausible" in fault.sentence


@pytest.mark.parametrize(("before", "asked"), [(119.5, True), (120.5, False)])
def test_a_shaft_may_start_slowly(before: float, asked: bool) -> None:
    """Once a PTO has passed 120 rpm, it is in rpm, and may turn slowly for any time."""
    watch = SpeedWatch(Source.PTO, "/speed")
    for i in range(100):
        watch.take(0.1 * i, before if i < 10 else 56.5)
    assert bool(watch.judge(10.0, 1.0, list)) == asked


def test_a_starter_may_turn_an_engine_for_three_seconds() -> None:
    """A slow engine is no fault for 3 s, which begin again after a pause of more than a second."""
    assert speed_faults(Source.ENGINE, 200.0, 3.05) == []
    assert speed_faults(Source.ENGINE, 200.0, 3.25) != []
    for pause, faulty in ((0.95, True), (1.05, False)):
        watch = SpeedWatch(Source.ENGINE, "/speed")
        for now in (0.0, 0.9, 1.8, 1.8 + pause, 2.7 + pause):
            watch.take(now, 200.0)
        assert bool(watch.judge(2.7 + pause, 1.0, list)) == faulty


def test_age_of_a_speed() -> None:
    """A speed stops when it is older than the limit."""
    watch = SpeedWatch(Source.PTO, "/speed")
    watch.take(0.0, 540.0)
    assert watch.judge(1.9, 2.0, list) == []
    assert "stopped 2.1 s ago" in watch.judge(2.1, 2.0, list)[0].sentence


@pytest.mark.parametrize(
    ("source", "value", "agrees", "differs"),
    [
        (Source.ENGINE, 1500.0, 99.9, 100.1),
        (Source.PTO, 540.0, 34.9, 35.1),
        (Source.GROUND, 2.0, 0.399, 0.401),
    ],
)
def test_limits_of_speeds_that_agree(
    source: Source, value: float, agrees: float, differs: float
) -> None:
    """Publishers agree up to 50 rpm of an engine, 20 rpm of a PTO, and 0.3 m/s, and a motion.

    In the 0.1 s until the first of them sends again, these change by 50 rpm, 15 rpm and 0.1 m/s.
    """
    for apart, faulty in ((agrees, False), (differs, True)):
        watch = SpeedWatch(source, "/speed")
        for i in range(10):
            watch.take(0.1 * i, value)
            watch.take(0.1 * i, value + apart)
        assert bool(watch.judge(0.9, 1.0, lambda: ["one", "two"])) == faulty


def test_limits_of_readings_that_agree() -> None:
    """Publishers disagree if values go to and fro by more than 0.03 rad and 0.5 rad/s."""
    times = seconds(100, 1)
    for apart, faulty in ((0.034, False), (0.036, True)):
        angles = [2.0 + apart * (i % 2) for i in range(100)]
        assert bool(judged(times, angles)[-1]) == faulty
    # Both move by 0.01 rad from value to value, so that one goes back by so much less.
    for apart, faulty in ((0.044, False), (0.046, True)):
        angles = [2.0 + 0.01 * (i // 2) + apart * (i % 2) for i in range(100)]
        assert bool(judged(times, angles)[-1]) == faulty
    # The first two values tell nothing; each of the others changes sides, five times in all.
    for count, faulty in ((6, False), (7, True)):
        angles = [2.0 + 0.05 * (i % 2) for i in range(count)]
        assert bool(judged(times[:count], angles)[-1]) == faulty


@pytest.mark.parametrize(
    ("age", "words"), [(-0.09, ""), (-0.11, "in the future"), (0.99, ""), (1.01, "1.0 s old")]
)
def test_limits_of_the_age_of_stamps(age: float, words: str) -> None:
    """Stamps may be 0.1 s ahead, and as old as a reading may be."""
    faults = judged(seconds(50, 1), [2.0] * 50, age=age)[-1]
    assert [fault.level for fault in faults] == [Level.WARN] * bool(words)
    assert all(words in fault.sentence for fault in faults)


@pytest.mark.parametrize(("step", "jumps"), [(0.099, False), (0.101, True)])
def test_limit_of_jumps(step: float, jumps: bool) -> None:
    """In 10 ms a hitch moves by 0.04 rad at most, and noise adds 0.06 rad; a crank may be fast."""
    angles = [2.0] * 50 + [2.0 + step] * 50
    assert bool(judged(seconds(100, 1), angles)[-1]) == jumps
    assert judged(seconds(100, 1), angles, watch=ReadingWatch(turns=True))[-1] == []


@pytest.mark.parametrize(("top", "jumps"), [(math.pi, False), (math.pi + 0.1, True)])
def test_sensor_that_wraps(top: float, jumps: bool) -> None:
    """From plus to minus half a turn is no jump, and no publishers disagree; from more, it is."""
    angles = [(top, 0.01 - math.pi)[i % 3 == 0] for i in range(100)]
    expected = replace(EXPECTED, first=-4.0, last=4.0)
    assert bool(judged(seconds(100, 1), angles, expected)[-1]) == jumps


@pytest.mark.parametrize(
    ("moved", "velocity", "contradicts"),
    [
        (0.0, 0.09, False),
        (0.0, 0.11, True),
        (0.4, 0.21, False),
        (0.4, 0.19, True),
        (-0.4, -0.21, False),
        (-0.4, -0.19, True),
    ],
)
def test_limits_of_a_contradiction(moved: float, velocity: float, contradicts: bool) -> None:
    """Position and velocity differ by 0.1 rad in a second, or by half of the larger of both."""
    watch, angles = ReadingWatch(), [2.0 + moved * i / 100 for i in range(101)]
    faults = judged(seconds(100, 1.01), angles, velocity=velocity, watch=watch)
    assert any("turned the crank by" in f.sentence for second in faults for f in second) == (
        contradicts
    )


@pytest.mark.parametrize(("rate", "fallen"), [(61.0, False), (59.0, True)])
def test_limit_of_a_rate_that_falls(rate: float, fallen: bool) -> None:
    """Less than 0.6 of the usual rate, which most seconds reach, is a fault."""
    assert bool(rate_alarms((100, 3), (rate, 2))[-1]) == fallen
    assert not any(rate_alarms((100, 2), (rate, 2)))  # two of four seconds are not most


@pytest.mark.parametrize(
    ("parts", "alarm", "begins"),
    [
        (((200, 6), (50, 30)), 4, 7),  # a slower sensor becomes usual
        (((100, 8), (0, 3), (500, 2), (100, 30)), 0, 0),  # what waited in a stall is caught up
        (((200, 12), (100, 30)), 10, 13),  # two publishers, of which one has ended
        (((100, 60), (50, 30)), 13, 61),  # half of the readings is lost
        (((20, 10), (100, 30)), 0, 0),  # a faster sensor is no fault
    ],
)
def test_usual_rate_follows_a_lasting_change(
    parts: Sequence[tuple[float, float]], alarm: int, begins: int
) -> None:
    """A loss of half of the readings alarms for 13 s; no rate is reported for ever."""
    alarms = rate_alarms(*parts)
    assert sum(alarms) == alarm
    assert alarms[begins : begins + alarm] == [True] * alarm


def test_one_angle_in_the_table_is_enough() -> None:
    """Angles outside are a fault only if no angle of a second is inside."""
    assert judged(seconds(50, 1), [4.0] * 50)[-1] != []
    watch = ReadingWatch(turns=True)
    assert judged(seconds(50, 1), [4.0] * 49 + [2.0], watch=watch)[-1] == []
    assert judged(seconds(50, 1), [4.0] * 25 + [math.nan] * 25)[-1] != []
    assert judged(seconds(50, 1), [2.0] * 49 + [math.nan])[-1] == []


@pytest.mark.parametrize(
    ("apart", "taken", "contradicts"),
    [(0.9, 1.0, True), (1.1, 1.0, False), (0.14, 0.5, True), (0.16, 0.5, False)],
)
def test_motion_in_a_gap_contradicts_nothing(apart: float, taken: float, contradicts: bool) -> None:
    """What a velocity means over more than a second without a reading is not known.

    Where the node leaves out readings, that is so over more than 0.15 s.
    """
    watch = ReadingWatch()
    for i in range(round(2.0 / apart) + 1):
        stamp = START + round(1e9 * apart * i)
        watch.take(apart * i, stamp, stamp, 2.0, 0.2, known=True)
    faults = watch.judge(apart * i, apart * i, replace(EXPECTED, taken=taken))
    assert any("turned the crank by" in fault.sentence for fault in faults) == contradicts


def test_levels_are_those_of_the_message() -> None:
    """Their numbers are the constants of ``diagnostic_msgs/msg/DiagnosticStatus``."""
    lines = message_text("diagnostic_msgs/msg/DiagnosticStatus").splitlines()
    words = [line.split("#")[0].replace("byte ", "").split("=") for line in lines if "=" in line]
    constants = {name.strip(): int(number) for name, number in words}
    assert constants == {level.name: level.value for level in Level}
    assert list(constants) == ["OK", "WARN", "ERROR", "STALE"]


@pytest.mark.parametrize(("invalid", "faulty"), [(5, False), (6, True), (25, True)])
def test_limit_of_readings_that_are_no_numbers(invalid: int, faulty: bool) -> None:
    """More than a tenth of the readings without a number is a fault, which says the share."""
    angles = ([math.nan] * invalid + [2.0] * 50)[:50]
    faults = judged(seconds(50, 1), angles)[-1]
    assert [fault.level for fault in faults] == [Level.WARN] * faulty
    words = f"{2 * invalid} % of the readings of {EXPECTED.name} are no numbers"
    assert all(words in fault.sentence for fault in faults)


def test_a_spike_is_said_for_ten_seconds() -> None:
    """A fault that comes and goes ends 10 s after it came last, and says how long ago that was."""
    angles = [2.0] * 1500
    angles[10] = 2.5
    faults = judged(seconds(100, 15), angles, ALONE)
    assert [bool(each) for each in faults] == [True] * 10 + [False] * 5
    assert faults[0][0].sentence.endswith("check the sensor and its cable.")
    assert faults[9][0].sentence.endswith("cable. This was 9 s ago.")


@pytest.mark.parametrize(
    ("taken", "count", "faulty"),
    [(1.0, 50, True), (0.5, 50, False), (0.3, 30, False), (0.5, 9, False), (0.5, 10, True)],
)
def test_what_is_left_out_is_no_fault_of_the_rate(taken: float, count: int, faulty: bool) -> None:
    """The readings that were left out or lost count; a few readings say nothing about the rate."""
    watch = ReadingWatch()
    before, after = judged(seconds(100, 5), [2.0] * 500, watch=watch), []
    for second in range(5, 8):
        for i in range(count):
            watch.take(second + i / 60, START, START, 2.0, math.nan, known=True)
        expected = replace(EXPECTED, taken=taken)
        after = watch.judge(second + 1.0, 1.0, expected)
    assert not any(before)
    assert bool([fault for fault in after if "instead of" in fault.sentence]) == faulty


@pytest.mark.parametrize(("taken", "faulty"), [(1.0, True), (0.1, False)])
def test_a_motion_that_the_node_left_out_contradicts_nothing(taken: float, faulty: bool) -> None:
    """Between two readings a second, a hitch may have started; it moves, and publishers agree."""
    watch = ReadingWatch()
    for i, angle in enumerate((2.0, 2.0, 2.3, 2.3, 2.0, 2.3, 2.0, 2.3, 2.0)):
        rate = 0.6 if i in (1, 4, 6) else 0.0
        stamp = START + i * SECOND // 2
        watch.take(0.5 * i, stamp, stamp, angle, rate, known=True)
    faults = watch.judge(4.5, 4.5, replace(EXPECTED, taken=taken))
    words = ("disagree", "turned the crank by")
    assert [any(w in f.sentence for f in faults) for w in words] == [faulty] * 2


def test_what_waited_is_taken_at_once() -> None:
    """Readings whose times of receipt are 0.5 s apart jump by less than a hitch can, at once."""
    for apart, faulty in ((0.5, False), (0.05, True)):
        watch = ReadingWatch()
        for i in range(3):
            received = START + round(1e9 * apart * i)
            watch.take(1e-4 * i, 0, received, 2.0 + 0.3 * i, math.nan, known=True)
        faults = watch.judge(1.0, 1.0, EXPECTED)
        assert any("jump" in fault.sentence for fault in faults) == faulty
