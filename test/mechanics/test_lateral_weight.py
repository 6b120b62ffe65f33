# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the weight does to the lateral half, by closed forms, finite rotations and elements."""

import copy
import math
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from linkage_vibration.mechanics.compatibility import CouplingError
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.support.resources import config_file
from test.support.hitch_in_space import (
    ASIDE,
    AXLES,
    CHAIN,
    CHAIN_AT,
    CHAIN_END,
    IMPLEMENT,
    TRACTOR,
    hitch,
    implement_tensor,
    pose,
)

FloatArray = NDArray[np.float64]
G = 9.80665
# kg, at the ends and the middle of both cranks: a uniform rod of 400 kg by Simpson's rule.
CRANKS = 400.0 * np.tile([1.0, 4.0, 1.0], 2) / 6.0


def described(*, tractor: bool, **lateral: Any) -> Any:
    """Return the shipped hitch with other numbers under `lateral`, on a tractor or clamped."""
    both: Any = yaml.safe_load(config_file("three_point_linkage_on_tractor.yaml").read_text())
    del both["uncertainty"]
    if not tractor:
        clamped = yaml.safe_load(config_file("three_point_linkage.yaml").read_text())
        both = clamped | {"lateral": both["lateral"]}
        both.pop("uncertainty", None)
        del both["lateral"]["axles"], both["lateral"]["inertia"]["base"]
    both["lateral"] |= lateral
    return both


def rigid(mapping: Any) -> Any:
    """Return a hitch whose links are nearly rigid and have nearly no weight."""
    mapping = copy.deepcopy(mapping)
    for link in mapping["links"].values():
        link["material"] = {"youngs_modulus": 2.1e16, "density": 1e-3, "poisson_ratio": 0.3}
    return mapping


def turned(vector: FloatArray) -> FloatArray:
    """Return the matrix of a rotation vector, by Rodrigues."""
    x, y, z = vector
    k, angle = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), float(np.linalg.norm(vector))
    half = np.sinc(angle / (2.0 * math.pi)) ** 2 / 2.0
    return np.asarray(np.eye(3) + np.sinc(angle / math.pi) * k + half * k @ k)


class RigidHitch:
    """Both sides of a hitch of rigid links; tractor and implement turn at will.

    The rockshaft with its cranks is a part of the tractor; the other links have no mass. All
    lengths are constraints.
    """

    def __init__(self, alpha3: float, *, tractor: bool, chain: float) -> None:
        self.alpha3, places = alpha3, pose(alpha3)
        spots = {
            (point, side): np.insert(places[point], 1, side * ASIDE[point])
            for point in ASIDE
            for side in (1.0, -1.0)
        }
        self.centres = np.array([[1.6, 0.0, 0.1], np.insert(places["M"], 1, 0.0)])
        self.spots, self.tractor, self.chain = spots, tractor, chain
        self.loads = np.zeros(len(AXLES))  # of the axles, N
        self.lengths, self.hooked = self.constraints(np.zeros(12)), self.chains(np.zeros(12))

    def at(self, q: FloatArray, body: int, place: FloatArray) -> FloatArray:
        """Return where a body, 0 is the tractor, carries a place."""
        moved, vector = q[6 * body : 6 * body + 3], q[6 * body + 3 : 6 * body + 6]
        centre = self.centres[body]
        return np.asarray(centre + moved + turned(vector) @ (place - centre))

    def cranks(self, q: FloatArray) -> FloatArray:
        """Return the ends and the middle of both cranks, (6, 3)."""
        ends = [[self.at(q, 0, self.spots[p, side]) for p in ("P3", "V2")] for side in (1.0, -1.0)]
        return np.array([place for a, b in ends for place in (a, (a + b) / 2.0, b)])

    def lower(self, q: FloatArray, side: float, share: float) -> FloatArray:
        """Return a place on a lower link, at a share of its length."""
        begin = self.at(q, 0, self.spots["P1", side])
        return np.asarray(begin + share * (self.at(q, 1, self.spots["E1", side]) - begin))

    def constraints(self, q: FloatArray) -> FloatArray:
        """Return the lengths of lower links, lift rods and the upper link."""
        lines = [self.at(q, 1, self.spots["E2", 1.0]) - self.at(q, 0, self.spots["P2", 1.0])]
        for side in (1.0, -1.0):
            lines.append(self.lower(q, side, 1.0) - self.lower(q, side, 0.0))
            top = self.at(q, 0, self.spots["V2", side])
            lines.append(self.lower(q, side, 0.366 / 0.810) - top)
        return np.linalg.norm(lines, axis=1)

    def chains(self, q: FloatArray) -> FloatArray:
        """Return the lengths of both chains."""
        ends = [CHAIN_END * [1.0, side, 1.0] for side in (1.0, -1.0)]
        hooks = [self.lower(q, side, CHAIN_AT / 0.810) for side in (1.0, -1.0)]
        both = zip(ends, hooks, strict=True)
        return np.array([np.linalg.norm(self.at(q, 0, end) - hook) for end, hook in both])

    def energy(self, q: FloatArray) -> float:
        """Return the potential energy of weight, chains and tyres."""
        weights = np.array([TRACTOR[0], IMPLEMENT[0]]) * G
        stretched = self.chains(q) - self.hooked
        fallen = self.cranks(q) - self.cranks(0.0 * q)
        energy = (
            weights @ q[[2, 8]]
            + G * CRANKS @ fallen[:, 2]
            + self.chain * (stretched @ stretched) / 2.0
        )
        for load, (x, z, track, *stiffness, contact) in zip(self.loads, AXLES, strict=True):
            for side in (0.5, -0.5):
                hub, soil = np.array([x, side * track, z]), np.array([x, side * track, contact])
                moved = self.at(q, 0, hub)[0] - x, *(self.at(q, 0, soil) - soil)[1:]
                energy += (np.array(stiffness) @ np.square(moved)) / 4.0 - load / 2.0 * moved[2]
        return float(energy)

    def frequencies(self) -> FloatArray:
        """Return the natural frequencies of small sideways motions about rest, Hz."""
        unit, step = np.eye(12), 1e-3

        def slope(f: Any) -> FloatArray:
            return np.array([(f(1e-5 * e) - f(-1e-5 * e)) / 2e-5 for e in unit])

        rates, dead, pushes = slope(self.constraints), slope(self.energy), []
        for i in range(len(AXLES)):
            self.loads = np.eye(len(AXLES))[i]
            pushes.append(slope(self.energy) - dead)
        free = slice(0 if self.tractor else 6, 12)
        unknown = np.column_stack([rates, *pushes])[free]
        found = np.linalg.lstsq(unknown, -dead[free], rcond=1e-9)[0]
        np.testing.assert_allclose(unknown @ found, -dead[free], atol=1e-3)  # N and N m
        self.loads = np.asarray(found[5:])

        def total(q: FloatArray) -> float:
            return self.energy(q) + float(found[:5] @ (self.constraints(q) - self.lengths))

        k = [
            [total(a + b) - total(a - b) - total(b - a) + total(-a - b) for b in step * unit]
            for a in step * unit
        ]
        m = np.diag([*3 * [TRACTOR[0]], *TRACTOR[1], *3 * [IMPLEMENT[0]], *3 * [0.0]])
        m[9:, 9:] = implement_tensor(self.alpha3)
        moved = slope(self.cranks)
        m += np.einsum("ick,c,jck->ij", moved, CRANKS, moved)
        odd = [i for i in (1, 3, 5, 7, 9, 11) if self.tractor or i > 5]
        z, both = null_space(rates[odd].T, rcond=1e-6), np.ix_(odd, odd)
        k, m = (z.T @ each[both] @ z for each in (np.array(k) / (4.0 * step**2), m))
        return np.asarray(np.sqrt(eigh(k, m, eigvals_only=True)) / (2.0 * math.pi))


def lateral(mapping: Any, alpha3: float) -> Any:
    """Return the solution of the lateral half that a mapping describes."""
    return LinkageModel(mechanism_from_mapping(mapping), half="lateral").solve(alpha3)


def hertz(solution: Any) -> FloatArray:
    """Return its undamped natural frequencies."""
    return np.asarray(solution.modes.omega / (2.0 * math.pi))


@pytest.mark.parametrize(
    ("chain", "tractor"),
    [
        (0.0, False),
        pytest.param(CHAIN, True, marks=pytest.mark.nightly),
        pytest.param(0.0, True, marks=pytest.mark.nightly),
        pytest.param(CHAIN, False, marks=pytest.mark.nightly),
    ],
)
def test_rigid_hitches(chain: float, tractor: bool) -> None:
    """The curvature of the potential energy of both sides gives the frequencies.

    A clamped one without chains is a pendulum.
    """
    mapping = rigid(described(tractor=tractor))
    mapping["links"]["input_crank"]["material"]["density"] = 400.0 / (0.020 * 0.036 * 0.203)
    if not chain:
        del mapping["lateral"]["chains"]
    for alpha3 in (1.7, 2.9):
        exact = RigidHitch(alpha3, tractor=tractor, chain=chain).frequencies()
        found = hertz(lateral(mapping, alpha3))[: len(exact)]
        np.testing.assert_allclose(found, exact, rtol=5e-5)
        mapping["lateral"]["weight"] = "ignored"
        off = hertz(lateral(mapping, alpha3))[: len(exact)] / exact - 1.0
        assert off[0] < -0.99 if not chain and not tractor else np.abs(off).max() > 5e-3
        mapping["lateral"]["weight"] = "carried"


def test_pendulum_on_parallel_links() -> None:
    """Without chains the implement moves along y alone, held by the tensions of the links.

    A tension N turns by y / L with its link, and so holds its end with N / L.
    """
    alpha3, y = 2.2, {"P1": 0.4, "E1": 0.4, "P3": 0.4, "V2": 0.4}
    mapping, places = rigid(described(tractor=False, y=y, chains={})), pose(alpha3)
    mass = IMPLEMENT[0]
    upper = (places["E2"] - places["P2"]) / math.dist(places["E2"], places["P2"])
    arm, mast = places["M"] - places["E1"], places["E2"] - places["E1"]
    # Moments about E1 on the implement: the weight, and the tension of the upper link.
    pull = mass * G * arm[0] / (mast[1] * upper[0] - mast[0] * upper[1])
    at_e1 = np.array([0.0, mass * G]) + pull * upper  # by both lower links on the implement
    rod = (places["V2"] - places["V1"]) / math.dist(places["V2"], places["V1"])
    hook, whole = places["V1"] - places["P1"], places["E1"] - places["P1"]
    # Moments about P1 on the lower links: the reaction of the implement, and the rods.
    lift = (whole[0] * at_e1[1] - whole[1] * at_e1[0]) / (hook[0] * rod[1] - hook[1] * rod[0])
    along = whole / math.hypot(*whole)
    outer, inner = -at_e1 @ along, (lift * rod - at_e1) @ along
    share = 0.366 / 0.810
    k = pull / 0.520 + (inner * share + outer * (1.0 - share)) / 0.810 + lift * share**2 / 0.534
    assert hertz(lateral(mapping, alpha3))[0] == pytest.approx(
        math.sqrt(k / mass) / (2.0 * math.pi), rel=1e-5
    )


@pytest.mark.parametrize("tractor", [False, True])
@pytest.mark.parametrize("alpha3_deg", [90.0, 135.0, 180.0])
def test_elastic_hitch_by_finite_elements_in_space(alpha3_deg: float, tractor: bool) -> None:
    """With both sides explicit, modes agree to 1e-5 below 10 Hz, and to 5e-5 up to 190 Hz.

    The weight changes some by 2 to 3 %.
    """
    alpha3 = math.radians(alpha3_deg)
    mapping = described(tractor=tractor)
    exact = hitch(alpha3, tractor=tractor, weight=True)[0]
    n, low = int((exact < 190.0).sum()), int((exact < 10.0).sum())
    found = hertz(lateral(mapping, alpha3))
    assert low == (5 if tractor else 2)
    np.testing.assert_allclose(found[:low], exact[:low], rtol=1e-5)
    np.testing.assert_allclose(found[:n], exact[:n], rtol=5e-5)
    mapping["lateral"]["weight"] = "ignored"
    assert np.abs(hertz(lateral(mapping, alpha3))[:2] / exact[:2] - 1.0).max() > 0.02


def test_reduced_stacked_and_by_forces() -> None:
    """Reduction and a stack of angles change nothing; what pins exert sways the implement."""
    mapping = described(tractor=True)
    mapping["damping"]["ratio"] = 1e-9  # of the mass of the implement, by Rayleigh's rule
    mechanism = mechanism_from_mapping(mapping)
    model = LinkageModel(mechanism, half="lateral")
    solution = model.solve(2.3)
    full = LinkageModel(mechanism, half="lateral", reduced=False).solve(2.3)
    np.testing.assert_allclose(hertz(solution)[:6], hertz(full)[:6], rtol=1e-6)
    stack = model.stack(np.array([1.9, 2.3]))
    np.testing.assert_allclose(stack.modes.omega[1, :9], solution.modes.omega[:9], rtol=1e-9)
    outputs = ["E1.y", "E1.x", "E1.z", "lower_link:E1.force_y", "upper_link:E2.force_y"]
    line = np.array([1.3])
    y, x, z, lower, upper = solution.frf(outputs, ["V1.y"]).frf(line)[0, :, 0]
    away = solution.configuration.place("implement", mechanism.rigid_bodies[0].centre_of_gravity)
    away = away - solution.configuration.place("implement", (0.0, 0.0))
    sway = y - away @ [x, z] / 0.4  # E1 is 0.4 m aside: it yaws by -x / 0.4, and rolls by z / 0.4
    square = -((2.0 * math.pi * 1.3) ** 2)
    assert -(2.0 * lower + upper) == pytest.approx(IMPLEMENT[0] * square * sway, rel=1e-6)
    exact = model.coupled_frf(2.3, line, ["E1.y"], ["V1.y"]).values[0, 0, 0]
    assert exact == pytest.approx(y, rel=1e-6)


@pytest.mark.parametrize("ends", [["P2", "E2"], ["V2", "V1"], ["P1", "E1"]])
def test_a_spring_beside_a_link_shares_its_tension(ends: list[str]) -> None:
    """Both together straighten their line as the link alone does, also if it is not in the plane.

    The spring of 1 TN/m carries most of the force, as links have 0.1 to 1 TN/m.
    """
    off = []
    for stiffness in (0.0, 1e12):
        mapping = rigid(described(tractor=True))
        for link in mapping["links"].values():
            link["material"]["youngs_modulus"] = 1e14
        if stiffness:
            mapping["springs"]["stay"] = {"between": ends, "stiffness": stiffness}
        with_it = hertz(lateral(mapping, 2.2))[:4]
        mapping["lateral"]["weight"] = "ignored"
        off.append(with_it / hertz(lateral(mapping, 2.2))[:4])
    np.testing.assert_allclose(off[1], off[0], rtol=2e-5)


def test_what_the_weight_topples_is_refused() -> None:
    """A tractor on soft tyres: 8 t at 0.95 m above the soil need 50 kN m/rad, by 0.64 m2 k."""
    for stiffness, topples in ((60e3, True), (110e3, False)):
        mapping = described(tractor=True)
        mapping["base"]["mounts"]["rear_axle"]["stiffness"] = [700e3, stiffness]
        if topples:
            with pytest.raises(ModelError, match=r"At 126.1 deg .* topples sideways under"):
                lateral(mapping, 2.2)
        else:
            assert not lateral(mapping, 2.2).modes.mechanism.any()


def test_a_weight_that_nothing_carries_is_refused() -> None:
    """Without cylinders the crank turns freely, so forces at rest are not known."""
    mapping = described(tractor=True)
    del mapping["springs"]
    with pytest.raises(CouplingError, match=r"Nothing carries the weight of .* `weight: ignored`"):
        lateral(mapping, 2.2)
    mapping["lateral"]["weight"] = "ignored"
    assert not lateral(mapping, 2.2).modes.mechanism.any()
