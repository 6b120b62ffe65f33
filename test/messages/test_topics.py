# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The definition and hash of a topic's type in a log, with ROS 2 and without."""

import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.messages.topics import (
    OUTPUT_TOPICS,
    PREDICTION,
    RESONANCE,
    TABLE_INFO,
    NodeTopic,
    log_topic,
)
from linkage_vibration.prediction.inputs.presets import INPUT_TOPICS
from linkage_vibration.support.resources import config_file, share_directory


@pytest.mark.parametrize("kind", [JOINT_STATE, FLOAT64, PREDICTION, RESONANCE])
def test_log_has_the_installed_definition(kind: str) -> None:
    """Definition and hash are those that the type's package installs."""
    topic = log_topic("/a", kind)
    assert (topic.name, topic.type) == ("/a", kind)
    assert (topic.definition, topic.type_hash) == (message_definition(kind), type_hash(kind))


@pytest.mark.parametrize("kind", [JOINT_STATE, FLOAT64, PREDICTION, RESONANCE, TABLE_INFO])
def test_definitions_without_ros(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where ROS 2 is not installed, a definition has the same fields and hash as where it is."""
    installed = log_topic("/a", kind)
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    topic = log_topic("/a", kind)
    assert topic.definition != installed.definition
    assert topic.type_hash == installed.type_hash
    for each in (topic, installed):
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(each.definition, kind))
        assert store.hash_rihs01(kind) == installed.type_hash


def test_manual_has_the_table_of_topics() -> None:
    """The manual and the node have one list of the topics that it publishes."""
    manual = (share_directory() / "docs" / "node.md").read_text()
    kinds = [t.type.removeprefix("linkage_vibration_interfaces/msg/") for t in OUTPUT_TOPICS]
    rows = [
        f"| `{t.name}` | `{kind}` | {t.meaning} |"
        for t, kind in zip(OUTPUT_TOPICS, kinds, strict=True)
    ]
    assert "\n".join(["| topic | type | meaning |", "|---|---|---|", *rows]) + "\n" in manual
    latched = " and ".join(f"`{t.name}`" for t in OUTPUT_TOPICS if t.latched)
    assert f"{latched} are transient local" in manual


@pytest.mark.parametrize(
    ("verb", "topics", "of_rclpy"),
    [
        ("subscribe", INPUT_TOPICS, {"clock", "parameter_events"}),
        ("publish", OUTPUT_TOPICS, {"~/transition_event", "rosout", "parameter_events"}),
    ],
)
def test_security_policy_allows_the_topics(
    verb: str, topics: tuple[NodeTopic, ...], of_rclpy: set[str]
) -> None:
    """The policy allows the topics of the list and those that rclpy adds, and no others."""
    policy = ElementTree.parse(config_file("sros2/linkage_vibration.policy.xml"))
    allowed = {topic.text for topic in policy.findall(f".//topics[@{verb}='ALLOW']/topic")}
    assert allowed == {topic.name.removeprefix("/") for topic in topics} | of_rclpy
