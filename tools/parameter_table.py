# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Prints the table of parameters in docs/node.md."""

from dataclasses import fields

from linkage_vibration.prediction.settings import Parameters, yaml_text

# ROS 2's names of the types, as `ros2 param describe` prints them.
TYPE_NAMES = {
    bool: "boolean",
    int: "integer",
    float: "double",
    str: "string",
    tuple: "double array",
}


def parameter_table() -> str:
    """Return the parameters as a Markdown table."""
    rows = ["| parameter | type | default | unit | valid | live | meaning |"]
    rows += ["|---|---|---|---|---|---|---|"]
    for parameter in fields(Parameters):
        words = parameter.metadata
        rows.append(
            f"| `{parameter.name}` | {TYPE_NAMES[type(parameter.default)]} "
            f"| `{yaml_text(parameter.default)}` | {words['unit']} | {words['valid']} "
            f"| {'yes' if words['live'] else ''} | {words['description']} |"
        )
    return "\n".join(rows)


if __name__ == "__main__":
    print(parameter_table())
