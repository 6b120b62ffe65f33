# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Start the node: parameters from a file, the joint and the recording from arguments."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return what is launched."""
    defaults = PathJoinSubstitution(
        [FindPackageShare("linkage_vibration"), "config", "linkage_vibration.params.yaml"]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=defaults, description="Parameters of the node (YAML)."
            ),
            DeclareLaunchArgument(
                "joint_name",
                default_value="hitch_rockshaft_joint",
                description="Joint whose position turns the input crank.",
            ),
            DeclareLaunchArgument(
                "record",
                default_value="false",
                description="Whether to log joint states and predictions in MCAP.",
            ),
            DeclareLaunchArgument(
                "log_directory",
                default_value=".",
                description="Folder for the logs.",
            ),
            Node(
                package="linkage_vibration",
                executable="linkage_vibration_node",
                name="linkage_vibration",
                output="screen",
                parameters=[
                    LaunchConfiguration("params_file"),
                    {
                        "joint_name": LaunchConfiguration("joint_name"),
                        "record": ParameterValue(LaunchConfiguration("record"), value_type=bool),
                        "log_directory": LaunchConfiguration("log_directory"),
                    },
                ],
            ),
        ]
    )
