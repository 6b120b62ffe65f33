# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the files that ship with the package, however it was installed."""

import os
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
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) for prefix in (*sourced, sys.prefix) if prefix]


def config_file(name: str) -> Path:
    """Return the path of a file below ``config``, such as ``three_point_linkage.yaml``."""
    return share_directory() / "config" / name
