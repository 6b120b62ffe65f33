# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What does a phone on the implement record when a hammer hits it at five heights?

It writes a CSV file for each height, of an implement that is 25 % heavier than its type plate says,
or of the mechanism in a file: ``python simulated_hammer.py FOLDER MECHANISM``.
The phone has no anti-aliasing filter: modes above half its rate are in the samples, folded.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import linkage_vibration as lv

HEIGHTS = (95, 115, 135, 155, 175)  # crank angles, deg
RATE, BLOWS, SECONDS = 400, 5, 8  # Hz, blows at each height, s from one to the next
IMPULSE, CONTACT = 200.0, 4e-3  # N s and s: half a sine, of a sledgehammer on wood
NOISE, GRAVITY = 0.05, 9.81  # m/s2
PLACES = [("E1", "x"), ("E1", "z")]

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
config = Path(__file__).parents[1] / "config"
mechanism = lv.read_mechanism(config / "three_point_linkage_on_tractor.yaml")
[implement] = mechanism.rigid_bodies
heavier = replace(mechanism, rigid_bodies=(replace(implement, mass=1.25 * implement.mass),))
recorded = lv.read_mechanism(sys.argv[2]) if len(sys.argv) > 2 else heavier
model, random = lv.LinkageModel(recorded), np.random.default_rng(1)

count = RATE * SECONDS
times = np.arange(count) / RATE - 1.0  # s after the blow
turning = np.pi / CONTACT  # rad/s
during = (times >= 0.0) & (times < CONTACT)
force = IMPULSE * turning / 2.0 * np.where(during, np.sin(turning * times), 0.0)  # N

for height in HEIGHTS:
    # Each term (a + s b) / (s^2 + c s + k) has two poles s, of all modes whatever their frequency.
    terms = model.solve(np.radians(height)).frf(PLACES, PLACES)
    root = np.sqrt((terms.decay / 2.0) ** 2 - terms.stiffness.astype(complex))
    poles = np.concatenate([root, -root]) - np.tile(terms.decay / 2.0, 2)
    residues = np.concatenate([terms.residues, terms.residues], axis=2)
    residues = residues + poles * np.concatenate([terms.rates, terms.rates], axis=2)
    residues = residues / np.concatenate([2.0 * root, -2.0 * root])
    # What half a sine makes of exp(s t), until its end and after it.
    each = poles[:, np.newaxis]
    late = np.exp(each * np.maximum(times - CONTACT, 0.0))
    driven = -each * np.sin(turning * times) - turning * np.cos(turning * times)
    response = turning * np.exp(each * np.maximum(times, 0.0))
    response += np.where(during, driven, turning * late)
    response *= (times >= 0.0) * IMPULSE * turning / 2.0 / (each**2 + turning**2)
    blows = []
    for angle in random.uniform(0.0, np.pi, BLOWS):  # each blow has another direction
        direction = np.array([np.cos(angle), np.sin(angle)])
        along = np.einsum("oip,i->op", residues, direction)
        signal = (along * poles**2) @ response + np.outer((along * poles).sum(axis=1), force)
        blows.append(signal.real.T)  # m/s2
    signals = np.vstack(blows) + random.normal(0.0, NOISE, (BLOWS * count, 2))
    largest = np.abs(signals).max()
    signals[:, 1] += GRAVITY
    path = folder / f"{height}.csv"
    titles = "time (s),acceleration x (m/s2),acceleration z (m/s2)"
    columns = np.column_stack([np.arange(len(signals)) / RATE, signals])
    np.savetxt(path, columns, "%.5f", ",", header=titles, comments="")
    print(f"{path}: {BLOWS} blows, up to {largest:.0f} m/s2")
