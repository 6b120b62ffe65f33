# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Levels by two tracks, against a simulation in time of a hitch in space on four tyres."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.integrate import trapezoid
from scipy.linalg import eig
from scipy.signal import lfilter
from scipy.special import ndtri

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, with_numbers
from linkage_vibration.prediction.doubts import excitation_doubts, slack_mode
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.ground import (
    GroundTable,
    Terrain,
    ground_spectrum,
    vertical_mounts,
)
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.loads import BASE_DISPLACEMENT, FORCE, Load
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.support.hitch_in_space import (
    AXLES,
    CHAIN,
    CHAIN_AT,
    CHAIN_END,
    CYLINDERS,
    DAMPING,
    Assembly,
    assembled,
    hitch,
    modes,
    pose,
)

ALPHA3, TERRAIN = 2.2, Terrain(256e-6)  # ISO class C
CHAIN_FORCE = ("check_chain", "force")
TYRES = [("base:rear_axle", "force_z"), ("base:front_axle", "force_z")]


@pytest.fixture(scope="module")
def mapping() -> Any:
    """Return the shipped hitch, exact, with the cylinders of the finite elements."""
    mapping = yaml.safe_load(config_file("three_point_linkage_on_tractor.yaml").read_text())
    del mapping["uncertainty"]
    mapping["springs"]["lift_cylinders"] = {"joint": "P3", "stiffness": CYLINDERS}
    mapping["lateral"]["weight"] = "ignored"  # as in the finite elements
    return mapping


@pytest.fixture(scope="module")
def built(mapping: Any) -> tuple[Mechanism, Table]:
    """Return the mechanism and its table."""
    mechanism = mechanism_from_mapping(mapping)
    points = ["E1", "E2", "rear_axle", "front_axle"]
    return mechanism, build_table(LinkageModel(mechanism), 1e-4, points)


def wheel_heights(speed: float, step: float, count: int, seed: int) -> np.ndarray:
    """Return heights and their rates under the wheels, (2, axles, left and right, count).

    The ground is a sum of plane waves over an isotropic surface: those with the wavenumber n along
    the way have wavenumbers n s / sqrt(1 - s^2) across it, with s uniform, if the density of the
    surface falls with the third power of the wavenumber.
    """
    random, n_waves = np.random.default_rng(seed), 12
    f = np.fft.rfftfreq(count, step)
    psd = np.zeros(len(f))
    band = (f >= 0.3) & (f <= 20.0)
    psd[band] = 256e-6 * (f[band] / speed / 0.1) ** -2.0 / speed
    s = random.uniform(-1.0, 1.0, (n_waves, len(f)))
    across = f / speed * s / np.sqrt(1.0 - s * s)
    waves = random.standard_normal((2, n_waves, len(f)))
    size = np.sqrt(psd * f[1] / n_waves) / 2.0
    heights = []
    for x, _, _, *_ in AXLES:
        for y in (0.8, -0.8):
            own = (waves[0] + 1j * waves[1]) * np.exp(2j * math.pi * across * y)
            lines = (size * own).sum(axis=0) * np.exp(2j * math.pi * f * x / speed)
            heights.append([lines, 2j * math.pi * f * lines])
    return np.moveaxis(
        np.fft.irfft(np.array(heights).reshape(2, 2, 2, -1), count, norm="forward"), 2, 0
    )


def simulated(
    rows: np.ndarray, a: Assembly, speed: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return responses, (n_rows, count), and by how much the ground pushes each wheel, (4, count).

    Rows, (n_rows, 2, size), are of displacements and velocities. All of the damping couples the
    modes. Each pole is integrated exactly for forces that change linearly between two times.
    """
    step, seconds, lead = 4e-3, 1600.0, 60.0
    count = round(seconds / step)
    hertz, shapes = modes(a)
    n, damping = len(hertz), shapes.T @ a.matrices[2] @ shapes
    system = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.diag((2.0 * math.pi * hertz) ** 2), -damping]]
    )
    heights, rates = wheel_heights(speed, step, count, seed)
    forces = np.array(
        [
            (axle[5] * heights[i, k] + DAMPING[i][2] * rates[i, k]) / 2.0
            for i, axle in enumerate(AXLES)
            for k in (0, 1)
        ]
    )
    wheels = [f"wheel{i}{sign}" for i in (0, 1) for sign in (1.0, -1.0)]
    rolled = shapes.T @ a.matrix(wheels)[2::3].T
    poles, left, right = eig(system, left=True)
    scale = 1.0 / np.einsum("ij,ij->j", left.conj(), right)
    into = scale[:, np.newaxis] * left.conj().T[:, n:]
    outputs = (np.concatenate([rows[:, 0] @ shapes, rows[:, 1] @ shapes], axis=1)) @ right
    responses = np.zeros((len(rows), count + round(lead / step)))
    for pole, weights, output in zip(poles, into @ rolled, outputs.T, strict=True):
        if pole.imag < 0.0:
            continue
        grown = np.exp(pole * step)
        old = (grown - (grown - 1.0) / (pole * step)) / pole
        new = ((grown - 1.0) / (pole * step) - 1.0) / pole
        drive = weights @ forces
        wrapped = np.concatenate([drive[-round(lead / step) :], drive])
        state = lfilter([new, old], [1.0, -grown], wrapped)
        weight = 2.0 if pole.imag > 0.0 else 1.0
        responses += weight * np.multiply.outer(output, state).real
    return responses[:, round(lead / step) :], forces


@pytest.mark.nightly(short="test_orders_across_the_plane")
@pytest.mark.parametrize("speed", [2.5, 20.0 / 3.6])
def test_levels_by_two_tracks(built: tuple[Mechanism, Table], speed: float) -> None:
    """Both directions of E1, a chain and the tyre that is off the ground most have these levels.

    They are within two standard errors by 40 parts of 40 s a seed, and 0.4 %, as the vertical half
    neglects that pairs bend sideways.
    """
    mechanism, table = built
    places, (a, _) = pose(ALPHA3), assembled(ALPHA3, tractor=True)
    rows = np.zeros((5, 2, a.size))
    rows[0, 1], rows[1, 1] = a.matrix(["E1L"])[[1, 2]]
    first = np.insert(places["P1"], 1, 0.2)
    hook = first + CHAIN_AT / 0.810 * (np.insert(places["E1"], 1, 0.4) - first)
    unit = (CHAIN_END - hook) / np.linalg.norm(CHAIN_END - hook)
    ends = a.matrix(["hookL", "endL"])
    rows[2, 0] = CHAIN * unit @ (ends[3:] - ends[:3])
    for i, axle in enumerate(AXLES):
        wheel = a.matrix([f"wheel{i}1.0"])[2] / 2.0
        rows[3 + i] = -axle[5] * wheel, -DAMPING[i][2] * wheel
    parts = []
    for seed in range(3):
        responses, pushed = simulated(rows, a, speed, seed)
        # The axle that pivots loads both of its wheels alike.
        responses[3:] += pushed[0], (pushed[2] + pushed[3]) / 2.0
        parts.append((responses**2).reshape(5, 40, -1).mean(axis=2))
    squares = np.concatenate(parts, axis=1)
    rms = np.sqrt(squares.mean(axis=1))
    errors = squares.std(axis=1, ddof=1) / math.sqrt(squares.shape[1]) / (2.0 * rms)
    assert (errors < 0.03 * rms).all()
    at = np.array([ALPHA3]), np.array([speed])
    lookup = GroundTable(table, mechanism, TERRAIN, [CHAIN_FORCE], point=("E1", "y"))
    levels = lookup.at(*at)
    upright = GroundTable(table, mechanism, TERRAIN, point=("E1", "z")).at(*at).velocity[0]
    found = [levels.velocity[0], upright, math.sqrt(levels.forces2[0, 0])]
    loads = LinkageModel(mechanism).mount_loads(ALPHA3) / 2.0
    lifted = int((loads / rms[3:]).argmin())
    found.append(-loads[lifted] / float(ndtri(levels.off_ground_share[0])))
    kept = [0, 1, 2, 3 + lifted]
    off, allowed = np.abs(np.array(found) - rms[kept]), 2.0 * errors[kept] + 0.004 * rms[kept]
    assert (off < allowed).all()
    moving, found[3] = [("E1", "y"), ("E1", "z"), CHAIN_FORCE, TYRES[lifted]], 2.0 * found[3]
    for source in (table, LinkageModel(mechanism)):
        for place, level in zip(moving, found, strict=True):
            f, density = ground_spectrum(source, mechanism, TERRAIN, place, ALPHA3, speed)
            total = trapezoid(density * f, np.log(f))
            assert math.sqrt(total) == pytest.approx(level, rel=3e-3)


def test_a_point_in_the_middle(built: tuple[Mechanism, Table]) -> None:
    """The mast is in the middle, so that its height has the level of the vertical half."""
    mechanism, table = built
    at, place = (np.array([ALPHA3]), np.array([3.0])), ("E2", "z")
    found = GroundTable(table, mechanism, TERRAIN, point=place).at(*at).velocity[0]
    half = replace(mechanism, lateral=None)
    f, density = ground_spectrum(LinkageModel(half), half, TERRAIN, place, ALPHA3, 3.0)
    assert found == pytest.approx(math.sqrt(trapezoid(density * f, np.log(f))), rel=3e-3)


def levels_of(built: tuple[Mechanism, Table], pretension: float | None) -> tuple[Any, Any]:
    """Return levels by the ground of a chain of a pretension, N, and their excitations."""
    mechanism, table = built
    assert mechanism.lateral is not None
    chains = tuple(replace(each, pretension=pretension) for each in mechanism.lateral.chains)
    mechanism = replace(mechanism, lateral=replace(mechanism.lateral, chains=chains))
    excitations = [Excitation("a farm track", Source.GROUND, 1.0, None, terrain=TERRAIN)]
    return LevelTable(Predictor(table), mechanism, excitations), excitations


@pytest.mark.nightly(short="test_orders_across_the_plane")
def test_a_chain_that_goes_slack_is_named(built: tuple[Mechanism, Table]) -> None:
    """At 10 km/h, it is one whose pretension is below what spectra demand at one of nine angles.

    One slack chain lowers the sway as chains of half the stiffness do in the finite elements.
    """
    mechanism, table = built
    needed = []
    for alpha3 in np.linspace(*table.alpha3_range, 9):
        spectrum = ground_spectrum(table, mechanism, TERRAIN, CHAIN_FORCE, alpha3, 10.0 / 3.6)
        needed.append(3.0 * math.sqrt(trapezoid(spectrum[1] * spectrum[0], np.log(spectrum[0]))))
    for share, named in ((0.98, True), (1.02, False)):
        levels, excitations = levels_of(built, share * max(needed))
        text = " ".join(excitation_doubts(excitations, levels))
        assert ("check_chain goes slack" in text) == named
        assert ("the implement sway is at about" in text) == named
    unknown = " ".join(excitation_doubts(*reversed(levels_of(built, None))))
    assert "check_chain has no `pretension`, so it is not known" in unknown
    side = [Excitation("side", Source.PTO, 1.0, Load(FORCE, "E1.y", 300.0, 1.0, 0.0, 0.0))]
    without_ground = " ".join(
        excitation_doubts(side, LevelTable(Predictor(table), mechanism, side))
    )
    assert "Whether check_chain goes slack is not known" in without_ground
    assert "goes slack is not known" not in text
    chain = levels.chains[0]
    tight, slack = slack_mode(mechanism, chain, ALPHA3)
    exact = hitch(ALPHA3, tractor=True)[0][4], hitch(ALPHA3, tractor=True, chain=CHAIN / 2.0)[0][4]
    assert (tight, slack) == pytest.approx(exact, rel=1e-3)
    assert 0.12 < 1.0 - slack / tight < 0.21  # of a prototype


@pytest.mark.parametrize(("share", "lifted"), [(0.195, False), (0.205, True)])
def test_an_order_and_both_tracks_lift_a_tyre(
    built: tuple[Mechanism, Table], share: float, lifted: bool
) -> None:
    """Squares of the force on the soil by an order, by heave and pitch, and by roll add up.

    A rear axle with a load of 8 kN is lifted before the front one, which pivots.
    """
    (mechanism, table), load = built, 8e3
    given = {"reference_force": (("base:rear_axle", load),)}
    parts = tuple(replace(half, **given) for half in table.parts)
    table = replace(table, parts=parts, **given)
    speed, model = 10.0 / 3.6, LinkageModel(mechanism)
    f, density = ground_spectrum(model, mechanism, TERRAIN, TYRES[0], ALPHA3, speed)
    squares = float(trapezoid(density * f, np.log(f)))
    mount = vertical_mounts(mechanism)[0]
    line = np.array([speed / (2.0 * math.pi * 0.8)])
    law = mount.stiffness[1] + 2j * math.pi * line * mount.damping[1]
    moved = model.solve(ALPHA3).frf([("rear_axle", "z")], [("rear_axle", "z")]).frf(line)[:, 0, 0]
    per_runout = float(abs(law * (1.0 - law * moved))[0]) / math.sqrt(2.0)
    runout = math.sqrt((load / ndtri(share)) ** 2 - squares) / per_runout
    wheel = Load(BASE_DISPLACEMENT, "base:rear_axle.z", runout, speed, 0.0, 0.0)
    excitations = [
        Excitation("tyre", Source.GROUND, line[0] / speed, wheel),
        Excitation("a farm track", Source.GROUND, 1.0, None, terrain=TERRAIN),
    ]
    speeds = np.full((len(Source), 1), math.nan)
    speeds[Source.GROUND.index] = speed
    levels = LevelTable(Predictor(table), mechanism, excitations).at(np.array([ALPHA3]), speeds)
    assert levels.off_ground_share[0] == pytest.approx(share, abs=2e-3)
    assert np.isnan(levels.velocities[0]).tolist() == [False, lifted]


def test_load_ratios_add_both_halves(built: tuple[Mechanism, Table]) -> None:
    """Those of a chain refer to its pretension, and those of pins add all components."""
    mechanism, table = built
    speed, angle = 10.0 / 3.6, np.array([ALPHA3])
    speeds = np.full((len(Source), 1), math.nan)
    speeds[Source.GROUND.index] = speed

    def square(place: tuple[str, str], halves: Any = mechanism) -> float:
        f, density = ground_spectrum(table, halves, TERRAIN, place, ALPHA3, speed)
        return float(trapezoid(density * f, np.log(f)))

    low = levels_of(built, 1e3)[0].at(angle, speeds)
    assert low.total_load_ratio[0] == pytest.approx(math.sqrt(square(CHAIN_FORCE)) / 1e3, rel=3e-3)
    levels = levels_of(built, 1e6)[0]
    assert levels.force_places[-1] == "check_chain"
    assert levels.force_places[low.total_load_places[0]] == "check_chain"
    high = levels.at(angle, speeds)
    place = levels.force_places[high.total_load_places[0]]
    components = "force_x", "force_y", "force_z"
    known = {*table.forces, *(table.lateral.forces if table.lateral else ())}
    both = sum(square((place, each)) for each in components if (place, each) in known)
    static = table.reference_forces(angle)[table.force_places.index(place), 0]
    assert high.total_load_ratio[0] == pytest.approx(math.sqrt(both) / static, rel=3e-3)
    alone = replace(mechanism, lateral=None)
    vertical = sum(
        square((place, each), alone) for each in components if (place, each) in table.forces
    )
    assert both > 1.02 * vertical


@pytest.mark.parametrize(("hertz", "force"), [(1.1, 3e4), (9.0, 3e6)])
def test_orders_across_the_plane(
    built: tuple[Mechanism, Table], hertz: float, force: float
) -> None:
    """A force along y has the levels of the finite elements, and those along z add squares.

    E1 is the left point of the response, chains refer to their pretension, and the rolling base
    lifts its tyres.
    """
    mechanism, table = built
    assert mechanism.lateral is not None
    chains = tuple(replace(each, pretension=10.0) for each in mechanism.lateral.chains)
    mechanism = replace(mechanism, lateral=replace(mechanism.lateral, chains=chains))
    w, (a, _) = 2.0 * math.pi * hertz, assembled(ALPHA3, tractor=True)
    stiffness, mass, damping = a.matrices
    ends = a.matrix(["E1L", "E1R"])
    sides = np.stack([force * (ends[i] + ends[i + 3]) / 2.0 for i in (1, 2)], axis=1)
    moved = np.linalg.solve(stiffness - w * w * mass + 1j * w * damping, sides) / math.sqrt(2.0)
    places = pose(ALPHA3)
    hook = np.insert(places["P1"], 1, 0.2)
    hook = hook + CHAIN_AT / 0.810 * (np.insert(places["E1"], 1, 0.4) - hook)
    unit = (CHAIN_END - hook) / np.linalg.norm(CHAIN_END - hook)
    hooked = a.matrix(["hookL", "endL"])
    pulled = np.abs(CHAIN * unit @ (hooked[3:] - hooked[:3]) @ moved)
    velocity = w * np.abs(ends[2] @ moved)
    laws = np.array([[abs(AXLES[i][5] + 1j * w * DAMPING[i][2])] for i in (0, 1)])
    pushed = laws * np.abs(a.matrix(["wheel01.0", "wheel11.0"])[[2, 5]] @ moved)  # of both wheels
    loads = LinkageModel(mechanism).mount_loads(ALPHA3)
    speeds = np.full((len(Source), 1), hertz)
    across, upright = (
        Excitation(f"shaft {at}", Source.PTO, 1.0, Load(FORCE, at, force, hertz, 0.0, 0.0))
        for at in ("E1.y", "E1.z")
    )
    for excitations, size in (([across], [1, 0]), ([upright, across], [1, 1])):
        levels = LevelTable(Predictor(table), mechanism, excitations)
        found = levels.at(np.array([ALPHA3]), speeds)
        assert found.velocities[0, -1] == pytest.approx(velocity[0], rel=2e-3)
        total = math.hypot(*(velocity * size))
        assert found.total_velocity[0] == pytest.approx(total, rel=5e-3)
        assert levels.force_places[found.load_places[0, -1]] == "check_chain"
        assert found.load_ratios[0, -1] == pytest.approx(pulled[0] / 10.0, rel=2e-3)
        lifted = (np.hypot(*(pushed * size).T) / loads).max()
        share = float(found.off_ground_share[0])
        assert -1.0 / float(ndtri(share)) == pytest.approx(lifted, rel=5e-3)
        np.testing.assert_array_equal(
            levels.excites,
            [[half != (e is across) for half in ~table.lateral_modes] for e in excitations],
        )


def test_factors_of_an_order_across_the_plane(mapping: Any) -> None:
    """They are those of models in which one number is larger or smaller by its deviation."""
    paths = "lateral.chains.check_chain.stiffness", "lateral.axles.rear_axle.stiffness"
    hertz, place, squares = np.array([1.3, 3.2, 9.0]), [("E1", "z")], np.zeros(3)
    for path in paths:
        logs = []
        for factor in (math.exp(0.2), math.exp(-0.2)):
            changed = with_numbers(mapping, [(path, number_at(mapping, path) * factor)])
            model = LinkageModel(mechanism_from_mapping(changed), half="lateral")
            frf = model.solve(ALPHA3).frf(place, [("E1", "y")]).frf(hertz)
            logs.append(np.log(np.abs(frf[:, 0, 0])))
        squares += ((logs[0] - logs[1]) / 2.0) ** 2
    short = mapping["input"] | {"range_deg": [122.0, 130.0]}
    claims = {"relative": dict.fromkeys(paths, 0.2)}
    mechanism = mechanism_from_mapping(mapping | {"input": short, "uncertainty": claims})
    table = build_table(LinkageModel(mechanism), 1e-4, ["E1"])
    side = Excitation("side", Source.PTO, 1.0, Load(FORCE, "E1.y", 300.0, 1.0, 0.0, 0.0))
    levels, angles = LevelTable(Predictor(table), mechanism, [side]), np.full(3, ALPHA3)
    factors = levels.factor_rows(angles, np.tile(hertz, (len(Source), 1)), 1.0)[:, 0]
    np.testing.assert_allclose(np.log(factors), np.sqrt(squares), rtol=0.05)
