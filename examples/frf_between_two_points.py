# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How does the hitch pin E1 respond in z to a force at the lift rod's pin V1 at 132 deg?"""

import math

import numpy as np

import linkage_vibration as lv

model = lv.LinkageModel(lv.read_mechanism())
frequencies = np.linspace(0.5, 200.0, 400)  # Hz

solution = model.solve(math.radians(132.0))
receptance = solution.frf([("E1", "z")], [("V1", "z")]).frf(frequencies)[:, 0, 0]  # m/N

for frequency in (1.0, 10.0, 100.0):
    line = np.abs(frequencies - frequency).argmin()
    magnitude, phase = abs(receptance[line]), np.degrees(np.angle(receptance[line]))
    print(f"{frequencies[line]:6.1f} Hz: {magnitude:.2e} m/N, {phase:6.1f} deg")
