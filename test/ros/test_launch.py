# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files: their text, and their actions where launch_ros is installed."""

import ast
import importlib.util
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import share_directory

PYTHON = share_directory() / "launch" / "linkage_vibration.launch.py"
XML = share_directory() / "launch" / "linkage_vibration.launch.xml"
LAUNCHED = Path(__file__).with_name("launched_node.py")
ROOT = Path(__file__).resolve().parents[2]


def overrides() -> dict[str, str]:
    """Return the parameters that are arguments of the Python file, and the names of their types."""
    [table] = [
        node.value
        for node in ast.walk(ast.parse(PYTHON.read_text()))
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OVERRIDES"
    ]
    assert isinstance(table, ast.Dict)
    actual = {}
    for name, value in zip(table.keys, table.values, strict=True):
        assert isinstance(name, ast.Constant)
        assert isinstance(value, ast.Tuple)
        actual[name.value] = ast.unparse(value.elts[0])
    return actual  # type: ignore[return-value]


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


@pytest.fixture
def context() -> Any:
    """Return a launch whose arguments are empty; without launch_ros, the test is skipped."""
    pytest.importorskip("launch_ros", reason="launch_ros comes with a ROS 2 install only")
    from launch import LaunchContext  # type: ignore[attr-defined]

    actual = LaunchContext(argv=[])
    names = [*overrides(), "params_file", "namespace", "enclave"]
    actual.launch_configurations.update({**dict.fromkeys(names, ""), "log_level": "warn"})
    return actual


def test_python_file_describes_a_launch(context: Any) -> None:
    """The Python file declares its arguments, and starts a node with two handlers of its end."""
    entities = launched().generate_launch_description().entities
    assert [type(entity).__name__ for entity in entities] == [
        *["DeclareLaunchArgument"] * (4 + len(overrides())),
        "OpaqueFunction",
    ]
    context.launch_configurations["params_file"] = str(PYTHON)
    *handlers, node = launched().start(context)
    assert [type(handler).__name__ for handler in handlers] == ["RegisterEventHandler"] * 2
    assert type(node).__name__ == "Node"


def test_missing_file_of_parameters_ends_the_launch(context: Any) -> None:
    """A params_file that does not exist is an error, not a warning."""
    context.launch_configurations["params_file"] = "/nope.yaml"
    with pytest.raises(RuntimeError, match=r"must be a file, not /nope\.yaml"):
        launched().start(context)


def test_log_level_is_that_of_the_node_in_its_namespace(context: Any) -> None:
    """The logger has the name of the node behind its namespaces; an enclave is passed on."""
    arguments = context.launch_configurations
    assert launched().ros_arguments(context) == ["--log-level", "linkage_vibration:=warn"]
    arguments.update({"ros_namespace": "/farm", "namespace": "tractor/hitch", "enclave": "/e"})
    assert launched().ros_arguments(context) == [
        "--log-level",
        "farm.tractor.hitch.linkage_vibration:=warn",
        "--enclave",
        "/e",
    ]


def test_arguments_that_were_not_given(context: Any) -> None:
    """Only arguments that were given become parameters."""
    assert launched().given(context) == {}
    context.launch_configurations.update({"record": "false", "joint_name": "5"})
    actual = {name: value.evaluate(context) for name, value in launched().given(context).items()}
    assert actual == {"joint_name": "5", "record": False}


def test_launched_node(environment: dict[str, str]) -> None:
    """A launch test starts the node by our launch file, which answers and ends cleanly."""
    pytest.importorskip("launch_testing", reason="launch_testing comes with a ROS 2 install only")
    test = [sys.executable, "-m", "launch_testing.launch_test", str(LAUNCHED)]
    done = subprocess.run(test, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Ran 1 test" in done.stderr + done.stdout
