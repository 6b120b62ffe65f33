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


def test_the_linkage_moves_with_its_tractor() -> None:
    """The base is not drawn, but the lower link's pin on it bounces in the tractor's mode."""
    table = load_table(config_file(DEFAULT_TABLE))
    grid = linkage_grid(read_mechanism(config_file(DEFAULT_MECHANISM)), table)
    assert grid is not None
    assert "ground" not in grid["bodies"]
    assert grid["bodies"][0] == "lower_link"
    np.testing.assert_allclose(grid["places"][:, 0], np.zeros((91, 2)), atol=1e-6)  # P1
    moved = grid["shapes"][table.mode_names.index("tractor bounce")][:, 0]
    assert np.abs(moved[:, 1]).min() > 0.1  # upwards or downwards at every angle
    assert grid["size"] < 2.5  # m, of the linkage and its implement alone
