# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the files and the commands of the package, however it was installed."""

import os
import shutil
import sys
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError

PACKAGE = "linkage_vibration"

# The default files, below config.
DEFAULT_MECHANISM = "three_point_linkage_on_tractor.yaml"
DEFAULT_TABLE = "tables/three_point_linkage_on_tractor.npz"
DEFAULT_EXCITATIONS = "excitations.yaml"
# The paper's linkage, on a ground that does not move.
PAPER_MECHANISM = "three_point_linkage.yaml"
PAPER_TABLE = "tables/three_point_linkage.npz"


class ResourceError(LinkageVibrationError):
    """A file that ships with the package is not installed."""


def share_directory() -> Path:
    """Return the folder of ``config``: of a checkout, else of a sourced ROS 2, else of Python."""
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "package.xml").is_file():
        return checkout
    for prefix in prefixes():
        share = prefix / "share" / PACKAGE
        if (share / "config").is_dir():
            return share
    problem = f"No share/{PACKAGE}/config was found under {', '.join(map(str, prefixes()))}"
    hint = "install the package again, or source the workspace that holds it"
    raise ResourceError(f"{problem}; {hint}.")


def prefixes() -> list[Path]:
    """Return the folders in which a sourced ROS 2 and Python install packages, in their order."""
    return [*_sourced_prefixes(), Path(sys.prefix)]


def _sourced_prefixes() -> list[Path]:
    return [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]


def config_file(name: str) -> Path:
    """Return the path of a file below ``config``, such as ``three_point_linkage.yaml``."""
    return share_directory() / "config" / name


def command(arguments: str, program: str = "linkage-vibration") -> str:
    """Return a command line that works here: colcon puts programs where only `ros2 run` looks."""
    installed = any((p / "lib" / PACKAGE / program).is_file() for p in _sourced_prefixes())
    if installed and shutil.which(program) is None:
        program = f"ros2 run {PACKAGE} {program}"
    return f"{program} {arguments}"
