# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that the node publishes: one list for its log, its manual and its policy."""

from dataclasses import dataclass

from linkage_vibration.bags.writing import Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import OWN_PACKAGE, message_definition, type_hash

PREDICTION = f"{OWN_PACKAGE}/msg/VibrationPrediction"
RESONANCE = f"{OWN_PACKAGE}/msg/Resonance"
LEVELS = f"{OWN_PACKAGE}/msg/Levels"
LOAD_STATE = f"{OWN_PACKAGE}/msg/LoadState"
ASSESSED = RESONANCE, LEVELS, LOAD_STATE  # about an assessed reading, in their order in a log
ADVICE = f"{OWN_PACKAGE}/msg/Advice"
MEASURED = f"{OWN_PACKAGE}/msg/MeasuredVibration"
TABLE_INFO = f"{OWN_PACKAGE}/msg/TableInfo"
MEASUREMENT = f"{OWN_PACKAGE}/msg/Measurement"  # The type of our own messages for inputs

PREDICTION_TOPIC = "/linkage_vibration/prediction"  # also of a node with its default name
RESONANCE_TOPIC = "/linkage_vibration/resonance"
LEVELS_TOPIC = "/linkage_vibration/levels"
LOAD_STATE_TOPIC = "/linkage_vibration/load_state"


@dataclass(frozen=True, slots=True)
class NodeTopic:
    """A topic that the node subscribes to or publishes."""

    name: str  # ``~/`` stands for the name of the node
    type: str
    meaning: str = ""  # a sentence for the manual
    latched: bool = False  # later subscribers receive the last message
    logged: bool = True  # by the node


OUTPUT_TOPICS = (
    NodeTopic(
        "~/prediction",
        PREDICTION,
        "One prediction for each reading, or at `prediction_rate`, with the stamp and the frame of "
        "the reading.",
    ),
    NodeTopic(
        "~/resonance",
        RESONANCE,
        "At `resonance_rate`, once a speed is known, for the most severe of five readings "
        "([windows](#windows)): the [excitation](excitation.md) that loads the linkage most, and "
        "the nearest natural frequency.",
    ),
    NodeTopic(
        "~/levels",
        LEVELS,
        "With each resonance: how strongly each excitation, and all together, load pins and "
        "cylinders and shake the response point.",
    ),
    NodeTopic(
        "~/load_state",
        LOAD_STATE,
        "For controllers, with each resonance, and once a second while there is none "
        "([load state](#what-a-controller-subscribes-to)).",
    ),
    NodeTopic(
        "~/advice",
        ADVICE,
        "Once a second while the total load ratio exceeds its limit: at which height and ground "
        "speed it would be smaller ([advice](advice.md)). It commands nothing.",
        latched=True,
    ),
    NodeTopic(
        "~/measured",
        MEASURED,
        "Once a second for each sensor of `sensor_file`: the measured and the predicted vibration "
        "([while you drive](measure_your_hitch.md#while-you-drive)).",
    ),
    NodeTopic(
        "~/table_info",
        TABLE_INFO,
        "The table in use and its mechanism, as YAML; published again when the table changes.",
        latched=True,
        logged=False,
    ),
    NodeTopic(
        "/diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        "At 1 Hz: what is wrong ([Diagnostics](#diagnostics)).",
        logged=False,
    ),
)


def log_topic(name: str, type_name: str, *, latched: bool = False) -> Topic:
    """Return what a log stores about a topic; a latched one keeps its last message."""
    # `ros2 bag play` then publishes as reliable, which reaches subscribers of both kinds.
    qos = offered_qos_profiles(latched=latched)
    return Topic(name, type_name, message_definition(type_name), type_hash(type_name), qos)
