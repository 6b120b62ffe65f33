# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's topics: their names, their types, and what a log has to know of one."""

from linkage_vibration.bags.writing import QUEUE_DEPTH, Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.prediction.excitation import Source

JOINT_STATES, HITCH_POSITION = "joint_states", "hitch_position"
SPEEDS = {"engine_speed": Source.ENGINE, "pto_speed": Source.PTO, "ground_speed": Source.GROUND}
PREDICTION_TOPIC = "/linkage_vibration/prediction"  # unless the node has another name
RESONANCE_TOPIC = "/linkage_vibration/resonance"

PREDICTION = "linkage_vibration_interfaces/msg/VibrationPrediction"
RESONANCE = "linkage_vibration_interfaces/msg/Resonance"
TABLE_INFO = "linkage_vibration_interfaces/msg/TableInfo"


def log_topic(name: str, type_name: str) -> Topic:
    """Return what a log has to know of a topic.

    Raises
    ------
    DefinitionError
        If its type is not installed, and rosbags does not know it either.
    """
    # Played back as reliable, a log reaches subscribers of either kind.
    qos = offered_qos_profiles(reliable=True, depth=QUEUE_DEPTH)
    return Topic(name, type_name, message_definition(type_name), type_hash(type_name), qos)
