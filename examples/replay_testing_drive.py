# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Does the node predict the readings of a played drive? Run this file with replay_testing.

In a workspace with this package and ROS 2's replay_testing, run
`ros2 run replay_testing replay_test examples/replay_testing_drive.py`.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from replay_testing import LocalFixture, analyze, fixtures, read_messages, run

ROOT = Path(__file__).parents[1]
PREDICTION, RESONANCE = "/linkage_vibration/prediction", "/linkage_vibration/resonance"
STATUS_OK = 0


@fixtures.parameterize([LocalFixture(path=ROOT / "config" / "drives" / "hitch_duty_cycle.mcap")])
class Fixtures:
    """The recorded drive, which has the readings and the speeds, but no predictions."""

    required_input_topics = ["/joint_states", "/engine_speed", "/pto_speed"]  # noqa: RUF012
    expected_output_topics = [PREDICTION, RESONANCE]  # noqa: RUF012


@run.default()
class Run:
    """The node, with the time of the played drive."""

    def generate_launch_description(self):
        """Return the launch file of the node with its argument."""
        source = PythonLaunchDescriptionSource(str(ROOT / "launch" / "linkage_vibration.launch.py"))
        arguments = [("use_sim_time", "true")]
        return LaunchDescription([IncludeLaunchDescription(source, launch_arguments=arguments)])


@analyze
class Analysis:
    """What the node published while the drive was played."""

    def test_predictions(self):
        """Every prediction is valid; the first readings are lost while the node starts."""
        result = [message for _, message, _ in read_messages(self.reader, topics=[PREDICTION])]
        assert len(result) > 1500, f"{len(result)} of 2000 readings were answered."
        assert all(message.status == STATUS_OK for message in result)
