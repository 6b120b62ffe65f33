# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replays of our own input message, and of readings whose stamps do not move."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.messages.topics import LOAD_STATE_TOPIC, MEASUREMENT, PREDICTION_TOPIC
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import share_directory
from test.support.messages import read_messages

START, STEP, N = 1_700_000_000 * 10**9, 10**7, 300  # ns, readings at 100 Hz
INVALID = range(0, N, 3)


def measured(path: Path, stamps: list[int]) -> Path:
    """Write hitch angles, of which every third one is not valid, and engine speeds in rad/s."""
    text = (share_directory() / "linkage_vibration_interfaces/msg/Measurement.msg").read_text()
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(text, MEASUREMENT))
    time, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {
            name: bag.add_connection(f"/measured_{name}", MEASUREMENT, typestore=store)
            for name in ("hitch_angle", "engine_speed")
        }
        for k, stamp in enumerate(stamps):
            head = header(stamp=time(*divmod(stamp, 10**9)), frame_id="hitch")
            numbers = {"engine_speed": (60.0, True), "hitch_angle": (2.0, k not in INVALID)}
            for name, (value, valid) in numbers.items():
                message = store.types[MEASUREMENT](head, value, valid)
                data = store.serialize_cdr(message, MEASUREMENT)
                bag.write(topics[name], START + k * STEP, data)
    return path


SETTINGS = Parameters(hitch_input="measurement", engine_input="measurement", prediction_rate=0.0)


def test_values_that_are_not_valid(tmp_path: Path) -> None:
    """Each third reading has no number; the others have their angle, and a speed in rad/s."""
    stamps = [START + k * STEP for k in range(N)]
    log = tmp_path / "log.mcap"
    replay([measured(tmp_path / "bag", stamps)], log, SETTINGS)
    predictions = [message for _, message in read_messages(log, PREDICTION_TOPIC)]
    assert [p.status for p in predictions] == [2 if k in INVALID else 0 for k in range(N)]
    assert {p.crank_angle for k, p in enumerate(predictions) if k not in INVALID} == {2.0}
    resonances = [m for _, m in read_messages(log, "/linkage_vibration/resonance")]
    speeds = [r.excitation_speed for r in resonances if r.excitation.startswith("engine")]
    assert speeds == pytest.approx([60.0] * len(speeds))
    assert speeds


@pytest.mark.parametrize(("frozen", "stamp"), [(False, START), (True, 0), (True, START)])
def test_stamps_that_do_not_move(tmp_path: Path, frozen: bool, stamp: int) -> None:
    """In 3 s there are 30 messages at 10 Hz; where the stamps stand, each says so."""
    stamps = [stamp + (0 if frozen else k * STEP) for k in range(N)]
    log = tmp_path / "log.mcap"
    replay([measured(tmp_path / "bag", stamps)], log, SETTINGS)
    states = [message for _, message in read_messages(log, LOAD_STATE_TOPIC)]
    assert len(states) in (30, 31)
    by_receipt = np.array([state.timed_by_receipt for state in states])
    assert by_receipt[1:].all() if frozen else not by_receipt.any()
    assert [state.count for state in states] == list(range(1, len(states) + 1))
