# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Answers to requests, without a node: FRFs, mode shapes, and another implement."""

import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.answers import (
    MAX_FREQUENCIES,
    Implement,
    LoadedModel,
    ModelWithoutTable,
    ServingError,
    answer_frf,
    answer_mode_shapes,
    rebuilt,
    with_implement,
)
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, TableError, load_table
from linkage_vibration.table.tabulation import build_table
from test.support.served import turning_table

DRIVE: dict[str, Any] = {"outputs": [], "inputs": [], "frequencies": np.array([])}


@pytest.fixture(scope="module")
def served(mechanism: Mechanism, mechanism_file: Path) -> LoadedModel:
    """Return the mechanism and the table of the package."""
    table = load_table(config_file("tables/three_point_linkage.npz"), mechanism)
    return ModelWithoutTable(mechanism, mechanism_file.read_text()).with_predictor(Predictor(table))


@pytest.mark.parametrize("alpha3", [1.6, 2.0, 2.6, 3.1])
def test_table_and_model_agree(served: LoadedModel, alpha3: float) -> None:
    """Each FRF of the table, at the default lines of the band, is within 1e-4 of the exact one."""
    every = [f"{point}.{direction}" for point in ("E1", "E2", "V1", "V2") for direction in "xz"]
    asked: dict[str, Any] = {"outputs": every, "inputs": every, "frequencies": np.array([])}
    answer = answer_frf(served, alpha3, exact=False, **asked)
    exact = answer_frf(served, alpha3, exact=True, **asked)
    np.testing.assert_array_equal(answer.frequencies, np.linspace(0.0, 200.0, 401))
    np.testing.assert_array_equal(
        answer.values,
        served.table.frf(alpha3, answer.outputs, answer.inputs).frf(answer.frequencies),
    )
    size = np.linalg.norm(exact.values, axis=0)
    apart = np.linalg.norm(answer.values - exact.values, axis=0) / size
    assert apart.max() < 1e-4


def test_motion_of_the_base_is_an_input(mechanism_file: Path) -> None:
    """The soil moves under all mounts or one; a ground without a base does not move."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    tractor = read_mechanism(path)
    table = load_table(config_file("tables/three_point_linkage_on_tractor.npz"), tractor)
    served = ModelWithoutTable(tractor, path.read_text()).with_predictor(Predictor(table))
    line, inputs = np.array([0.0]), ["base.z", "base:front_axle.z", "front_axle.z"]
    answer = answer_frf(served, 2.0, ["rear_axle.z"], inputs, line, exact=True)
    np.testing.assert_allclose(answer.values[0, 0, :2], [1.0, 0.0], atol=1e-6)
    assert answer.values[0, 0, 2].real == pytest.approx(0.0, abs=1e-9)
    mechanism = read_mechanism(mechanism_file)
    table = load_table(config_file("tables/three_point_linkage.npz"))
    clamped = ModelWithoutTable(mechanism, mechanism_file.read_text()).with_predictor(
        Predictor(table)
    )
    for exact in (False, True):
        with pytest.raises(ServingError, match=r"base\.z"):
            answer_frf(clamped, 2.0, ["E1.z"], ["base.z"], line, exact=exact)


@pytest.mark.parametrize("exact", [False, True])
def test_forces_are_outputs(served: LoadedModel, exact: bool) -> None:
    """At 0 Hz both lower links and the upper link carry a force on the implement; none is an input.

    One of the two lower links carries half of their force.
    """
    pins = ["lower_link:E1.force_z", "upper_link:E2.force_z"]
    answer = answer_frf(served, 2.0, pins, ["E1.z"], np.array([0.0]), exact=exact)
    lower, upper = answer.values[0, :, 0]
    assert 2.0 * lower + upper == pytest.approx(1.0, abs=1e-4)
    with pytest.raises(ServingError, match=r"inputs\[0\] is 'lower_link:E1.force_z'; name one of"):
        answer_frf(served, 2.0, ["E1.z"], pins[:1], np.array([0.0]), exact=exact)


def test_sections_are_outputs_of_the_model(served: LoadedModel) -> None:
    """A pin carries no moment; the table has no sections, and the error names the remedy."""
    sections = ["upper_link:E2.moment", "upper_link:E2.axial"]
    answer = answer_frf(served, 2.0, sections, ["E2.x"], np.array([0.0]), exact=True)
    moment, axial = answer.values[0]
    assert abs(moment[0]) < 1e-6 * abs(axial[0])
    with pytest.raises(ServingError, match="or set exact to use the model"):
        answer_frf(served, 2.0, sections, ["E1.z"], np.array([0.0]), exact=False)


def test_shapes_make_the_frf(served: LoadedModel) -> None:
    """At a resonance, the receptance of the drive point is about shape^2 / (2 i zeta omega^2)."""
    modes = answer_mode_shapes(served, 2.3)
    at = modes.places.index(("E1", "z"))
    omega, zeta = 2.0 * math.pi * modes.natural_frequencies[0], modes.damping_ratios[0]
    single = modes.shapes[0, at] ** 2 / (2j * zeta * omega**2)
    line = modes.natural_frequencies[:1]
    answer = answer_frf(served, 2.3, [], [], line, exact=True)
    assert answer.outputs == answer.inputs == (("E1", "z"),)
    assert answer.values[0, 0, 0] == pytest.approx(single, rel=0.01)
    place = served.model.kinematics.at(2.3).place("implement", (0.0, 0.0))
    np.testing.assert_allclose(modes.positions[[at - 1, at]], place, rtol=1e-12)


@pytest.mark.parametrize(
    ("changed", "exact", "why"),
    [
        ({"outputs": ["E1.z"]}, False, "outputs has places but inputs is empty; give both"),
        ({"inputs": ["E1.z"]}, True, "inputs has places but outputs is empty; give both"),
        ({"outputs": ["E1"], "inputs": ["E1.z"]}, False, r"outputs\[0\] is 'E1'; name one of E1"),
        ({"outputs": ["E1.z"], "inputs": ["P1.z"]}, True, r"inputs\[0\] is 'P1.z'; name one of V1"),
        ({"frequencies": np.array([9.0, 201.0])}, False, r"\[1\] is 201 Hz; the table holds from"),
        ({"frequencies": np.array([math.nan])}, True, r"\[0\] is nan Hz; give finite"),
        ({"frequencies": np.array([math.nan])}, False, r"\[0\] is nan Hz; give finite"),
        ({"frequencies": np.array([-1.0])}, False, r"\[0\] is -1 Hz; give finite frequencies"),
        ({"frequencies": np.array([-1.0])}, True, r"\[0\] is -1 Hz; give finite frequencies"),
        ({"frequencies": np.zeros(MAX_FREQUENCIES + 1)}, True, "too many for one answer"),
        ({"outputs": ["E1.z"] * 300, "inputs": ["E1.z"]}, False, "too many for one answer"),
        ({"alpha3": 5.0}, False, "outside the table"),
        ({"alpha3": 5.0}, True, "cannot close at alpha3"),
        ({"alpha3": math.inf}, True, "crank_angle is inf; give a finite angle"),
    ],
)
def test_refused_frf(served: LoadedModel, changed: dict[str, Any], exact: bool, why: str) -> None:
    """An invalid request is refused with the place and the remedy."""
    with pytest.raises(LinkageVibrationError, match=why):
        answer_frf(served, **{"alpha3": 2.0, "exact": exact, **DRIVE, **changed})


@pytest.mark.parametrize("angle_deg", [205.0, 229.2])
def test_angle_that_the_linkage_cannot_reach(served: LoadedModel, angle_deg: float) -> None:
    """The remedy is another angle, not another mechanism; the shipped table has 90 to 180 deg."""
    words = rf"be at {angle_deg:g} deg \(.*\); give a crank_angle of the table, 90 to 180 deg"
    with pytest.raises(ServingError, match=words):
        answer_mode_shapes(served, math.radians(angle_deg))
    with pytest.raises(ServingError, match=words):
        answer_frf(served, math.radians(angle_deg), exact=True, **DRIVE)


def test_frf_of_a_crank_that_turns_all_the_way() -> None:
    """A table over a whole turn answers on every turn as the model does, up to a limit."""
    path = config_file("four_bar.yaml")
    mechanism = read_mechanism(path)
    predictor = Predictor(turning_table())
    turning = ModelWithoutTable(mechanism, path.read_text()).with_predictor(predictor)
    here = answer_frf(turning, math.radians(10.0), exact=False, **DRIVE)
    for degrees in (370.0, -350.0, 3610.0):
        answer = answer_frf(turning, math.radians(degrees), exact=False, **DRIVE)
        np.testing.assert_allclose(answer.values, here.values, rtol=1e-9)
    ours = answer_frf(turning, math.radians(370.0), exact=False, **DRIVE).values
    exact = answer_frf(turning, math.radians(370.0), exact=True, **DRIVE).values
    assert np.linalg.norm(ours - exact) < 2.0 * predictor.table.frf_error * np.linalg.norm(exact)
    with pytest.raises(TableError, match="outside the table"):
        answer_frf(turning, 1e7, exact=False, **DRIVE)


def test_exact_beyond_the_band(served: LoadedModel) -> None:
    """The model answers outside the table."""
    answer = answer_frf(served, 2.0, [], [], np.array([250.0]), exact=True)
    assert np.isfinite(answer.values).all()


def test_implement(served: LoadedModel, tmp_path: Path) -> None:
    """The YAML of the changed mechanism describes it, and only the implement differs."""
    implement = Implement("", 1200.0, 333.3, (0.25, 0.8))
    mechanism, text = with_implement(served.mechanism, served.mechanism_text, implement)
    (tmp_path / "changed.yaml").write_text(text)
    assert read_mechanism(tmp_path / "changed.yaml").model_hash == mechanism.model_hash
    [body] = mechanism.rigid_bodies
    assert (body.mass, body.inertia, body.centre_of_gravity) == (1200.0, 333.3, (0.25, 0.8))
    [old] = served.mechanism.rigid_bodies
    assert replace(mechanism, rigid_bodies=(old,)).model_hash == served.mechanism.model_hash
    same = Implement("implement", old.mass, old.inertia, ())
    assert with_implement(mechanism, text, same)[0].rigid_bodies[0].mass == old.mass
    unmoved, _ = with_implement(served.mechanism, served.mechanism_text, same)
    assert unmoved.model_hash == served.mechanism.model_hash


def test_an_implement_in_space() -> None:
    """Inertias in roll and yaw change as the mass does; impossible ones are refused by name."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    known, text = read_mechanism(path), path.read_text()
    mechanism, changed = with_implement(known, text, Implement("", 1200.0, 300.0, ()))
    assert known.lateral is not None
    assert mechanism.lateral is not None
    assert dict(known.lateral.inertia)["implement"] == (550.0, 650.0)
    assert dict(mechanism.lateral.inertia)["implement"] == (825.0, 975.0)
    assert dict(mechanism.lateral.inertia)["ground"] == dict(known.lateral.inertia)["ground"]
    assert yaml.safe_load(changed)["lateral"]["inertia"]["implement"] == {"roll": 825, "yaw": 975}
    with_implement(known, text, Implement("", 1200.0, 1790.0, ()))
    # No body has an inertia about one axis that exceeds the sum of those about the others.
    with pytest.raises(ServingError, match="pitch cannot be 1810; give one of 150 to 1800"):
        with_implement(known, text, Implement("", 1200.0, 1810.0, ()))


def test_rebuilt(served: LoadedModel, tmp_path: Path) -> None:
    """The table of a heavier implement is as accurate as the old one, for the same places."""
    heavy, _ = with_implement(
        served.mechanism, served.mechanism_text, Implement("", 1200.0, 300.0, ())
    )
    shipped = read_excitations(config_file("excitations.yaml"))
    excitations = [each for each in shipped if each.source is Source.PTO]  # they act on the hitch
    predictor, levels = rebuilt(heavy, served.table, excitations, tmp_path)
    table = predictor.table
    assert pickle.loads(pickle.dumps((predictor, levels)))[0].table.table_id == table.table_id
    assert table.model_hash == heavy.model_hash
    assert set(table.places) == set(served.table.places)
    assert table.interpolation_error.max() <= 1e-6
    assert table.natural_frequencies[0, 0] < 0.9 * served.table.natural_frequencies[0, 0]
    with pytest.raises(ServingError, match="cancelled"):
        rebuilt(heavy, served.table, excitations, tmp_path / "missing")


def test_an_implement_that_was_used_before_is_not_built_again(
    served: LoadedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its table is that of the user's cache, unless it has to be like another table."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tolerances = list[float]()

    def build(model: LinkageModel, tolerance: float, *others: Any) -> Table:
        tolerances.append(tolerance)
        return build_table(model, tolerance, *others)

    monkeypatch.setattr("linkage_vibration.table.tabulation.build_table", build)
    heavy, _ = with_implement(
        served.mechanism, served.mechanism_text, Implement("", 1300.0, 300.0, ())
    )
    shipped = read_excitations(config_file("excitations.yaml"))
    orders = [each for each in shipped if each.source is Source.PTO]
    first, again = (rebuilt(heavy, served.table, orders, tmp_path)[0].table for _ in range(2))
    assert tolerances == [1e-6]
    assert again.table_id == first.table_id
    coarse = replace(served.table, interpolation_error=served.table.interpolation_error + 1e-3)
    other = rebuilt(heavy, coarse, orders, tmp_path)[0].table
    assert len(tolerances) == 2
    assert tolerances[1] > 1e-3
    assert other.table_id != first.table_id
    fewer = replace(served.table, places=tuple(p for p in served.table.places if p[0][0] == "E"))
    small = rebuilt(heavy, fewer, orders, tmp_path)[0].table
    assert {point for point, _ in small.places} == {"E1", "E2"}


@pytest.mark.parametrize(
    ("implement", "why"),
    [
        (Implement("", -1.0, 1.0, ()), r"rigid_bodies.implement.mass: -1 is not greater than zero"),
        (Implement("", 1.0, 0.0, ()), r"rigid_bodies.implement.inertia: 0 is not greater"),
        (Implement("", 800.0, 2e9, ()), "radius of gyration"),
        (Implement("", 1.0, math.inf, ()), "inf is not a finite number"),
        (Implement("", 1.0, 1.0, (math.nan, 0.0)), r"centre_of_gravity\[0\]: nan is not a finite"),
        (Implement("", 1.0, 1.0, (1.0,)), "has 1 numbers; give"),
        (Implement("plough", 1.0, 1.0, ()), "no rigid body 'plough'; name one of: implement"),
    ],
)
def test_refused_implement(served: LoadedModel, implement: Implement, why: str) -> None:
    """An invalid implement is refused as in a file."""
    with pytest.raises((ServingError, MechanismError), match=why):
        with_implement(served.mechanism, served.mechanism_text, implement)


def test_which_rigid_body() -> None:
    """Without a rigid body the request is refused; if there are two, one must be named."""
    none, two = (config_file(name) for name in ("four_bar.yaml", "stephenson_six_bar.yaml"))
    with pytest.raises(ServingError, match="four_bar has no rigid body to change; describe"):
        with_implement(read_mechanism(none), none.read_text(), Implement("", 1.0, 1.0, ()))
    mechanism = read_mechanism(two)
    with pytest.raises(ServingError, match="name one of: rocker, pendulum"):
        with_implement(mechanism, two.read_text(), Implement("", 1.0, 1.0, ()))
    changed, _ = with_implement(mechanism, two.read_text(), Implement("pendulum", 3.0, 0.2, ()))
    assert changed.rigid_bodies[0] == mechanism.rigid_bodies[0]
    assert changed.rigid_bodies[1].mass == 3.0


def test_links_from_files_are_not_read_again(
    mapping: Any, mechanism: Mechanism, model: LinkageModel
) -> None:
    """A link from a file is kept, even if the file was moved."""
    part = next(c for c in model.components if c.name == "upper_link")
    assert isinstance(part, Component)
    body = Matrices(part.dofs, part.mass, part.stiffness)
    mapping["links"]["upper_link"] = {
        "points": mapping["links"]["upper_link"]["points"],
        "file": {"kind": "matrices", "path": "gone.npz"},
    }
    links = [replace(k, body=body) if k.name == "upper_link" else k for k in mechanism.links]
    known = replace(mechanism, links=tuple(links))
    heavy = Implement("", 1200.0, 300.0, ())
    changed, text = with_implement(known, yaml.safe_dump(mapping, sort_keys=False), heavy)
    assert [k.body for k in changed.links] == [k.body for k in known.links]
    assert yaml.safe_load(text)["links"]["upper_link"]["file"]["path"] == "gone.npz"
    assert changed.rigid_bodies[0].mass == 1200.0


def test_another_centre_of_gravity_stays_uncertain() -> None:
    """Distances that are uncertain become coordinates that are as uncertain."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    implement = Implement("", 900.0, 220.0, (0.1, 1.0))
    changed, _ = with_implement(read_mechanism(path), path.read_text(), implement)
    assert changed.uncertainty is not None
    known = {number.path: number.deviation for number in changed.uncertainty.numbers}
    above = "rigid_bodies.implement.centre_of_gravity"
    assert [known[f"{above}.{i}"] for i in (0, 1)] == [0.05, 0.05]
    assert f"{above}.E1" not in known
