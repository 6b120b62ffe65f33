# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures what gravity changes in the shipped hitches: ``python -m benchmark gravity``."""

import math
from dataclasses import replace

import numpy as np

from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

GRAVITY = 9.81  # m/s2
LINKAGES = ("three_point_linkage", "three_point_linkage_on_tractor")


def compare(name: str) -> str:
    """Return a table of the changes of a shipped linkage's natural frequencies over its stroke."""
    mechanism = read_mechanism(config_file(f"{name}.yaml"))
    light, heavy = LinkageModel(mechanism), LinkageModel(replace(mechanism, gravity=GRAVITY))
    modes = load_table(config_file(f"tables/{name}.npz"), mechanism).mode_names
    rows = []
    for alpha3 in np.linspace(*mechanism.stroke, 7).tolist():
        before, after = (model.solve(alpha3).modes.omega[: len(modes)] for model in (light, heavy))
        changes = 100.0 * (after / before - 1.0)
        rows.append([f"{math.degrees(alpha3):.0f}", *(f"{change:+.2f}" for change in changes)])
    return table(["alpha3, deg", *modes], rows)


def main() -> None:
    """Compare both hitches, and write the page."""
    parts = [
        "This page shows by how many percent gravity changes the undamped natural frequencies of "
        "the shipped hitches, through the forces that carry the weight."
    ]
    for name in LINKAGES:
        parts += [f"## {name}", compare(name)]
    publish("gravity", "Gravity", parts, machine())


if __name__ == "__main__":
    main()
