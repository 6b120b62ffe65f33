# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The model on a grid of angles, from which a page draws it at any: shapes, and the receptance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.drawing.geometry import largest, mode_curves, nearest_mode, scene, size
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.table.table import Table

FloatArray = NDArray[np.float64]

DRAWN_ANGLES = 91  # between which a page interpolates places and shapes
FRF_ANGLES = 361  # and the terms of the receptance


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """The linkage over its range of angles.

    Attributes
    ----------
    angles : ndarray, (n_angles,)
        rad.
    bodies : tuple of str
        Names.
    rigid : tuple of bool
        Which of them are rigid.
    lengths : tuple of int
        How many points each body's curve has.
    places : ndarray, (n_angles, n_points, 2)
        Of all curves, one behind the other, m.
    joints, centres : ndarray, (n_angles, n, 2)
        Pins that move, and centres of gravity, m.
    ground : ndarray, (n, 2)
        Pins on the ground, m.
    shapes : ndarray, (n_modes, n_angles, n_points, 2)
        How modes move the curves' points; the one that moves most moves by 1.
    size : float
        Of the linkage, m.
    """

    angles: FloatArray
    bodies: tuple[str, ...]
    rigid: tuple[bool, ...]
    lengths: tuple[int, ...]
    places: FloatArray
    joints: FloatArray
    centres: FloatArray
    ground: FloatArray
    shapes: FloatArray
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class FrfTerms:
    """The receptance at the drive point over the range of angles, as `PoleResidue`.

    Attributes
    ----------
    angles : ndarray, (n_angles,)
        rad.
    terms : ndarray, (n_angles, n_terms, 7)
        k (real, imaginary), c, residue (real, imaginary), rate (real, imaginary).
    residual : ndarray, (n_angles, 2)
        Real and imaginary.
    band : tuple of float
        Hz.
    place : str
        Where, as in "E1 z".
    """

    angles: FloatArray
    terms: FloatArray
    residual: FloatArray
    band: tuple[float, float]
    place: str


def drawing(mechanism: Mechanism, table: Table) -> Drawing | None:
    """Draw the linkage and the table's modes at angles over the table's range.

    Returns None where the model has no shapes, as with links that are known by FRFs alone.
    """
    low, high = table.alpha3_range
    angles = np.linspace(low, high, DRAWN_ANGLES)
    try:
        model = LinkageModel(mechanism)
        solutions = [model.solve(float(angle)) for angle in angles]
    except LinkageVibrationError:
        return None
    scenes = [scene(model, solution.configuration) for solution in solutions]
    lengths = {name: len(curve) for name, curve in scenes[0].bodies.items()}
    frequencies = table.evaluate(angles)[:, : table.n_modes]
    shapes = np.zeros((table.n_modes, len(angles), sum(lengths.values()), 2))
    for mode in range(table.n_modes):
        for i, solution in enumerate(solutions):
            moved = mode_curves(solution, nearest_mode(solution, float(frequencies[i, mode])))
            shape = np.vstack(list(moved.values())) / largest(moved)
            # A shape has no sign of its own: it takes that of its neighbour.
            turned = i > 0 and float((shape * shapes[mode, i - 1]).sum()) < 0.0
            shapes[mode, i] = -shape if turned else shape
    rigid = {body.name for body in mechanism.rigid_bodies}
    return Drawing(
        angles=angles,
        bodies=tuple(lengths),
        rigid=tuple(name in rigid for name in lengths),
        lengths=tuple(lengths.values()),
        places=np.array([np.vstack(list(drawn.bodies.values())) for drawn in scenes]),
        joints=np.array([drawn.joints for drawn in scenes]),
        centres=np.array([drawn.centres for drawn in scenes]),
        ground=scenes[0].ground,
        shapes=shapes,
        size=max(size(drawn.bodies) for drawn in scenes),
    )


def frf_terms(mechanism: Mechanism, table: Table) -> FrfTerms | None:
    """Return the receptance at the drive point at angles over the table's range.

    Returns None where the table has none.
    """
    place = (mechanism.response.point, mechanism.response.direction)
    if place not in table.places:
        return None
    low, high = table.alpha3_range
    angles = np.linspace(low, high, FRF_ANGLES)
    found = [table.frf(float(angle), [place], [place]) for angle in angles]
    residual = np.array([frf.residual[0, 0] for frf in found])
    return FrfTerms(
        angles,
        np.array([_terms(frf) for frf in found]),
        np.column_stack([residual.real, residual.imag]),
        (max(table.band[0], 0.0), table.band[1]),
        " ".join(place),
    )


def _terms(frf: PoleResidue) -> FloatArray:
    k, residue, rate = frf.stiffness, frf.residues[0, 0], frf.rates[0, 0]
    return np.column_stack(
        [k.real, k.imag, frf.decay, residue.real, residue.imag, rate.real, rate.imag]
    )
