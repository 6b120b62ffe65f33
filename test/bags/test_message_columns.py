# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Columns equal the fields of messages that are decoded one by one."""

from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_columns import LOG_TIME, read_columns, topic_types
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.writing import Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.support.resources import config_file
from test.support.messages import read_messages, resonance

RESONANCE = "linkage_vibration_interfaces/msg/Resonance"
NUMBERS = ("excitation_frequency", "probability", "approach_rate")
QOS = offered_qos_profiles()


def topic(name: str, definition: str | None = None) -> Topic:
    """Return a topic of resonances."""
    return Topic(
        name, RESONANCE, definition or message_definition(RESONANCE), type_hash(RESONANCE), QOS
    )


def test_strings_of_any_length(tmp_path: Path) -> None:
    """Names of several lengths, some with the same padded size, are read in their order."""
    names = ["a", "engine 1.5", "", "abc", "abcd", "pto 2", "ab"] * 50
    path = tmp_path / "log.mcap"
    with LogWriter(path, [topic("/r")]) as log:
        for k, name in enumerate(names):
            numbers = {"mode": k}
            for i, field in enumerate(NUMBERS):
                numbers[field] = k + i
            message = resonance(excitation=name, table_id="t", **numbers)
            log.write("/r", encode_message(RESONANCE, message, k, 7 * k, "frame"[: k % 5]), k, k)
    columns = read_columns(path, topic_types(path))["/r"]
    messages = [message for _, message in read_messages(path, "/r")]
    assert columns["excitation"].tolist() == names
    np.testing.assert_array_equal(columns[LOG_TIME], np.arange(len(names)))
    for name in ("mode", *NUMBERS):
        np.testing.assert_array_equal(columns[name], [getattr(m, name) for m in messages], name)
    np.testing.assert_array_equal(columns["header.stamp.nanosec"], 7 * np.arange(len(names)))
    assert columns["header.frame_id"].tolist() == [m.header.frame_id for m in messages]


def test_numbers_of_the_shipped_drive() -> None:
    """Numbers are read from a bag that has other topics too."""
    path = config_file("drives/hitch_duty_cycle.mcap")
    columns = read_columns(path, {"/engine_speed": "std_msgs/msg/Float64"})["/engine_speed"]
    expected = [message.data for _, message in read_messages(path, "/engine_speed")]
    np.testing.assert_array_equal(columns["data"], expected)
    assert len(expected) == 200


def test_empty_topic(tmp_path: Path) -> None:
    """A topic without messages has empty columns."""
    with LogWriter(tmp_path / "log.mcap", [topic("/r")]):
        pass
    columns = read_columns(tmp_path / "log.mcap", {"/r": RESONANCE})["/r"]
    assert columns["natural_frequency"].shape == columns[LOG_TIME].shape == (0,)


@pytest.mark.parametrize("data", [b"\0\1\0\0" + bytes(8), b"\0\1\0\0" + b"\xff" * 90])
def test_invalid_messages(tmp_path: Path, data: bytes) -> None:
    """The error for a message that does not match its type names the file and the topic."""
    path = tmp_path / "log.mcap"
    with LogWriter(path, [topic("/r")]) as log:
        log.write("/r", data, 1, 1)
    with pytest.raises(BagError, match=r"log\.mcap: a message on /r does not match"):
        read_columns(path, {"/r": RESONANCE})


def test_unsupported_fields(tmp_path: Path) -> None:
    """The error for a list of texts names the field."""
    path = tmp_path / "log.mcap"
    with LogWriter(path, [topic("/r", "string[] names")]):
        pass
    with pytest.raises(BagError, match=r"field names of .* is not a number, text"):
        read_columns(path, {"/r": RESONANCE})
