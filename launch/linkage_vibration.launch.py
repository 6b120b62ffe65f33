# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Start the node: parameters from a file, and those that change from run to run as arguments."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

# Parameters that may be given beside params_file, with their types; one that is empty is its.
OVERRIDES = {
    "autostart": (bool, "Configure and activate at start; if false, a lifecycle manager does"),
    "input": (str, "Where the crank angle comes from: joint_state or percent"),
    "joint_name": (str, "Joint whose position turns the input crank"),
    "record": (bool, "Whether to log in MCAP from the start"),
    "log_directory": (str, "Folder for the logs"),
    "use_sim_time": (bool, "Whether to take time from /clock, as when a bag is played"),
}


def generate_launch_description() -> LaunchDescription:
    """Return what is launched."""
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
                description="What the node prints at least: debug, info, warn, error or fatal.",
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
    """Return those parameters that were given as arguments."""
    return {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (kind, _) in OVERRIDES.items()
        if context.launch_configurations[name]
    }


def node(context: LaunchContext) -> list[Node]:
    """Return the node; of its parameters, the later ones win."""
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
