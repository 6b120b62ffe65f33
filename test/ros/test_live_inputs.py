# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of installed types are those of their definitions."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from linkage_vibration.bags.schemas import NUMBERS, SchemaField, schema_of_text
from linkage_vibration.messages.definitions import message_definition
from linkage_vibration.prediction.settings import ParameterError, Parameters, with_values
from linkage_vibration.readers.sensors import SensorError, live_sensors
from linkage_vibration.ros.live_inputs import installed_schema, live_topics

PACKAGES = ("sensor_msgs", "std_msgs", "geometry_msgs", "diagnostic_msgs", "rcl_interfaces")


def plain(fields: tuple[SchemaField, ...]) -> list[tuple[str, str, int | None]]:
    """Return fields with one name for each kind of number."""
    return [(each.name, NUMBERS.get(each.type, each.type), each.length) for each in fields]


@pytest.mark.parametrize("package", PACKAGES)
def test_installed_types(package: str) -> None:
    """Rosidl describes each installed type as its text does, also nested and bounded fields."""
    names = [name for name in vars(import_module(f"{package}.msg")) if name[0].isupper()]
    assert names
    for name in names:
        type_name = f"{package}/msg/{name}"
        expected = schema_of_text(message_definition(type_name), type_name)
        actual = installed_schema(type_name)
        assert actual.keys() == expected.keys()
        for each, fields in actual.items():
            if "wstring" not in str(fields):  # rosbags takes it for a message
                assert plain(fields) == plain(expected[each])


def test_inputs_of_one_topic() -> None:
    """Inputs that read one topic share it, unless their types differ."""
    same = {"hitch_topic": "s", "engine_topic": "s", "engine_type": "sensor_msgs/JointState"}
    settings = with_values(Parameters(), {**same, "engine_field": "velocity[crankshaft]"})
    topics = live_topics(settings, lambda name: f"/{name}")
    assert list(topics) == ["/s", "/pto_speed", "/ground_speed"]
    assert topics["/s"].crank is not None
    assert len(topics["/s"].speeds) == 1
    with pytest.raises(
        ParameterError, match=r"topic /s is read as std_msgs/msg/Float64 and as sen"
    ):
        live_topics(with_values(Parameters(), {**same, "engine_type": ""}), lambda name: f"/{name}")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("topic: /imu", ""),
        ("topic: /imu, type: Imu", "Key type of the sensor imu: the type Imu is not installed"),
        ("topic: /imu, type: sensor_msgs/msg/Nope", "type sensor_msgs/msg/Nope is not installed"),
        ("topic: /joint_states", "Key type of the sensor imu: topic /joint_states is read as sens"),
        ("file: imu.csv", "imu is in a CSV file, which only `linkage-vibration listen` reads"),
    ],
)
def test_sensors_of_a_running_node(tmp_path: Path, text: str, problem: str) -> None:
    """A sensor needs a topic of an installed type; an error names the fault."""
    file = tmp_path / "sensors.yaml"
    file.write_text(f"imu: {{{text}, unit: g, at: E1}}\n")

    def resolve(name: str) -> str:
        return f"/{name.lstrip('/')}"

    if not problem:
        topics = live_topics(Parameters(), resolve, live_sensors(file))
        assert [place for place, _ in topics["/imu"].sensors] == [0]
        return
    with pytest.raises((ParameterError, SensorError), match=re.escape(problem)):
        live_topics(Parameters(), resolve, live_sensors(file))
