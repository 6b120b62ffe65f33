# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a log must say about a ROS 2 message type, from the files that its package installs.

Reading ``share/<package>/msg`` needs no rclpy and loads no type support.
"""

import json
import os
import re
import sys
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError

SEPARATOR = "=" * 80
# The first word of a field: `std_msgs/Header`, `Point[4]`, `geometry_msgs/Pose[<=8]`.
_MESSAGE_TYPE = re.compile(r"(?:(?P<package>[a-z]\w*)/)?(?P<name>[A-Z][A-Za-z0-9]*)(?:\[.*)?")


class DefinitionError(LinkageVibrationError):
    """A message type's definition is not installed where ROS 2 keeps definitions."""


def message_definition(type_name: str) -> str:
    """Return the definition of a message type with those of all types that it contains.

    Parameters
    ----------
    type_name : str
        Full name such as ``sensor_msgs/msg/JointState``.

    Returns
    -------
    str
        The ``ros2msg`` text of an MCAP schema: the type's own ``.msg``, then each dependency once,
        after a line of 80 ``=`` and a line ``MSG: package/Type``.

    Raises
    ------
    DefinitionError
        If the type, or one that it contains, is not installed.
    """
    texts = {type_name: _read(type_name)}
    waiting = [type_name]
    while waiting:
        name = waiting.pop(0)
        for dependency in _dependencies(texts[name], package=name.split("/")[0]):
            if dependency not in texts:
                texts[dependency] = _read(dependency)
                waiting.append(dependency)
    definition = texts.pop(type_name)
    for dependency, text in texts.items():
        definition += f"\n{SEPARATOR}\nMSG: {dependency.replace('/msg/', '/')}\n{text}"
    return definition


def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of a message type (REP 2016).

    Parameters
    ----------
    type_name : str
        Full name such as ``sensor_msgs/msg/JointState``.

    Returns
    -------
    str
        ``RIHS01_`` and 64 hexadecimal digits; empty before ROS 2 Iron, which brought the hashes.

    Raises
    ------
    DefinitionError
        If the type is not installed.
    """
    path = _find(type_name).with_suffix(".json")
    if not path.is_file():
        return ""
    hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
    return str(next(entry["hash_string"] for entry in hashes if entry["type_name"] == type_name))


def _dependencies(text: str, package: str) -> list[str]:
    """Return the full names of the message types that the fields of a ``.msg`` text have."""
    names = []
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if words and (match := _MESSAGE_TYPE.fullmatch(words[0])):
            names.append(f"{match['package'] or package}/msg/{match['name']}")
    return names


def _read(type_name: str) -> str:
    """Return the ``.msg`` text of a message type."""
    return _find(type_name).read_text(encoding="utf-8")


def _find(type_name: str) -> Path:
    """Return the path of a message type's ``.msg``."""
    package, _, name = type_name.split("/")
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for prefix in [*prefixes, sys.prefix]:
        path = Path(prefix) / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path
    raise DefinitionError(
        f"The definition of {type_name} (share/{package}/msg/{name}.msg) was not found under "
        f"{', '.join([*prefixes, sys.prefix])}; install {package}, or source the ROS 2 that has it."
    )
