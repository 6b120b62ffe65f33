# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Declares, describes and sets the node's parameters in ROS 2."""

from dataclasses import fields
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from linkage_vibration.prediction.settings import (
    ParameterError,
    Parameters,
    check_value,
    own_type,
    with_values,
)


def declare_parameters(node: Node) -> tuple[Parameters, dict[str, ParameterError]]:
    """Declare every parameter on a node, and return their values.

    Invalid parameters get their defaults; their errors are also returned, by name.
    """
    values: dict[str, Any] = {}
    faults: dict[str, ParameterError] = {}
    for parameter in fields(Parameters):
        name = parameter.name
        # It is first declared with any type, because rclpy refuses an integer for a double.
        anything = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(name, parameter.default, anything).value
        node.undeclare_parameter(name)
        try:
            values[name] = check_value(name, given)
        except ParameterError as error:
            values[name], faults[name] = parameter.default, error
        node.declare_parameter(name, values[name], _descriptor(parameter), ignore_override=True)
    return Parameters(**values), faults


def _descriptor(parameter: Any) -> ParameterDescriptor:
    """Return what `ros2 param describe` shows."""
    words = parameter.metadata
    unit, between = words["unit"], words["between"]
    fixed = parameter.name == "autostart"
    description = words["description"] + (f" Unit: {unit}." if unit else "")
    if not words["live"]:
        description += " Read at start." if fixed else " Read when the node is configured."
    valid = f"Must be {words['valid']}."
    found = ParameterDescriptor(
        description=description, additional_constraints=valid, read_only=fixed
    )
    if between is not None:
        ends = {"from_value": between[0], "to_value": between[1]}
        if type(parameter.default) is int:
            found.integer_range = [IntegerRange(**ends)]
        else:
            found.floating_point_range = [FloatingPointRange(**ends)]
    return found


def in_own_types(asked: "list[Parameter[Any]]") -> "list[Parameter[Any]]":
    """Return parameters that are to be set, with integers for doubles converted."""
    kinds = {parameter.name: type(parameter.default) for parameter in fields(Parameters)}
    return [
        Parameter(p.name, value=own_type(kinds[p.name], p.value)) if p.name in kinds else p
        for p in asked
    ]


def changed(
    settings: Parameters, asked: "list[Parameter[Any]]", *, configured: bool
) -> tuple[Parameters, SetParametersResult]:
    """Return the parameters after a change, and whether the change is allowed.

    Parameters
    ----------
    settings, asked : Parameters, list of rclpy.parameter.Parameter
        The current parameters, and new values, also of parameters that every node has.
    configured : bool
        Whether the node is configured, so that only live parameters may be set.
    """
    live = {parameter.name: parameter.metadata["live"] for parameter in fields(Parameters)}
    values = {p.name: p.value for p in asked if p.name in live}
    try:
        found = with_values(settings, values)
        if configured:
            found.crank_input()
        reason = ""
    except ParameterError as error:
        reason = str(error)
    for name in values:
        if configured and not live[name]:
            reason = (
                f"Parameter {name} is read when the node is configured; clean the node up first "
                "(`ros2 lifecycle set`), or give the parameter at the start."
            )
    if reason:
        return settings, SetParametersResult(successful=False, reason=reason)
    return found, SetParametersResult(successful=True)
