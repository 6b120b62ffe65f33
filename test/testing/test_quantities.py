# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Each limit fails above it and passes at it, on drives that are written message by message."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import config_file
from linkage_vibration.testing.bag_checks import Failure, check_bag
from linkage_vibration.testing.limits import Limits, TestKitError
from test.support.messages import read_messages, read_stamped
from test.support.random_resonances import (
    CLEAR,
    NOTE,
    START,
    UNKNOWN,
    WARNING,
    Message,
    write_drive,
)

STEP = 100_000_000  # ns
NODE = "/linkage_vibration"
DRIVE = config_file("drives/hitch_duty_cycle.mcap")


def message(k: int, state: int = CLEAR, ratio: float = 0.05, **more: Any) -> Message:
    """Return the k-th message at 10 Hz, in which the second excitation has a state."""
    loads = np.float32([0.01, ratio, 0.01, 0.01]).tolist()
    values: dict[str, Any] = {
        "stamp": START + k * STEP,
        "angle": math.radians(120.0),
        "state": state,
        "states": (CLEAR, state, CLEAR, CLEAR),
        "ratios": tuple(loads),
        "total": float(np.float32(ratio)),
        "excitation": "engine 3",
        "unknown": 0,
        "limit": 0.33,
    }
    return Message(**values | more)


def failures(folder: Path, messages: Sequence[Message], **limits: Any) -> list[Failure]:
    """Return the failures of a drive of these messages."""
    path = folder / "drive.mcap"
    if not path.exists():
        write_drive(path, list(messages))
    return list(check_bag(path, Limits(**limits)).failures)


@pytest.mark.parametrize("excitation", [None, "engine 3"])
def test_time_in_warning_and_note(tmp_path: Path, excitation: str | None) -> None:
    """Of 10 s, 2 s are warnings, and 3 s notes or warnings, also of the excitation that causes it.

    The failure names the moment at which the time is exceeded.
    """
    state = {**dict.fromkeys(range(20, 40), WARNING), **dict.fromkeys(range(70, 80), NOTE)}
    drive = [message(k, state.get(k, CLEAR)) for k in range(100)]
    assert not failures(
        tmp_path, drive, warning_time=2.0, note_time=3.0, excitation=excitation, known_share=1.0
    )
    warned, noted = failures(
        tmp_path, drive, warning_time=1.95, note_time=2.95, excitation=excitation
    )
    assert (warned.limit, warned.seconds, warned.count) == ("warning_time", 3.9, 1)
    assert (noted.limit, noted.seconds, noted.count) == ("note_time", 7.9, 1)
    of = "" if excitation is None else " of engine 3"
    assert f"the warning time{of} is 2.000 s, more than 1.95," in str(warned)
    assert f"the note time{of} is 3.000 s, more than 2.95," in str(noted)
    assert "(most severe: engine 3)" in str(warned)
    assert not failures(
        tmp_path, drive, warning_time=0.0, note_time=0.0, excitation="engine 1", known_share=1.0
    )


@pytest.mark.parametrize("limit", ["load_ratio", "warning_time", "note_time"])
def test_what_is_not_known(tmp_path: Path, limit: str) -> None:
    """Of 100 messages, 6 without a speed fail a known share of 0.95, but not one of 0.94.

    An excitation that does not follow this speed is known all the time.
    """
    lost = {"unknown": 4, "states": (CLEAR, CLEAR, CLEAR, UNKNOWN)}
    drive = [message(k, **(lost if 50 <= k < 56 else {})) for k in range(100)]
    assert not failures(tmp_path, drive, **{limit: 1.0}, known_share=0.94)
    assert not failures(tmp_path, drive, **{limit: 1.0}, excitation="engine 3", known_share=1.0)
    [failure] = failures(tmp_path, drive, **{limit: 1.0})
    assert (failure.limit, failure.seconds) == ("known_share", 5.0)
    assert f"known for 94 % of the drive whether {limit} is exceeded, less than 95 %" in str(
        failure
    )
    assert "The PTO speed was not known for 0.6 s" in str(failure)


def test_without_loads_nothing_can_warn(tmp_path: Path) -> None:
    """Where no load is known, no warning is no answer; a note by a near mode is one."""
    lost = {"total": math.nan, "ratios": (math.nan,) * 4}
    drive = [message(k, **lost) for k in range(50)]
    assert not failures(tmp_path, drive, note_time=0.0)
    [failure] = failures(tmp_path, drive, warning_time=0.0)
    assert failure.limit == "known_share"
    assert "known for 0 % of the drive" in str(failure)


def test_a_load_of_one_excitation(tmp_path: Path) -> None:
    """The load of one excitation is that of its row, and a load that is never known fails."""
    drive = [message(k, ratio=0.3 if k == 30 else 0.05) for k in range(50)]
    assert not failures(tmp_path, drive, load_ratio=0.02, excitation="engine 1", known_share=1.0)
    [failure] = failures(tmp_path, drive, load_ratio=0.29, excitation="engine 3")
    assert (failure.limit, failure.seconds, failure.count) == ("load_ratio", 3.0, 1)
    assert "the load ratio of engine 3 is 0.3, more than 0.29," in str(failure)
    with pytest.raises(TestKitError, match=r"excitation is 'engine 2'; .* has only engine 1, eng"):
        failures(tmp_path, drive, load_ratio=1.0, excitation="engine 2")
    (tmp_path / "drive.mcap").unlink()
    unknown = [message(k, ratio=math.nan) for k in range(50)]
    [failure] = failures(tmp_path, unknown, load_ratio=1.0, excitation="engine 3", known_share=None)
    assert failure.limit == "known_share"


def test_angles_and_frequencies(tmp_path: Path) -> None:
    """The range of an angle and of a mode is that of the messages; the worst moment is named."""
    drive = [message(k, angle=math.radians(110.0 + k)) for k in range(21)]
    path = write_drive(tmp_path / "drive.mcap", drive)
    modes = [m.natural_frequencies[1] for _, m in read_messages(path, f"{NODE}/prediction")]
    low, high = min(modes), max(modes)
    within = {"crank_angle_deg": (109.999, 130.001), "frequencies": {2: (low - 1e-9, high + 1e-9)}}
    assert not failures(tmp_path, drive, **within, known_share=1.0)
    [above] = failures(tmp_path, drive, crank_angle_deg=(100.0, 125.5))
    assert (above.seconds, above.count) == (2.0, 5)
    assert "the crank angle is 130.00 deg, not from 100 to 125.5," in str(above)
    [below] = failures(tmp_path, drive, crank_angle_deg=(112.5, 140.0))
    assert (below.seconds, below.count) == (0.0, 3)
    [failure] = failures(tmp_path, drive, frequencies={1: (0.0, 1e4), 2: (0.0, high - 1e-6)})
    assert failure.seconds == pytest.approx(0.1 * modes.index(high))
    assert f"mode 2 (implement pitch) is {high:.4g} Hz, not from 0 to" in str(failure)
    with pytest.raises(TestKitError, match=r"frequencies has mode 99; .* has \d+ modes"):
        failures(tmp_path, drive, frequencies={99: (0.0, 1.0)})


def test_angles_that_are_no_numbers(tmp_path: Path) -> None:
    """If every status is allowed, an angle without a number is not known to be in its range."""
    drive = [message(k, angle=math.nan if k in (3, 4) else 2.0) for k in range(20)]
    limits: dict[str, Any] = {"statuses": None, "crank_angle_deg": (90.0, 180.0)}
    limits["input_faults"] = None
    assert not failures(tmp_path, drive, **limits, known_share=0.9)
    [failure] = failures(tmp_path, drive, **limits, known_share=0.91)
    assert (failure.limit, failure.seconds) == ("known_share", pytest.approx(0.3))
    assert "2 of 20 messages do not have it" in str(failure)


def test_duration_and_jumps(tmp_path: Path) -> None:
    """The drive lasts 9.8 s between two jumps of the clock to an earlier time."""
    stamps = [*range(50), *range(30), *range(20)]
    drive = [message(k) for k in stamps]
    assert not failures(tmp_path, drive, duration=9.9, clock_jumps=2)
    short, jump = failures(tmp_path, drive, duration=9.91, clock_jumps=1)
    assert (short.limit, jump.limit) == ("duration", "clock_jumps")
    assert "the bag lasts 9.900 s, less than 9.91, and ends" in str(short)
    assert (jump.count, jump.seconds) == (1, pytest.approx(8.0))
    assert "there are more jumps of the clock to an earlier time than 1," in str(jump)
    assert not failures(tmp_path, drive, clock_jumps=1, windows=((0.0, 7.9),))


def test_windows(tmp_path: Path) -> None:
    """Only what happens in the windows counts; a message holds in the part before their end."""
    state = dict.fromkeys(range(20, 40), WARNING)
    drive = [message(k, state.get(k, CLEAR), 0.5 if k == 60 else 0.05) for k in range(100)]
    windows = ((1.0, 3.05), (7.0, 9.0))
    assert not failures(
        tmp_path, drive, load_ratio=0.4, warning_time=1.0501, windows=windows, known_share=1.0
    )
    [failure] = failures(tmp_path, drive, warning_time=1.0499, windows=windows)
    assert failure.seconds == pytest.approx(3.0)
    assert "the warning time is 1.050 s" in str(failure)
    [failure] = failures(tmp_path, drive, load_ratio=0.4, windows=((6.05, 7.0),))
    assert (failure.limit, failure.seconds) == ("load_ratio", 6.0)
    assert not failures(tmp_path, drive, load_ratio=0.4, windows=((6.1, 7.0),))


def test_faults_of_the_inputs(tmp_path: Path) -> None:
    """A crank that jumps by 0.5 rad at 3.0 s fails, unless a fault is allowed or before windows."""
    drive = [message(k, angle=2.0 + 0.5 * (k >= 30)) for k in range(60)]
    for allowed in ({"input_faults": 1}, {"input_faults": None}, {"windows": ((0.0, 2.9),)}):
        assert not failures(tmp_path, drive, **allowed)
    for limits in ({}, {"windows": ((2.9, 5.0),)}):
        [failure] = failures(tmp_path, drive, **limits)
        assert (failure.limit, failure.seconds) == ("input_faults", 3.0)
        assert "1 of 10 readings of the crank angle jump by up to 0.5 rad" in failure.words


def test_windows_that_a_drive_does_not_cover(tmp_path: Path) -> None:
    """A window after the end, or in a gap, fails, as nothing was checked there."""
    drive = [message(k) for k in (*range(50), *range(80, 100))]
    assert not failures(tmp_path, drive, windows=((0.0, 4.0), (8.0, 10.0)))
    for window in ((8.0, 10.2), (5.5, 7.5)):
        [failure] = failures(tmp_path, drive, windows=(window,))
        assert failure.limit == "windows"
        assert f"cover the window from {window[0]:g} to {window[1]:g} s" in str(failure)
    [failure] = failures(tmp_path, drive, load_ratio=1.0, windows=((3.0, 9.0),))
    assert failure.limit == "known_share"  # the gap of 3.1 s lasts for 0.1 s as a message does
    assert "known for 50 % of the drive" in str(failure)
    assert "No message states the load for 3.0 s" in str(failure)
    [failure] = failures(tmp_path, drive, load_ratio=1.0, windows=((6.0, 9.0),))
    assert "No load is known for the first 2.0 s" in str(failure)


def test_gaps_in_windows(tmp_path: Path) -> None:
    """A gap of 5 s counts in a window that it overlaps, and not in one before."""
    drive = [message(k) for k in (*range(50), *range(99, 120))]
    assert not failures(tmp_path, drive, gap=1.0, windows=((0.0, 4.9),))
    [failure] = failures(tmp_path, drive, gap=1.0, windows=((0.0, 5.0),), known_share=0.0)
    assert (failure.limit, failure.seconds) == ("gap", pytest.approx(4.9))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the shipped drive with its predictions, on ground that does not move."""
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    replay([DRIVE], path, Parameters(ground_speed=0.0))
    return path


@pytest.mark.parametrize("excitation", [None, "tines 2"])
def test_velocity(log: Path, excitation: str | None) -> None:
    """The velocity is that of the messages, of all excitations or of one."""
    levels = read_stamped(log, f"{NODE}/levels")
    info = {name: i for i, name in enumerate(_names(log))}
    values = [
        (m.total_velocity if excitation is None else m.velocities[info[excitation]], time)
        for time, m in levels
    ]
    largest, time = max((v, t) for v, t in values if not math.isnan(v))
    passed = Limits(velocity=1.0001 * largest, excitation=excitation, known_share=0.9)
    assert check_bag(log, passed).passed
    limits = Limits(velocity=0.9999 * largest, excitation=excitation, known_share=0.9)
    [failure] = check_bag(log, limits).failures
    assert (failure.limit, failure.time) == ("velocity", time)
    whose = "" if excitation is None else f" of {excitation}"
    assert f"the velocity of the response point{whose} is {largest:.3g} m/s" in str(failure)


def _names(log: Path) -> list[str]:
    """Return the excitations of a log by the index in its messages."""
    found = {
        state.excitation_index: resonance.excitation
        for (_, state), (_, resonance) in zip(
            read_messages(log, f"{NODE}/load_state"),
            read_messages(log, f"{NODE}/resonance"),
            strict=True,
        )
    }
    return [found.get(i, "") for i in range(max(found) + 1)]


def test_place(log: Path) -> None:
    """A place has the load where it is largest; where another is loaded more, it is not known."""
    at = {"lower_link:V1": 0.0, "lower_link:E1": 0.0}
    levels = [m for _, m in read_messages(log, f"{NODE}/levels")]
    for each in levels:
        at[each.total_load_place] = max(at[each.total_load_place], each.total_load_ratio)
    low, high = sorted(at, key=lambda place: at[place])
    assert 0.0 < at[low] < at[high]
    [failure] = check_bag(
        log, Limits(load_ratio=0.99 * at[high], place=high, known_share=0.0)
    ).failures
    assert f"the load ratio in {high} is" in str(failure)
    assert check_bag(log, Limits(load_ratio=1.01 * at[low], place=low, known_share=0.0)).passed
    limit = 0.5 * (at[low] + at[high])
    elsewhere = sum(m.total_load_ratio > limit for m in levels) / len(levels)
    known = check_bag(log, Limits(load_ratio=limit, place=low, known_share=0.99))
    [failure] = known.failures
    share = float(str(failure).split("known for ")[1].split(" %")[0])
    unknown = sum(bool(m.unknown_sources) for _, m in read_messages(log, f"{NODE}/load_state"))
    assert share < 100.0 * (1.0 - elsewhere) + 0.1
    assert share > 100.0 * (1.0 - elsewhere - unknown / len(levels)) - 8.0
    with pytest.raises(
        TestKitError, match=r"place is 'lower_link:V9'; .* has only .*lower_link:V1"
    ):
        check_bag(log, Limits(load_ratio=1.0, place="lower_link:V9"))


def test_reasons_come_first(tmp_path: Path) -> None:
    """A drive out of the table says so first, and one without speeds, why no load is known."""
    shifted = Parameters(hitch_offset=0.3, ground_speed=0.0)
    report = check_bag(DRIVE, Limits(load_ratio=1.0, warning_time=0.0), shifted)
    causes = ["statuses", "input_faults", "known_share"]
    assert [failure.limit for failure in report.failures] == causes
    assert "The crank angle was not within the table for 10.6 s" in str(report.failures[2])
    never = check_bag(DRIVE, Limits(load_ratio=1.0), Parameters(hitch_offset=4.0)).failures
    assert [*dict.fromkeys(failure.limit for failure in never)] == causes
    words = "check hitch_offset or hitch_sign. What the drive did to the linkage is not known"
    assert words in str(never[-1])
    limits = Limits(load_ratio=1.0, statuses=None, input_faults=None)
    allowed = check_bag(DRIVE, limits, Parameters(hitch_offset=4.0))
    assert [failure.limit for failure in allowed.failures] == ["known_share"]
    silent = [
        message(k, UNKNOWN, math.nan, excitation="", unknown=14, states=(UNKNOWN,) * 4)
        for k in range(50)
    ]
    [failure] = failures(tmp_path, silent, load_ratio=1.0, warning_time=0.0, velocity=1.0)
    assert failure.limit == "known_share"
    assert "the engine, PTO and ground speeds were never known" in str(failure)


def test_stamps_that_stand_still(tmp_path: Path) -> None:
    """Where the stamps do not move, no time is known, and nothing passes."""
    drive = [message(0, WARNING) for _ in range(50)]
    _, failure = failures(tmp_path, drive, warning_time=10.0)
    assert failure.limit == "known_share"
