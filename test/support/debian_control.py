# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes with bloom's templates what a build farm would: ``python -m ... FOLDER``.

It runs in a process of its own, because bloom reads the index of distributions as it is imported.
Rosdep's rules are on the network, so `resolve` has those of Ubuntu 24.04 for our keys.
"""

import sys
from pathlib import Path

PIP = {"mcap-ros2-support": "mcap-ros2-support", "python3-rosbags-pip": "rosbags"}
"""Keys that rosdep installs with pip."""


def resolve(key: str, *_: object, **__: object) -> tuple[list[str], str, str]:
    """Return what rosdep does: the packages of a key, their installer, and that of the system."""
    if key in PIP:
        return [PIP[key]], "pip", "apt"
    package = key if key.startswith("python3-") else f"ros-jazzy-{key.replace('_', '-')}"
    return [package], "apt", "apt"


def main() -> None:
    """Write the folder debian into the folder of a package."""
    from bloom.generators import common
    from bloom.generators.debian.generator import place_template_files, process_template_files
    from bloom.generators.rosdebian import get_subs
    from catkin_pkg.package import parse_package

    common.resolve_rosdep_key = resolve
    folder = Path(sys.argv[1])
    package = parse_package(folder)
    place_template_files(str(folder), package.get_build_type())
    process_template_files(str(folder), get_subs(package, "ubuntu", "noble", "jazzy", 0, False))


if __name__ == "__main__":
    main()
