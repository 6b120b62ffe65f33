# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The bytes of predictions and resonances, and the descriptions of faults."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import ADVICE, LOAD_STATE, PREDICTION, RESONANCE
from linkage_vibration.prediction.predictor import Prediction, Status, fault
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

    values = {"natural_frequency": 2.0, "approach_rate": -4.0, "probability": 0.5}
    values |= {"excitation_frequency": number, "mode": mode}
    texts = {"excitation": excitation, "table_id": "0123456789ab"}
    known = resonance(**values, **texts)
    message = deserialize_message(encode_message(RESONANCE, known, 5, 7, frame), Message)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (5, 7)
    assert (message.header.frame_id, message.excitation) == (frame, excitation)
    assert message.excitation_frequency == number or math.isnan(number)
    actual = (message.natural_frequency, message.approach_rate, message.probability, message.mode)
    assert actual == (2.0, -4.0, 0.5, mode)
    assert message.table_id == "0123456789ab"


@given(
    numbers=st.tuples(st.floats(), st.floats()),
    ratios=st.tuples(*[st.floats(width=32)] * 3),
    small=st.tuples(*[st.integers(0, 255)] * 3),
    index=st.integers(-1, 2**15 - 1),
    count=st.integers(0, 2**32 - 1),
    by_receipt=st.booleans(),
    frame=TEXT,
)
def test_load_states_are_what_ros_reads(
    numbers: tuple[float, float],
    ratios: tuple[float, float, float],
    small: tuple[int, int, int],
    index: int,
    count: int,
    by_receipt: bool,
    frame: str,
) -> None:
    """A ROS 2 reader reads every field; but for the frame, the message has a fixed size.

    With an empty frame these are 4 bytes of the encapsulation, 16 of the header, 4 of the counter,
    4 of small numbers, 2 of the index and 2 to align, 12 of the ratios, and 16 of what is quiet.
    """
    from rclpy.serialization import deserialize_message

    from linkage_vibration_interfaces.msg import LoadState

    values: dict[str, Any] = dict(zip(("quiet_speed", "quiet_angle"), numbers, strict=True))
    names = "total_load_ratio", "load_ratio_limit", "known_share"
    values |= dict(zip(names, ratios, strict=True))
    values |= dict(zip(("state", "unknown_sources", "speed_source"), small, strict=True))
    values |= {"excitation_index": index, "count": count, "timed_by_receipt": by_receipt}
    known = resonance(**values)
    assert len(encode_message(LOAD_STATE, known, -5, 7, "")) == 60
    message = deserialize_message(encode_message(LOAD_STATE, known, -5, 7, frame), LoadState)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (-5, 7)
    assert message.header.frame_id == frame
    for name, value in values.items():
        assert getattr(message, name) == value or math.isnan(value)


@given(st.lists(st.lists(st.floats(width=32), min_size=7, max_size=7), min_size=4, max_size=4))
def test_places_of_advice_are_what_ros_reads(numbers: list[list[float]]) -> None:
    """A ROS 2 reader finds each number of each place in its field."""
    from rclpy.serialization import deserialize_message

    from linkage_vibration_interfaces.msg import Advice

    [kind] = [field.dtype for field in message_fields(ADVICE) if field.count]
    places = np.array([tuple(row) for row in numbers], kind)
    for texts in (("", "", ""), ("a", "bc", "def"), ("abcd", "efgh", "ijkl")):
        names = dict(zip(("table_id", "sentence", "not_counted"), texts, strict=True))
        advice = MessageColumns(**names, places=places)
        message = deserialize_message(encode_message(ADVICE, advice, 5, 7, "f"), Advice)
        assert (message.table_id, message.sentence, message.not_counted) == texts
        for place, row in zip(message.places, numbers, strict=True):
            values = [getattr(place, name) for name in place.get_fields_and_field_types()]
            np.testing.assert_array_equal(values, row)


@pytest.mark.parametrize(
    ("degrees", "words"),
    [
        (85.0, "85 deg is not in the table's 90 to 180 deg"),
        (840.0, "but 120 deg is: is the joint's zero turns off?"),
        (-600.0, "but 120 deg is: is the joint's zero turns off?"),
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
    assert ("turns off" in text) == ("turns off" in words)
