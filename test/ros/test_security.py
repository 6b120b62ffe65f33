# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The SROS 2 policy allows exactly what the node publishes and receives."""

from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

from linkage_vibration.prediction.inputs.presets import INPUT_TOPICS
from linkage_vibration.support.resources import share_directory

POLICY = share_directory() / "config" / "sros2" / "linkage_vibration.policy.xml"


def allowed(node: str, kind: str, verb: str) -> set[str]:
    """Return the names that the policy allows a node for a kind of endpoint."""
    profiles = f"enclaves/enclave/profiles/profile[@node='{node}']"
    profile = ElementTree.parse(POLICY).getroot().find(profiles)
    assert profile is not None
    assert profile.attrib["ns"] == "/"
    group = profile.find(f"{kind}s[@{verb}='ALLOW']")
    assert group is not None
    return {str(item.text) for item in group.findall(kind)}


def test_policy_is_the_nodes(start: Callable[..., Any], meet: Callable[[str], Any]) -> None:
    """The topics and services of a running node are those that the policy names."""
    start()
    peer = meet("linkage_vibration")

    def named(actual: list[tuple[str, list[str]]]) -> set[str]:
        own = "/linkage_vibration/"
        return {
            f"~/{name.removeprefix(own)}" if name.startswith(own) else name.removeprefix("/")
            for name, _ in actual
        }

    def without_actions(names: set[str]) -> set[str]:
        """Return names with actions in place of the topics and services that make them up."""
        return {name.partition("/_action/")[0] for name in names}

    chosen = {topic.name for topic in INPUT_TOPICS if topic.logged}

    # Parameters choose the inputs; the clock is received where time is simulated.
    def found() -> list[set[str]]:
        node, readings, graph = (
            ("linkage_vibration", "/"),
            ("linkage_vibration_readings", "/"),
            peer.node,
        )
        return [
            without_actions(named(graph.get_publisher_names_and_types_by_node(*node))),
            named(graph.get_subscriber_names_and_types_by_node(*node)) | {"clock"},
            without_actions(named(graph.get_service_names_and_types_by_node(*node))),
            named(graph.get_publisher_names_and_types_by_node(*readings)),
            named(graph.get_subscriber_names_and_types_by_node(*readings)) | chosen,
            named(graph.get_service_names_and_types_by_node(*readings)),
        ]

    actions = allowed("linkage_vibration", "action", "execute")
    expected = [
        allowed("linkage_vibration", "topic", "publish") | actions,
        allowed("linkage_vibration", "topic", "subscribe") - {"parameter_events"},
        allowed("linkage_vibration", "service", "reply") | actions,
        allowed("linkage_vibration_readings", "topic", "publish"),
        allowed("linkage_vibration_readings", "topic", "subscribe"),
        set(),
    ]
    peer.spin(lambda: found() == expected, "the endpoints of the policy")  # they come one by one
