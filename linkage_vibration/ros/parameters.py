# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters: declared, checked and documented from one list."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import yaml
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from linkage_vibration.errors import LinkageVibrationError

Value = TypeVar("Value", bool, int, float, str)

# ROS 2's names of the types, as `ros2 param describe` prints them.
TYPE_NAMES = {bool: "boolean", int: "integer", float: "double", str: "string"}


class ParameterError(LinkageVibrationError):
    """A parameter of the node has a value that it cannot have."""


def _parameter(
    default: Value,
    unit: str,
    valid: str,
    description: str,
    check: Callable[[Value], bool] = lambda value: True,
) -> Value:
    """Return a dataclass field that carries what a declaration and a manual say."""
    metadata = {"unit": unit, "valid": valid, "description": description, "check": check}
    found: Any = field(default=default, metadata=metadata)
    return found  # type: ignore[no-any-return]


@dataclass(frozen=True, slots=True)
class Parameters:
    """What the node was asked to do; fixed while it runs, so that one log has one meaning.

    The fields' metadata are the descriptors; their order is the manual's.
    """

    joint_name: str = _parameter(
        "hitch_rockshaft_joint",
        "",
        "the name of a joint",
        "Joint whose position turns the input crank.",
        lambda name: name != "",
    )
    sign: int = _parameter(
        1,
        "1",
        "1 or -1",
        "Sense of the joint: crank angle = sign * scale * position + offset.",
        lambda sign: sign in (1, -1),
    )
    scale: float = _parameter(
        1.0,
        "rad per unit of position",
        "a finite number greater than 0",
        "Change of the crank angle per unit of joint position.",
        lambda scale: 0.0 < scale < math.inf,
    )
    offset: float = _parameter(
        0.0, "rad", "a finite number", "Crank angle at joint position 0.", math.isfinite
    )
    mechanism_file: str = _parameter(
        "",
        "",
        "the path of a YAML file, or empty",
        "Mechanism; empty for the three-point linkage that ships with the package.",
    )
    table_file: str = _parameter(
        "",
        "",
        "the path of an .npz file, or empty",
        "Table of that mechanism, made by `linkage-vibration build`; empty for the one that ships "
        "with the package, or, where mechanism_file is given, for one computed at start.",
    )
    record: bool = _parameter(
        False,
        "",
        "true or false",
        "Whether to log the joint states that are used and the predictions, in MCAP.",
    )
    log_directory: str = _parameter(
        "",
        "",
        "the path of a folder that exists, or empty",
        "Where logs go; empty for the current directory.",
    )

    def crank_angle(self, position: float) -> float:
        """Return the crank angle alpha3 (rad) at a position of the joint (its own unit)."""
        return self.sign * self.scale * position + self.offset


def check_value(name: str, value: object) -> Any:
    """Return the value of a parameter, in its own type.

    Parameters
    ----------
    name : str
        A field of `Parameters`.
    value : object
        What a person gave for it.

    Raises
    ------
    ParameterError
        If it has another type, or is not valid.
    """
    parameter = next(f for f in fields(Parameters) if f.name == name)
    kind = type(parameter.default)
    if kind is float and type(value) is int:
        value = float(value)  # YAML's `scale: 1` means a number as much as `scale: 1.0` does.
    if type(value) is not kind or not parameter.metadata["check"](value):
        raise ParameterError(
            f"Parameter {name} must be {parameter.metadata['valid']}, not {value!r}; "
            f"write for example `{name}: {_yaml(parameter.default)}`."
        )
    return value


def declare_parameters(node: Node) -> Parameters:
    """Declare every parameter on a node, and return what it was given.

    Raises
    ------
    ParameterError
        If one of them is not valid.
    """
    values = {}
    for parameter in fields(Parameters):
        # Declared first with any type, so that rclpy does not refuse an int before it is looked at.
        anything = ParameterDescriptor(dynamic_typing=True)
        given = node.declare_parameter(parameter.name, parameter.default, anything).value
        node.undeclare_parameter(parameter.name)
        values[parameter.name] = check_value(parameter.name, given)
        unit = parameter.metadata["unit"]
        descriptor = ParameterDescriptor(
            description=parameter.metadata["description"] + (f" Unit: {unit}." if unit else ""),
            additional_constraints=f"Must be {parameter.metadata['valid']}.",
            read_only=True,
        )
        node.declare_parameter(
            parameter.name, values[parameter.name], descriptor, ignore_override=True
        )
    return Parameters(**values)


def parameters_yaml(parameters: Parameters, node_name: str) -> str:
    """Return a file for ``--params-file`` that gives a node these parameters."""
    values = {f.name: getattr(parameters, f.name) for f in fields(parameters)}
    return yaml.safe_dump({node_name: {"ros__parameters": values}}, sort_keys=False)


def parameter_table() -> str:
    """Return the parameters as a Markdown table, for the manual."""
    rows = ["| parameter | type | default | unit | valid | meaning |", "|---|---|---|---|---|---|"]
    for parameter in fields(Parameters):
        words = parameter.metadata
        rows.append(
            f"| `{parameter.name}` | {TYPE_NAMES[type(parameter.default)]} "
            f"| `{_yaml(parameter.default)}` | {words['unit']} | {words['valid']} "
            f"| {words['description']} |"
        )
    return "\n".join(rows) + "\n"


def _yaml(value: object) -> str:
    """Return a scalar as YAML writes it."""
    return yaml.safe_dump(value, default_flow_style=True).splitlines()[0]
