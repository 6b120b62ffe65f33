# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Names of modes, and shares of their kinetic energy."""

import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.mode_names import KineticEnergy, _along, kinetic_energy, name_modes
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table, save_table
from linkage_vibration.table.tabulation import build_table

TRACTOR = "three_point_linkage_on_tractor.yaml"


def test_shares_add_up_to_one() -> None:
    """In every mode, and a rigid body's are its mass and inertia times squared velocities."""
    model = LinkageModel(read_mechanism(config_file(TRACTOR)))
    solution = model.solve(2.0)
    energy = kinetic_energy(solution)
    np.testing.assert_allclose(energy.group_shares().sum(axis=1), 1.0, rtol=1e-12)
    row = energy.motions.index(("ground", "pitch"))
    moved = solution.participation([("front_axle", "z"), ("rear_axle", "z")])
    turn = (moved[0] - moved[1]) / 2.5  # modes have unit modal mass
    np.testing.assert_allclose(energy.shares[row], 6000.0 * turn**2, atol=1e-9)
    assert (energy.mounts[:3] > 0.5).all()
    assert (energy.mounts[3:6] < 0.5).all()


def test_names_of_the_linkage_on_its_tractor_hold_over_the_stroke(tmp_path: Path) -> None:
    """Three modes of each half are the tractor's, the others the implement's but for one.

    A file keeps all of it.
    """
    mechanism = replace(read_mechanism(config_file(TRACTOR)), uncertainty=None)
    table = build_table(LinkageModel(mechanism), 1e-4)
    vertical, lateral = (np.array(table.mode_names)[table.lateral_modes == i] for i in (0, 1))
    assert {*vertical[:3]} == {"tractor pitch", "tractor surge", "tractor bounce"}
    assert vertical[3:5].tolist() == ["implement heave", "implement pitch"]
    assert vertical[5].endswith("bending")
    motions = product(("tractor", "implement"), ("sway", "roll", "yaw"))
    assert {*lateral} == {" ".join(each) for each in motions}
    np.testing.assert_allclose(table.mode_shares.sum(axis=1), 1.0, atol=1e-3)
    save_table(table, tmp_path / "table.npz")
    again = load_table(tmp_path / "table.npz", mechanism)
    assert again.mode_names == table.mode_names
    assert np.array_equal(again.mode_shares, table.mode_shares)
    assert table.mode_label(7) == "mode 8 (implement heave)"


def test_without_tractor_the_same_mode_has_the_same_name() -> None:
    """Whoever watches the implement's heave watches mode 1 there, and mode 8 on the tractor."""
    table = load_table(config_file("tables/three_point_linkage.npz"))
    assert table.mode_names[0] == "implement heave"
    shipped = load_table(config_file("tables/three_point_linkage_on_tractor.npz"))
    assert shipped.mode_names.index("implement heave") == 7


def test_a_link_by_matrices_stretches_or_bends() -> None:
    """Without a drawing, the share along a link is that of the squares of its motions along x."""
    link = LinkageModel(read_mechanism(config_file("four_bar.yaml"))).components[1]
    bare = replace(link, drawing=None)
    shapes = np.zeros((len(link.dofs), 3))
    for dof, row in zip(link.dofs, shapes, strict=True):
        row[:] = {"x": (3.0, 0.0, 1.0), "z": (1.0, 2.0, 0.0), "theta": (9.0, 9.0, 0.0)}[
            dof.direction
        ]
    np.testing.assert_allclose(_along(bare, shapes), [0.9, 0.0, 1.0])


def test_link_bends_and_repeated_names_are_numbered() -> None:
    """A beam alone in a mode bends; two of its modes differ by a number."""
    table = build_table(LinkageModel(read_mechanism(config_file("four_bar.yaml"))), 1e-3)
    assert table.mode_names[:2] == ("coupler bending", "rocker bending")
    shares = np.array([[0.9, 0.2, 0.7], [0.1, 0.8, 0.3]])
    energy = KineticEnergy((("arm", "bending"), ("rod", "bending")), (), shares, np.zeros(3))
    assert name_modes(energy) == ("arm bending", "rod bending", "arm bending 2")


def test_one_motion_belongs_to_one_mode() -> None:
    """Two modes that are mostly heave share heave and pitch so that the sum is largest."""
    motions = tuple(("plough", motion) for motion in ("surge", "heave", "pitch"))
    shares = np.array([[0.1, 0.0], [0.6, 0.7], [0.3, 0.3]])
    energy = KineticEnergy(motions, ("plough",), shares, np.zeros(2))
    assert name_modes(energy) == ("plough pitch", "plough heave")
    assert name_modes(energy, ["", "lift"]) == ("plough pitch", "lift")


@pytest.mark.parametrize("mounts", [0.7, 0.4])
def test_a_tractor_has_as_many_modes_as_motions(mounts: float) -> None:
    """Of four modes with most of their strain in the tyres, that with least is the implement's.

    With three such modes, each of these is the tractor's. Names without a motion have a number.
    """
    motions = [("ground", "sway"), ("ground", "roll"), ("ground", "yaw"), ("plough", "roll")]
    shares = np.array(
        [[0.6, 0.2, 0.1, 0.1], [0.1, 0.5, 0.1, 0.1], [0.1, 0.1, 0.4, 0.5], [0.2, 0.2, 0.4, 0.3]]
    )
    energy = KineticEnergy(tuple(motions), ("plough",), shares, np.array([0.9, mounts, 0.6, 0.8]))
    names = name_modes(energy)
    if mounts > 0.6:
        assert names == ("tractor sway", "tractor roll", "plough roll", "tractor yaw")
    else:
        assert names == ("tractor sway", "plough roll", "tractor roll", "tractor yaw")
    alone = KineticEnergy((("plough", "roll"),), ("plough",), np.ones((1, 2)), np.zeros(2))
    assert name_modes(alone) == ("plough roll", "plough roll 2")


@pytest.mark.parametrize("rounding", [-1e-14, 0.0, 1e-14])
def test_equal_energy_goes_to_the_first(rounding: float) -> None:
    """In a symmetric mode bodies or motions have equal energy, which rounding does not split."""
    motions = tuple((body, motion) for body in ("left", "right") for motion in ("surge", "heave"))
    shares = np.array([[0.25, 0.3], [0.25, 0.3], [0.25, 0.2], [0.25, 0.2]])
    turned = shares + rounding * np.array([[-1.0], [2.0], [3.0], [-4.0]])
    energy = KineticEnergy(motions, ("left", "right"), turned, np.zeros(2))
    assert name_modes(energy) == ("left surge", "left heave")
    energy = KineticEnergy(motions, (), turned, np.zeros(2))  # links
    assert name_modes(energy) == ("left surge", "left surge 2")
    more = shares + 1e-6 * np.array([[-1.0], [0.0], [0.0], [2.0]])
    energy = KineticEnergy(motions, ("left", "right"), more, np.zeros(2))
    assert name_modes(energy) == ("right heave", "left heave")


def _named(names: Any) -> Any:
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    mapping["response"]["mode_names"] = names
    return mapping


def test_names_of_the_file_come_first() -> None:
    """An empty name keeps the one that was found, and names enter the model's hash."""
    mechanism = mechanism_from_mapping(_named(["my mode", ""]))
    table = build_table(LinkageModel(mechanism), 1e-3)
    assert table.mode_names[:2] == ("my mode", "implement pitch")
    assert (
        mechanism.model_hash != read_mechanism(config_file("three_point_linkage.yaml")).model_hash
    )
    assert math.isclose(table.mode_shares[0].sum(), 1.0, abs_tol=1e-3)


@pytest.mark.parametrize("names", [["a", "a"], ["2"], [" a"], "a", [1]])
def test_invalid_names_are_refused(names: Any) -> None:
    """A number is refused because it would be taken for the number of a mode."""
    with pytest.raises(MechanismError, match="mode_names"):
        mechanism_from_mapping(_named(names))
