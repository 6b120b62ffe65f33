# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Readings out of joint states, and predictions as bytes."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.prediction import Prediction, Status
from linkage_vibration.messages import ReadingError, encode_prediction, joint_position


def state(names: list[str], positions: list[float]) -> Any:
    """Return what a joint state has of names and positions."""
    return SimpleNamespace(name=names, position=positions)


def test_position_is_found_by_name() -> None:
    """In any order; a message about other joints has none."""
    assert joint_position(state(["a", "b"], [1.0, 2.0]), "b") == 2.0
    assert joint_position(state(["b", "a"], [1.0, 2.0]), "b") == 1.0
    assert joint_position(state(["a"], [1.0]), "b") is None
    assert joint_position(state(["a"], []), "b") is None
    assert joint_position(state([], []), "b") is None


@pytest.mark.parametrize(
    ("names", "positions", "words"),
    [
        (["b"], [], "1 names but 0 positions"),
        (["a", "b"], [1.0], "2 names but 1 positions"),
        (["b"], [1.0, 2.0], "1 names but 2 positions"),
        (["b", "b"], [1.0, 2.0], "named 2 times"),
    ],
)
def test_untrustworthy_readings(names: list[str], positions: list[float], words: str) -> None:
    """Sizes that differ and a joint named twice are told."""
    with pytest.raises(ReadingError, match=words):
        joint_position(state(names, positions), "b")


@given(
    frame=st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20),
    table=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=20),
    modes=st.integers(1, 6),
    angle=st.floats(),
    sec=st.integers(-(2**31), 2**31 - 1),
)
def test_bytes_are_what_ros_reads(
    frame: str, table: str, modes: int, angle: float, sec: int
) -> None:
    """A ROS 2 reader gets every field back from our bytes, and its own bytes of them are ours."""
    from rclpy.serialization import deserialize_message, serialize_message

    from linkage_vibration_interfaces.msg import VibrationPrediction

    numbers = np.linspace(1.0, 2.0, modes)
    prediction = Prediction(angle, Status.OK, numbers, -numbers, 3.0, 4.0, 5e-7, table)
    encoded = encode_prediction(prediction, sec, 7, frame)
    message = deserialize_message(encoded, VibrationPrediction)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (sec, 7)
    assert (message.header.frame_id, message.table_id) == (frame, table)
    assert message.crank_angle == angle or math.isnan(angle)
    assert message.natural_frequencies.tolist() == numbers.tolist()
    assert message.damping_ratios.tolist() == (-numbers).tolist()
    assert (message.frf_peak_frequency, message.frf_peak_magnitude) == (3.0, 4.0)
    own = serialize_message(message)
    assert len(own) == len(encoded)
