# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Computes the points and curves that show a linkage and its modes in the plane."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray, IntArray
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Point
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel, Solution

_ON = 1e-6  # of the length of an axis; a point that is nearer to a node lies on the axis

Curves = dict[str, FloatArray]  # the points of each body's curve, (n, 2), along x and z


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The curves, in m, and the positions, (n, 2), in m, that show a linkage."""

    bodies: Curves  # see `curves`
    joints: FloatArray  # moving pins
    ground: FloatArray  # pins on the ground
    centres: FloatArray  # centres of gravity
    names: tuple[str, ...]  # of the moving pins, then of those on the ground


def scene(model: LinkageModel, configuration: Configuration) -> Outline:
    """Return the curves and points that show a linkage in a configuration."""
    mechanism = model.mechanism
    ground = dict(mechanism.ground)
    pins = {point: body for point, _, body in mechanism.joints if point not in ground}
    place = configuration.place
    joints = [place(body, mechanism.local_points(body)[point]) for point, body in pins.items()]
    centres = [place(body.name, body.centre_of_gravity) for body in mechanism.rigid]
    every = joints, list(ground.values()), centres
    moving, fixed, gravity = (np.reshape(places, (-1, 2)) for places in every)
    return Outline(curves(model, configuration), moving, fixed, gravity, (*pins, *ground))


def curves(model: LinkageModel, configuration: Configuration) -> Curves:
    """Return curves, m: axes of links with detours to points beside them, closed rigid bodies."""
    lines = {}
    for component in model.components:
        name = component.name
        points = model.mechanism.local_points(name)
        if isinstance(component, Component) and component.drawing is not None:
            axis = [(float(x), float(z)) for x, z in component.drawing.places]
            for node, point in _beside(component.drawing.places, points):
                axis[node + 1 : node + 1] = [points[point], axis[node]]
        else:
            axis = list(points.values())
        lines[name] = np.array([configuration.place(name, place) for place in axis])
    for rigid in model.mechanism.rigid:
        corners = lines[rigid.name]
        centre = configuration.place(rigid.name, rigid.centre_of_gravity)
        lines[rigid.name] = np.vstack([corners, centre, corners[:1]])
    return lines


def mode_curves(solution: Solution, mode: int | IntArray) -> Curves:
    """Return displacements of the points of `curves` in a mass-normalised mode, 1/sqrt(kg).

    Of several modes, (k,), they are (n, 2, k).
    """
    model, shape, shapes = solution.model, solution.modes.shapes[:, mode], dict[str, FloatArray]()
    rigid, u = {body.name for body in model.mechanism.rigid}, shape[: len(model.interface)]
    for component in model.system.components:
        name, points = component.name, model.mechanism.local_points(component.name)
        rows = {p: model.interface.displacement(name, p, solution.configuration) for p in points}
        moved, own = np.array([row @ u for row in rows.values()]), shape[model.system.rows[name]]
        if component.drawing is not None:
            along = (component.drawing.displacement @ own)[:, :2]
            moved = np.einsum("ij,nj...->ni...", solution.configuration.turn(name), along)
            for node, point in _beside(component.drawing.places, points):
                moved = np.insert(moved, node + 1, [rows[point] @ u, moved[node]], axis=0)
        elif name in rigid:
            # The first two coordinates of a rigid body are its centre's displacements.
            moved = np.concatenate([moved, own[np.newaxis, :2], moved[:1]])
        shapes[name] = moved
    return shapes


def left_curves(solution: Solution, mode: int | IntArray, vertical: LinkageModel) -> Curves:
    """Return `mode_curves` of the left side in lateral modes; links are drawn straight."""
    model, shapes = solution.model, dict[str, FloatArray]()
    u = solution.modes.shapes[: len(model.interface), mode]
    for component in vertical.system.components:
        name, points = component.name, model.mechanism.local_points(component.name)
        rows = [model.interface.displacement(name, p, solution.configuration) for p in points]
        moved = (np.array(rows) @ u)[:, ::2]
        if component.drawing is not None:
            x, along = [place[0] for place in points.values()], component.drawing.places[:, 0]
            weights = np.column_stack([np.interp(along, x, each) for each in np.eye(len(x))])
            moved = np.tensordot(weights, moved, axes=1)
        else:  # The centre of gravity of a rigid body moves along y alone.
            moved = np.concatenate([moved, np.zeros_like(moved[:1]), moved[:1]])
        shapes[name] = moved
    return shapes


def _beside(axis: FloatArray, points: Mapping[str, Point]) -> list[tuple[int, str]]:
    """Return points beside an axis with their nearest nodes, in falling order for insertions."""
    nearest = []
    for name, point in points.items():
        apart = np.linalg.norm(axis - np.array(point), axis=1)
        if apart.min() > _ON * np.ptp(axis, axis=0).max():
            nearest.append((int(apart.argmin()), name))
    return sorted(nearest, reverse=True)


def nearest_mode(solution: Solution, frequency: float) -> int:
    """Return the undamped mode nearest to a frequency, Hz, also where modes of a table crossed."""
    return int(np.abs(solution.modes.omega - 2.0 * math.pi * frequency).argmin())


def largest(displacements: Curves) -> float:
    """Return the largest displacement of a point, in the unit of the displacements."""
    return max(float(np.linalg.norm(moved, axis=1).max()) for moved in displacements.values())


def size(curves: Curves) -> float:
    """Return the diagonal of the box around all curves, m."""
    return float(np.linalg.norm(np.ptp(np.vstack(list(curves.values())), axis=0)))
