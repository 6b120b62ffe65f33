# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files: their text, and their actions where launch_ros is installed."""

import ast
import importlib.util
from dataclasses import fields
from typing import Any
from xml.etree import ElementTree

import pytest

from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import share_directory

PYTHON = share_directory() / "launch" / "linkage_vibration.launch.py"
XML = share_directory() / "launch" / "linkage_vibration.launch.xml"


def overrides() -> dict[str, str]:
    """Return the parameters that are arguments of the Python file, and the names of their types."""
    [table] = [
        node.value
        for node in ast.walk(ast.parse(PYTHON.read_text()))
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OVERRIDES"
    ]
    assert isinstance(table, ast.Dict)
    found = {}
    for name, value in zip(table.keys, table.values, strict=True):
        assert isinstance(name, ast.Constant)
        assert isinstance(value, ast.Tuple)
        found[name.value] = ast.unparse(value.elts[0])
    return found  # type: ignore[return-value]


def launched() -> Any:
    """Return the Python file as a module."""
    spec = importlib.util.spec_from_file_location("launched", PYTHON)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_arguments_become_parameters_of_the_node() -> None:
    """Each argument is a parameter of this node, with its type, or of every node."""
    known = {field.name: type(field.default).__name__ for field in fields(Parameters)}
    known["use_sim_time"] = "bool"
    assert overrides().items() <= known.items()


def test_xml_is_the_python_file() -> None:
    """The XML file only includes the installed Python file."""
    [include] = ElementTree.parse(XML).getroot()
    assert include.tag == "include"
    place = PYTHON.relative_to(share_directory())
    assert include.attrib == {"file": f"$(find-pkg-share linkage_vibration)/{place}"}


def test_python_file_describes_a_launch() -> None:
    """Where launch_ros is installed, the Python file makes nine arguments and a node."""
    pytest.importorskip("launch_ros", reason="launch_ros comes with a ROS 2 install only")
    entities = launched().generate_launch_description().entities
    assert [type(entity).__name__ for entity in entities] == [
        *["DeclareLaunchArgument"] * (3 + len(overrides())),
        "OpaqueFunction",
    ]


def test_arguments_that_were_not_given() -> None:
    """Where launch_ros is installed: only arguments that were given become parameters."""
    pytest.importorskip("launch_ros", reason="launch_ros comes with a ROS 2 install only")
    from launch import LaunchContext  # type: ignore[attr-defined]

    context = LaunchContext(argv=[])
    context.launch_configurations.update(dict.fromkeys(overrides(), ""))
    assert launched().given(context) == {}
    context.launch_configurations.update({"record": "false", "joint_name": "5"})
    found = {name: value.evaluate(context) for name, value in launched().given(context).items()}
    assert found == {"joint_name": "5", "record": False}
