# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Start the node: parameters from a file, and those that change from run to run as arguments."""

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

    def argument(name: str, kind: type) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=kind)

    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=defaults,
                description="Parameters of the node (YAML); those below win over it.",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of the node and of its relative topics.",
            ),
            DeclareLaunchArgument(
                "autostart",
                default_value="true",
                description="Configure and activate at start; if false, a lifecycle manager does.",
            ),
            DeclareLaunchArgument(
                "input",
                default_value="joint_state",
                description="Where the crank angle comes from: joint_state or percent.",
            ),
            DeclareLaunchArgument(
                "joint_name",
                default_value="hitch_rockshaft_joint",
                description="Joint whose position turns the input crank.",
            ),
            DeclareLaunchArgument(
                "record",
                default_value="false",
                description="Whether to log in MCAP from the start.",
            ),
            DeclareLaunchArgument(
                "log_directory",
                default_value=".",
                description="Folder for the logs.",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                description="Whether to take time from /clock, as when a bag is played.",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                description="What the node prints at least: debug, info, warn, error or fatal.",
            ),
            Node(
                package="linkage_vibration",
                executable="linkage_vibration_node",
                name="linkage_vibration",
                namespace=LaunchConfiguration("namespace"),
                output="screen",
                ros_arguments=[
                    "--log-level",
                    ["linkage_vibration:=", LaunchConfiguration("log_level")],
                ],
                parameters=[
                    LaunchConfiguration("params_file"),
                    {
                        "autostart": argument("autostart", bool),
                        "input": argument("input", str),
                        "joint_name": argument("joint_name", str),
                        "record": argument("record", bool),
                        "log_directory": argument("log_directory", str),
                        "use_sim_time": argument("use_sim_time", bool),
                    },
                ],
            ),
        ]
    )
