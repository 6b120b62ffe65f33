# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters as ROS 2 declares, describes and sets them."""

from collections.abc import Iterable, Mapping
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
    """Declare every parameter on a node.

    Returns
    -------
    settings : Parameters
        What it was given, with the defaults of those that are not valid.
    faults : dict of str to ParameterError
        What is wrong with these, by name.
    """
    values: dict[str, Any] = {}
    faults: dict[str, ParameterError] = {}
    for parameter in fields(Parameters):
        name = parameter.name
        # Declared first with any type, so that rclpy does not refuse an int before it is looked at.
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
    """Return what `ros2 param describe` tells."""
    words = parameter.metadata
    unit, between = words["unit"], words["between"]
    fixed = parameter.name == "autostart"
    description = words["description"] + (f" Unit: {unit}." if unit else "")
    if not words["live"]:
        description += " Read at start." if fixed else " Read when the node is configured."
    descriptor = ParameterDescriptor(
        description=description,
        additional_constraints=f"Must be {words['valid']}.",
        read_only=fixed,
    )
    if between is not None and type(parameter.default) is int:
        descriptor.integer_range = [IntegerRange(from_value=between[0], to_value=between[1])]
    elif between is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=between[0], to_value=between[1])
        ]
    return descriptor


def in_own_types(asked: "list[Parameter[Any]]") -> "list[Parameter[Any]]":
    """Return parameters that are to be set, whole numbers as doubles where these are wanted."""
    kinds = {parameter.name: type(parameter.default) for parameter in fields(Parameters)}
    return [
        Parameter(p.name, value=own_type(kinds[p.name], p.value)) if p.name in kinds else p
        for p in asked
    ]


def changed(
    settings: Parameters, asked: "Iterable[Parameter[Any]]", *, configured: bool
) -> tuple[Parameters, SetParametersResult]:
    """Return the parameters as they would be, and whether they may be set so.

    Parameters
    ----------
    settings : Parameters
        As they are.
    asked : iterable of rclpy.parameter.Parameter
        Some of them, as they are to be, and others that are none of ours.
    configured : bool
        Whether the node is, so that only live ones may be set.
    """
    known = {parameter.name: parameter.metadata for parameter in fields(Parameters)}
    values: Mapping[str, Any] = {p.name: p.value for p in asked if p.name in known}
    try:
        for name in values:
            if configured and not known[name]["live"]:
                raise ParameterError(
                    f"Parameter {name} is read when the node is configured; clean it up first "
                    "(`ros2 lifecycle set`), or give it at start."
                )
        found = with_values(settings, values)
        if configured:
            found.crank_input()
    except ParameterError as error:
        return settings, SetParametersResult(successful=False, reason=str(error))
    return found, SetParametersResult(successful=True)
