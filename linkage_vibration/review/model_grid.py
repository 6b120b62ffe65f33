# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluates the model on a grid of angles, between which the page interpolates."""

from itertools import pairwise
from typing import Any

import numpy as np

from linkage_vibration.drawing.geometry import left_curves, mode_curves, nearest_mode, scene, size
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import GROUND, Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import Table

DRAWN_ANGLES = 91  # of positions and mode shapes


def linkage_grid(mechanism: Mechanism, table: Table) -> dict[str, Any] | None:
    """Return the linkage without its base over a table's range, and modes; None without shapes.

    ``places``, (n_angles, n_points, 2), m, and ``shapes``, (n_modes, n_angles, n_points, 2), are of
    all curves with so many points as ``lengths``; ``joints`` and ``centres`` are (n_angles, n, 2).
    """
    angles = np.linspace(*table.alpha3_range, DRAWN_ANGLES)
    try:
        model = LinkageModel(mechanism)
        solved = [half.stack(angles).rows for half in model.halves]
    except LinkageVibrationError:
        return None
    scenes = [scene(model, solution.configuration) for solution in solved[0]]
    lengths = {n: len(curve) for n, curve in scenes[0].bodies.items() if n != GROUND}
    frequencies = table.evaluate(angles)[:, : table.n_modes]
    shapes = np.zeros((table.n_modes, len(angles), sum(lengths.values()), 2))
    for lateral, solutions in enumerate(solved):
        for i, solution in enumerate(solutions):
            # An overdamped mode does not oscillate.
            known = np.isfinite(frequencies[i]) & (table.lateral_modes == lateral)
            at = np.array([nearest_mode(solution, f) for f in frequencies[i, known]], np.int64)
            moved = left_curves(solution, at, model) if lateral else mode_curves(solution, at)
            shape = np.concatenate([moved[name] for name in lengths])
            longest = np.linalg.norm(shape, axis=1).max(axis=0)
            shapes[known, i] = np.moveaxis(shape / longest, 2, 0)
    for before, here in pairwise(shapes.swapaxes(0, 1)):
        # The sign of a shape is arbitrary; it is that of the shape at the previous angle.
        here[(here * before).sum(axis=(1, 2)) < 0.0] *= -1.0
    rigid = {body.name for body in mechanism.rigid_bodies}
    arrays = {
        "places": np.array([np.vstack([drawn.bodies[n] for n in lengths]) for drawn in scenes]),
        "shapes": shapes,
        "joints": np.array([drawn.joints for drawn in scenes]),
        "centres": np.array([drawn.centres[: len(mechanism.rigid_bodies)] for drawn in scenes]),
        "ground": scenes[0].ground,
    }
    return {
        "bodies": list(lengths),
        "rigid": [name in rigid for name in lengths],
        "lengths": list(lengths.values()),
        "names": scenes[0].names,
        "size": max(
            size({GROUND: drawn.ground, **{n: drawn.bodies[n] for n in lengths}})
            for drawn in scenes
        ),
        "angles": angles,
        "lateral": table.lateral_modes.tolist(),
        **{name: array.astype(np.float32) for name, array in arrays.items()},
    }
