# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The walls of the house: who may import whom."""

import ast
from pathlib import Path

import pytest

import linkage_vibration

PACKAGE = Path(linkage_vibration.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

# From the ground up; each may import what stands above it in this list, and its own room.
ORDER = [
    "errors",
    "files",
    "processes",
    "resources",
    "mechanics",
    "interpolation",
    "table",
    "tabulation",
    "prediction",
    "inputs",
    "excitation",
    "messages",
    "readers",
    "serving",
    "scene",
    "plan",
    "logs",
    "topics",
    "parameters",
    "replay",
    "drive",
    "calibration",
    "sweep",
    "published",
    "plots",
    "review",
    "testkit",
    "pytest_plugin",
    "figures",
    "reproduction",
    "ros",
    "demo",
    "cli",
]
ROS = {
    "rclpy",
    "rcl_interfaces",
    "sensor_msgs",
    "std_msgs",
    "builtin_interfaces",
    "rosidl_runtime_py",
}
ROS |= {"linkage_vibration_interfaces", "ament_index_python", "rosgraph_msgs", "std_srvs"}
ROS |= {"diagnostic_msgs", "geometry_msgs", "lifecycle_msgs", "visualization_msgs"}
PURE = {"__future__", "collections", "dataclasses", "difflib", "enum", "functools", "hashlib"}
PURE |= {"itertools", "json", "math", "numpy", "scipy", "typing"}


def imports(path: Path) -> set[str]:
    """Return the modules that a file imports, anywhere in it, by their full names."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            found.add(node.module or "")
    return found


def room(path: Path) -> str:
    """Return the first part of a module's name below the package."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_walls(path: Path) -> None:
    """ROS lives in ros/ alone, mechanics know numbers alone, and nothing imports upwards."""
    names = imports(path)
    tops = {name.split(".")[0] for name in names}
    own = {name.split(".")[1] for name in names if name.startswith("linkage_vibration.")}
    if room(path) != "ros":
        assert not tops & ROS
    if room(path) == "mechanics":
        assert tops <= PURE | {"linkage_vibration"}
        assert own <= {"mechanics", "errors"}
        calls = {
            node.func.id
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        assert not calls & {"open", "print"}
    if room(path) != "__init__":
        below = ORDER[: ORDER.index(room(path)) + 1]
        assert own <= set(below), f"{room(path)} imports upwards: {own - set(below)}"
