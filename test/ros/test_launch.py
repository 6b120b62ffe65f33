# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files: their syntax here, their actions where launch_ros is installed."""

import ast
import importlib.util
from dataclasses import fields
from xml.etree import ElementTree

import pytest

from linkage_vibration.resources import share_directory
from linkage_vibration.ros.parameters import Parameters

PYTHON = share_directory() / "launch" / "linkage_vibration.launch.py"
XML = share_directory() / "launch" / "linkage_vibration.launch.xml"


def declared_in_python() -> dict[str, str]:
    """Return the arguments that the Python file declares, with their descriptions."""
    calls = [
        node
        for node in ast.walk(ast.parse(PYTHON.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "DeclareLaunchArgument"
    ]
    return {
        ast.literal_eval(call.args[0]): next(
            ast.literal_eval(k.value) for k in call.keywords if k.arg == "description"
        )
        for call in calls
    }


def test_both_files_take_the_same_arguments() -> None:
    """Python and XML declare the same arguments, each described in the same words."""
    in_xml = {
        arg.attrib["name"]: arg.attrib["description"]
        for arg in ElementTree.parse(XML).getroot().findall("arg")
    }
    assert declared_in_python() == in_xml
    assert len(in_xml) == 9


def test_arguments_become_parameters_of_the_node() -> None:
    """What either file sets is a parameter that the node has, or one of every node."""
    node = ElementTree.parse(XML).getroot().find("node")
    assert node is not None
    set_in_xml = {param.attrib["name"] for param in node.findall("param") if "name" in param.attrib}
    known = {field.name for field in fields(Parameters)} | {"use_sim_time"}
    assert set_in_xml <= known
    for name in set_in_xml:
        assert f'"{name}": argument("{name}"' in PYTHON.read_text()


def test_python_file_describes_a_launch() -> None:
    """Where launch_ros is installed, the Python file makes nine arguments and a node."""
    pytest.importorskip("launch_ros", reason="launch_ros comes with a ROS 2 install only")
    spec = importlib.util.spec_from_file_location("launched", PYTHON)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert len(module.generate_launch_description().entities) == 10
