# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Bags are checked against limits, and a failure reports and draws the moment."""

import math
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from linkage_vibration.bags.log_writer import ChunkLog, Messages
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import (
    LEVELS_TOPIC,
    LOAD_STATE_TOPIC,
    PREDICTION,
    PREDICTION_TOPIC,
    RESONANCE_TOPIC,
    log_topic,
)
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.review.log import read_log
from linkage_vibration.review.overview import drive_summary
from linkage_vibration.review.review_page import review_page
from linkage_vibration.support.resources import config_file
from linkage_vibration.testing.bag_checks import check_bag
from linkage_vibration.testing.limits import Limits, TestKitError
from test.support.messages import read_messages, read_stamped
from test.support.random_resonances import random_drive, write_drive

DRIVE = config_file("drives/hitch_duty_cycle.mcap")
START = 1_767_225_600 * 10**9  # ns, of the drive: 2026-01-01


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the drive with its predictions."""
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    replay([DRIVE], path, Parameters())
    return path


def rewritten(
    log: Path, path: Path, keep: "np.ndarray", delays: "np.ndarray", empty: Sequence[str] = ()
) -> Path:
    """Write joint states of a log, and predictions that were sent after a delay, s."""
    with log.open("rb") as file:
        reader = make_reader(file)
        states, predictions = (
            [message for *_, message in reader.iter_messages([topic])]
            for topic in ("/joint_states", PREDICTION_TOPIC)
        )
    topics = [log_topic("/joint_states", JOINT_STATE), log_topic(PREDICTION_TOPIC, PREDICTION)]
    topics += [log_topic(name, FLOAT64) for name in empty]
    with ChunkLog(path, topics, [], {}) as out:
        for k in keep.tolist():
            row, sent = np.array([k]), np.array([states[k].log_time])
            for topic, message, after in (
                (topics[0].name, states[k], 0.0),
                (topics[1].name, predictions[k], delays[k]),
            ):
                data = np.frombuffer(message.data, np.uint8)[np.newaxis]
                out.write([Messages(topic, data, row, sent, sent + round(1e9 * after))])
    return path


def test_a_drive_within_its_limits(log: Path) -> None:
    """The drive keeps its range and its rate, as a bag and as a log."""
    for bag in (DRIVE, log):
        report = check_bag(bag, Limits(gap=0.0101))
        assert (report.passed, report.predictions, report.picture) == (True, 2000, None)
        assert "2000 predictions within their limits" in str(report)


def test_load_ratio_is_that_of_the_resonances(log: Path) -> None:
    """The reported moment is that of the largest load ratio in the log."""
    resonances = dict(read_stamped(log, RESONANCE_TOPIC))
    actual = [
        (message.total_load_ratio, time, resonances[time].excitation)
        for time, message in read_stamped(log, LEVELS_TOPIC)
        if not math.isnan(message.total_load_ratio)
    ]
    largest, time, excitation = max(actual)
    assert check_bag(log, Limits(load_ratio=1.01 * largest, known_share=None)).passed
    [failure] = check_bag(log, Limits(load_ratio=0.99 * largest, known_share=None)).failures
    assert (failure.limit, failure.time) == ("load_ratio", time)
    assert failure.seconds == pytest.approx(1e-9 * (time - START), abs=1e-9)
    assert excitation in failure.words
    half = 0.5 * largest
    exceeded = sum(ratio > half for ratio, *_ in actual)
    assert (
        check_bag(log, Limits(load_ratio=half, known_share=None)).failures[0].count == exceeded > 1
    )


def test_statuses_tell_the_first_moment() -> None:
    """Shifted beyond the table, the drive fails at the first angle outside."""
    settings = Parameters(hitch_sign=-1, hitch_offset=4.95)
    [failure] = check_bag(DRIVE, Limits(), settings).failures
    position = np.array(
        [
            m.position[m.name.index("hitch_rockshaft_joint")]
            for _, m in read_messages(DRIVE, "/joint_states")
        ]
    )
    beyond = 4.95 - position < np.pi / 2
    beyond |= 4.95 - position > np.pi
    assert failure.count == beyond.sum()
    assert failure.time == START + int(beyond.argmax()) * 10**7
    assert "OUT_OF_RANGE" in failure.words
    assert "2026-01-01 00:00:" in str(failure)
    allowed = Limits(statuses=(Status.OK, Status.OUT_OF_RANGE))
    assert check_bag(DRIVE, allowed, settings).passed


def test_gap_and_latency_of_a_recording(log: Path, tmp_path: Path) -> None:
    """A gap of 0.25 s and a latency of 30 ms are found at their times."""
    keep = np.r_[0:100, 124:300]
    delays = np.full(2000, 0.002)
    delays[200] = 0.03
    bag = rewritten(log, tmp_path / "recorded.mcap", keep, delays)
    assert check_bag(bag, Limits(gap=0.26, latency=0.031)).passed
    gap, latency = check_bag(bag, Limits(gap=0.2, latency=0.02)).failures
    assert (gap.limit, gap.seconds, gap.count) == ("gap", pytest.approx(0.99), 1)
    assert "no prediction for 0.250 s" in gap.words
    assert (latency.limit, latency.seconds, latency.count) == ("latency", pytest.approx(2.0), 1)
    assert "took 0.03000 s" in latency.words


def test_what_is_not_known_fails(log: Path) -> None:
    """A limit of the load is only kept if it is known for long enough that it is.

    In the shipped drive the ground is never known, and three orders lie beyond the table.
    """
    states = [message for _, message in read_messages(log, LOAD_STATE_TOPIC)]
    assert all(message.unknown_sources for message in states)
    [failure] = check_bag(log, Limits(load_ratio=1e3)).failures
    assert (failure.limit, failure.seconds, failure.count) == ("known_share", 0.0, 1)
    assert "known for 0 % of the drive whether load_ratio is exceeded" in failure.words
    assert check_bag(log, Limits(load_ratio=1e3, known_share=0.0)).passed
    read = read_log(log)
    assert (drive_summary(read)["known_share"], review_page(read).content["calm"]) == (0.0, False)


def test_status_comes_before_loads_that_are_not_known() -> None:
    """A drive outside the table has no load because of that, which the report says."""
    failures = check_bag(DRIVE, Limits(load_ratio=0.33), Parameters(hitch_offset=4.0)).failures
    causes = ["statuses", "input_faults", "known_share"]
    assert [*dict.fromkeys(each.limit for each in failures)] == causes
    assert "are outside 90 to 180 deg: check hitch_offset or hitch_sign" in failures[-1].words


def test_failures_name_the_load(log: Path) -> None:
    """Load, place and excitation of the moment are in the failure of any limit."""
    messages = dict(read_stamped(log, LEVELS_TOPIC))
    [failure] = check_bag(log, Limits(load_ratio=1e-4, known_share=None)).failures
    about = messages[failure.time]
    assert f"in {about.total_load_place} is {about.total_load_ratio:.2g}" in failure.words
    excitation = dict(read_stamped(log, RESONANCE_TOPIC))[failure.time].excitation
    assert f"(most severe: {excitation}), more than 0.0001" in failure.words
    failure = check_bag(log, Limits(gap=0.001)).failures[0]
    assert " while the load ratio in " in failure.words


def test_empty_topics_are_not_counted(log: Path, tmp_path: Path) -> None:
    """The node's log lists topics without messages, which do not hinder the latency."""
    delays = np.full(2000, 0.002)
    bag = rewritten(log, tmp_path / "log.mcap", np.arange(50), delays, ["/hitch_position"])
    assert check_bag(bag, Limits(latency=0.01)).passed
    assert not check_bag(bag, Limits(latency=0.001)).passed


def test_missing_quantities(log: Path, tmp_path: Path) -> None:
    """A limit on a quantity that a bag lacks is refused."""
    with pytest.raises(TestKitError, match="must be replayed"):
        check_bag(DRIVE, Limits(latency=0.1))
    with pytest.raises(TestKitError, match="is a replay, which has no latency"):
        check_bag(log, Limits(latency=0.1))
    bag = rewritten(log, tmp_path / "recorded.mcap", np.arange(10), np.full(2000, 0.002))
    [failure] = check_bag(bag, Limits(load_ratio=0.1)).failures
    assert failure.limit == "known_share"
    assert "the log holds no speed of engine, PTO or ground" in failure.words


@pytest.mark.parametrize("same", [True, False])
def test_baseline(log: Path, tmp_path: Path, same: bool) -> None:
    """A bag is equal to its own log, and a shifted angle differs from the first prediction on."""
    settings = Parameters(hitch_offset=0.0 if same else -0.01)
    report = check_bag(DRIVE, Limits(baseline_tolerance=0.0), settings, baseline=log)
    assert report.passed == same
    assert report.checked == ("statuses", "input_faults", "baseline")
    if not same:
        [failure] = report.failures
        assert (failure.limit, failure.seconds, failure.count) == ("baseline", 0.0, 2000)
        assert f"the log (B) differs from {log} (A) by more than 0 % in " in str(failure)


def test_baseline_of_another_drive(log: Path, tmp_path: Path) -> None:
    """Where the comparison refuses, so does the check."""
    other = write_drive(tmp_path / "other.mcap", random_drive(1)[3:])
    with pytest.raises(LinkageVibrationError, match=re.escape(f"{other}")):
        check_bag(log, Limits(), baseline=other)


def test_picture(log: Path, tmp_path: Path) -> None:
    """A failure is drawn if a picture is requested; otherwise no picture is written."""
    report = check_bag(
        log, Limits(load_ratio=1e-4, known_share=None), picture=tmp_path / "failed.png"
    )
    assert report.picture == tmp_path / "failed.png"
    assert report.picture.read_bytes().startswith(b"\x89PNG")
    assert str(report.picture) in str(report)
    assert check_bag(log, Limits(), picture=tmp_path / "passed.png").picture is None
    assert not (tmp_path / "passed.png").exists()


def test_plugin(tmp_path: Path) -> None:
    """In a run of pytest, the fixture fails a test with the report and a picture."""
    test = tmp_path / "test_drive.py"
    test.write_text(
        "from linkage_vibration.support.resources import config_file\n"
        "from linkage_vibration.testing.limits import Limits\n"
        "DRIVE = config_file('drives/hitch_duty_cycle.mcap')\n"
        "def test_good(check_bag):\n"
        "    check_bag(DRIVE, Limits(gap=0.05))\n"
        "def test_bad(check_bag):\n"
        "    check_bag(DRIVE, Limits(load_ratio=1e-4))\n"
        "def test_refused(check_bag):\n"
        "    check_bag(DRIVE, Limits(latency=0.1))\n"
    )
    run = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "linkage_vibration.testing.pytest_plugin",
            "-p",
            "no:cacheprovider",
            f"--basetemp={tmp_path / 'base'}",
            str(test),
        ],
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 1, run.stdout + run.stderr
    assert "2 failed, 1 passed" in run.stdout
    assert "must be replayed and has no latency" in run.stdout
    assert "Traceback" not in run.stdout
    assert "bag_checks.py" not in run.stdout
    assert "the load ratio in " in run.stdout
    assert "more than 0.0001" in run.stdout
    [picture] = (tmp_path / "base").rglob("hitch_duty_cycle.png")
    assert f"picture: {picture}" in run.stdout
