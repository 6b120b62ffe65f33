# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A base that moves, against an explicit chassis, its limits, and the other ways to solve it."""

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh, null_space

from linkage_vibration.drawing.geometry import curves, mode_curves
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import GROUND, Mechanism, MechanismError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.answers import Implement, with_implement
from linkage_vibration.studies.calibration import calibrate, read_calibration
from linkage_vibration.support.resources import config_file

FloatArray = NDArray[np.float64]

TRACTOR: dict[str, Any] = {
    "mass": 4500.0,
    "inertia": 6000.0,
    "centre_of_gravity": [1.6, 0.1],
    "mounts": {
        "rear_axle": {"at": [0.6, -0.05], "stiffness": [7.0e5, 7.0e5], "damping": [4.4e3, 4.4e3]},
        "front_axle": {"at": [3.1, -0.05], "stiffness": [6.0e5, 6.0e5], "damping": [3.8e3, 3.8e3]},
    },
}
DRIVES = [("E1", "z"), ("P3", "x"), ("front_axle", "z")]


def on_base(*, oil: float | None = None, **changes: Any) -> Mechanism:
    """Return the shipped linkage on a tractor; oil in N m/rad replaces the clamp of the crank."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    mapping["base"] = {**copy.deepcopy(TRACTOR), **changes}
    if oil is not None:
        del mapping["links"]["input_crank"]["clamped"]
        mapping["springs"] = {"oil": {"joint": "P3", "stiffness": oil}}
    return mechanism_from_mapping(mapping)


@pytest.fixture(scope="module")
def clamped() -> LinkageModel:
    """Return the shipped linkage on a ground that does not move."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    return LinkageModel(mechanism_from_mapping(mapping))


@pytest.fixture(scope="module")
def tractor() -> LinkageModel:
    """Return the shipped linkage on a tractor."""
    return LinkageModel(on_base())


def chassis_frequencies(clamped: LinkageModel, alpha3: float) -> FloatArray:
    """Return natural frequencies in Hz with a chassis body that is added to the matrices by hand.

    The chassis has x, z and theta of its centre of gravity after all other interface DoFs.
    """
    configuration = clamped.kinematics.at(alpha3)
    system, joining = clamped.system, clamped.interface.join(configuration)
    n, ground = system.n_interface, dict(clamped.mechanism.ground)
    x0, z0 = TRACTOR["centre_of_gravity"]

    def carried(place: tuple[float, float]) -> FloatArray:
        x, z = place
        return np.array([[1.0, 0.0, -(z - z0)], [0.0, 1.0, x - x0]])

    rows = []
    for row, label in zip(joining.compatibility, joining.labels, strict=True):
        own = np.zeros(3)
        point = label.split()[1] if label.startswith("pin") else ""
        if point in ground:  # its row is the ground's displacement, 0, less the link's
            own = carried(ground[point])[0 if label.endswith("x") else 1]
        if label.startswith("clamp"):
            own[2] = -1.0
        rows.append([*row, *own])
    order = [*range(n), *range(len(system.mass), len(system.mass) + 3), *range(n, len(system.mass))]
    body = np.diag([TRACTOR["mass"], TRACTOR["mass"], TRACTOR["inertia"]])
    mass = block_diag(system.mass, body)[np.ix_(order, order)]
    stiffness = block_diag(system.stiffness, np.zeros((3, 3)))[np.ix_(order, order)]
    for mount in TRACTOR["mounts"].values():
        at = carried(mount["at"])
        stiffness[n : n + 3, n : n + 3] += at.T @ np.diag(mount["stiffness"]) @ at
    basis = block_diag(null_space(np.array(rows)), np.eye(len(mass) - n - 3))
    values = eigh(basis.T @ mass @ basis, basis.T @ stiffness @ basis, eigvals_only=True)
    return np.asarray(np.sort(1.0 / np.sqrt(values))[:6] / (2.0 * math.pi))


@pytest.mark.parametrize("alpha3_deg", [90.0, 135.0, 180.0])
def test_base_equals_an_explicit_chassis(
    clamped: LinkageModel, tractor: LinkageModel, alpha3_deg: float
) -> None:
    """The first six undamped natural frequencies agree to 1e-10."""
    alpha3 = math.radians(alpha3_deg)
    actual = tractor.solve(alpha3).modes.omega[:6] / (2.0 * math.pi)
    np.testing.assert_allclose(actual, chassis_frequencies(clamped, alpha3), rtol=1e-10)


def test_kinematics_are_those_on_a_fixed_ground(
    clamped: LinkageModel, tractor: LinkageModel
) -> None:
    """Every pose is the same to the last bit."""
    first, other = (model.kinematics.at(2.0) for model in (clamped, tractor))
    assert np.array_equal(first.origins, other.origins)
    assert np.array_equal(first.angles, other.angles)


def test_heavy_base_on_hard_mounts_gives_the_clamped_linkage(clamped: LinkageModel) -> None:
    """The difference falls towards zero in proportion to the base's inertia."""
    expected = clamped.solve(2.4).modes.omega[:3]
    apart = []
    for size in (1e6, 1e8):
        mounts = {"axle": {"at": [0.6, 0.0], "stiffness": [0.0, 0.0]}}
        model = LinkageModel(on_base(mass=size, inertia=size, mounts=mounts))
        apart.append(model.solve(2.4).modes.omega[3:6] / expected - 1.0)
    assert np.abs(apart[1]).max() < 1e-4
    np.testing.assert_allclose(apart[0] / apart[1], 100.0, rtol=0.02)


def test_base_without_mounts_floats() -> None:
    """Three modes are at 0 Hz and move the base and the linkage as one rigid body."""
    model = LinkageModel(on_base(mounts={}))
    solution = model.solve(2.0)
    assert solution.modes.mechanism.tolist()[:4] == [True, True, True, False]
    strain = np.abs(model.system.stiffness @ solution.modes.shapes)
    assert strain[:, :3].max() < 1e-9 * strain[:, 3].max()


def test_soft_oil_leaves_one_degree_of_freedom(clamped: LinkageModel) -> None:
    """A crank on a weak spring k swings at sqrt(k / J), J from the rigid motion of the linkage."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    del mapping["links"]["input_crank"]["clamped"]
    mapping["springs"] = {"oil": {"joint": "P3", "stiffness": 1.0}}
    model = LinkageModel(mechanism_from_mapping(mapping))
    configuration = model.kinematics.at(2.0)
    inertia = 0.0
    for component in model.components:
        assert isinstance(component, Component)
        body = component.name
        if body == "implement":
            (rigid,) = model.mechanism.rigid_bodies
            rate = configuration.place_rate(body, rigid.centre_of_gravity)
            inertia += rigid.mass * float(rate @ rate)
            inertia += rigid.inertia * configuration.velocity_ratio(body) ** 2
            continue
        link = next(link for link in model.mechanism.links if link.name == body)
        (_, start), (_, end) = link.points[0], link.points[-1]
        first, other = (configuration.place_rate(body, place) for place in (start, end))
        steel = mapping["links"][body]["material"]["density"]
        section = link.body.segments[0].section  # type: ignore[attr-defined]
        length = math.dist(start, end)
        bar = link.count * steel * section.area * length
        # A uniform bar, with the rotary inertia of its sections.
        inertia += bar * float(first @ first + first @ other + other @ other) / 3.0
        turn = configuration.velocity_ratio(body)
        inertia += link.count * steel * section.second_moment * length * turn**2
    expected = math.sqrt(1.0 / inertia) / (2.0 * math.pi)
    actual = model.solve(2.0).modes.omega[0] / (2.0 * math.pi)
    assert actual == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("oil", [None, 3.0e5])
def test_every_way_to_solve_agrees(oil: float | None) -> None:
    """Modal sum and LM-FBS agree at points of the base too."""
    model = LinkageModel(on_base(oil=oil))
    solution = model.solve(2.0)
    lines = np.array([0.0, 1.5, 2.5, 6.0, 60.0])
    ours = solution.frf(DRIVES, DRIVES).frf(lines)
    theirs = model.coupled_frf(2.0, lines, DRIVES, DRIVES).values
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(ours).max()
    np.testing.assert_allclose(ours, ours.swapaxes(1, 2), rtol=1e-9)


def test_damping_rule_does_not_reach_the_base(tractor: LinkageModel) -> None:
    """Rayleigh's term in the mass would damp the tractor against a frame that does not exist."""
    system = tractor.system
    assert not system.damping[system.rows[GROUND]].any()
    assert system.damping[system.rows["implement"]].any()


def test_base_is_drawn_as_a_rigid_body(tractor: LinkageModel) -> None:
    """Its curve moves in a mode without stretching, and belongs to the ground."""
    solution = tractor.solve(2.0)
    places = curves(tractor, solution.configuration)[GROUND]
    moved = mode_curves(solution, 0)[GROUND]
    along, change = np.diff(places, axis=0), np.diff(moved, axis=0)
    assert np.abs(moved).max() > 1e-3
    assert np.abs((along * change).sum(axis=1)).max() < 1e-12


def test_another_implement_keeps_the_base(tractor: LinkageModel) -> None:
    """The YAML and the mechanism that `set_implement` serves still have it."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    text = yaml.safe_dump({**mapping, "base": TRACTOR}, sort_keys=False)
    changed, text = with_implement(tractor.mechanism, text, Implement("", 1200.0, 300.0, ()))
    assert changed.base == tractor.mechanism.base
    assert yaml.safe_load(text)["base"] == TRACTOR


def test_calibration_fits_the_base(tmp_path: Path, tractor: LinkageModel) -> None:
    """Its mass and a tyre are found again from three natural frequencies."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    wanted = tractor.solve(2.0).natural_frequencies
    fit = {
        "mechanism": "tractor.yaml",
        "parameters": {
            "base.inertia": [4000.0, 9000.0],
            "base.mounts.rear_axle.stiffness.1": [4.0e5, 9.0e5],
        },
        "targets": [
            {"mode": i + 1, "at_deg": math.degrees(2.0), "hz": float(wanted[i])} for i in range(4)
        ],
    }
    mapping["base"] = {**copy.deepcopy(TRACTOR), "inertia": 7500.0}
    mapping["base"]["mounts"]["rear_axle"]["stiffness"] = [7.0e5, 5.0e5]
    (tmp_path / "tractor.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False))
    (tmp_path / "fit.yaml").write_text(yaml.safe_dump(fit, sort_keys=False))
    calibration = calibrate(read_calibration(tmp_path / "fit.yaml"), starts=1)
    np.testing.assert_allclose(calibration.values, [6000.0, 7.0e5], rtol=1e-3)


@pytest.mark.parametrize(
    ("spoil", "path"),
    [
        (lambda base: base.pop("inertia"), "base.inertia"),
        (lambda base: base.update(mass=-1.0), "base.mass"),
        (lambda base: base["mounts"]["rear_axle"].update(stiffness=[-1.0, 0.0]), "rear_axle.stiff"),
        (lambda base: base["mounts"]["rear_axle"].update(damping=3.0), "rear_axle.damping"),
        (lambda base: base["mounts"]["rear_axle"].update(track=-0.1), "rear_axle.track"),
        (lambda base: base["mounts"]["rear_axle"].update(track=10.1), "rear_axle.track"),
        (lambda base: base["mounts"]["rear_axle"].update(stifness=3.0), "rear_axle.stifness"),
        (lambda base: base["mounts"]["rear_axle"].update(stiffness=[2e15, 0.0]), "axle.stiffness"),
        (lambda base: base["mounts"]["rear_axle"].update(damping=[0.0, 2e12]), "axle.damping"),
        (lambda base: base.update(centre_of_gravity=[1600.0, 100.0]), "base"),
        (lambda base: base["mounts"].update(E1=base["mounts"]["rear_axle"]), "base.mounts.E1"),
        (lambda base: base["mounts"].update(P1=base["mounts"]["rear_axle"]), "base.mounts.P1"),
    ],
)
def test_invalid_base_is_refused(spoil: Callable[[Any], object], path: str) -> None:
    """The error names the key."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    mapping["base"] = copy.deepcopy(TRACTOR)
    spoil(mapping["base"])
    with pytest.raises(MechanismError) as caught:
        mechanism_from_mapping(mapping)
    assert path in caught.value.path


def test_hardest_mounts_hold_the_base(clamped: LinkageModel) -> None:
    """Mounts and dampers as hard as they may be clamp the linkage, within rounding."""
    for hard in ({"stiffness": [1e15, 1e15]}, {"stiffness": [0.0, 0.0], "damping": [1e12, 1e12]}):
        mounts = {name: {"at": [at, 0.0], **hard} for name, at in (("rear", 0.6), ("front", 3.1))}
        frequencies = LinkageModel(on_base(mounts=mounts)).solve(2.4).natural_frequencies
        expected = clamped.solve(2.4).natural_frequencies[:3]
        near = frequencies[np.abs(frequencies[:, np.newaxis] - expected).argmin(axis=0)]
        np.testing.assert_allclose(near, expected, rtol=1e-6)


def test_hash_of_a_linkage_without_base_is_that_before_bases_existed(clamped: LinkageModel) -> None:
    """The table that ships was built before; with a base the hash differs."""
    with np.load(config_file("tables/three_point_linkage.npz")) as stored:
        text = str(stored["metadata"]) if "metadata" in stored else str(dict(stored))
    assert clamped.mechanism.model_hash in text
    assert on_base().model_hash != clamped.mechanism.model_hash


TYRE = {"width_in": 16.9, "rim_in": 38.0, "pressure": 1.1e5, "count": 2}


def on_tyres(tyre: dict[str, Any], /, **changes: Any) -> dict[str, Any]:
    """Return a description whose rear axle stands on tyres."""
    mapping = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
    mapping["base"] = copy.deepcopy(TRACTOR)
    axle = {"at": [0.6, -0.05], "stiffness_x": 7.0e5, "damping": [4.4e3, 4.4e3], "tyre": tyre}
    mapping["base"]["mounts"]["rear_axle"] = {**axle, **changes}
    return dict(mapping)


@pytest.mark.parametrize(
    ("tyre", "expected"),
    [
        (TYRE, 2 * 344_922.8),  # 172 - 67.26 + 240.1828 kN/m, by hand
        ({**TYRE, "age_years": 10.0, "count": 1}, 400_922.8),  # 56 kN/m more
        ({**TYRE, "factor": 0.8}, 2 * 275_938.24),
        ({"width_in": 14.9, "rim_in": 28, "pressure": 1.6e5}, 349_396.8),  # 122.44 + 226.9568
        ({"size": "14.9-28", "pressure": 1.6e5}, 349_396.8),
        # 420 mm are 16.5354 inches: 172 - 60.18 + 0.34 x 16.5354 x 34 x 1.2 = 341.1995 kN/m
        ({"size": "420/85R34", "pressure": 1.2e5}, 341_199.527_559_055),
        ({"size": "VF 420/85 R34", "pressure": 1.2e5}, 341_199.527_559_055),
    ],
)
def test_tyre_has_the_stiffness_of_lines_and_murphy(tyre: dict[str, Any], expected: float) -> None:
    """The formula by hand; the mechanism is the one that has the number."""
    own = mechanism_from_mapping(on_tyres(tyre))
    assert own.base is not None
    assert own.base.mounts[0].stiffness == (7.0e5, pytest.approx(expected, rel=1e-12))
    plain = on_tyres({})
    axle = plain["base"]["mounts"]["rear_axle"]
    del axle["tyre"], axle["stiffness_x"]
    axle["stiffness"] = [7.0e5, expected]
    assert mechanism_from_mapping(plain).model_hash == own.model_hash


def test_numbers_of_a_tyre_may_be_uncertain() -> None:
    """A pressure that changes by d changes two tyres by 2 x 0.34 W D d, in kN/m and bar."""
    paths = {"base.mounts.rear_axle.tyre.pressure": 0.1, "base.mounts.rear_axle.tyre.factor": 0.2}
    mapping = on_tyres({**TYRE, "factor": 1.0})
    uncertain = mechanism_from_mapping({**mapping, "uncertainty": {"relative": paths}}).uncertainty
    assert uncertain is not None
    pressure, _ = uncertain.numbers
    sides = [uncertain.described([pressure.value + change, 1.0]).base for change in (-10.0, 10.0)]
    low, high = (side.mounts[0].stiffness[1] for side in sides if side)
    slope = (high - low) / 20.0
    assert slope == pytest.approx(2 * 0.34 * 16.9 * 38.0 * 1e3 / 1e5, rel=1e-9)


@pytest.mark.parametrize(
    ("tyre", "changes", "path"),
    [
        ({"width_in": 429.0}, {}, "tyre.width_in"),  # mm
        ({"rim_in": 0.97}, {}, "tyre.rim_in"),  # m
        ({"pressure": 1.1}, {}, "tyre.pressure"),  # bar
        ({"pressure": 6.0e5}, {}, "tyre.pressure"),
        ({"age_years": -1.0}, {}, "tyre.age_years"),
        ({"age_years": 31.0}, {}, "tyre.age_years"),
        ({"count": 0}, {}, "tyre.count"),
        ({"factor": 0.1}, {}, "tyre.factor"),
        ({"presure": 1e5}, {}, "tyre.presure"),
        ({"size": "420"}, {}, "tyre.size"),
        ({"size": "42/85R34"}, {}, "tyre.size"),  # 1.7 inches
        ({}, {"tyre": "420/85R34"}, "rear_axle.tyre"),  # without a pressure
        ({}, {"stiffness": [7e5, 7e5]}, "rear_axle.stiffness"),
        ({}, {"stiffness_x": -1.0}, "rear_axle.stiffness_x"),
    ],
)
def test_invalid_tyre_is_refused(tyre: dict[str, Any], changes: dict[str, Any], path: str) -> None:
    """The error names the key, such as one in another unit."""
    with pytest.raises(MechanismError) as caught:
        mechanism_from_mapping(on_tyres({**TYRE, **tyre}, **changes))
    assert caught.value.path.endswith(path)
