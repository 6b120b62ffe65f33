# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Prints the tables of parameters and of presets in docs/node.md."""

import re
from dataclasses import fields

from linkage_vibration.prediction.inputs.presets import PRESETS, Preset
from linkage_vibration.prediction.settings import Parameters, yaml_text

USUAL = {
    *("hitch_input", "engine_input", "pto_input", "ground_input", "joint_name", "calibration"),
    *("hitch_position", "engine_speed", "pto_speed", "ground_speed", "mechanism_file"),
    *("table_file", "excitation_file", "implement_file", "implement", "sensor_file"),
    *("warning_load_ratio", "record", "log_directory"),
}
"""The parameters that most users set; all others are in the section for experts."""


def parameter_table(*, usual: bool) -> str:
    """Return the parameters that most users set, or all others, as a Markdown table.

    Parameters that differ only in the name of an input share a row, which calls this name INPUT;
    one that all inputs have is named once.
    """
    names: dict[str, list[str]] = {}
    rows = dict[str, str]()
    for parameter in fields(Parameters):
        if (parameter.name in USUAL) != usual:
            continue
        words = parameter.metadata
        unit = words["unit"].removesuffix("1")
        default = f"`{yaml_text(parameter.default)}` {unit}".strip()
        meaning = words["description"].partition(": `")[0].rstrip(".") + "."
        meaning = meaning.removesuffix(" If it is empty, the preset decides.")
        valid = words["valid"].removesuffix(", or empty")
        if " or " in valid and not isinstance(parameter.default, bool):
            meaning += f" Valid: {valid}."
        row = f"| {default} | {meaning} |"
        common = re.sub("hitch|engine|pto|PTO|ground", "INPUT", row)
        mark = "" if words["live"] else "*"
        same = names.setdefault(common, [])
        same.append(f"`{parameter.name}`{mark}")
        rows[common] = common if len(same) > 1 else row
        if len(same) == len(PRESETS):
            same[:] = [f"`INPUT_{parameter.name.partition('_')[2]}`{mark}"]
    return "\n".join(
        [
            "| parameter | default | meaning |",
            "|---|---|---|",
            *(f"| {', '.join(names[common])} {row}" for common, row in rows.items()),
        ]
    )


def preset_table() -> str:
    """Return what each preset reads, as a Markdown table."""
    groups: dict[tuple[str, str], list[Preset]] = {}
    for presets in PRESETS.values():
        for key, preset in presets.items():
            groups.setdefault((key, preset.type), []).append(preset)
    rows = []
    for (key, kind), same in groups.items():
        topics = ", ".join(f"`{topic}`" for topic in dict.fromkeys(p.topic for p in same))
        numbers = ", ".join(
            f"`{field}` ({unit})" for field, unit in dict.fromkeys((p.field, p.unit) for p in same)
        ).replace("{joint_name}", "JOINT")
        rows.append(f"| `{key}` | {topics} | `{kind}` | {numbers} |")
    return "\n".join(["| preset | topic | type | number |", "|---|---|---|---|", *rows])


if __name__ == "__main__":
    print(preset_table(), parameter_table(usual=True), parameter_table(usual=False), sep="\n\n")
