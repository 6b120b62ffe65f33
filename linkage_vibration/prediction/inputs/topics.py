# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that the node subscribes to: one list for its arguments, its manual and its policy."""

from linkage_vibration.messages.topics import INPUT_QOS, NodeTopic
from linkage_vibration.prediction.inputs.presets import PRESETS

HITCHED_TOPIC = "hitched_implement"
"""Topic that names the implement on the hitch."""

_PRESETS = [preset for presets in PRESETS.values() for preset in presets.values()]
_HITCHED = NodeTopic(
    HITCHED_TOPIC,
    "std_msgs/msg/String",
    f"{INPUT_QOS}; also latched",
    "The name of the implement on the hitch ([implements](services.md#implements-by-name)); "
    "subscribed if `implement_file` is given.",
    logged=False,
)
INPUT_TOPICS = (
    *(
        NodeTopic(one.topic, one.type, INPUT_QOS, one.meaning)
        for one in {preset.topic: preset for preset in _PRESETS}.values()
    ),
    _HITCHED,
)
