# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that the node subscribes to: one list for its arguments, its manual and its policy."""

from linkage_vibration.bags.can_frames import FRAME_TYPES
from linkage_vibration.bags.message_types import STRING
from linkage_vibration.messages.topics import NodeTopic
from linkage_vibration.prediction.inputs.presets import PRESETS

HITCHED_TOPIC = "hitched_implement"
"""Topic that names the implement on the hitch."""


def input_depth(type_name: str) -> int:
    """Return how many messages of a type wait at most; of frames, most are of other signals."""
    return 200 if type_name in FRAME_TYPES else 10


def _input_qos(type_name: str) -> str:
    return f"best effort, keep last {input_depth(type_name)}"


_PRESETS = [preset for presets in PRESETS.values() for preset in presets.values()]
_HITCHED = NodeTopic(
    HITCHED_TOPIC,
    STRING,
    f"{_input_qos(STRING)}; also latched",
    "The name of the implement on the hitch ([implements](services.md#implements-by-name)); "
    "subscribed if `implement_file` is given.",
    logged=False,
)
INPUT_TOPICS = (
    *(
        NodeTopic(one.topic, one.type, _input_qos(one.type), one.meaning)
        for one in {preset.topic: preset for preset in _PRESETS}.values()
    ),
    _HITCHED,
)
