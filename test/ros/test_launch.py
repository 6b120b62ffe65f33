# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files: their syntax here, their actions where launch_ros is installed."""

import ast
import importlib.util
from xml.etree import ElementTree

import pytest

from linkage_vibration.resources import share_directory

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
    assert set(in_xml) == {"params_file", "joint_name", "record", "log_directory"}


def test_python_file_describes_a_launch() -> None:
    """Where launch_ros is installed, the Python file makes four arguments and a node."""
    pytest.importorskip("launch_ros", reason="launch_ros comes with a ROS 2 install only")
    spec = importlib.util.spec_from_file_location("launched", PYTHON)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert len(module.generate_launch_description().entities) == 5
