# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that the node subscribes to: one list for its arguments and its policy."""

from linkage_vibration.messages.topics import NodeTopic
from linkage_vibration.prediction.inputs.presets import PRESETS

INPUT_DEPTH = 200
"""How many messages of an input wait at most: a busy machine pauses the node for 0.1 s."""

_PRESETS = [preset for presets in PRESETS.values() for preset in presets.values()]
INPUT_TOPICS = tuple(
    NodeTopic(preset.topic, preset.type)
    for preset in {preset.topic: preset for preset in _PRESETS}.values()
)
