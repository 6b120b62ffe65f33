# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of our messages."""

from pathlib import Path

import pytest

from linkage_vibration.messages.definitions import OWN_PACKAGE
from linkage_vibration.messages.fields import Field, message_fields
from linkage_vibration.messages.topics import (
    ADVICE,
    LEVELS,
    LOAD_STATE,
    MEASURED,
    PREDICTION,
    RESONANCE,
    TABLE_INFO,
)
from linkage_vibration.support.resources import share_directory

PLACE, MEASUREMENT = (f"{OWN_PACKAGE}/msg/{name}" for name in ("AdvisedPlace", "Measurement"))
MESSAGES = [PREDICTION, RESONANCE, LEVELS, LOAD_STATE, ADVICE, PLACE, MEASURED, TABLE_INFO]
MESSAGES.append(MEASUREMENT)


@pytest.mark.parametrize("kind", MESSAGES)
def test_fields_are_those_of_the_generated_class(kind: str) -> None:
    """The fields at the top have the names and order of the class that ROS 2 generates."""
    from linkage_vibration.ros.endpoints import message_class

    names = dict.fromkeys(field.name.split(".")[0] for field in message_fields(kind))
    assert list(names) == list(message_class(kind).get_fields_and_field_types())


def test_nested_fields_and_sequences() -> None:
    """A header is flattened, and a sequence is marked."""
    fields = message_fields(PREDICTION)
    assert fields[:3] == (
        Field("header.stamp.sec", "int32", False),
        Field("header.stamp.nanosec", "uint32", False),
        Field("header.frame_id", "string", False),
    )
    assert Field("natural_frequencies", "float64", True) in fields


@pytest.mark.parametrize("kind", MESSAGES)
def test_sequences_are_bounded(kind: str) -> None:
    """The limits are those of the class that ROS 2 generates, and no sequence is without one."""
    from linkage_vibration.ros.endpoints import message_class

    types = message_class(kind).get_fields_and_field_types()
    limits = {
        name: int(text.rstrip(">").rpartition(", ")[2])
        for name, text in types.items()
        if text.startswith("sequence")
    }
    fields = [field for field in message_fields(kind) if field.is_sequence]
    assert {field.name: field.limit for field in fields} == limits
    assert (limits == {}) == (kind in (RESONANCE, LOAD_STATE, ADVICE, PLACE, MEASUREMENT))


def test_every_message_has_a_topic_or_a_name() -> None:
    """No message definition is forgotten."""
    actual = {path.stem for path in Path(share_directory()).glob("*_interfaces/msg/*.msg")}
    assert actual == {kind.split("/")[-1] for kind in MESSAGES}
