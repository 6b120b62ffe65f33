# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The rooms of the package, and which of them may import which."""

import ast
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

import linkage_vibration

PACKAGE = Path(linkage_vibration.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

# A room imports only from itself and from the rooms before it in this list.
ROOMS = [
    "errors",
    "support",
    "bags",
    "messages",
    "mechanics",
    "table",
    "prediction",
    "readers",
    "export",
    "drawing",
    "listening",
    "playback",
    "review",
    "testing",
    "studies",
    "ros",
    "demo",
    "cli",
]
ROS = {
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "linkage_vibration_interfaces",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "rosidl_runtime_py",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
}
# The mechanics take numbers and give numbers, so they need no more of the standard library.
PURE = {"__future__", "collections", "dataclasses", "difflib", "enum", "functools", "hashlib"}
PURE |= {"copy", "itertools", "json", "math", "numpy", "re", "scipy", "typing"}


def imports(path: Path) -> set[str]:
    """Return the full names of the modules that a file imports anywhere."""
    actual: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            actual.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            actual.add(node.module or "")
            actual.update(f"{node.module}.{alias.name}" for alias in node.names)
    return actual


def room(path: Path) -> str:
    """Return the room of a file: the first part of its name below the package."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def module_name(path: Path) -> str:
    """Return the dotted name of a file; that of a package is the name of its folder."""
    parts = ("linkage_vibration", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_every_room_is_listed() -> None:
    """The list above is the whole house."""
    assert {room(path) for path in MODULES} == {*ROOMS, "__init__"}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_walls(path: Path) -> None:
    """No room imports a later one, ROS stays in ros/, and the mechanics know numbers alone."""
    names = imports(path)
    tops = {name.split(".")[0] for name in names}
    own = {name.split(".")[1] for name in names if name.startswith("linkage_vibration.")} & {*ROOMS}
    if room(path) != "ros":
        assert not tops & ROS
    if room(path) == "bags":
        assert own <= {"bags", "errors", "support"}
    if room(path) == "export":
        assert not own & {"bags", "readers"}  # it gets numbers, and reads no files of users
    if room(path) == "mechanics":
        assert tops <= PURE | {"linkage_vibration"}
        assert own <= {"mechanics", "errors", "support"}
        assert not any("support" in name and "conversions" not in name for name in names)
        calls = {
            node.func.id
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        assert not calls & {"open", "print"}
    if room(path) != "__init__":
        allowed = ROOMS[: ROOMS.index(room(path)) + 1]
        assert own <= set(allowed), f"{room(path)} imports {own - set(allowed)}"


def test_no_import_circle() -> None:
    """No module imports itself through others, not even inside a function."""
    known = {module_name(path): path for path in MODULES}
    graph = {name: imports(path) & set(known) - {name} for name, path in known.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"These modules import each other in a circle: {' -> '.join(error.args[1])}.")


def test_permitted_floating_point_errors_have_reasons() -> None:
    """Each `errstate` has a comment behind it, or above it, that says what it permits and why."""
    for path in MODULES:
        lines = path.read_text().splitlines()
        for before, line in pairwise(lines):
            reason = "  # " in line or before.lstrip().startswith("# ")
            assert reason or "errstate(" not in line, f"{path}: {line}"
