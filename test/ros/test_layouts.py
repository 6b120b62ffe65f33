# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The layouts for viewers name topics of the node and fields of their types."""

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from linkage_vibration_interfaces.msg import (
    Levels,
    LoadState,
    Resonance,
    TableInfo,
    VibrationPrediction,
)

TOPICS = {
    "/linkage_vibration/prediction": VibrationPrediction,
    "/linkage_vibration/resonance": Resonance,
    "/linkage_vibration/load_state": LoadState,
    "/linkage_vibration/levels": Levels,
    "/linkage_vibration/table_info": TableInfo,
    "/diagnostics": DiagnosticArray,
}
FIELDS = {topic: kind.get_fields_and_field_types() for topic, kind in TOPICS.items()}
LAYOUTS = "foxglove_layout.json", "plotjuggler_layout.xml"
LAYOUT = json.loads(config_file(LAYOUTS[0]).read_text())


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
    assert kinds == {"Plot", "StateTransitions", "DiagnosticSummary", "RawMessages"}


def test_every_topic_and_field_is_there() -> None:
    """Each path is a topic of the node and a field of its type, with an index for an array."""
    shown = [path for config in LAYOUT["configById"].values() for path in paths(config)]
    for path in shown:
        topic, _, field = path.partition(".")
        assert topic in TOPICS, path
        if field:
            name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()  # type: ignore[union-attr]
            kind = FIELDS[topic][name]
            assert (index is not None) == kind.startswith("sequence<"), path
    assert {path.partition(".")[0] for path in shown} == set(TOPICS)


def is_field(topic: str, path: str) -> bool:
    """Return whether a path such as ``natural_frequencies[0]`` is a number of a topic's type."""
    match = re.fullmatch(r"(\w+)(\[\d+\])?", path)
    kinds = FIELDS[topic]
    return match is not None and kinds[match[1]].startswith("sequence<") == (match[2] is not None)


def test_ground_is_shown_with_the_limit() -> None:
    """Both layouts show the load of the ground, its limit, and what is not known.

    The index of the ground is that in the shipped file of excitations.
    """
    every = read_excitations(config_file("excitations.yaml"))
    [ground] = [i for i, each in enumerate(every) if each.terrain]
    shown = {path for config in LAYOUT["configById"].values() for path in paths(config)}
    root = ET.parse(config_file(LAYOUTS[1])).getroot()
    curves = {curve.attrib["name"] for curve in root.iter("curve")}
    expected = {
        ("levels", f"load_ratios[{ground}]"),
        ("load_state", "load_ratio_limit"),
        ("load_state", "unknown_sources"),
    }
    assert {f"/linkage_vibration/{topic}.{field}" for topic, field in expected} <= shown
    assert {f"/linkage_vibration/{topic}/{field}" for topic, field in expected} <= curves
    assert "/linkage_vibration/levels.ground_unknown" in shown


def test_modes_are_those_in_the_plane() -> None:
    """Both layouts show them of the shipped tractor, and labels count them from 1."""
    vertical = np.flatnonzero(~load_table().lateral_modes)
    texts = [config_file(name).read_text() for name in LAYOUTS]
    for kind in ("natural_frequencies", "frequency_stddevs", "damping_ratios"):
        for text in texts:
            shown = [int(each) for each in re.findall(rf"{kind}\[(\d+)\]", text)]
            assert shown == vertical[len(vertical) - len(shown) :].tolist()
    labels = re.findall(r'\[(\d+)\]",\s*"label": "mode (\d+)"', texts[0])
    assert len(labels) == 8
    assert all(int(index) + 1 == int(label) for index, label in labels)


def test_curves_of_plotjuggler() -> None:
    """Each curve of its layout is a field of a topic; titles and tabs are not empty."""
    root = ET.parse(config_file(LAYOUTS[1])).getroot()
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) == len(set(curves)) > 20
    for curve in curves:
        topic, _, path = curve.rpartition("/")
        assert is_field(topic, path), curve
    assert all(tab.attrib["tab_name"] for tab in root.iter("Tab"))
    for splitter in root.iter("DockSplitter"):
        areas = splitter.findall("DockArea")
        assert (
            int(splitter.attrib["count"]) == len(areas) == len(splitter.attrib["sizes"].split(";"))
        )
        assert all(area.attrib["name"] for area in areas)
