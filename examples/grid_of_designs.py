# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How do the natural frequencies at 140 deg change over a grid of designs?"""

import itertools
import math
import tempfile
from pathlib import Path

import yaml

import linkage_vibration as lv

shipped = Path(__file__).parents[1] / "config" / "three_point_linkage.yaml"
description = yaml.safe_load(shipped.read_text())  # of your own linkage

masses = [400.0, 800.0, 1200.0]  # of the implement, kg
holes = [0.200, 0.340, 0.366]  # along the lower link, m

with tempfile.TemporaryDirectory() as folder:
    design = Path(folder, "design.yaml")
    for mass, hole in itertools.product(masses, holes):
        description["rigid_bodies"]["implement"]["mass"] = mass
        description["links"]["lower_link"]["points"]["V1"] = hole
        design.write_text(yaml.safe_dump(description, sort_keys=False))
        try:
            table = lv.build_table(lv.LinkageModel(lv.read_mechanism(design)), tolerance=1e-4)
        except lv.LinkageVibrationError as error:
            print(f"{mass:g} kg, {hole:g} m: {error}")
            continue
        frequencies = lv.Predictor(table).predict(math.radians(140.0)).natural_frequencies
        print(f"{mass:g} kg, {hole:g} m: {', '.join(f'{f:.2f}' for f in frequencies)} Hz")
