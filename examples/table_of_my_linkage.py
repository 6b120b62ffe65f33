# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How do I build a table for my own linkage once, and predict from it later?"""

import math
import tempfile
from pathlib import Path

import linkage_vibration as lv

description = Path(__file__).parents[1] / "config" / "four_bar.yaml"  # your own file

with tempfile.TemporaryDirectory() as folder:
    mechanism = lv.read_mechanism(description)
    table = lv.build_table(lv.LinkageModel(mechanism), tolerance=1e-6)
    lv.save_table(table, f"{folder}/four_bar.npz")

    table = lv.load_table(f"{folder}/four_bar.npz", mechanism)  # refuses another mechanism's table
    low, high = table.alpha3_range
    prediction = lv.Predictor(table).predict(0.5 * (low + high))

print(f"{len(table.alpha3)} angles from {math.degrees(low):.0f} to {math.degrees(high):.0f} deg")
print(f"mode 1 in the middle: {prediction.natural_frequencies[0]:.2f} Hz")
print(f"relative error: {prediction.interpolation_error:.0e}")
