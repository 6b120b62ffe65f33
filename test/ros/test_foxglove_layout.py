# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer's layout names topics of the node and fields of their types."""

import json
import re
from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from visualization_msgs.msg import MarkerArray

from linkage_vibration.support.resources import config_file
from linkage_vibration_interfaces.msg import Resonance, TableInfo, VibrationPrediction

TOPICS = {
    "/linkage_vibration/prediction": VibrationPrediction,
    "/linkage_vibration/resonance": Resonance,
    "/linkage_vibration/table_info": TableInfo,
    "/linkage_vibration/markers": MarkerArray,
    "/diagnostics": DiagnosticArray,
}
LAYOUT = json.loads(config_file("foxglove_layout.json").read_text())


def panels(layout: Any) -> Iterator[str]:
    """Return the panels of a layout."""
    if isinstance(layout, str):
        yield layout
    else:
        yield from panels(layout["first"])
        yield from panels(layout["second"])


def paths(config: Any) -> Iterator[str]:
    """Return every topic that a panel shows, with or without a field."""
    yield from (path["value"] for path in config.get("paths", ()))
    yield from config.get("topics", ())
    yield from (config[key] for key in ("topicPath", "topicToRender") if key in config)


def test_every_panel_is_shown_once() -> None:
    """The layout shows exactly the panels that are configured."""
    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
    kinds = {panel.split("!")[0] for panel in LAYOUT["configById"]}
    assert kinds == {"3D", "Plot", "StateTransitions", "DiagnosticSummary", "RawMessages"}


def test_every_topic_and_field_is_there() -> None:
    """Each path is a topic of the node and a field of its type, with an index for an array."""
    shown = [path for config in LAYOUT["configById"].values() for path in paths(config)]
    for path in shown:
        topic, _, field = path.partition(".")
        assert topic in TOPICS, path
        if field:
            name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()  # type: ignore[union-attr]
            kind = TOPICS[topic].get_fields_and_field_types()[name]
            assert (index is not None) == kind.startswith("sequence<"), path
    assert {path.partition(".")[0] for path in shown} == set(TOPICS)
