# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node reads frames of a CAN bus over DDS, with messages built in the shape of can_msgs."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.bags.can_logs import DEFINITION
from linkage_vibration.bags.message_columns import read_columns, topic_types
from linkage_vibration.messages.topics import PREDICTION_TOPIC, RESONANCE_TOPIC
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters, with_values
from test.support.can_bus import EPOCH, BusFrame, recorded_frames, synthetic_hitch, write_candump
from test.support.interface_packages import built_package, environment_with
from test.support.ros_process import documented, slowness, start_node

pytest.importorskip("can", reason="logs of a CAN bus are read by python-can (extra can)")
CAN = documented("can.md", "engine_input: can")
SECOND = 10**9


@pytest.fixture(scope="module")
def with_can(environment: dict[str, str]) -> dict[str, str]:
    """Return an environment that has can_msgs."""
    frame = DEFINITION.partition("=====")[0]
    return environment_with(environment, built_package("can_msgs", {"Frame": frame}))


def drive(seconds: int) -> list[BusFrame]:
    """Return recorded frames of a tractor with a synthetic hitch that is not available at first."""
    recorded = [f for f in recorded_frames() if f.time < EPOCH + seconds * SECOND]
    times = [EPOCH + k * SECOND // 10 for k in range(10 * seconds)]
    raw = [0xFF] * 5 + [round(125 + 120 * np.sin(k / 10)) for k in range(5, len(times))]
    return [*recorded, *synthetic_hitch(times, raw)]


def test_frames_over_dds(with_can: dict[str, str], tmp_path: Path) -> None:
    """With the parameters of the manual, the answers of the node are those of a replay.

    Each missing value is logged once.
    """
    bus = write_candump(tmp_path / "bus.log", drive(4))
    node = start_node(tmp_path / "node.txt", with_can, **CAN, record=True, log_directory=tmp_path)
    node.wait_for("CAN signal rear_hitch_position on /from_can_bus")
    play = [sys.executable, "-m", "linkage_vibration.cli", "play", str(bus)]
    played = subprocess.run(play, env=with_can, capture_output=True, text=True, check=True)
    assert "messages were published" in played.stdout
    assert node.stop() == 0
    [log] = tmp_path.glob("linkage_vibration_*.mcap")
    settings = with_values(Parameters(), CAN)
    replay(bus, tmp_path / "offline.mcap", settings)
    replay(log, tmp_path / "again.mcap", settings)
    actual, offline, again = (
        read_columns(path, {name: topic_types(path)[name] for name in topics})
        for path, topics in (
            (log, (PREDICTION_TOPIC, RESONANCE_TOPIC)),
            (tmp_path / "offline.mcap", (PREDICTION_TOPIC,)),
            (tmp_path / "again.mcap", (PREDICTION_TOPIC, RESONANCE_TOPIC)),
        )
    )
    for topic, columns in again.items():
        for name, column in columns.items():
            if name != "place":
                np.testing.assert_array_equal(column, actual[topic][name], err_msg=name)
    live, whole = actual[PREDICTION_TOPIC], offline[PREDICTION_TOPIC]
    sec, nanosec = "header.stamp.sec", "header.stamp.nanosec"
    stamps = [each[sec] * 10**9 + each[nanosec] for each in (live, whole)]
    answered = np.isin(stamps[1], stamps[0])
    assert answered.all() or slowness() > 1.0  # a busy machine leaves readings out
    for name in ("crank_angle", "natural_frequencies", "header.stamp.nanosec", "status"):
        np.testing.assert_array_equal(live[name], whole[name][answered], err_msg=name)
    assert node.printed.count("rear_hitch_position is not available (0xFF)") == 1
    assert node.printed.count("rear_pto_speed is not available") == 1


def test_signal_that_does_not_exist(environment: dict[str, str], tmp_path: Path) -> None:
    """Without can_msgs, the error names the package."""
    node = start_node(tmp_path / "node.txt", environment, **CAN)
    assert node.process.wait(120) == 1
    assert "the type can_msgs/msg/Frame is not installed" in node.printed
