# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A test for launch_testing, which `test_launch.py` runs with ``launch_test``.

Its name keeps pytest from taking it for tests of its own.
"""

import os
import unittest
from typing import Any

import launch_testing
from launch import LaunchDescription  # type: ignore[attr-defined]
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest

from linkage_vibration.prediction.predictor import Status
from linkage_vibration.support.resources import share_directory
from test.support.ros_process import JOINT, peer_of

NODE = "linkage_vibration"


def generate_test_description() -> LaunchDescription:
    """Return our launch file with arguments, and the start of the tests."""
    shared = share_directory()  # of the checkout, which may differ from what is installed
    parameters = str(shared / "config" / f"{NODE}.params.yaml")
    arguments = {"params_file": parameters, "log_level": "warn", "joint_name": JOINT}
    source = PythonLaunchDescriptionSource(str(shared / "launch" / f"{NODE}.launch.py"))
    return LaunchDescription(
        [IncludeLaunchDescription(source, launch_arguments=arguments.items()), ReadyToTest()]
    )


class LaunchedNode(unittest.TestCase):
    """The node while it runs."""

    def test_answers(self) -> None:
        """A reading is answered by a prediction."""
        with peer_of(NODE, int(os.environ["ROS_DOMAIN_ID"])) as peer:
            answer = peer.ask([JOINT], [2.25])
        assert (answer.crank_angle, answer.status) == (2.25, Status.OK)


@launch_testing.post_shutdown_test()  # type: ignore[misc]
class EndedNode(unittest.TestCase):
    """The node after the launch has ended it."""

    def test_exit_code(self, proc_info: Any) -> None:
        """The node ends cleanly."""
        launch_testing.asserts.assertExitCodes(proc_info)

    def test_log_level(self, proc_output: Any) -> None:
        """Nothing below a warning was printed."""
        printed = "".join(event.text.decode() for event in proc_output)
        assert "[INFO]" not in printed
