# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluates the model on a grid of angles, between which the page interpolates."""

from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from linkage_vibration.drawing.geometry import (
    largest,
    left_curves,
    mode_curves,
    nearest_mode,
    scene,
    size,
)
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import Table

DRAWN_ANGLES = 91  # of positions and mode shapes
FRF_ANGLES = 361  # of the receptance


def linkage_grid(mechanism: Mechanism, table: Table) -> dict[str, Any] | None:
    """Return the linkage and left-side modes over a table's range; None without shapes.

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
    lengths = {name: len(curve) for name, curve in scenes[0].bodies.items()}
    frequencies = table.evaluate(angles)[:, : table.n_modes]
    shapes = np.zeros((table.n_modes, len(angles), sum(lengths.values()), 2))
    for mode in range(table.n_modes):
        lateral = bool(table.lateral_modes[mode])
        for i, solution in enumerate(solved[lateral]):
            if np.isnan(frequencies[i, mode]):
                continue  # an overdamped mode does not oscillate
            at = nearest_mode(solution, float(frequencies[i, mode]))
            moved = left_curves(solution, at, model) if lateral else mode_curves(solution, at)
            shape = np.vstack(list(moved.values())) / largest(moved)
            # The sign of a shape is arbitrary; it is that of the shape at the previous angle.
            turned = i > 0 and float((shape * shapes[mode, i - 1]).sum()) < 0.0
            shapes[mode, i] = -shape if turned else shape
    rigid = {body.name for body in mechanism.rigid}
    arrays = {
        "places": np.array([np.vstack(list(drawn.bodies.values())) for drawn in scenes]),
        "shapes": shapes,
        "joints": np.array([drawn.joints for drawn in scenes]),
        "centres": np.array([drawn.centres for drawn in scenes]),
        "ground": scenes[0].ground,
    }
    return {
        "bodies": list(lengths),
        "rigid": [name in rigid for name in lengths],
        "lengths": list(lengths.values()),
        "size": max(size(drawn.bodies) for drawn in scenes),
        "angles": angles,
        **{name: array.astype(np.float32) for name, array in arrays.items()},
    }


def receptance_grid(mechanism: Mechanism, table: Table) -> dict[str, Any] | None:
    """Return the drive point's receptance over the range of a table; None if it has none.

    ``terms``, (n_angles, n_terms, 7), are stiffness, decay, residue and rate of `PoleResidue`,
    complex but for the decay; ``residual``, (n_angles, 2), follows.
    """
    place = (mechanism.response.point, mechanism.response.direction)
    if place not in table.places:
        return None
    angles = np.linspace(*table.alpha3_range, FRF_ANGLES)
    terms, residuals = [], []
    for angle in angles:
        frf = table.frf(float(angle), [place], [place])
        k, residue, rate = frf.stiffness, frf.residues[0, 0], frf.rates[0, 0]
        parts = [k.real, k.imag, frf.decay, residue.real, residue.imag, rate.real, rate.imag]
        terms.append(np.column_stack(parts))
        residuals.append(frf.residual[0, 0])
    return {
        "place": " ".join(place),
        "band": [max(table.band[0], 0.0), table.band[1]],
        "n_terms": terms[0].shape[0],
        "angles": angles,
        "terms": np.array(_continued(terms)),
        "residual": np.column_stack([np.real(residuals), np.imag(residuals)]),
        "frequencies": table.evaluate(angles)[:, : table.n_modes],
    }


def _continued(terms: list[FloatArray]) -> list[FloatArray]:
    """Order the terms of each angle, (n_terms, 7), so that each continues the one before.

    A term without a counterpart, as where poles become real, gets one with the same poles that does
    not respond.
    """
    paired = [terms[0]]
    for here in terms[1:]:
        before = paired[-1]
        earlier, later = _poles(before)[:, np.newaxis], _poles(here)
        away = np.abs(earlier - later) / (np.abs(earlier) + np.abs(later))
        left, right = linear_sum_assignment(away**2)  # squares keep the order of shifted poles
        after = _silent(before)
        after[left] = here[right]
        new = np.delete(here, right, axis=0)
        if len(new):
            paired = [np.vstack([past, _silent(new)]) for past in paired]
        paired.append(np.vstack([after, new]))
    return paired


def _poles(terms: FloatArray) -> np.ndarray[Any, np.dtype[np.complex128]]:
    """Return one pole of each term, (n_terms,), rad/s."""
    half = terms[:, 2] / 2.0
    return np.asarray(-half + np.sqrt(half**2 - (terms[:, 0] + 1j * terms[:, 1])))


def _silent(terms: FloatArray) -> FloatArray:
    """Return terms with the same poles that do not respond."""
    return np.asarray(np.hstack([terms[:, :3], np.zeros_like(terms[:, 3:])]))
