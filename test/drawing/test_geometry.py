# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The curves of a linkage have the right positions, lengths and displacements."""

import math

import numpy as np
import pytest

from linkage_vibration.drawing.geometry import (
    curves,
    largest,
    mode_curves,
    nearest_mode,
    scene,
    size,
)
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file


@pytest.mark.parametrize("name", ["three_point_linkage", "four_bar", "stephenson_six_bar"])
def test_curves_meet_in_the_joints(name: str) -> None:
    """At any angle, joints lie on the curves of both bodies, and links keep their lengths."""
    model = LinkageModel(read_mechanism(config_file(f"{name}.yaml")))
    mechanism = model.mechanism
    low, high = mechanism.stroke
    for alpha3 in np.linspace(low, high, 5):
        drawn = scene(model, model.kinematics.at(alpha3))
        assert len(drawn.joints) == len(
            {p for p, first, _ in mechanism.joints if first != "ground"}
        )
        for joint in drawn.joints:
            touching = [
                body
                for body, curve in drawn.bodies.items()
                if np.linalg.norm(curve - joint, axis=1).min() < 1e-9
            ]
            assert len(touching) >= 2
        for link in mechanism.links:
            points = np.array([place for _, place in link.points])
            long = np.linalg.norm(points[:, np.newaxis] - points, axis=2).max()
            apart = drawn.bodies[link.name][:, np.newaxis] - drawn.bodies[link.name]
            assert np.linalg.norm(apart, axis=2).max() == pytest.approx(long, rel=1e-9)
        np.testing.assert_array_equal(drawn.ground, [place for _, place in mechanism.ground])


def test_mode_is_the_solutions(model: LinkageModel) -> None:
    """Points move by the participations of the solution, and rigid bodies keep their shape."""
    solution = model.solve(2.2)
    places, moved = curves(model, solution.configuration), mode_curves(solution, 1)
    shown = moved["implement"][:2].ravel()  # E1 and E2
    asked = [(point, direction) for point in ("E1", "E2") for direction in "xz"]
    np.testing.assert_allclose(shown, solution.participation(asked)[:, 1], rtol=1e-12)
    np.testing.assert_allclose(moved["lower_link"][0], 0.0, atol=1e-9)  # the pin on the ground
    lower, rod = places["lower_link"], places["lift_rod"]  # which share the pin V1
    [v1] = np.flatnonzero(np.linalg.norm(lower - rod[-1], axis=1) < 1e-12)
    pin = solution.participation(["V1.x", "V1.z"])[:, 1]
    np.testing.assert_allclose([moved["lower_link"][v1], moved["lift_rod"][-1]], [pin, pin], 1e-7)
    at, by = places["implement"], moved["implement"]
    for i in range(3):
        for j in range(i):
            arm = at[i] - at[j]
            stretch = float(arm @ (by[i] - by[j])) / float(arm @ arm)
            assert abs(stretch) < 1e-12 * largest(moved)
    assert largest(moved) == max(np.linalg.norm(m, axis=1).max() for m in moved.values())


def test_a_point_beside_the_axis_moves_with_the_mode() -> None:
    """The curve makes a detour to a point beside the axis, which moves with the mode."""
    model = LinkageModel(read_mechanism(config_file("stephenson_six_bar.yaml")))
    solution = model.solve(1.5)
    for mode in range(3):
        places, moved = curves(model, solution.configuration), mode_curves(solution, mode)
        assert {k: v.shape for k, v in places.items()} == {k: v.shape for k, v in moved.items()}
        place = solution.configuration.place("coupler", (0.250, 0.120))
        [at] = np.flatnonzero(np.linalg.norm(places["coupler"] - place, axis=1) < 1e-12)
        np.testing.assert_array_equal(places["coupler"][at - 1], places["coupler"][at + 1])
        expected = solution.participation([("P", "x"), ("P", "z")])[:, mode]
        np.testing.assert_allclose(moved["coupler"][at], expected, rtol=1e-6)


def test_nearest_mode_and_size(model: LinkageModel) -> None:
    """A mode is found by its frequency; the size is the diagonal of the box around all curves."""
    solution = model.solve(2.2)
    for mode in range(4):
        assert nearest_mode(solution, solution.natural_frequencies[mode] + 1e-3) == mode
    box = {"a": np.array([[0.0, 0.0], [3.0, 0.0]]), "b": np.array([[1.0, 4.0]])}
    assert size(box) == pytest.approx(math.hypot(3.0, 4.0))
