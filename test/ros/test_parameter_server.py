# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Declaring and setting parameters."""

from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from linkage_vibration.prediction.parameter_files import has_parameters, read_parameters
from linkage_vibration.prediction.settings import NODE_NAME, ParameterError, Parameters
from linkage_vibration.ros.log_control import log_folder
from linkage_vibration.ros.parameter_server import changed, declare_parameters, new_values


@pytest.mark.parametrize(
    "text",
    [
        "/**: {ROS: {hitch_sign: -1, hitch_scale: 1e-3, hitch_offset: 2, joint_name: arm}}",
        "/**: {ROS: {joint_name: 1e3_arm, hitch_sign: -1}}",
        "linkage_vibration: {ROS: {calibration: [0, 3, 100, 1]}}",
        "/linkage_vibration: {ROS: {hitch_scale: 3.}}\n/**: {ROS: {hitch_scale: 2.}}",
        "/**: {ROS: {hitch_scale: 2.}}\n/linkage_vibration: {ROS: {hitch_scale: 3.}}",
        "/*: {ROS: {hitch_sign: -1}}\n/**/linkage_vibration: {ROS: {hitch_scale: .5}}",
        "/a/linkage_vibration: {ROS: {hitch_sign: -1}}\n/**: {ROS: {hitch_scale: 2.}}",
        "/*/linkage_vibration: {ROS: {hitch_sign: -1}}\n/**: {ROS: {hitch_scale: 2e0}}",
        "a: {linkage_vibration: {ROS: {hitch_sign: -1}}}\n/**: {ROS: {hitch_scale: 2}}",
        "/**: {ROS: {use_sim_time: false, qos_overrides: {a: 1}, hitch_offset: -.5E+1}}",
    ],
)
def test_a_file_means_the_same_to_node_and_replay(
    environment: dict[str, str], tmp_path: Path, text: str
) -> None:
    """Our reader gives the values that rclpy gives a node that is started with the file."""
    path = tmp_path / "params.yaml"
    path.write_text(text.replace("ROS", "ros__parameters"))
    context = Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    node = Node(NODE_NAME, context=context, automatically_declare_parameters_from_overrides=True)
    try:
        given = declare_parameters(node)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert read_parameters(path) == given != Parameters()


SECTIONS = ["a", "/a", "/ns/a", "ns/a", "/*/a", "/**/a", "/**", "/*", "/ns/*", "/ns/b", "/**/b"]


@pytest.mark.parametrize("opened", [f"{section}: {{" for section in SECTIONS] + ["ns: {a: {"])
def test_sections_of_a_node(environment: dict[str, str], tmp_path: Path, opened: str) -> None:
    """A file has parameters for a node exactly if rclpy takes some from it."""
    path = tmp_path / "params.yaml"
    path.write_text(f"{opened} ros__parameters: {{hitch_sign: -1}} " + "}" * opened.count("{"))
    context = Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    options: Any = {"automatically_declare_parameters_from_overrides": True}
    node = Node("a", namespace="ns", context=context, start_parameter_services=False, **options)
    try:
        assert has_parameters(path, "/ns/a") == node.has_parameter("hitch_sign")
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_log_directory_must_be_a_folder(tmp_path: Path) -> None:
    """A folder that does not exist, or a file, is refused before recording starts."""
    assert log_folder(Parameters(log_directory=str(tmp_path))) == tmp_path
    (tmp_path / "file").touch()
    for name in ("missing", "file"):
        with pytest.raises(ParameterError, match=f"log_directory must be a folder.*{name}; create"):
            log_folder(Parameters(log_directory=str(tmp_path / name)))


def test_what_may_be_set() -> None:
    """Live parameters may be set at any time, others only while the node is not configured."""
    settings = Parameters()
    live, other = Parameter("near_margin", value=0.2), Parameter("log_directory", value="/tmp")
    assert changed(settings, [live], configured=True).near_margin == 0.2
    with pytest.raises(ParameterError, match="log_directory is read when the node is configured"):
        changed(settings, [live, other], configured=True)
    both = changed(settings, [live, other], configured=False)
    assert (both.log_directory, both.near_margin) == ("/tmp", 0.2)
    assert changed(settings, [Parameter("use_sim_time", value=True)], configured=True) == settings
    for name, value, words in (
        (
            "hitch_sign",
            True,
            "hitch_sign must be 1 or -1, not True; write for example `hitch_sign: 1`",
        ),
        ("autostart", False, "autostart is read at the start"),
        ("qos_overrides./a.publisher.depth", 3, "publisher.depth is read at the start"),
        ("use_sim_time", 1, "use_sim_time must be true or false, not 1"),
        ("logdirectory", "/tmp", r"did you mean log_directory\?"),
    ):
        with pytest.raises(ParameterError, match=words):
            changed(settings, [Parameter(name, value=value)], configured=False)


def test_what_is_unchanged_is_not_set(environment: dict[str, str]) -> None:
    """An integer for a double is converted; values that are already set are left out."""
    context = Context()
    rclpy.init(context=context)
    node = Node(NODE_NAME, context=context, automatically_declare_parameters_from_overrides=True)
    try:
        declare_parameters(node)
        dump = list(node.get_parameters_by_prefix("").values())
        assert new_values(node, dump) == []
        asked = [Parameter("stale_after", value=2), Parameter("hitch_scale", value=1)]
        asked += [Parameter("hitch_sign", value=True), Parameter("unknown", value=1)]
        actual = {p.name: p.value for p in new_values(node, asked)}
        assert actual == {"stale_after": 2.0, "hitch_sign": True, "unknown": 1}
        assert type(actual["stale_after"]) is float
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
