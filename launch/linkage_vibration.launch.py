# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Starts the node with parameters from a file and, where given, from arguments."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

# Arguments that replace parameters of params_file, with their types. Empty ones replace nothing.
OVERRIDES = {
    "autostart": (bool, "Configure and activate at the start; else a lifecycle manager does it"),
    "input": (str, "Source of the crank angle: joint_state or percent"),
    "joint_name": (str, "Joint whose position turns the input crank"),
    "record": (bool, "Whether to record in MCAP from the start"),
    "log_directory": (str, "Folder for the logs"),
    "use_sim_time": (bool, "Whether to use the time of /clock, for example of a played bag"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the node."""
    shipped = PathJoinSubstitution(
        [FindPackageShare("linkage_vibration"), "config", "linkage_vibration.params.yaml"]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=shipped, description="Parameters of the node (YAML)."
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of the node and of its relative topics.",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                description="Lowest printed level of messages: debug, info, warn, error or fatal.",
            ),
            *(
                DeclareLaunchArgument(
                    name, default_value="", description=f"{words}. Empty: as in params_file."
                )
                for name, (_, words) in OVERRIDES.items()
            ),
            OpaqueFunction(function=node),
        ]
    )


def given(context: LaunchContext) -> dict[str, ParameterValue]:
    """Return the parameters that were given as arguments."""
    return {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (kind, _) in OVERRIDES.items()
        if context.launch_configurations[name]
    }


def node(context: LaunchContext) -> list[Node]:
    """Return the node; arguments come after the file, so they take precedence."""
    return [
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
            parameters=[LaunchConfiguration("params_file"), given(context)],
        )
    ]
