# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Declares, describes and sets the node's parameters in ROS 2."""

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
        The given values, and the default values of invalid parameters.
    faults : dict of str to ParameterError
        The errors of invalid parameters, by name.
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
    """Return parameters that are to be set, with integers for doubles converted."""
    kinds = {parameter.name: type(parameter.default) for parameter in fields(Parameters)}
    return [
        Parameter(p.name, value=own_type(kinds[p.name], p.value)) if p.name in kinds else p
        for p in asked
    ]


def changed(
    settings: Parameters, asked: "Iterable[Parameter[Any]]", *, configured: bool
) -> tuple[Parameters, SetParametersResult]:
    """Return the parameters after a change, and whether the change is allowed.

    Parameters
    ----------
    settings : Parameters
        The current parameters.
    asked : iterable of rclpy.parameter.Parameter
        New values, possibly also of parameters that every node has.
    configured : bool
        Whether the node is configured, so that only live parameters may be set.
    """
    known = {parameter.name: parameter.metadata for parameter in fields(Parameters)}
    values: Mapping[str, Any] = {p.name: p.value for p in asked if p.name in known}
    reason = ""
    try:
        found = with_values(settings, values)
        if configured:
            found.crank_input()
    except ParameterError as error:
        reason = str(error)
    for name in values:
        if configured and not known[name]["live"]:
            reason = (
                f"Parameter {name} is read when the node is configured; clean the node up first "
                "(`ros2 lifecycle set`), or give the parameter at the start."
            )
    if reason:
        return settings, SetParametersResult(successful=False, reason=reason)
    return found, SetParametersResult(successful=True)
