# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The diagnostics: their levels, sentences and numbers, and one message each second over DDS."""

import math
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.health import Fault, Level, ReadingWatch
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.ros.diagnostics import Health, statuses
from linkage_vibration.ros.statistics import LATENCIES, Second, SequenceGaps, Statistics
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.messages import changed, resonance

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
NEAR = resonance(
    state=ResonanceState.WARNING,
    excitation="engine 3",
    excitation_frequency=94.0,
    mode=1,
    natural_frequency=95.0,
    table_id="a table",
    load_ratios=np.array([0.4], np.float32),
    load_ratio_factors=np.array([1.1], np.float32),
    load_place="pin E3",
    total_load_ratio=0.5,
)
# Mode 1 is known, and mode 3 is overdamped, so that nothing about it is uncertain.
UNCERTAIN = replace(
    Predictor(load_table(config_file(PAPER_TABLE))).predict(2.0),
    natural_frequencies=np.array([4.0, 100.0, math.nan]),
    frequency_stddevs=np.array([0.01, 1.4, math.nan]),
    damping_ratios=np.array([0.01, 0.02, math.nan]),
    damping_ratio_stddevs=np.array([0.0, 0.006, math.nan]),
)


def recorder(**changes: Any) -> Any:
    """Return a recorder as far as a status reads it."""
    state = {"active": True, "recording": True, "path": Path("/logs/a.mcap"), "written": 10}
    return SimpleNamespace(**{**state, "dropped": 0, "deleted": 0, "error": None, **changes})


QUIET = Second(rate=100.0, without_numbers=0.0)


def losing(lost: int) -> Second:
    """Return ten seconds in which 990 messages of each of two topics came, and some of one not."""
    return replace(QUIET, arrived=Counter({"/a": 990, "/b": 990}), lost=Counter({"/a": lost}))


TABLE = replace(load_table(config_file(PAPER_TABLE)), interpolation_error=np.array([1e-9, 4.6e-7]))
PREDICTING = {
    "input_name": "joint hitch on /joint_states",
    "age": 0.01,
    "stale_after": 1.0,
    "prediction": None,
    "resonance": changed(NEAR, state=ResonanceState.CLEAR),
    "excitations": (),
    "readings": ReadingWatch(),
    "reading_faults": [],
    "speed_faults": [],
    "clock_missing": False,
    "paused": False,
    "unmatched": [],
    "sensors": None,
    "measured": {},
}
ORDERS = ("order_levels", "order_stddevs", "predicted_levels", "predicted_factors", "differences")


def heard(
    difference: float, doubts: str = "", modes: str = "", compared: int = 0, silent: str = ""
) -> dict[str, Any]:
    """Return sensors of which one measures an order that is twice as strong as predicted."""
    orders = dict(zip(ORDERS, np.array([[0.2], [0.01], [0.1], [1.5], [difference]]), strict=True))
    message = MessageColumns(sensor="imu", doubts=doubts, **orders)
    of_modes = SimpleNamespace(sentence=lambda: modes, compared=compared)
    sensors = SimpleNamespace(names=("imu", *silent.split()), modes=of_modes)
    return {"sensors": sensors, "measured": {"imu": (0.0, message)}}


def healthy(**changes: Any) -> Health:
    """Return a sound state, except for changes of it, of what predicts, or of what records."""
    of_input = {name: changes.pop(name) for name in PREDICTING.keys() & changes}
    recording = {"recorder": changes.pop("recorder", recorder())}
    sound: dict[str, Any] = {
        "state": "active",
        "problem": "",
        "second": QUIET,
        "served": SimpleNamespace(table=TABLE, mechanism=SimpleNamespace(name="a linkage")),
        "predicting": SimpleNamespace(**PREDICTING | of_input),
        "recording": SimpleNamespace(**recording),
    }
    return Health(**sound | changes)


@pytest.mark.parametrize(
    ("changes", "level", "words"),
    [
        ({}, OK, "Predicting at 100 Hz"),
        ({"state": "inactive"}, OK, "The node is inactive"),
        (
            {"state": "unconfigured", "predicting": None, "recording": None, "served": None},
            OK,
            "The node is unconfigured",
        ),
        ({"problem": "/none.yaml: cannot be read"}, ERROR, "/none.yaml"),
        ({"age": 2.5, "clock_missing": True}, STALE, "no time arrives on /clock"),
        ({"age": 2.5}, STALE, "not received joint hitch on /joint_states for 2.5 s"),
        ({"age": math.nan}, STALE, "has not received joint hitch on /joint_states."),
        ({"second": replace(QUIET, without_numbers=0.25)}, WARN, "25 % of the crank angles"),
        ({"second": replace(QUIET, clock_jumps=1)}, WARN, "clock has jumped"),
        ({"same_name": 2}, WARN, "2 nodes have this name"),
        ({"unmatched": ["The QoS of a.", "The QoS of b."]}, WARN, "The QoS of a. The QoS of b."),
        (
            {"prediction": UNCERTAIN},
            WARN,
            r"Mode 2 \(implement pitch\) is uncertain: .* 1.4 % of .* and 30 % of its damping",
        ),
        (
            {"resonance": NEAR, "recorder": recorder(recording=False, error="disk full")},
            OK,
            "Predicting at 100 Hz",
        ),
        ({"resonance": NEAR, "second": replace(QUIET, without_numbers=0.5)}, WARN, "50 %"),
    ],
)
def test_most_serious_problem_first(changes: dict[str, Any], level: bytes, words: str) -> None:
    """Each problem has a level and a sentence; of two problems the more serious one is reported."""
    actual = statuses("a", healthy(**changes), Statistics())[0]
    assert actual.level == level
    assert re.search(words, actual.message)


@pytest.mark.parametrize(
    ("part", "changes", "level", "words"),
    [
        (
            "resonance",
            {"resonance": NEAR},
            WARN,
            r"engine 3 at 94.0 Hz exerts 0.4 of the static .* pin E3 \(stand.* a factor of 1.1\)",
        ),
        (
            "resonance",
            {
                "resonance": changed(
                    NEAR, load_ratio_factors=np.full(1, np.nan), unknown_factors="x"
                )
            },
            WARN,
            r"\(standard deviation not known, as x\), all excitations together 0.5",
        ),
        (
            "resonance",
            {"resonance": changed(NEAR, state=ResonanceState.NOTE)},
            OK,
            "All loads are 0.5 of the static forces",
        ),
        (
            "resonance",
            {"resonance": changed(NEAR, state=ResonanceState.NOTE, total_load_ratio=math.nan)},
            STALE,
            "No load is known",
        ),
        ("resonance", {}, OK, "All loads are 0.5 of the static forces"),
        ("resonance", {"resonance": None}, STALE, "as no speed has arrived"),
        ("resonance", {"age": 1.1}, STALE, "as no reading arrives"),
        ("resonance", {"age": 0.9}, OK, "All loads are 0.5 of the static forces"),
        ("resonance", {"age": math.nan}, STALE, "as no reading arrives"),
        (
            "resonance",
            {
                "resonance": changed(
                    NEAR, state=ResonanceState.UNKNOWN, unknown_sources=2, excitation_index=-1
                )
            },
            STALE,
            "No load is known",
        ),
        ("resonance", {"state": "inactive", "resonance": NEAR}, OK, "The node is inactive"),
        ("log", {}, OK, "Recording to /logs/a.mcap"),
        ("log", {"recorder": recorder(recording=False)}, OK, "No log is recorded"),
        ("log", {"recorder": recorder(dropped=3)}, WARN, "3 messages are missing in the log"),
        (
            "log",
            {"recorder": recorder(dropped=3, error="Too large.")},
            WARN,
            "3 messages are missing in the log. Too large.",
        ),
        ("log", {"recorder": recorder(recording=False, dropped=3)}, OK, "No log is recorded"),
        ("log", {"recorder": recorder(recording=False, error="disk full")}, ERROR, "disk full"),
        ("log", {"recorder": recorder(active=False, error="disk hangs")}, ERROR, "disk hangs"),
        ("input", {}, OK, "No fault is known of joint hitch"),
        ("input", {"reading_faults": [Fault(Level.ERROR, "Degrees.")]}, ERROR, "Degrees."),
        ("input", {"second": losing(10)}, OK, "No fault is known of joint hitch"),
        (
            "input",
            {"second": losing(11)},
            WARN,
            "^11 of 1001 messages of /a were lost in the last 10",
        ),
        ("input", {"second": replace(QUIET, wait=0.049)}, OK, "No fault is known of joint hitch"),
        (
            "input",
            {"second": replace(QUIET, wait=0.051)},
            WARN,
            "waited up to 0.051 s for the node; the machine is too slow or too busy",
        ),
        (
            "input",
            {"second": replace(QUIET, wait=0.051, dropped=40)},
            WARN,
            "waited up to 0.051 s for the node, and 40 were left out for newer ones",
        ),
        ("speeds", {"speed_faults": [Fault(Level.WARN, "It stopped.")]}, WARN, "It stopped."),
        ("resonance", {"paused": True}, STALE, "The time on /clock stands still"),
        (
            "sensors",
            heard(1.9) | {"measured": {}},
            STALE,
            "No sensor has sent samples that can be used for 5 s",
        ),
        ("sensors", heard(1.9), OK, "agrees with the predictions .orders compared: 1, modes: 0"),
        ("sensors", heard(math.nan), STALE, "so nothing is compared"),
        ("sensors", heard(math.nan, compared=2), OK, "orders compared: 0, modes: 2"),
        ("sensors", heard(1.9, silent="axle"), WARN, "^axle: It has sent no samples for 5 s.$"),
        (
            "sensors",
            {**heard(2.1), "excitations": [SimpleNamespace(name="rotor 1")], "resonance": None},
            WARN,
            "imu: rotor 1 is 2 times as strong as predicted .2.1 standard deviations",
        ),
        ("sensors", heard(0.0, "It hangs loose."), WARN, "imu: It hangs loose."),
        ("sensors", heard(0.0, "", "The heave is low."), WARN, "The heave is low."),
    ],
)
def test_each_part_has_a_status(
    part: str, changes: dict[str, Any], level: bytes, words: str
) -> None:
    """Inputs, resonance and log have statuses of their own, beside that of the predictions."""
    actual = statuses("a", healthy(**changes), Statistics(lost=Counter({"/a": 2, "/b": 9})))
    [own] = [each for each in actual if each.name == f"a: {part}"]
    assert own.level == level
    assert re.search(words, own.message)


def test_numbers() -> None:
    """Percentiles, counts, table and log have names."""
    dropped = Counter({"/b": 30, "/a": 10})
    statistics = Statistics(received=7, with_numbers=6, clock_jumps=2, dropped=dropped)
    statistics.latencies.extend(1e-3 * i for i in range(1, 101))
    values = {v.key: v.value for v in statuses("a", healthy(), statistics)[0].values}
    assert float(values["latency p50 [ms]"]) == pytest.approx(50.5)
    assert float(values["latency p99 [ms]"]) == pytest.approx(99.01)
    names = ("messages received", "predictions", "clock jumps", "table id", "table error", "log")
    log = "/logs/a.mcap"
    assert [values[name] for name in names] == ["7", "6", "2", TABLE.table_id, "4.6e-07", log]
    assert (values["recording"], values["log files deleted"]) == ("true", "0")
    assert values["messages left out"] == "/a 10, /b 30"


def test_statistics_are_bounded_and_count() -> None:
    """Rate and share are those of the last second; the memory for latencies is bounded."""
    statistics = Statistics(with_numbers=100, clock_jumps=4, wait=3.0)
    assert statistics.since_last_time(10.0) == Second(0.0, 0.0, wait=3.0)
    statistics.with_numbers, statistics.without_numbers = 130, 10
    assert statistics.since_last_time(10.5) == Second(80.0, 0.25, 3.0)
    assert statistics.since_last_time(11.5) == Second(0.0, 0.0, 3.0)
    statistics.latencies.extend([0.0] * 10 * LATENCIES)
    assert len(statistics.latencies) == LATENCIES


def test_events_are_said_for_ten_statuses() -> None:
    """Losses, waits and jumps of a second are in its status and in the nine after it."""
    statistics = Statistics()
    statistics.since_last_time(0.0)
    statistics.lost["/a"], statistics.lost["/b"] = 5, 1
    statistics.clock_jumps = 1
    statistics.dropped["/a"], statistics.dropped["/b"] = 6, 2
    statistics.arrived["/a"], statistics.wait = 50, 2.0
    lost, arrived = Counter({"/a": 5, "/b": 1}), Counter({"/a": 50})
    for i in range(1, 11):
        expected = Second(0.0, 0.0, 2.0, 1, 8, arrived, lost)
        assert statistics.since_last_time(float(i)) == expected
    assert statistics.since_last_time(11.0) == Second(0.0, 0.0, wait=2.0)
    assert statistics.since_last_time(12.0) == Second(0.0, 0.0)


@pytest.mark.parametrize(
    ("numbers", "publishers", "missing"),
    [
        ([7, 8, 9], 1, 0),  # the publisher was there before
        ([1, 2, 5, 9], 1, 5),
        ([1, 5, 9], 2, 3),  # the other one may have sent 5
        ([50, 1, 51, 2, 53, 4], 2, 2),  # two publishers, of which each loses one
        ([10, 5000, 11, 5001], 2, 0),
        ([10, 5000, 5001], 1, 4989),
        ([9, 1, 2, 3], 1, 0),  # the publisher has restarted
    ],
)
def test_gaps_of_sequence_numbers(numbers: list[int], publishers: int, missing: int) -> None:
    """Missing numbers are counted for each publisher of a topic."""
    gaps = SequenceGaps()
    assert sum(gaps.before(number, lambda: publishers) for number in numbers) == missing


def test_wall_clock_that_was_set() -> None:
    """A step by more than 0.5 s against the steady clock is counted as a jump, once."""
    statistics = Statistics()
    for wall, steady in ((100.0, 1.0), (101.4, 2.0), (98.0, 3.0), (99.0, 4.0), (100.6, 5.0)):
        statistics.watch_wall_clock(wall, steady)
    assert statistics.clock_jumps == 2
