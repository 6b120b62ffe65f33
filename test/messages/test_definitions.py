# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions and hashes of message types."""

from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.messages.definitions import DefinitionError, message_definition, type_hash

TYPES = [
    "linkage_vibration_interfaces/msg/VibrationPrediction",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/MultiDOFJointState",  # nests four levels deep and shares dependencies
    "std_msgs/msg/Float64",
]


@pytest.mark.parametrize("type_name", TYPES)
def test_definition_is_complete(type_name: str) -> None:
    """Another parser, given the definition alone, computes the hash that ROS 2 installed."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_definition(type_name), type_name))
    assert store.hash_rihs01(type_name) == type_hash(type_name)


def test_definition_names_each_dependency_once() -> None:
    """Dependencies follow in the layout that MCAP's ros2msg asks for."""
    definition = message_definition("sensor_msgs/msg/MultiDOFJointState")
    headings = [block.splitlines()[0] for block in definition.split("=" * 80 + "\n")[1:]]
    assert sorted(headings) == [
        "MSG: builtin_interfaces/Time",
        "MSG: geometry_msgs/Quaternion",
        "MSG: geometry_msgs/Transform",
        "MSG: geometry_msgs/Twist",
        "MSG: geometry_msgs/Vector3",
        "MSG: geometry_msgs/Wrench",
        "MSG: std_msgs/Header",
    ]


def test_types_of_the_same_package_and_arrays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unqualified types, arrays of each kind, constants and comments are recognised."""
    folder = tmp_path / "share" / "made_up" / "msg"
    folder.mkdir(parents=True)
    (folder / "Outer.msg").write_text(
        "# Wrong of a comment\n"
        "uint8 KIND=1 # Wrong\n"
        'string NAME="Wrong"\n'
        "Inner[] a\n"
        "made_up/Other[<=3]\tb\n"
        "\n"
        "float64[3] c\n"
    )
    (folder / "Inner.msg").write_text("Other[2] x\n")
    (folder / "Other.msg").write_text("string<=5 y\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    definition = message_definition("made_up/msg/Outer")
    assert [line for line in definition.splitlines() if line.startswith("MSG: ")] == [
        "MSG: made_up/Inner",
        "MSG: made_up/Other",
    ]
    assert type_hash("made_up/msg/Outer") == ""  # as before Iron, which brought the hashes


def test_missing_type_is_named() -> None:
    """The error names the missing file, the searched folders and the remedy."""
    with pytest.raises(DefinitionError, match=r"no_such_msgs/msg/Thing\.msg.*install no_such_msgs"):
        message_definition("no_such_msgs/msg/Thing")


def test_another_installed_version_of_our_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log describes the messages that this package encodes, whatever version is installed."""
    kind = "linkage_vibration_interfaces/msg/Resonance"
    definition, correct = message_definition(kind), type_hash(kind)
    folder = tmp_path / "share" / "linkage_vibration_interfaces" / "msg"
    folder.mkdir(parents=True)
    (folder / "Resonance.msg").write_text("uint8 state\n")
    (folder / "Resonance.json").write_text('{"type_hashes": []}')
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert (message_definition(kind), type_hash(kind)) == (definition, correct)
