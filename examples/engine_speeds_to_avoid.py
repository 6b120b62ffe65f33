# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which speeds of a six-cylinder engine come within 10 % of a mode at each hitch angle?"""

import math

import linkage_vibration as lv

ORDER = 3.0  # a six-cylinder four-stroke engine fires three times per turn
MARGIN = 0.1
IDLE, RATED = 800.0, 2200.0  # rpm

table = lv.load_table()
predictor = lv.Predictor(table)
for angle_deg in range(90, 181, 15):
    prediction = predictor.predict(math.radians(angle_deg))
    ranges = []
    for frequency in prediction.natural_frequencies[~table.lateral_modes]:  # it acts in the plane
        low, high = (60.0 * frequency * (1.0 + side) / ORDER for side in (-MARGIN, MARGIN))
        if low < RATED and high > IDLE:
            ranges.append(f"{max(low, IDLE):.0f} to {min(high, RATED):.0f} rpm")
    print(f"{angle_deg:4d} deg: avoid {' and '.join(ranges) or 'nothing'}")
