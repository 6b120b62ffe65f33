# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Where are the resonances of the hitch at a crank angle of 132 deg?"""

import math

import linkage_vibration as lv

model = lv.LinkageModel(lv.read_mechanism())
solutions = [half.solve(math.radians(132.0)) for half in model.halves]

for solution, motions in zip(solutions, ("in the plane", "sway, roll and yaw"), strict=True):
    print(f"{motions}:")
    modes = zip(solution.natural_frequencies[:6], solution.damping_ratios[:6], strict=True)
    for mode, (frequency, damping) in enumerate(modes, start=1):
        print(f"mode {mode}: {frequency:7.2f} Hz, damping ratio {100.0 * damping:.2f} %")

peak = solutions[0].peak((0.0, 200.0))
print(f"The response is highest at {peak.frequency:.2f} Hz: {peak.magnitude:.2e} m/N")
