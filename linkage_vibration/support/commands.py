# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How a person runs the commands of this package where it is installed."""

import os
import shutil
from pathlib import Path

PACKAGE = "linkage_vibration"


def command(arguments: str, program: str = "linkage-vibration") -> str:
    """Return a command line that works here: colcon puts programs where only `ros2 run` looks."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    installed = any(Path(p, "lib", PACKAGE, program).is_file() for p in prefixes if p)
    if installed and shutil.which(program) is None:
        program = f"ros2 run {PACKAGE} {program}"
    return f"{program} {arguments}"
