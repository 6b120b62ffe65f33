# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Starts the node with parameters from a file and, where given, from arguments."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit, OnProcessIO
from launch.events.process import ProcessExited, ProcessIO
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare
from launch_ros.utilities import prefix_namespace

NAME = "linkage_vibration"

# Arguments that replace parameters of params_file, with their types. Empty ones replace nothing.
OVERRIDES = {
    "autostart": (bool, "Configure and activate at the start; else a lifecycle manager does it"),
    "hitch_input": (
        str,
        "What publishes the crank angle: joint_states, percent, ros2_isobus or can",
    ),
    "joint_name": (str, "Joint whose position turns the input crank"),
    "record": (bool, "Whether to record in MCAP from the start"),
    "log_directory": (str, "Folder for the logs"),
    "use_sim_time": (bool, "Whether to use the time of /clock, for example of a played bag"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the node."""
    shipped = PathJoinSubstitution([FindPackageShare(NAME), "config", f"{NAME}.params.yaml"])
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
            DeclareLaunchArgument(
                "enclave",
                default_value="",
                description="Enclave of SROS 2, such as /linkage_vibration. Empty: none.",
            ),
            *(
                DeclareLaunchArgument(
                    name, default_value="", description=f"{words}. Empty: as in params_file."
                )
                for name, (_, words) in OVERRIDES.items()
            ),
            OpaqueFunction(function=start),
        ]
    )


def given(context: LaunchContext) -> dict[str, ParameterValue]:
    """Return the parameters that were given as arguments."""
    return {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (kind, _) in OVERRIDES.items()
        if context.launch_configurations[name]
    }


def ros_arguments(context: LaunchContext) -> list[str]:
    """Return the log level of the node's own logger, and the enclave if one was given."""
    arguments = context.launch_configurations
    outer = arguments.get("ros_namespace", "")
    namespace = prefix_namespace(outer, arguments["namespace"]) or ""
    logger = ".".join(filter(None, [*namespace.split("/"), NAME]))
    enclave = ["--enclave", arguments["enclave"]] if arguments["enclave"] else []
    return ["--log-level", f"{logger}:={arguments['log_level']}", *enclave]


def start(context: LaunchContext) -> list[Node | RegisterEventHandler]:
    """Return the node, and handlers that end the launch with the reason if the node fails.

    Arguments come after the file, so they take precedence.
    """
    file = context.launch_configurations["params_file"]
    if not Path(file).is_file():
        raise RuntimeError(f"params_file must be a file, not {file}; name an existing file.")
    node = Node(
        package=NAME,
        executable=f"{NAME}_node",
        name=NAME,
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        ros_arguments=ros_arguments(context),
        parameters=[file, given(context)],
    )
    printed = [""]

    def keep_last_line(event: ProcessIO) -> None:
        printed.extend(line for line in event.text.decode(errors="replace").splitlines() if line)
        del printed[:-1]

    def end(event: ProcessExited, _: LaunchContext) -> None:
        if event.returncode > 0:
            reason = printed[-1].rpartition("]: ")[2]  # without level, time and logger
            raise RuntimeError(f"The node ended with exit code {event.returncode}: {reason}")

    return [
        RegisterEventHandler(OnProcessIO(target_action=node, on_stderr=keep_last_line)),
        RegisterEventHandler(OnProcessExit(target_action=node, on_exit=end)),
        node,
    ]
