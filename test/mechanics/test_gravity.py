# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Gravity, against closed forms and an independent potential energy of large motions."""

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.linalg import eigh
from scipy.special import jn_zeros

from linkage_vibration.mechanics.bodies.beam import beam_matrices
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.compatibility import CouplingError
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.sensitivity import Sensitivity
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.tabulation import build_table
from test.support.bob import ARM, BOB, INERTIA, MASS

G = 9.81
PENDULUM: dict[str, Any] = {
    "name": "pendulum",
    "gravity": G,
    "ground": {"P": [0.0, 0.0]},
    "links": {},
    "rigid_bodies": {"bob": BOB},
    "input": {"link": "bob", "range_deg": [-120.0, 120.0]},
    "assembly": {"alpha3_deg": 0.0},
    "damping": {"ratio": 0.02, "at_hz": [1.0, 10.0]},
    "response": {"drive_point": "E", "direction": "z", "band_hz": [0.0, 10.0], "modes": 1},
}
STEEL = {"youngs_modulus": 210e9, "density": 7800.0, "poisson_ratio": 0.3}


def pendulum(**changes: Any) -> LinkageModel:
    """Return the pendulum with other top-level keys."""
    return LinkageModel(mechanism_from_mapping({**copy.deepcopy(PENDULUM), **changes}))


def hanging_beam(section: dict[str, Any], *, gravity: float, mass: float = 0.0) -> LinkageModel:
    """Return a beam of 2 m that hangs on a pin, with a point mass at its end."""
    beam = {"points": {"P": 0.0, "E": 2.0}, "section": section, "material": STEEL, "elements": 128}
    if mass:
        beam["masses"] = {"E": mass}
    bodies = {"links": {"bob": beam}, "rigid_bodies": {}}
    changes = {**copy.deepcopy(PENDULUM), **bodies, "gravity": gravity}
    return LinkageModel(mechanism_from_mapping(changes), reduced=False)


def test_pendulum_swings_at_its_natural_frequency() -> None:
    """It is sqrt(m g l / (J + m l^2)) / 2 pi; without gravity nothing holds it."""
    expected = math.sqrt(MASS * G * ARM / (INERTIA + MASS * ARM**2)) / (2.0 * math.pi)
    found = pendulum().solve(-math.pi / 2.0).natural_frequencies[0]
    assert found == pytest.approx(expected, rel=1e-10)
    assert pendulum(gravity=0.0).solve(-math.pi / 2.0).modes.mechanism[0]


@pytest.mark.parametrize("alpha3_deg", [-60.0, 0.0, 35.0, 90.0])
def test_spring_carries_a_pendulum_at_any_angle(alpha3_deg: float) -> None:
    """Its stiffness is k - m g l sin(alpha3), also upside down."""
    stiffness, alpha3 = 400.0, math.radians(alpha3_deg)
    model = pendulum(springs={"spring": {"joint": "P", "stiffness": stiffness}})
    held = stiffness - MASS * G * ARM * math.sin(alpha3)
    expected = math.sqrt(held / (INERTIA + MASS * ARM**2)) / (2.0 * math.pi)
    assert model.solve(alpha3).natural_frequencies[0] == pytest.approx(expected, rel=1e-9)


def test_linkage_that_falls_is_refused() -> None:
    """A pendulum falls beside its lowest position, and upside down on too soft a spring."""
    with pytest.raises(CouplingError, match=r"Nothing carries the weight.*30\.000 deg"):
        pendulum().solve(math.radians(30.0))
    for stiffness in (20.0, 80.0):
        soft = pendulum(springs={"spring": {"joint": "P", "stiffness": stiffness}})
        with pytest.raises(CouplingError, match=r"does not stay at alpha3 = 90\.000 deg"):
            soft.solve(math.pi / 2.0)


def test_linkage_that_falls_fast_is_refused() -> None:
    """Upside down, m g l / (J + m l^2) of a short pendulum is 79 (rad/s)^2, above (2 pi)^2."""
    bob = {**PENDULUM["rigid_bodies"]["bob"], "centre_of_gravity": [0.12, 0.0], "inertia": 0.006}
    short = pendulum(
        rigid_bodies={"bob": bob}, springs={"spring": {"joint": "P", "stiffness": 1e-6}}
    )
    with pytest.raises(CouplingError, match=r"does not stay at alpha3 = 90\.000 deg"):
        short.solve(math.pi / 2.0)


def test_light_and_stiff_link_is_not_refused(mapping: Any) -> None:
    """A lift rod of 1e-6 kg/m3 and 1e15 Pa is a rigid bar without mass, as one of 1e13 Pa is."""
    mapping["gravity"] = G
    first = []
    for modulus, density in ((1e13, 1e-3), (1e15, 1e-6)):
        light = {**STEEL, "youngs_modulus": modulus, "density": density}
        mapping["links"]["lift_rod"]["material"] = light
        model = LinkageModel(mechanism_from_mapping(mapping))
        first.append(model.solve(2.3).natural_frequencies[:3])
    np.testing.assert_allclose(first[0], first[1], rtol=1e-3)


def test_hanging_ribbon_has_the_frequencies_of_a_chain() -> None:
    """A thin ribbon swings at j / 2 sqrt(g / L), with the zeros j of the Bessel function J0."""
    thin = {"shape": "rectangle", "width": 0.01, "height": 1e-6}
    found = hanging_beam(thin, gravity=G).solve(-math.pi / 2.0).natural_frequencies[:3]
    expected = jn_zeros(0, 3) / 2.0 * math.sqrt(G / 2.0) / (2.0 * math.pi)
    np.testing.assert_allclose(found, expected, rtol=5e-4)


def test_tension_raises_the_frequencies_of_a_rod() -> None:
    """By sqrt(1 + T L^2 / (n^2 pi^2 E I)) where a mass of 2 t at its end holds it."""
    size, mass = 0.02, 2000.0
    rod = {"shape": "round", "diameter": size}

    def bending(gravity: float) -> Any:
        solution = hanging_beam(rod, gravity=gravity, mass=mass).solve(-math.pi / 2.0)
        upright = np.abs(solution.participation([("E", "z")])[0]) < 1e-6
        return solution.modes.omega[upright][1:4]

    taut, slack = bending(G), bending(0.0)
    area, second_moment = math.pi / 4.0 * size**2, math.pi / 64.0 * size**4
    tension = G * (mass + STEEL["density"] * area)  # in the middle
    n = np.arange(1, 4)
    share = tension * 2.0**2 / ((n * math.pi) ** 2 * STEEL["youngs_modulus"] * second_moment)
    np.testing.assert_allclose(taut / slack, np.sqrt(1.0 + share), rtol=1e-3)


BASE: dict[str, Any] = {
    "mass": 300.0,
    "inertia": 40.0,
    "centre_of_gravity": [0.3, -0.1],
    "mounts": {
        "left": {"at": [-0.2, -0.3], "stiffness": [3.0e5, 4.0e5]},
        "right": {"at": [1.1, -0.25], "stiffness": [2.0e5, 5.0e5]},
    },
}
FIXED = [-0.1, 0.6]
COUPLER: dict[str, Any] = {"B": [0.0, 0.0], "C": [0.7, 0.0], "H": [0.2, 0.3]}
CYLINDER: dict[str, Any] = {
    "base_end": [-0.35, 0.05],
    "rod_end": [0.15, 0.1],
    "bore": 0.05,
    "stroke": 0.3,
    "closed_length": 0.2,
    "bulk_modulus": 1.0e8,
}
FOUR_BAR: dict[str, Any] = {
    "name": "loaded four-bar",
    "gravity": G,
    "ground": {"A": [0.0, 0.0], "D": [0.9, 0.1]},
    "links": {
        "crank": {
            "points": {"A": 0.0, "B": 0.3},
            "section": {"shape": "rectangle", "width": 0.02, "height": 0.008},
            "material": STEEL,
        },
        "rocker": {  # its pin is beside its axis
            "points": {"D": 0.0, "C": [0.5, 0.04]},
            "section": {"shape": "round", "diameter": 0.012},
            "material": STEEL,
            "masses": {"C": 3.0},
        },
    },
    "rigid_bodies": {
        "coupler": {
            "points": COUPLER,
            "centre_of_gravity": [0.3, 0.25],
            "mass": 60.0,
            "inertia": 4.0,
        }
    },
    "base": BASE,
    "input": {"link": "crank", "range_deg": [60.0, 120.0]},
    "assembly": {"alpha3_deg": 90.0, "angles_deg": {"coupler": 10.0, "rocker": 100.0}},
    "damping": {"ratio": 0.01, "at_hz": [2.0, 50.0]},
    "response": {"drive_point": "C", "direction": "x", "band_hz": [0.0, 100.0], "modes": 4},
}
SPRINGS: dict[str, dict[str, Any]] = {
    "joint": {"joint": "A", "stiffness": 3.0e3},
    "points": {"between": ["F", "H"], "stiffness": 2.0e4},
    "cylinder": {"joint": "A", "cylinder": CYLINDER},
}


class Large:
    """The four-bar in large motions, from its energy alone; coordinates are motions from rest.

    They are those of the base and of the coupler (x, z, theta), and of the nodes of both beams, of
    which the ends have theta alone. Beams are Reissner's, with one strain of each kind an element.
    """

    elements = 16

    def __init__(self, model: LinkageModel, spring: dict[str, Any], stiffness: float) -> None:
        self.at = model.kinematics.at(math.pi / 2.0)
        self.spring, self.spring_stiffness = spring, stiffness
        self.beams = [self._beam(link) for link in ("crank", "rocker")]
        self.size = 6 + sum(3 * self.elements - 1 for _ in self.beams)

    def _beam(self, name: str) -> tuple[str, float, np.ndarray, float]:
        section = FOUR_BAR["links"][name]["section"]
        if name == "crank":
            b, h = section["width"], section["height"]
            area, second_moment = b * h, b * h**3 / 12.0
            shear, length = 10.0 * (1.0 + 0.3) / (12.0 + 11.0 * 0.3), 0.3
        else:
            area = math.pi / 4.0 * section["diameter"] ** 2
            second_moment = area**2 / (4.0 * math.pi)
            shear, length = 6.0 * (1.0 + 0.3) / (7.0 + 6.0 * 0.3), 0.5
        youngs = STEEL["youngs_modulus"]
        rigid = np.array([youngs * area, shear * youngs / 2.6 * area, youngs * second_moment])
        return name, length, rigid * length / self.elements, STEEL["density"] * area * length

    def bodies(self, q: Any) -> tuple[Any, Any]:
        """Return a function that gives the place of a point of base and coupler, (..., 2)."""

        def base(point: Any) -> Any:
            return _carried(np.array(BASE["centre_of_gravity"]), q[..., :3], np.array(point))

        def coupler(point: Any) -> Any:
            centre = self.at.place("coupler", (0.3, 0.25))
            return _carried(centre, q[..., 3:6], self.at.place("coupler", tuple(point)))

        return base, coupler

    def nodes(self, q: Any) -> list[tuple[Any, Any]]:
        """Return places, (..., n, 2), and rotations, (..., n), of the nodes of both beams."""
        base, coupler = self.bodies(q)
        found, first = [], 6
        for (name, length, _, _), ends in zip(self.beams, (("A", "B"), ("D", "C")), strict=True):
            n, angle = self.elements, self.at.angle(name)
            own = q[..., first : first + 3 * n - 1]
            first += 3 * n - 1
            theta, moved = own[..., : n + 1], own[..., n + 1 :].reshape(*q.shape[:-1], n - 1, 2)
            rest = [self.at.place(name, (length * i / n, 0.0)) for i in range(1, n)]
            arm = 0.04 if name == "rocker" else 0.0
            turned = angle + theta[..., -1]
            back = arm * np.stack([-np.sin(turned), np.cos(turned)], axis=-1)
            start = base(FOUR_BAR["ground"][ends[0]])[..., np.newaxis, :]
            end = (coupler(COUPLER[ends[1]]) - back)[..., np.newaxis, :]
            found.append((np.concatenate([start, rest + moved, end], axis=-2), theta))
        return found

    def strains(self, q: Any) -> Any:
        """Return the stretches of everything that is elastic, (..., n_strains)."""
        base, coupler = self.bodies(q)
        found = []
        for (name, length, _, _), (places, theta) in zip(self.beams, self.nodes(q), strict=True):
            along = np.diff(places, axis=-2) / (length / self.elements)
            turned = self.at.angle(name) + (theta[..., 1:] + theta[..., :-1]) / 2.0
            c, s = np.cos(turned), np.sin(turned)
            found.append(c * along[..., 0] + s * along[..., 1] - 1.0)
            found.append(-s * along[..., 0] + c * along[..., 1])
            found.append(np.diff(theta, axis=-1) / (length / self.elements))
        for mount in BASE["mounts"].values():
            found.append(base(mount["at"]))
        crank = self.nodes(q)[0][1][..., 0]
        if self.spring is SPRINGS["joint"]:
            found.append((crank - q[..., 2])[..., np.newaxis])
        else:
            end = coupler(COUPLER["H"])
            start = base(FIXED)
            if self.spring is SPRINGS["cylinder"]:
                start = base(CYLINDER["base_end"])
                angle = self.at.angle("crank") + crank
                c, s = np.cos(angle), np.sin(angle)
                x, z = CYLINDER["rod_end"]
                end = base((0.0, 0.0)) + np.stack([c * x - s * z, s * x + c * z], axis=-1)
            found.append(np.sqrt(((end - start) ** 2).sum(axis=-1))[..., np.newaxis])
        return np.concatenate(found, axis=-1)

    def rigidities(self) -> Any:
        """Return the stiffness that belongs to each of the strains."""
        beams = [np.repeat(rigid, self.elements) for _, _, rigid, _ in self.beams]
        mounts = [mount["stiffness"] for mount in BASE["mounts"].values()]
        return np.concatenate([*beams, *mounts, [self.spring_stiffness]])

    def inertias(self, q: Any) -> tuple[Any, Any]:
        """Return all that has a mass: its coordinates, (..., n), and their masses, (n,)."""
        parts, masses = [q[..., :6]], [[300.0, 300.0, 40.0, 60.0, 60.0, 4.0]]
        for (_, _, _, mass), (places, _) in zip(self.beams, self.nodes(q), strict=True):
            parts.append(places.reshape(*q.shape[:-1], -1))
            lumps = np.full(self.elements + 1, mass / self.elements)
            lumps[[0, -1]] /= 2.0
            masses.append(np.repeat(lumps, 2))
        parts.append(self.bodies(q)[1](COUPLER["C"]))  # the point mass of the rocker
        return np.concatenate(parts, axis=-1), np.concatenate([*masses, [3.0, 3.0]])

    def weight(self, q: Any) -> Any:
        """Return the potential energy of gravity, J."""
        parts, masses = self.inertias(q)
        up = np.tile([0.0, 1.0], len(masses) // 2 + 1)[: len(masses)]
        up[:6] = [0.0, 1.0, 0.0, 0.0, 1.0, 0.0]
        return G * parts @ (masses * up)

    def squares(self, *, gravity: bool) -> Any:
        """Return the squares of the natural angular frequencies, ascending."""
        here = np.zeros(self.size)
        stretch = _jacobian(self.strains, here)
        stiffness = stretch.T @ (self.rigidities()[:, np.newaxis] * stretch)
        if gravity:
            load = -_jacobian(lambda q: self.weight(q)[..., np.newaxis], here)[0]
            forces = self.rigidities() * (stretch @ np.linalg.solve(stiffness, load))

            def energy(q: Any) -> Any:
                return (self.strains(q) @ forces + self.weight(q))[..., np.newaxis]

            step = 1e-5
            sides = step * np.eye(self.size)
            rows = [_jacobian(energy, s)[0] - _jacobian(energy, -s)[0] for s in sides]
            stiffness = stiffness + np.array(rows) / (2.0 * step)
        _, masses = self.inertias(here)
        rows = _jacobian(lambda q: self.inertias(q)[0], here)
        # The ends of beams turn without any mass, which is given a little.
        mass = rows.T @ (masses[:, np.newaxis] * rows) + 1e-9 * np.eye(self.size)
        return eigh(stiffness, mass, eigvals_only=True)


def _carried(centre: Any, motion: Any, point: Any) -> Any:
    """Return where a point of a rigid body is after a motion (x, z, theta), (..., 2)."""
    c, s = np.cos(motion[..., 2]), np.sin(motion[..., 2])
    x, z = point - centre
    turned = np.stack([c * x - s * z, s * x + c * z], axis=-1)
    return centre + motion[..., :2] + turned


def _jacobian(function: Any, at: Any) -> Any:
    """Return the derivatives of a function by steps along the imaginary axis, (n_out, n)."""
    step = 1e-30
    return function(at + 1j * step * np.eye(len(at))).imag.T / step


@pytest.mark.parametrize("name", list(SPRINGS))
def test_gravity_changes_modes_as_the_energy_of_large_motions_does(name: str) -> None:
    """The four-bar has beams, a rigid body, an arm, a base, and a spring of each kind."""
    changes: dict[str, Any] = {"springs": {"spring": SPRINGS[name]}}
    if name == "points":
        changes["ground"] = {**FOUR_BAR["ground"], "F": FIXED}
    heavy, light = (
        LinkageModel(mechanism_from_mapping({**FOUR_BAR, **changes, "gravity": g}), reduced=False)
        for g in (G, 0.0)
    )
    solutions = [model.solve(math.pi / 2.0) for model in (heavy, light)]
    stiffness = float(solutions[0].joining.stiffness[0])
    if name == "cylinder":
        rod = solutions[0].configuration.place("crank", tuple(CYLINDER["rod_end"]))
        away = rod - np.array(CYLINDER["base_end"])
        lever = (rod[0] * away[1] - rod[1] * away[0]) / np.hypot(*away)
        stiffness /= lever**2
    large = Large(heavy, SPRINGS[name], stiffness)
    expected = [large.squares(gravity=g)[:5] for g in (True, False)]
    found = [solution.modes.omega[:5] ** 2 for solution in solutions]
    np.testing.assert_allclose(found[1], expected[1], rtol=5e-3)  # the two meshes
    change = np.abs(expected[0] - expected[1])
    np.testing.assert_allclose(
        found[0] - found[1], expected[0] - expected[1], atol=5e-3 * change.max()
    )


@pytest.fixture(scope="module")
def hitch() -> LinkageModel:
    """Return the linkage on its tractor with gravity."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    return LinkageModel(mechanism_from_mapping({**yaml.safe_load(path.read_text()), "gravity": G}))


def test_every_way_to_solve_agrees(hitch: LinkageModel) -> None:
    """Modal sum and FRFs agree, and reduced and unreduced links."""
    solution, places = hitch.solve(2.9), [("E1", "z"), ("P3", "x")]
    lines = np.array([0.0, 1.5, 8.0, 90.0])
    ours, theirs = (
        solution.frf(places, places).frf(lines),
        hitch.coupled_frf(2.9, lines, places, places),
    )
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(ours).max()
    whole = LinkageModel(hitch.mechanism, reduced=False).solve(2.9).modes.omega[:6]
    np.testing.assert_allclose(solution.modes.omega[:6], whole, rtol=1e-5)


def test_table_has_the_frequencies_under_gravity(hitch: LinkageModel) -> None:
    """At an angle between its points; its hash is not that without gravity."""
    low, high = 2.8, 3.0
    short = replace(hitch.mechanism, stroke=(low, high), uncertainty=None)
    table = build_table(LinkageModel(short), 1e-5)
    expected = hitch.solve(2.93).natural_frequencies[:6]
    np.testing.assert_allclose(table.interpolate(2.93)[0][:6], expected, rtol=1e-5)
    assert hitch.mechanism.model_hash != replace(hitch.mechanism, gravity=0.0).model_hash


def test_deviations_hold_with_gravity(hitch: LinkageModel) -> None:
    """They contain what a number changes in the forces that carry the weight."""
    mechanism = hitch.mechanism
    assert mechanism.uncertainty is not None
    solution = hitch.solve(3.1)
    found = Sensitivity(hitch).at(solution, 150.0)
    for i, number in enumerate(mechanism.uncertainty.numbers):
        if not number.path.startswith(("rigid_bodies", "base.mass", "ground.P2.1")):
            continue
        sides = [LinkageModel(side).solve(3.1) for side in number.sides]
        low, high = (np.log(side.natural_frequencies[:6]) for side in sides)
        expected = (high - low) * number.deviation / (2.0 * number.step)
        limit = 5e-3 * np.abs(expected).max()
        np.testing.assert_allclose(found.log_frequencies[i][:6], expected, atol=limit)


def test_what_gravity_does_not_cover_is_refused(hitch: LinkageModel) -> None:
    """Links of unknown shape, and a gravity that points upwards are refused."""
    (rod,) = (link for link in hitch.mechanism.links if link.name == "lift_rod")
    found = beam_matrices(rod.body, rod.points)  # type: ignore[arg-type]
    plain = replace(rod, body=Matrices(found.dofs, found.mass, found.stiffness))
    links = tuple(plain if link is rod else link for link in hitch.mechanism.links)
    other = replace(hitch.mechanism, links=links)
    with pytest.raises(MechanismError, match=r"links\.lift_rod .* remove gravity"):
        LinkageModel(other)
    with pytest.raises(MechanismError, match=r"gravity: -9.81 is below 0; give 9\.81, in m/s2"):
        pendulum(gravity=-G)
