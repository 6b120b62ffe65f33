# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What does a phone on the implement record when a hammer hits it at five heights?

It writes a CSV file for each height, of an implement that is 25 % heavier than its type plate says.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import linkage_vibration as lv

HEIGHTS = (95, 115, 135, 155, 175)  # crank angles, deg
RATE, BLOWS, SECONDS = 400, 5, 8  # Hz, blows at each height, s from one to the next
IMPULSE, WIDTH = 200.0, 3e-3  # N s and s, of a sledgehammer with a rubber head
NOISE, GRAVITY = 0.05, 9.81  # m/s2

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
config = Path(__file__).parents[1] / "config"
mechanism = lv.read_mechanism(config / "three_point_linkage_on_tractor.yaml")
[implement] = mechanism.rigid_bodies
heavier = replace(mechanism, rigid_bodies=(replace(implement, mass=1.25 * implement.mass),))
model, random = lv.LinkageModel(heavier), np.random.default_rng(1)

count = RATE * SECONDS
lines = np.fft.rfftfreq(count, 1.0 / RATE)  # Hz
omega = 2.0 * np.pi * lines
force = IMPULSE * np.exp(-((WIDTH * omega) ** 2) / 2.0 - 1j * omega)  # a second after the start
for height in HEIGHTS:
    solution = model.solve(np.radians(height))
    places = [("E1", "x"), ("E1", "z")]
    frf = solution.frf(places, places).frf(lines)  # m/N, (n_lines, 2, 2)
    blows = []
    for angle in random.uniform(0.0, np.pi, BLOWS):  # each blow has another direction
        direction = np.array([np.cos(angle), np.sin(angle)])
        spectrum = -(omega**2 * force)[:, np.newaxis] * (frf @ direction)
        blows.append(np.fft.irfft(spectrum, count, axis=0) * RATE)  # m/s2
    signals = np.vstack(blows) + random.normal(0.0, NOISE, (BLOWS * count, 2))
    largest = np.abs(signals).max()
    signals[:, 1] += GRAVITY
    times = np.arange(len(signals)) / RATE
    path = folder / f"{height}.csv"
    titles = "time (s),acceleration x (m/s2),acceleration z (m/s2)"
    np.savetxt(path, np.column_stack([times, signals]), "%.5f", ",", header=titles, comments="")
    print(f"{path}: {BLOWS} blows, up to {largest:.0f} m/s2")
