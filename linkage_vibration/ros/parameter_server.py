# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Declares, describes and sets the node's parameters in ROS 2."""

from collections.abc import Collection, Iterable
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from linkage_vibration.prediction.settings import (
    DECLARED,
    ParameterError,
    Parameters,
    converted,
    is_ros_parameter,
    with_values,
)
from linkage_vibration.ros.endpoints import OUTPUTS, QOS_VALUES


def declare_parameters(node: Node) -> Parameters:
    """Declare every parameter on a node, and return their values; raise a `ParameterError`."""
    at_start = node.get_parameters_by_prefix("")
    given = {name: p.value for name, p in at_start.items() if not is_ros_parameter(name)}
    for name in given:
        node.undeclare_parameter(name)
    _check_sim_time(at_start.values())
    settings = with_values(Parameters(), given)
    for name, parameter in DECLARED.items():
        value = getattr(settings, name)
        node.declare_parameter(name, value, _descriptor(parameter), ignore_override=True)
    return settings


def _descriptor(parameter: Any) -> ParameterDescriptor:
    """Return what `ros2 param describe` shows."""
    words = parameter.metadata
    unit, between = words["unit"], words["between"]
    fixed = parameter.name == "autostart"
    description = words["description"] + (f" Unit: {unit}." if unit else "")
    if not words["live"]:
        description += " Read at start." if fixed else " Read when the node is configured."
    valid = f"Must be {words['valid']}."
    descriptor = ParameterDescriptor(
        description=description, additional_constraints=valid, read_only=fixed
    )
    if between is not None:
        ends = {"from_value": between[0], "to_value": between[1]}
        if type(parameter.default) is int:
            descriptor.integer_range = [IntegerRange(**ends)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(**ends)]
    return descriptor


def new_values(node: Node, asked: "list[Parameter[Any]]") -> "list[Parameter[Any]]":
    """Return what differs from what is set, in the declared types, so that a dump can be loaded."""
    differing = []
    for parameter in asked:
        name = parameter.name
        value = converted(name, parameter.value)
        before = converted(name, node.get_parameter_or(name).value)  # None if it is unknown
        if type(value) is not type(before) or value != before:
            differing.append(parameter if is_ros_parameter(name) else Parameter(name, value=value))
    return differing


def check_qos_overrides(node: Node, inputs: Iterable[str]) -> None:
    """Refuse QoS overrides of other topics than the outputs and the inputs, by absolute names."""
    topics = [f"{name}.subscription" for name in inputs]
    topics += [f"{node.resolve_topic_name(topic.name)}.publisher" for topic in OUTPUTS]
    valid = [f"{topic}.{policy}" for topic in topics for policy in QOS_VALUES]
    for name, parameter in node.get_parameters_by_prefix("qos_overrides").items():
        if name not in valid:
            near = get_close_matches(name, valid, 1, 0.0)[0]
            raise ParameterError(
                f"Parameter qos_overrides.{name} changes no topic of the node; did you mean "
                f"qos_overrides.{near}?"
            )
        values: Collection[Any] = QOS_VALUES[name.rpartition(".")[2]]
        if type(parameter.value) is not type(next(iter(values))) or parameter.value not in values:
            listing = f"1 to {len(values)}" if isinstance(values, range) else " or ".join(values)
            raise ParameterError(
                f"Parameter qos_overrides.{name} must be {listing}, not {parameter.value!r}."
            )


def changed(settings: Parameters, asked: "list[Parameter[Any]]", *, configured: bool) -> Parameters:
    """Return the parameters after a request; a configured node changes only live ones."""
    _check_sim_time(asked)
    for parameter in asked:
        if parameter.name.partition(".")[0] in ("autostart", "qos_overrides"):
            raise ParameterError(f"Parameter {parameter.name} is read at the start; give it there.")
    requested = {p.name: p.value for p in asked if not is_ros_parameter(p.name)}
    new = with_values(settings, requested)
    for name in requested:
        if configured and not DECLARED[name].metadata["live"]:
            raise ParameterError(
                f"Parameter {name} is read when the node is configured; clean the node up first "
                "(`ros2 lifecycle set`), or give the parameter at the start."
            )
    return new


def _check_sim_time(parameters: "Iterable[Parameter[Any]]") -> None:
    """Refuse a value with which rclpy would silently use the wall clock."""
    for parameter in parameters:
        if parameter.name == "use_sim_time" and type(parameter.value) is not bool:
            raise ParameterError(
                f"Parameter use_sim_time must be true or false, not {parameter.value!r}; "
                "write for example `use_sim_time: true`."
            )
