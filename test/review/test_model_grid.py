# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the page interpolates between angles agrees with the model."""

from typing import Any

import numpy as np
import pytest

from linkage_vibration.drawing.geometry import curves
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review.model_grid import linkage_grid
from linkage_vibration.support.resources import (
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table

Grid = dict[str, Any]


@pytest.fixture(scope="module")
def drawn(mechanism: Mechanism) -> Grid:
    """Return the grid of the shipped linkage."""
    grid = linkage_grid(mechanism, load_table(config_file(PAPER_TABLE)))
    assert grid is not None
    return grid


def test_places_between_angles(drawn: Grid, model: LinkageModel) -> None:
    """Halfway between two angles of the grid, the mean of the positions is exact to 0.1 mm."""
    for i in (0, 40, 89):
        halfway = drawn["angles"][i : i + 2].mean()
        exact = np.vstack(list(curves(model, model.kinematics.at(halfway)).values()))
        np.testing.assert_allclose(drawn["places"][i : i + 2].mean(axis=0), exact, atol=1e-4)


def test_shapes_do_not_flip(drawn: Grid) -> None:
    """The sign of a shape never changes from angle to angle, and its largest displacement is 1."""
    np.testing.assert_allclose(np.linalg.norm(drawn["shapes"], axis=3).max(axis=2), 1.0, rtol=1e-6)
    before, after = drawn["shapes"][:, :-1], drawn["shapes"][:, 1:]
    sizes = np.linalg.norm(before, axis=(2, 3)) * np.linalg.norm(after, axis=(2, 3))
    assert ((before * after).sum(axis=(2, 3)) / sizes).min() > 0.98


def test_tractor_is_drawn_and_moves() -> None:
    """The base is a body of the picture, and bounces in its mode while the linkage follows."""
    own = read_mechanism(config_file(DEFAULT_MECHANISM))
    table = load_table(config_file(DEFAULT_TABLE))
    grid = linkage_grid(own, table)
    assert grid is not None
    at = grid["bodies"].index("ground")
    start = sum(grid["lengths"][:at])
    points = slice(start, start + grid["lengths"][at])
    bounce = table.mode_names.index("tractor bounce")
    moved = grid["shapes"][bounce][:, points]  # (n_angles, n_points, 2)
    assert np.abs(moved[..., 1]).min() > 0.1  # upwards or downwards at every angle
    places = grid["places"][:, points]
    assert np.ptp(places, axis=0).max() < 1e-6  # only modes move the tractor
    # A rigid body moves by a translation and a rotation: u = t + (-theta z, theta x).
    x, z = places[0].T
    rigid = np.zeros((2 * len(x), 3))
    rigid[: len(x), 0] = rigid[len(x) :, 1] = 1.0
    rigid[: len(x), 2], rigid[len(x) :, 2] = -z, x
    every = grid["shapes"][:, :, points].transpose(3, 2, 0, 1).reshape(len(rigid), -1)
    fitted = rigid @ np.linalg.lstsq(rigid, every, rcond=None)[0]
    np.testing.assert_allclose(fitted, every, atol=1e-5)
