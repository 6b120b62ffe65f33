# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a linkage looks like: curves and points in the plane, for any way of drawing them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Point
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel, Solution

FloatArray = NDArray[np.float64]

_ON = 1e-6  # of an axis' length: a point that is nearer to a node than that stands on it

Curves = dict[str, FloatArray]
"""Points of each body's curve, (n, 2), along x and z."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A linkage in one configuration.

    Attributes
    ----------
    bodies : dict of str to ndarray, (n, 2)
        Curves, m; a rigid body's is closed by its centre of gravity.
    joints, ground, centres : ndarray, (n, 2)
        Pins that move, pins on the ground, and the rigid bodies' centres of gravity, m.
    """

    bodies: Curves
    joints: FloatArray
    ground: FloatArray
    centres: FloatArray


def scene(model: LinkageModel, configuration: Configuration) -> Scene:
    """Return what a linkage looks like in a configuration."""
    mechanism = model.mechanism
    ground = dict(mechanism.ground)
    pins = {point: body for point, _, body in mechanism.joints if point not in ground}
    return Scene(
        curves(model, configuration),
        _rows(
            [
                configuration.place(body, mechanism.local_points(body)[point])
                for point, body in pins.items()
            ]
        ),
        _rows([np.array(place) for place in ground.values()]),
        _rows(
            [
                configuration.place(body.name, body.centre_of_gravity)
                for body in mechanism.rigid_bodies
            ]
        ),
    )


def curves(model: LinkageModel, configuration: Configuration) -> Curves:
    """Return the curve of each body, m.

    That is a link's axis, from which it goes out and back to points beside it; of a rigid body its
    points and its centre of gravity, closed.
    """
    found = {}
    for component in model.components:
        name = component.name
        known = model.mechanism.local_points(name)
        if isinstance(component, Component) and component.drawing is not None:
            axis = [(float(x), float(z)) for x, z in component.drawing.places]
            for node, point in _beside(component.drawing.places, known):
                axis[node + 1 : node + 1] = [known[point], axis[node]]
        else:
            axis = list(known.values())
        found[name] = np.array([configuration.place(name, place) for place in axis])
    for rigid in model.mechanism.rigid_bodies:
        own = found[rigid.name]
        centre = configuration.place(rigid.name, rigid.centre_of_gravity)
        found[rigid.name] = np.vstack([own, centre, own[:1]])
    return found


def mode_curves(solution: Solution, mode: int) -> Curves:
    """Return how a mass-normalised mode moves the points of `curves`, 1/sqrt(kg)."""
    model, shape = solution.model, solution.modes.shapes[:, mode]
    found = {name: moved[:, ::2] for name, (_, moved) in solution.link_shapes(mode).items()}
    for component in model.components:
        if isinstance(component, Component) and component.drawing is not None:
            name, moved = component.name, found[component.name]
            known = model.mechanism.local_points(name)
            for node, point in _beside(component.drawing.places, known):
                rows = model.interface.displacement(name, point, solution.configuration)[::2]
                aside = rows @ shape[: rows.shape[1]]
                moved = np.insert(moved, node + 1, [aside, moved[node]], axis=0)
            found[name] = moved
    for rigid in model.mechanism.rigid_bodies:
        # Its own coordinates are its centre's displacements along the global axes and its turn.
        centre = shape[model.system.rows[rigid.name]][:2]
        own = found[rigid.name]
        found[rigid.name] = np.vstack([own, centre, own[:1]])
    return found


def _beside(axis: FloatArray, points: Mapping[str, Point]) -> list[tuple[int, str]]:
    """Return the points that are not on an axis, each with its nearest node, the last node first.

    From the last on, what is put behind a node leaves those before it where they are.
    """
    found = []
    for name, point in points.items():
        apart = np.linalg.norm(axis - np.array(point), axis=1)
        if apart.min() > _ON * np.ptp(axis, axis=0).max():
            found.append((int(apart.argmin()), name))
    return sorted(found, reverse=True)


def nearest_mode(solution: Solution, frequency: float) -> int:
    """Return the mode whose natural frequency is nearest to one in Hz.

    Given a prediction's, that is the mode that the table tracks, also where modes have crossed.
    """
    return int(np.abs(solution.natural_frequencies - frequency).argmin())


def largest(displacements: Curves) -> float:
    """Return how far the point that moves most moves."""
    return max(float(np.linalg.norm(moved, axis=1).max()) for moved in displacements.values())


def corners(curves: Curves) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper corner of the box about all curves, (2,) each, m."""
    every = np.vstack(list(curves.values()))
    return every.min(axis=0), every.max(axis=0)


def size(curves: Curves) -> float:
    """Return the diagonal of that box, m."""
    low, high = corners(curves)
    return float(np.linalg.norm(high - low))


def _rows(places: Sequence[FloatArray]) -> FloatArray:
    """Return places as rows, (n, 2), of which there may be none."""
    return np.array(places, dtype=float).reshape(-1, 2)
