# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's topics: their names, their types, and what a log has to know of one."""

from linkage_vibration.bags.writing import QUEUE_DEPTH, Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import DefinitionError, message_definition, type_hash
from linkage_vibration.prediction.excitation import Source

JOINT_STATES, HITCH_POSITION = "joint_states", "hitch_position"
SPEEDS = {"engine_speed": Source.ENGINE, "pto_speed": Source.PTO, "ground_speed": Source.GROUND}
PREDICTION_TOPIC = "/linkage_vibration/prediction"  # unless the node has another name
RESONANCE_TOPIC = "/linkage_vibration/resonance"

PREDICTION = "linkage_vibration_interfaces/msg/VibrationPrediction"
RESONANCE = "linkage_vibration_interfaces/msg/Resonance"


def log_topic(name: str, type_name: str) -> Topic:
    """Return what a log has to know of a topic.

    Raises
    ------
    DefinitionError
        If its type is not installed, and rosbags does not know it either.
    """
    # Played back as reliable, a log reaches subscribers of either kind.
    qos = offered_qos_profiles(reliable=True, depth=QUEUE_DEPTH)
    return Topic(name, type_name, *_definition(type_name), qos)


def _definition(type_name: str) -> tuple[str, str]:
    """Return a type's definition and hash; where ROS 2 is not installed, as rosbags has them."""
    try:
        return message_definition(type_name), type_hash(type_name)
    except DefinitionError as error:
        missing = error
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise missing from None
    store = get_typestore(Stores.LATEST)
    if type_name not in store.fielddefs:
        raise missing
    return store.generate_msgdef(type_name, ros_version=2)[0], store.hash_rihs01(type_name)
