# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluates the model on a grid of angles, between which the page interpolates."""

from typing import Any

import numpy as np

from linkage_vibration.drawing.geometry import (
    largest,
    left_curves,
    mode_curves,
    nearest_mode,
    scene,
    size,
)
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
        solved = [[half.solve(float(angle)) for angle in angles] for half in model.halves]
    except LinkageVibrationError:
        return None
    scenes = [scene(model, solution.configuration) for solution in solved[0]]
    lengths = {n: len(curve) for n, curve in scenes[0].bodies.items() if n != GROUND}
    frequencies = table.evaluate(angles)[:, : table.n_modes]
    shapes = np.zeros((table.n_modes, len(angles), sum(lengths.values()), 2))
    for mode in range(table.n_modes):
        lateral = bool(table.lateral_modes[mode])
        for i, solution in enumerate(solved[lateral]):
            if np.isnan(frequencies[i, mode]):
                continue  # an overdamped mode does not oscillate
            at = nearest_mode(solution, float(frequencies[i, mode]))
            moved = left_curves(solution, at, model) if lateral else mode_curves(solution, at)
            moved = {name: moved[name] for name in lengths}
            shape = np.vstack(list(moved.values())) / largest(moved)
            # The sign of a shape is arbitrary; it is that of the shape at the previous angle.
            turned = i > 0 and float((shape * shapes[mode, i - 1]).sum()) < 0.0
            shapes[mode, i] = -shape if turned else shape
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
