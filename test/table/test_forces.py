# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Forces in tables, against the model."""

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, TableError, load_table, save_table
from linkage_vibration.table.tabulation import build_table
from test.support.free_bodies import Array, forces_by_cuts

NAMES = ("three_point_linkage", "three_point_linkage_on_tractor")


def shipped(name: str) -> tuple[LinkageModel, Table]:
    """Return a model and its shipped table: of modes, and of reduced models with coupled modes."""
    mechanism = read_mechanism(config_file(f"{name}.yaml"))
    return LinkageModel(mechanism), load_table(config_file(f"tables/{name}.npz"), mechanism)


@pytest.mark.parametrize("name", [pytest.param(NAMES[0], marks=pytest.mark.nightly), NAMES[1]])
def test_forces_are_those_of_the_model(name: str) -> None:
    """Between cells, forces agree within the error that the table reports."""
    model, table = shipped(name)
    assert table.force_places == model.force_places
    assert table.forces == model.forces.places
    assert force_errors(model, table, 5).max() < table.force_error < 1e-3


def force_errors(model: LinkageModel, table: Table, count: int) -> Array:
    """Return the errors of forces at random angles, (count,), L2 norms of the largest of an input.

    They are compared with forces on bodies that are cut free.
    """
    places, errors = table.places[:3], list[float]()
    lines = np.linspace(*table.band, 202)[1:]
    for alpha3 in np.random.default_rng(4).uniform(*table.alpha3_range, count).tolist():
        exact = forces_by_cuts(model, alpha3, lines, places)
        off = np.linalg.norm(table.frf(alpha3, table.forces, places).frf(lines) - exact, axis=0)
        errors.append((off / np.linalg.norm(exact, axis=0).max(axis=0)).max())
    return np.array(errors)


def test_reported_error_of_forces_beside_a_damper(mapping: Any, tmp_path: Path) -> None:
    """A coil-over in a short stroke couples the modes; its own damper is in its force, too.

    The error that is reported bounds that at random angles, and is not much larger.
    """
    mapping["springs"] = {"strut": {"between": ["P1", "E2"], "stiffness": 61e3, "damping": 1900.0}}
    mapping["input"]["range_deg"] = [120.0, 130.0]
    mapping["links"]["lower_link"]["masses"] = {"E1": 14.0}
    model = LinkageModel(mechanism_from_mapping(mapping))
    table = build_table(model, tolerance=1e-5)
    save_table(table, tmp_path / "table.npz")
    loaded = load_table(tmp_path / "table.npz")
    assert "strut" in loaded.force_places
    errors = force_errors(model, loaded, 5)
    assert errors.max() < loaded.force_error < 1e-2


@pytest.mark.parametrize("name", NAMES)
def test_static_forces_are_those_of_the_model(name: str) -> None:
    """The table interpolates components, from which magnitudes and references follow."""
    model, table = shipped(name)
    angles = np.random.default_rng(5).uniform(*table.alpha3_range, 9)
    exact = np.array([model.static_forces(angle) for angle in angles]).T
    np.testing.assert_allclose(table.forces_at_rest(angles), exact, rtol=1e-6)
    references = np.maximum(exact, 0.1 * exact.max(axis=0))
    np.testing.assert_allclose(table.reference_forces(angles), references, rtol=1e-6)
    assert table.reference_forces(np.empty(0)).shape == (len(table.force_places), 0)


def test_a_given_reference_replaces_static_forces(mapping: Any, tmp_path: Path) -> None:
    """The number of the mechanism file is that of every pin, also after loading."""
    mapping = copy.deepcopy(mapping)
    mapping["response"]["reference_force"] = 12e3
    mapping["input"]["range_deg"] = [120.0, 130.0]
    table = build_table(LinkageModel(mechanism_from_mapping(mapping)))
    save_table(table, tmp_path / "table.npz")
    loaded = load_table(tmp_path / "table.npz")
    references = loaded.reference_forces(np.radians([121.0, 128.0]))
    np.testing.assert_array_equal(references, np.full((len(loaded.force_places), 2), 12e3))
    assert loaded.forces_at_rest(np.radians([125.0])).max() > 15e3
    mapping["response"]["reference_force"] = {"upper_link:P2": 9e3}
    some = build_table(LinkageModel(mechanism_from_mapping(mapping)))
    save_table(some, tmp_path / "some.npz")
    some, angle = load_table(tmp_path / "some.npz"), np.radians([125.0])
    here = some.force_places.index("upper_link:P2")
    static, references = some.forces_at_rest(angle), some.reference_forces(angle)
    assert references[here] == 9e3 != pytest.approx(static[here], rel=0.1)
    largest = 0.1 * static.max()
    np.testing.assert_array_equal(
        np.delete(references, here), np.maximum(np.delete(static, here), largest)
    )


def test_points_of_frfs_do_not_limit_forces(mapping: Any) -> None:
    """A table of one point has all forces by a force there."""
    mapping = copy.deepcopy(mapping)
    mapping["input"]["range_deg"] = [120.0, 130.0]
    model = LinkageModel(mechanism_from_mapping(mapping))
    table = build_table(model, points=["E2"])
    assert table.places == (("E1", "z"), ("E2", "x"), ("E2", "z"))
    assert table.force_places == model.force_places
    force, alpha3, lines = (
        [("upper_link:P2", "force_x")],
        math.radians(127.0),
        np.array([3.0, 50.0]),
    )
    exact = model.solve(alpha3).frf(force, table.places).frf(lines)
    np.testing.assert_allclose(table.frf(alpha3, force, table.places).frf(lines), exact, rtol=1e-4)


def test_linkage_that_moves_freely_has_no_forces_in_its_table(mapping: Any) -> None:
    """It has no FRFs either."""
    mapping = copy.deepcopy(mapping)
    del mapping["links"]["input_crank"]["clamped"]
    mapping["input"]["range_deg"] = [120.0, 130.0]
    mapping["response"]["band_hz"] = [5.0, 200.0]
    table = build_table(LinkageModel(mechanism_from_mapping(mapping)), tolerance=1e-4)
    assert table.force_places == ()
    assert table.forces == ()
    assert math.isnan(table.force_error)
    assert table.reference_forces(np.array([2.15])).shape == (0, 1)


def test_forces_are_no_inputs_of_a_table() -> None:
    """The error lists the places that are."""
    _, table = shipped(NAMES[1])
    force = [("lower_link:E1", "force_x")]
    with pytest.raises(TableError, match="no FRF at lower_link:E1 force_x; it has these: E1 z"):
        table.frf(2.0, [("E1", "z")], force)
    with pytest.raises(TableError, match=r"no FRF at bar:E1 force_x; it has these: .*force_x"):
        table.frf(2.0, [("bar:E1", "force_x")], [("E1", "z")])
