# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Says in one sentence which library is missing, and how it is installed."""

from collections.abc import Iterator
from contextlib import contextmanager

from linkage_vibration.errors import LinkageVibrationError

_PIP_NAMES = {"mcap_ros2": "mcap-ros2-support", "yaml": "PyYAML"}
_INTERFACES = "linkage_vibration_interfaces"


@contextmanager
def needed(extra: str, problem: str, error: type[LinkageVibrationError]) -> Iterator[None]:
    """Turn a failure to import a library into an error that names the extra which installs it."""
    try:
        yield
    except ImportError:
        raise error(f"{problem}; run `pip install linkage_vibration[{extra}]`.") from None


def missing_library(error: ImportError) -> str:
    """Return a sentence about a library that cannot be imported."""
    name = (error.name or "").partition(".")[0]
    if name == _INTERFACES:
        remedy = "build it with colcon and source install/setup.bash, or run "
        remedy += f"`pip install ./{_INTERFACES}` in a checkout"
    elif name == "rclpy" or name.endswith(("_msgs", "_srvs", "_interfaces")):
        remedy = "source a ROS 2 installation (Jazzy or later), or run "
        remedy += "`pip install linkage_vibration[ros]`"
    else:
        remedy = f"run `pip install {_PIP_NAMES.get(name, name)}`"
    return f"Python cannot import {name or 'a library'} ({error}); {remedy}."
