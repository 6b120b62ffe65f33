# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How do the natural frequencies at 140 deg change over a grid of designs?"""

import itertools
import math
from pathlib import Path

import linkage_vibration as lv

shipped = Path(__file__).parents[1] / "config" / "three_point_linkage.yaml"
masses = [400.0, 800.0, 1200.0]  # of the implement, kg
holes = [0.200, 0.340, 0.366]  # along the lower link, m
designs = {"rigid_bodies.implement.mass": masses, "links.lower_link.points.V1": holes}

data = lv.sweep(lv.read_mechanism(shipped), designs, [math.radians(140.0)]).isel(alpha3=0)
for i, j in itertools.product(range(len(masses)), range(len(holes))):
    design = data[dict(zip(designs, (i, j), strict=True))]
    frequencies = ", ".join(f"{f:.2f}" for f in design.natural_frequencies.values)
    print(f"{masses[i]:g} kg, {holes[j]:g} m: {design.problem.item() or frequencies + ' Hz'}")
