# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Prints the table of parameters in docs/node.md."""

import re
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
    """Return the parameters as a Markdown table.

    Parameters that differ only in the name of an input share a row, which calls this name INPUT.
    """
    names: dict[str, list[str]] = {}
    rows = dict[str, str]()
    for parameter in fields(Parameters):
        words = parameter.metadata
        row = (
            f"| {TYPE_NAMES[type(parameter.default)]} "
            f"| `{yaml_text(parameter.default)}` | {words['unit']} | {words['valid']} "
            f"| {'yes' if words['live'] else ''} | {words['description']} |"
        )
        common = re.sub("hitch|engine|pto|PTO|ground", "INPUT", row)
        names.setdefault(common, []).append(f"`{parameter.name}`")
        rows[common] = common if len(names[common]) > 1 else row
    return "\n".join(
        [
            "| parameter | type | default | unit | valid | live | meaning |",
            "|---|---|---|---|---|---|---|",
            *(f"| {', '.join(names[common])} {row}" for common, row in rows.items()),
        ]
    )


if __name__ == "__main__":
    print(parameter_table())
