# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What does an implement of 1200 kg instead of 800 kg change in a recorded drive?"""

import tempfile
from pathlib import Path

import numpy as np

import linkage_vibration as lv

drive = Path(__file__).parents[1] / "config" / "drives" / "hitch_duty_cycle.mcap"

with tempfile.TemporaryDirectory() as folder:
    lv.replay([drive], f"{folder}/light.mcap")
    lv.replay([drive], f"{folder}/heavy.mcap", what_if=lv.WhatIf(mass=1200.0))
    light, heavy = lv.read_log(f"{folder}/light.mcap"), lv.read_log(f"{folder}/heavy.mcap")

change = heavy.natural_frequencies / light.natural_frequencies - 1.0  # (n, n_modes)
for mode in range(light.n_modes):
    largest = np.abs(change[:, mode]).argmax()
    print(
        f"{light.mode_label(mode)}: at most {100.0 * change[largest, mode]:+.1f} %, "
        f"at {np.degrees(light.crank_angle[largest]):.1f} deg"
    )
