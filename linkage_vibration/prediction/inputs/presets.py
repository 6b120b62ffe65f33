# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What tractors publish: presets of the inputs, by name."""

import math
from dataclasses import dataclass

from linkage_vibration.bags.message_types import CAN_FRAME, FLOAT64, ISOBUS_FRAME, JOINT_STATE
from linkage_vibration.messages.topics import MEASUREMENT

HITCH, ENGINE, PTO, GROUND = ("hitch", "engine", "pto", "ground")
"""The inputs, of which the last three are the values of `Source`."""
PLAIN_TYPES = FLOAT64, MEASUREMENT
"""Types whose messages can be any input, so that only the name of their topic says which."""

_HIGHEST_RPM = 8031.875  # 0xFAFF steps of 0.125 rpm; higher values mean "error" or "not available"
_HIGHEST_SPEED = 64.255  # m/s, the same in steps of 0.001 m/s


@dataclass(frozen=True, slots=True)
class Preset:
    """What an input reads unless parameters say otherwise."""

    topic: str
    type: str
    field: str  # ``{joint_name}`` stands for the parameter joint_name
    unit: str
    meaning: str  # a sentence for the manual
    low: float = -math.inf  # a number outside of this range means that the value is not available
    high: float = math.inf


def _number(name: str, unit: str) -> Preset:
    return Preset(f"{name}_speed", FLOAT64, "data", unit, f"Speed in {unit}.")


def _measured(what: str, unit: str) -> Preset:
    meaning = f"The {what.replace('_', ' ')} in {unit}, with a stamp and a flag that it is valid."
    return Preset(f"measured_{what}", MEASUREMENT, "value", unit, meaning)


def _can(signal: str, unit: str) -> Preset:
    """Return the preset of a signal of ISO 11783-7 or J1939, on the topic of ros2_socketcan."""
    meaning = "Frames of the CAN bus, which all inputs with the preset `can` share."
    return Preset("from_can_bus", CAN_FRAME, signal, unit, meaning)


_TECU = "ISOBUS/tecu"

PRESETS: dict[str, dict[str, Preset]] = {
    HITCH: {
        "joint_states": Preset(
            "joint_states",
            JOINT_STATE,
            "position[{joint_name}]",
            "rad",
            "The node finds the joint by its name, in any order.",
        ),
        "percent": Preset(
            "hitch_position",
            FLOAT64,
            "data",
            "percent",
            "The ISO 11783 rear hitch position, from 0 (down) to 100 (up).",
        ),
        "ros2_isobus": Preset(
            f"{_TECU}/rear_hitch_status",
            "ros2_isobus/msg/TecuRearHitchStatus",
            "position_percent",
            "percent",
            "The rear hitch position of ROS2ISOBUS, where 102 means that it is not available.",
            0.0,
            100.0,
        ),
        "can": _can("rear_hitch_position", "percent"),
        "measurement": _measured("hitch_angle", "rad"),
    },
    ENGINE: {
        "float64": _number("engine", "rpm"),
        "ros2_isobus": Preset(
            "ISOBUS/bus_rx_frames",
            ISOBUS_FRAME,
            "engine_speed",
            "rpm",
            "Frames of the CAN bus that ROS2ISOBUS receives, by which the engine speed comes.",
        ),
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
            "The rear PTO speed of ROS2ISOBUS.",
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
            "The ground speed of ROS2ISOBUS, negative in reverse.",
            -_HIGHEST_SPEED,
            _HIGHEST_SPEED,
        ),
        "can": _can("wheel_based_speed", "m/s"),
        "measurement": _measured("ground_speed", "m/s"),
    },
}
"""The presets of each input, of which the first is the default."""
