# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What tractors publish: presets of the inputs, by name."""

import math
from dataclasses import dataclass

from linkage_vibration.bags.message_types import CAN_FRAME, FLOAT64, ISOBUS_FRAME, JOINT_STATE
from linkage_vibration.messages.topics import MEASUREMENT, NodeTopic

HITCH, ENGINE, PTO, GROUND = ("hitch", "engine", "pto", "ground")
"""The inputs, of which the last three are the values of `Source`."""
PLAIN_TYPES = FLOAT64, MEASUREMENT  # can be any input; only the name of their topic says which

_HIGHEST_RPM = 8031.875  # 0xFAFF steps of 0.125 rpm; higher values mean "error" or "not available"
_HIGHEST_SPEED = 64.255  # m/s, the same in steps of 0.001 m/s


@dataclass(frozen=True, slots=True)
class Preset:
    """What an input reads unless parameters say otherwise."""

    topic: str
    type: str
    field: str  # ``{joint_name}`` stands for the parameter joint_name
    unit: str
    low: float = -math.inf  # a number outside of this range means that the value is not available
    high: float = math.inf


def _number(name: str, unit: str) -> Preset:
    return Preset(f"{name}_speed", FLOAT64, "data", unit)


def _measured(what: str, unit: str) -> Preset:
    return Preset(f"measured_{what}", MEASUREMENT, "value", unit)


def _can(signal: str, unit: str) -> Preset:
    """Return the preset of a signal of ISO 11783-7 or J1939, on the topic of ros2_socketcan."""
    return Preset("from_can_bus", CAN_FRAME, signal, unit)


_TECU = "ISOBUS/tecu"

PRESETS: dict[str, dict[str, Preset]] = {
    HITCH: {
        "joint_states": Preset("joint_states", JOINT_STATE, "position[{joint_name}]", "rad"),
        "percent": Preset("hitch_position", FLOAT64, "data", "percent"),  # 0 is down
        "ros2_isobus": Preset(
            f"{_TECU}/rear_hitch_status",
            "ros2_isobus/msg/TecuRearHitchStatus",
            "position_percent",
            "percent",
            0.0,
            100.0,
        ),
        "can": _can("rear_hitch_position", "percent"),
        "measurement": _measured("hitch_angle", "rad"),
    },
    ENGINE: {
        "float64": _number("engine", "rpm"),
        "ros2_isobus": Preset("ISOBUS/bus_rx_frames", ISOBUS_FRAME, "engine_speed", "rpm"),
        "can": _can("engine_speed", "rpm"),
        "measurement": _measured("engine_speed", "rad/s"),
    },
    PTO: {
        "float64": _number("pto", "rpm"),
        "ros2_isobus": Preset(
            f"{_TECU}/rear_pto_status",
            "ros2_isobus/msg/TecuRearPtoStatus",
            "rpm",
            "rpm",
            0.0,
            _HIGHEST_RPM,
        ),
        "can": _can("rear_pto_speed", "rpm"),
        "measurement": _measured("pto_speed", "rad/s"),
    },
    GROUND: {
        "float64": _number("ground", "m/s"),
        "ros2_isobus": Preset(
            f"{_TECU}/ground_speed",
            "ros2_isobus/msg/TecuGroundSpeed",
            "speed_ms",
            "m/s",
            -_HIGHEST_SPEED,
            _HIGHEST_SPEED,
        ),
        "can": _can("wheel_based_speed", "m/s"),
        "measurement": _measured("ground_speed", "m/s"),
    },
}
"""The presets of each input, of which the first is the default."""

INPUT_DEPTH = 200  # messages of an input wait at most; a busy machine pauses the node for 0.1 s

_BY_TOPIC = {each.topic: each for presets in PRESETS.values() for each in presets.values()}
INPUT_TOPICS = tuple(NodeTopic(preset.topic, preset.type) for preset in _BY_TOPIC.values())
"""The topics that the node subscribes to: one list for its arguments and its policy."""
