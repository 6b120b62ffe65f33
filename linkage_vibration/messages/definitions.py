# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions and hashes of message types, as a log stores them; needs no rclpy.

Our own definitions ship with this package. Those of other packages are read from where ROS 2 is
installed, or else from rosbags.
"""

import json
import re
from contextlib import suppress
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.resources import prefixes, share_directory
from linkage_vibration.support.version import VERSION

OWN_PACKAGE = "linkage_vibration_interfaces"
SEPARATOR = "=" * 80
# The first word of a field: `std_msgs/Header`, `Point[4]`, `geometry_msgs/Pose[<=8]`.
_MESSAGE_TYPE = re.compile(r"(?:(?P<package>[a-z]\w*)/)?(?P<name>[A-Z][A-Za-z0-9_]*)(?:\[.*)?")


class DefinitionError(LinkageVibrationError):
    """The definition of a message type was not found, or is that of another version."""


def message_definition(type_name: str) -> str:
    """Return the ``ros2msg`` schema of a type: its ``.msg``, and that of each type it contains."""
    texts = {type_name: message_text(type_name)}
    waiting = [type_name]
    while waiting:
        name = waiting.pop(0)
        for dependency in _dependencies(texts[name], package=name.split("/")[0]):
            if dependency not in texts:
                texts[dependency] = message_text(dependency)
                waiting.append(dependency)
    definition = texts.pop(type_name)
    for dependency, text in texts.items():
        definition += f"\n{SEPARATOR}\nMSG: {dependency.replace('/msg/', '/')}\n{text}"
    return definition if definition.endswith("\n") else f"{definition}\n"


def message_text(type_name: str) -> str:
    """Return the ``.msg`` text of a type, or raise a `DefinitionError` if it is not found."""
    package, _, name = type_name.split("/")
    installed = _shipped(type_name) or _installed(type_name)
    if installed is not None:
        return installed.read_text(encoding="utf-8")
    store = None
    with suppress(ImportError):
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.LATEST)
    if store is None or type_name not in store.types:
        file = f"share/{package}/msg/{name}.msg"
        raise DefinitionError(
            f"The definition of {type_name} ({file}) was not found under "
            f"{', '.join(map(str, prefixes()))}; install {package}, or source the ROS 2 that has "
            "it. For a standard type, `pip install rosbags` is enough."
        )
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return text.split(SEPARATOR)[0].rstrip("\n")


def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of a type (REP 2016); empty without rosbags and a ROS 2 since Iron."""
    installed = _installed(type_name)
    # Another version of our interface package may be installed.
    if installed is not None and installed.read_text(encoding="utf-8") == message_text(type_name):
        return _installed_hash(installed, type_name)
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        return ""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_definition(type_name), type_name))
    return store.hash_rihs01(type_name)


def _installed_hash(path: Path, type_name: str) -> str:
    """Return the hash beside an installed definition; empty for a ROS 2 before Iron."""
    path = path.with_suffix(".json")
    if not path.is_file():
        return ""
    hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
    return str(next(h["hash_string"] for h in hashes if h["type_name"] == type_name))


def _dependencies(text: str, package: str) -> list[str]:
    """Return the full names of the message types that the fields of a ``.msg`` text have."""
    names = []
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if words and (match := _MESSAGE_TYPE.fullmatch(words[0])):
            names.append(f"{match['package'] or package}/msg/{match['name']}")
    return names


def check_interfaces() -> None:
    """Refuse our messages, services and actions that are installed with other fields."""
    folder, different = share_directory() / OWN_PACKAGE, []
    for kind in ("msg", "srv", "action"):
        for path in sorted((folder / kind).glob(f"*.{kind}")):
            name = f"{OWN_PACKAGE}/{kind}/{path.stem}"
            if (installed := _installed(name)) is not None and _code(installed) != _code(path):
                different.append(name)
    if different:
        raise DefinitionError(
            f"The installed {', '.join(different)} differs, so {OWN_PACKAGE} has another version "
            f"than linkage_vibration {VERSION}; install {OWN_PACKAGE} {VERSION}, or rebuild the "
            "workspace."
        )


def _code(path: Path) -> list[list[str]]:
    """Return the words of the lines of a definition without comments."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [words for line in lines if (words := line.partition("#")[0].split())]


def _shipped(type_name: str) -> Path | None:
    """Return the path of one of our definitions, which ship with this package."""
    package, kind, name = type_name.split("/")
    path = share_directory() / OWN_PACKAGE / kind / f"{name}.{kind}"
    return path if package == OWN_PACKAGE and path.is_file() else None


def _installed(type_name: str) -> Path | None:
    """Return the path of the definition that a package has installed, if any."""
    package, kind, name = type_name.split("/")
    paths = (prefix / "share" / package / kind / f"{name}.{kind}" for prefix in prefixes())
    return next((path for path in paths if path.is_file()), None)
