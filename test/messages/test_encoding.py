# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The bytes of predictions and resonances, and the descriptions of faults."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import LOAD_STATE, PREDICTION, RESONANCE
from linkage_vibration.prediction.predictor import Prediction, Status, fault
from linkage_vibration.prediction.resonance import ResonanceState
from test.support.messages import resonance

TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


@given(
    frame=TEXT,
    table=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=20),
    modes=st.integers(1, 6),
    angle=st.floats(),
    sec=st.integers(-(2**31), 2**31 - 1),
)
def test_bytes_are_what_ros_reads(
    frame: str, table: str, modes: int, angle: float, sec: int
) -> None:
    """A ROS 2 reader reads every field from our bytes, and writes as many bytes."""
    from rclpy.serialization import deserialize_message, serialize_message

    from linkage_vibration_interfaces.msg import VibrationPrediction

    numbers = np.linspace(1.0, 2.0, modes)
    prediction = Prediction(
        angle,
        Status.OK,
        numbers,
        -numbers,
        0.5 * numbers,
        2.0 * numbers,
        3.0,
        4.0,
        5e-7,
        table,
        numbers,
    )
    encoded = encode_message(PREDICTION, prediction, sec, 7, frame)
    message = deserialize_message(encoded, VibrationPrediction)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (sec, 7)
    assert (message.header.frame_id, message.table_id) == (frame, table)
    assert message.crank_angle == angle or math.isnan(angle)
    assert message.natural_frequencies.tolist() == numbers.tolist()
    assert message.frequency_stddevs.tolist() == (2.0 * numbers).tolist()
    assert message.damping_ratios.tolist() == (-numbers).tolist()
    assert (message.frf_peak_frequency, message.frf_peak_magnitude) == (3.0, 4.0)
    own = serialize_message(message)
    assert len(own) == len(encoded)


@given(frame=TEXT, excitation=TEXT, number=st.floats(), mode=st.integers(-1, 2**15 - 1))
def test_resonances_are_what_ros_reads(
    frame: str, excitation: str, number: float, mode: int
) -> None:
    """A ROS 2 reader reads every field of a resonance from our bytes."""
    from rclpy.serialization import deserialize_message

    from linkage_vibration_interfaces.msg import Resonance as Message

    state = ResonanceState.WARNING
    values = {"natural_frequency": 2.0, "margin": 3.0, "relative_margin": 4.0, "approach": -1}
    values |= {"state": state, "excitation_frequency": number, "mode": mode}
    texts = {"excitation": excitation, "table_id": "0123456789ab"}
    known = resonance(**values, **texts, time_to_crossing=math.inf)
    message = deserialize_message(encode_message(RESONANCE, known, 5, 7, frame), Message)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (5, 7)
    assert (message.header.frame_id, message.excitation) == (frame, excitation)
    assert (message.state, message.mode, message.approach) == (Message.STATE_WARNING, mode, -1)
    assert message.excitation_frequency == number or math.isnan(number)
    actual = (message.natural_frequency, message.margin, message.relative_margin)
    assert actual == (2.0, 3.0, 4.0)
    assert (message.time_to_crossing, message.table_id) == (math.inf, "0123456789ab")


@given(
    margin=st.floats(),
    ratio=st.floats(width=32),
    limit=st.floats(2.0**-20, 2.0**20, width=32),
    numbers=st.tuples(*[st.integers(-1, 2**15 - 1)] * 2),
    directions=st.tuples(*[st.integers(-1, 1)] * 2),
    frame=TEXT,
)
def test_load_states_have_a_fixed_size(
    margin: float,
    ratio: float,
    limit: float,
    numbers: tuple[int, int],
    directions: tuple[int, int],
    frame: str,
) -> None:
    """A ROS 2 reader reads every field, and any values have 35 bytes with those of the header.

    These are 4 of the encapsulation, 8 of the stamp, 8 + 4 + 4 of the numbers, 2 + 2 of the
    indices, and 3 of the state and the directions.
    """
    from rclpy.serialization import deserialize_message

    from linkage_vibration_interfaces.msg import LoadState

    names = "relative_margin", "total_load_ratio", "load_ratio_limit", "excitation_index", "mode"
    values = dict(zip(names, (margin, ratio, limit, *numbers), strict=True))
    values |= {"state": 1, "quiet_speed_direction": directions[0]}
    values |= {"quiet_angle_direction": directions[1]}
    encoded = encode_message(LOAD_STATE, resonance(**values), -5, 7, frame)
    assert len(encoded) == 4 + 8 + 8 + 4 + 4 + 2 + 2 + 3
    message = deserialize_message(encoded, LoadState)
    assert (message.stamp.sec, message.stamp.nanosec) == (-5, 7)
    for name, value in values.items():
        np.testing.assert_equal(getattr(message, name), value)


@pytest.mark.parametrize(
    ("degrees", "words"),
    [
        (85.0, "85 deg is not in the table's 90 to 180 deg"),
        (480.0, "but 120 deg is: is the joint's zero a turn off?"),
        (-240.0, "but 120 deg is: is the joint's zero a turn off?"),
        (math.inf, "not a finite number"),
    ],
)
def test_faults_in_words(degrees: float, words: str) -> None:
    """The text describes the fault, and recognises an angle that is off by a turn."""
    status = Status.OUT_OF_RANGE if math.isfinite(degrees) else Status.INVALID_ANGLE
    none = np.full(3, math.nan)
    nan = math.nan
    prediction = Prediction(
        math.radians(degrees), status, none, none, none, none, nan, nan, nan, "table", none
    )
    text = fault(prediction, (math.pi / 2.0, math.pi))
    assert words in text
    assert ("turn off" in text) == ("turn off" in words)
