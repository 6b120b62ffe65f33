# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lateral half against closed forms, own finite elements in space, and the paper's model."""

import copy
import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.ground_motion import transmissibility
from linkage_vibration.mechanics.mode_names import kinetic_energy, name_modes
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from test.support import hitch_in_space
from test.support.hitch_in_space import hitch

IN_SPACE = config_file("three_point_linkage_on_tractor.yaml")
CLAMPED = config_file("three_point_linkage.yaml")


@pytest.fixture
def tractor() -> Any:
    """Return the shipped hitch with its lateral half, exact, as a mapping."""
    mapping = yaml.safe_load(IN_SPACE.read_text())
    del mapping["uncertainty"]
    mapping["lateral"]["weight"] = "ignored"  # test_lateral_weight.py has it
    return mapping


@pytest.fixture
def clamped(tractor: Any) -> Any:
    """Return the same hitch on a ground that does not move, with a clamped crank."""
    lateral = tractor["lateral"]
    del lateral["axles"], lateral["inertia"]["base"]
    return yaml.safe_load(CLAMPED.read_text()) | {"lateral": lateral}


def lateral(mapping: Any, *, reduced: bool = True) -> LinkageModel:
    """Return the lateral half that a mapping describes."""
    return LinkageModel(mechanism_from_mapping(mapping), half="lateral", reduced=reduced)


def hertz(model: LinkageModel, alpha3: float) -> Any:
    """Return all undamped natural frequencies, Hz."""
    return model.solve(alpha3).modes.omega / (2.0 * math.pi)


@pytest.mark.parametrize("alpha3_deg", [90.0, 135.0, 180.0])
@pytest.mark.parametrize("on", ["clamped", "tractor"])
def test_both_halves_by_finite_elements_in_space(
    on: str, alpha3_deg: float, request: pytest.FixtureRequest
) -> None:
    """With both sides explicit, lateral modes agree to 1e-5 below 10 Hz and to 5e-5 to 190 Hz.

    The vertical half neglects that pairs move sideways as they bend: 0.4 % of the heave.
    """
    mapping, alpha3 = request.getfixturevalue(on), math.radians(alpha3_deg)
    exact, vertical = hitch(alpha3, tractor=on == "tractor")
    found, low, high = hertz(lateral(mapping), alpha3), exact < 10.0, exact < 190.0
    assert low.sum() == (2 if on == "clamped" else 5)
    assert high.sum() > low.sum() + 2
    np.testing.assert_allclose(found[: low.sum()], exact[low], rtol=1e-5)
    np.testing.assert_allclose(found[: high.sum()], exact[high], rtol=5e-5)
    if on == "clamped":  # On the tractor, the oil differs.
        heave = hertz(LinkageModel(mechanism_from_mapping(mapping)), alpha3)[0]
        assert 0.0 < heave / vertical[0] - 1.0 < 0.004
        assert heave < 0.975 * hertz(LinkageModel(read_mechanism(CLAMPED)), alpha3)[0]


@pytest.mark.parametrize("aside", [0.25, 0.32])
def test_a_rockshaft_that_twists(
    tractor: Any, aside: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between both cranks it has 4 kt for the left one, as the finite elements have it.

    The cranks may be parallel to the plane or not.
    """
    monkeypatch.setitem(hitch_in_space.ASIDE, "V2", aside)
    tractor["lateral"]["y"]["V2"] = aside
    tractor["lateral"]["rockshaft"] = 2e4
    exact = hitch(2.2, tractor=True, rockshaft=2e4)[0]
    np.testing.assert_allclose(hertz(lateral(tractor), 2.2)[:5], exact[:5], rtol=1e-6)
    assert exact[1] < 0.9 * hitch(2.2, tractor=True)[0][1]


@pytest.mark.parametrize(
    ("deg", "names"),
    [
        (90, {"implement roll": 2.56, "implement sway": 5.25, "implement yaw": 117.7}),
        (135, {"implement roll": 2.30, "implement sway": 5.05, "implement yaw": 118.0}),
        (180, {"implement roll": 2.17, "implement sway": 5.57, "implement yaw": 117.0}),
    ],
)
def test_names(tractor: Any, deg: float, names: dict[str, float]) -> None:
    """The tractor sways, yaws and rolls below 5 Hz, and the implement between them and above.

    The frequencies are those of finite elements of both sides in space.
    """
    solution = lateral(tractor).solve(math.radians(deg))
    frequencies = (solution.modes.omega / (2.0 * math.pi))[:6].tolist()
    found = dict(zip(name_modes(kinetic_energy(solution)), frequencies, strict=False))
    assert [name for name in found if name.startswith("tractor")] == [
        "tractor sway",
        "tractor yaw",
        "tractor roll",
    ]
    assert {name: found[name] for name in names} == pytest.approx(names, abs=0.05, rel=2e-3)


@pytest.mark.parametrize("deg", [90.0, 180.0])
def test_axis_of_roll(tractor: Any, deg: float) -> None:
    """It is that of the body, whose mast is its x axis: 5.2 deg beyond upright in mid-stroke.

    A quarter of a turn swaps roll and yaw, but not what modes are called.
    """
    names = list[tuple[str, ...]]()

    def modes(inertias: dict[str, float]) -> Any:
        tractor["lateral"]["inertia"]["implement"] = inertias
        solution = lateral(tractor).solve(math.radians(deg))
        names.append(name_modes(kinetic_energy(solution))[:6])
        return solution.natural_frequencies[:8]

    given = modes({"roll": 550.0, "yaw": 650.0})
    places = hitch_in_space.pose(math.radians(135.0))
    x, z = places["E2"] - places["E1"]
    axis = -math.degrees(math.atan2(z, x))
    assert modes({"roll": 550.0, "yaw": 650.0, "axis": axis}) == pytest.approx(given, rel=1e-9)
    swapped = modes({"roll": 650.0, "yaw": 550.0, "axis": axis + 90.0})
    assert swapped == pytest.approx(given, rel=1e-9)
    assert names[0] == names[1] == names[2]
    off = modes({"roll": 550.0, "yaw": 650.0, "axis": axis + 45.0})
    assert np.abs(off / given - 1.0).max() > 0.01


@pytest.mark.parametrize("deg", [90.0, 135.0, 180.0])
def test_names_follow_the_motion_and_not_the_axes(tractor: Any, deg: float) -> None:
    """With equal inertias, the axes that a body has by its description mean nothing.

    Mode 3 turns by at most 15 deg beside what points forward, and mode 6 by at most 15 deg beside
    what points up (by an outsider's model, as the directions of the energy are).
    """
    energies = []
    for axis in (-80.0, -50.0, -40.0, 0.0):
        tractor["rigid_bodies"]["implement"]["inertia"] = 600.0
        inertias = {"roll": 900.0, "yaw": 900.0, "axis": axis}
        tractor["lateral"]["inertia"]["implement"] = inertias
        energy = kinetic_energy(lateral(tractor).solve(math.radians(deg)), slice(6))
        names = name_modes(energy)
        assert (names[2], names[5]) == ("implement roll", "implement yaw")
        energies.append(energy.shares)
    np.testing.assert_allclose(energies, energies[:1] * 4, atol=1e-6)
    row = energy.motions.index(("implement", "roll"))
    whole = energies[0][[i for i, each in enumerate(energy.motions) if each[0] == "implement"], 2]
    assert energies[0][row, 2] > 0.9 * whole[1:].sum()


def plate(mapping: Any, contact: float) -> LinkageModel:
    """Return a uniform plate of 2.5 m by 1.6 m on four corners, with a hitch without weight."""
    for link in mapping["links"].values():
        link["material"] = {**link["material"], "density": 1e-6}
    mapping["rigid_bodies"]["implement"] |= {"mass": 1e-6, "inertia": 2e-7}
    mapping["lateral"]["inertia"]["implement"] = {"roll": 5e-7, "yaw": 6e-7}
    mapping["lateral"]["inertia"]["base"] = {"roll": 960.0, "yaw": 4500.0 * (1.25**2 + 0.64) / 3.0}
    mounts = {}
    for i, name in enumerate(("rear_axle", "front_axle")):
        spring = {"stiffness": [0.6e6, 0.6e6], "damping": [600.0, 600.0]}
        mounts[name] = {"at": [0.35 + 2.5 * i, 0.1], **spring}
        across = {"track": 1.6, "stiffness": 0.6e6, "damping": 600.0, "contact": contact}
        mapping["lateral"]["axles"][name] = across
    mapping["base"] |= {"inertia": 4500.0 * 1.25**2 / 3.0, "mounts": mounts}
    return lateral(mapping)


def on_mounts(model: LinkageModel) -> tuple[Any, Any]:
    """Return natural frequencies, rad/s, and damping ratios of the modes on the mounts."""
    solution = model.solve(2.0)
    own = kinetic_energy(solution).mounts > 0.5
    shapes, omega = solution.vectors[:, own], solution.modes.omega[own]
    return omega, (shapes * (solution.coupled.damping @ shapes)).sum(axis=0) / (2.0 * omega)


def test_uniform_plate_on_corner_springs(tractor: Any) -> None:
    """Roll and pitch are sqrt(3) times bounce, and yaw is sqrt(3) times sway.

    All dampers have 1 ms times the stiffness, so the damping ratio is half of 1 ms times omega.
    """
    model = plate(tractor, 0.1)
    sway = math.sqrt(1.2e6 / 4500.0)
    expected = [sway, math.sqrt(3.0) * sway, math.sqrt(3.0) * sway]
    found, damping = on_mounts(model)
    assert found == pytest.approx(expected, rel=2e-6)
    assert damping == pytest.approx(0.5e-3 * found, rel=1e-5)
    vertical = on_mounts(LinkageModel(mechanism_from_mapping(tractor)))[0]
    assert vertical == pytest.approx(expected[:1] + expected[:2], rel=2e-6)  # surge is bounce here


def test_uniform_plate_held_below(tractor: Any) -> None:
    """With the soil 1 m below, sway and roll are those of a problem of two equations."""
    found = on_mounts(plate(tractor, -0.9))[0]
    assert found[[0, -1]] == pytest.approx([9.8015, 47.123], rel=2e-5)
    k, inertia = 1.2e6, 960.0
    trace, product = k / 4500.0 + 1.64 * k / inertia, 0.64 * k * k / (4500.0 * inertia)
    root = math.sqrt(trace**2 - 4.0 * product)
    exact = [math.sqrt((trace - root) / 2.0), math.sqrt((trace + root) / 2.0)]
    assert found[[0, -1]] == pytest.approx(exact, rel=2e-6)


def test_pendulum(clamped: Any) -> None:
    """Without chains nothing holds parallel links: one mode at 0 Hz; chains hold it."""
    clamped["lateral"]["y"] |= {"P1": 0.4, "P3": 0.4, "V2": 0.4}
    assert not lateral(clamped).solve(2.0).modes.mechanism.any()
    del clamped["lateral"]["chains"]
    modes = lateral(clamped).solve(2.0).modes
    assert modes.mechanism.sum() == 1
    assert modes.omega[1] > 2.0 * math.pi * 1.0


@pytest.fixture(scope="module")
def paper() -> Mechanism:
    """Return the paper's linkage in space, with its implement held."""
    response = {"drive_point": "V1", "direction": "y", "modes": 3}
    both = {"held": ["implement"], "response": response, "weight": "ignored"}
    return mechanism_from_mapping(yaml.safe_load(CLAMPED.read_text()) | {"lateral": both})


def test_the_papers_table_2(paper: Mechanism) -> None:
    """Physical DoFs 9, 6, 6, 6, 3 from both halves, and the rotation of the crank."""
    dofs: dict[str, set[str]] = {}
    for model in (LinkageModel(paper), LinkageModel(paper, half="lateral")):
        for component in model.components:
            dofs.setdefault(component.name, set()).update(map(str, component.dofs))
    names = ["lower_link", "upper_link", "input_crank", "lift_rod", "implement"]
    assert [len(dofs[name]) for name in names] == [9, 6, 7, 6, 3]


def test_the_papers_rows(paper: Mechanism) -> None:
    """A pin of two pairs has the rows of eq. 22, of which the third joins u_y alone."""
    model = LinkageModel(paper, half="lateral")
    configuration = model.kinematics.at(2.0)
    joining = model.interface.join(configuration)
    first, second = configuration.angle("lower_link"), configuration.angle("lift_rod")
    rows = [i for i, label in enumerate(joining.labels) if label.startswith("pin V1")]
    c, s, d, t = math.cos(first), math.sin(first), math.cos(second), math.sin(second)
    expected = [[c, -s, 0, -d, t, 0], [0, 0, 1, 0, 0, -1], [s, c, 0, -t, -d, 0]]
    at = [
        [f"{part.name} {dof}" for part in model.components for dof in part.dofs].index(name)
        for body in ("lower_link", "lift_rod")
        for name in (f"{body} V1 x", f"{body} V1 z", f"{body} V1 y")
    ]
    np.testing.assert_allclose(joining.compatibility[np.ix_(rows, at)], expected, atol=1e-14)
    assert np.count_nonzero(joining.compatibility[rows]) == 10


def test_the_papers_modes_out_of_the_plane(paper: Mechanism) -> None:
    """They are 141.712, 183.715 and 357.261 Hz at every angle, as its own model in space gave.

    That model kept 20 modes of a link in each direction.
    """
    links = tuple(link.meshed(24, 40) for link in paper.links)
    model = LinkageModel(replace(paper, links=links), half="lateral")
    for alpha3 in (1.6, 2.2, 3.1):
        frequencies = hertz(model, alpha3)
        for expected in (141.712, 183.715, 357.261):
            assert np.abs(frequencies / expected - 1.0).min() < 1.5e-6
        exact = hitch(alpha3, tractor=False, paper=True)[0]
        np.testing.assert_allclose(frequencies[: len(exact)], exact, rtol=5e-6)


def test_in_the_middle_the_vertical_half_is_todays(paper: Mechanism) -> None:
    """With y = 0 everywhere it has the same matrices and modes to the last bit."""
    plain = LinkageModel(read_mechanism(CLAMPED)).solve(2.0)
    both = LinkageModel(paper).solve(2.0)
    assert np.array_equal(plain.modes.omega, both.modes.omega)
    assert np.array_equal(plain.modes.shapes, both.modes.shapes)
    assert plain.model.mechanism.model_hash != both.model.mechanism.model_hash


@pytest.mark.parametrize("on", ["clamped", "tractor"])
def test_reduced_stacked_and_by_frfs(on: str, request: pytest.FixtureRequest) -> None:
    """Reduction, a stack of angles, and LM-FBS give the same lateral half.

    Half of a link's modes in each direction leave 2e-5 above 130 Hz, as the manual says.
    """
    mapping = request.getfixturevalue(on)
    model, full = lateral(mapping), lateral(mapping, reduced=False)
    found, exact = hertz(model, 2.0), hertz(full, 2.0)
    for highest, rtol in (130.0, 1e-6), (190.0, 2e-5):
        n = int((exact < highest).sum())
        np.testing.assert_allclose(found[:n], exact[:n], rtol=rtol)
    angles = np.linspace(*model.mechanism.stroke, 3)
    stack = model.stack(angles)
    for row, alpha3 in zip(stack.modes.omega, angles, strict=True):
        np.testing.assert_allclose(row[:9], model.solve(alpha3).modes.omega[:9], rtol=1e-9)
    places, lines = ["E1.y", "E1.z", "V1.x", "V1.y"], np.array([0.7, 2.0, 30.0])
    modal = model.solve(2.0).frf(places, places).frf(lines)
    coupled = model.coupled_frf(2.0, lines, places, places).values
    np.testing.assert_allclose(coupled, modal, rtol=1e-6, atol=1e-7 * np.abs(modal).max())


def test_a_chain_is_a_spring_on_both_sides(clamped: Any) -> None:
    """Two springs in space from V1 to the ground, described as one, are chains at V1."""
    clamped["lateral"]["chains"]["check_chain"] |= {"at": 0.366, "damping": 40.0}
    chained = lateral(clamped).solve(2.0)
    del clamped["lateral"]["chains"]
    clamped["ground"]["Q"] = [0.0, 0.0]
    clamped["lateral"]["y"]["Q"] = 0.45
    stay = {"between": ["Q", "V1"], "stiffness": 10e6, "damping": 80.0}
    clamped["springs"] = {"stay": stay}
    sprung = lateral(clamped).solve(2.0)
    np.testing.assert_allclose(sprung.modes.omega, chained.modes.omega, rtol=1e-9)
    np.testing.assert_allclose(sprung.damping_ratios[:3], chained.damping_ratios[:3], rtol=1e-6)


def test_forces_at_beams_of_true_length(tractor: Any) -> None:
    """What the pins of the vertical half exert on the implement moves its mass."""
    tractor["damping"]["ratio"] = 1e-9  # of the mass of the implement, by Rayleigh's rule
    solution = LinkageModel(mechanism_from_mapping(tractor)).solve(2.3)
    places = [f"{at}.{axis}" for at in ("E1", "E2") for axis in "xz"]
    places += [f"{pin}.force_{axis}" for pin in ("lower_link:E1", "upper_link:E2") for axis in "xz"]
    x1, z1, x2, z2, *forces = solution.frf(places, ["V1.z"]).frf(np.array([1.3]))[0, :, 0]
    implement, at = solution.model.mechanism.rigid_bodies[0], solution.configuration
    mast = at.place("implement", (0.438, 0.0)) - at.place("implement", (0.0, 0.0))
    arm = at.place("implement", implement.centre_of_gravity) - at.place("implement", (0.0, 0.0))
    turn = (mast[0] * (z2 - z1) - mast[1] * (x2 - x1)) / (mast @ mast)
    needed = (
        -800.0 * (2.0 * math.pi * 1.3) ** 2 * np.array([x1 - turn * arm[1], z1 + turn * arm[0]])
    )
    exerted = -np.array([2.0 * forces[0] + forces[2], 2.0 * forces[1] + forces[3]])
    np.testing.assert_allclose(exerted, needed, rtol=1e-6, atol=1e-6 * np.abs(needed).max())


def test_forces_move_the_implement(tractor: Any) -> None:
    """What the pins exert sways, rolls and yaws its mass: Newton's and Euler's equations."""
    tractor["damping"]["ratio"] = 1e-9  # of the mass of the implement, by Rayleigh's rule
    solution = lateral(tractor).solve(2.3)
    pins = [f"lower_link:E1.force_{axis}" for axis in "xyz"]
    moved = [f"{at}.{axis}" for at in ("E1", "E2") for axis in "xyz"]
    outputs = [*moved, *pins, "upper_link:E2.force_y"]
    values = solution.frf(outputs, ["V1.y"]).frf(np.array([1.3]))[0, :, 0]
    (x1, y1, _, _, y2, _), (fx, fy, fz, upper) = values[:6], values[6:]
    at, implement = solution.configuration, solution.model.mechanism.rigid_bodies[0]
    centre = at.place("implement", implement.centre_of_gravity)
    lower, top = (at.place("implement", place) - centre for place in ((0.0, 0.0), (0.438, 0.0)))
    yaw, roll = -x1 / 0.4, values[2] / 0.4
    assert y1 - y2 == pytest.approx((lower - top) @ [yaw, -roll], rel=1e-9)
    sway, square = y1 - lower @ [yaw, -roll], -((2.0 * math.pi * 1.3) ** 2)
    across = -(2.0 * fy + upper)  # of both pins of the lower links, on the implement
    rolled = 2.0 * fy * lower[1] + upper * top[1] - 2.0 * fz * 0.4
    yawed = -(2.0 * fy * lower[0] + upper * top[0]) + 2.0 * fx * 0.4
    assert across == pytest.approx(800.0 * square * sway, rel=1e-6)
    needed = square * hitch_in_space.implement_tensor(2.3)[::2, ::2] @ [roll, yaw]
    assert [rolled, yawed] == pytest.approx(needed.tolist(), rel=1e-6)


def test_forces_of_chains_and_tyres_across(tractor: Any) -> None:
    """A chain pulls by its stiffness, and both tyres of an axle push by theirs."""
    # A place of the base where the soil holds the wheels, and one where the chain ends.
    tractor["ground"] |= {"S": [0.6, -0.85], "Q": [0.0, 0.0]}
    tractor["lateral"]["y"]["Q"] = 0.45
    for end in "SQ":
        tractor["springs"][f"at_{end}"] = {"between": [end, "V1"], "stiffness": 1e-9}
    tractor["lateral"]["chains"]["check_chain"] |= {"at": 0.366, "damping": 40.0}
    solution = lateral(tractor).solve(2.0)
    line = np.array([1.1])
    force = solution.frf(["base:rear_axle.force_y"], ["E1.y"]).frf(line)[0, 0, 0]
    moved = solution.frf(["S.y"], ["E1.y"]).frf(line)[0, 0, 0]
    assert force == pytest.approx((400e3 + 2j * math.pi * 1.1 * 2600.0) * moved, rel=1e-9)
    hook = solution.configuration.place("lower_link", (0.366, 0.0))
    away = np.array([-hook[0], 0.45 - 0.2 - 0.2 * 0.366 / 0.810, -hook[1]])
    places = [f"{point}.{axis}" for point in ("Q", "V1") for axis in "xyz"]
    both = solution.frf(places, ["E1.y"]).frf(line)[0, :, 0].reshape(2, 3)
    stretched = away @ (both[0] - both[1]) / np.linalg.norm(away)
    pulled = solution.frf(["check_chain.force"], ["E1.y"]).frf(line)[0, 0, 0]
    assert pulled == pytest.approx((5e6 + 2j * math.pi * 1.1 * 40.0) * stretched, rel=1e-9)


def test_what_the_lateral_half_answers(tractor: Any) -> None:
    """It responds along x, y and z, by its own response; the other half lacks y."""
    model = lateral(tractor)
    solution = model.solve(2.0)
    response = model.mechanism.response
    assert (response.point, response.direction, response.band) == ("E1", "y", (0.0, 200.0))
    line = np.array([3.0])
    direct = solution.frf(["E1.y"], ["E1.y"]).frf(line)
    assert solution.drive_point.frf(line) == pytest.approx(direct)
    with pytest.raises(ModelError, match="vertical half alone"):
        transmissibility(solution, ["E1.z"], "base.z")
    with pytest.raises(ModelError, match="use x or z, as this is the vertical half"):
        LinkageModel(model.mechanism).solve(2.0).participation(["E1.y"])
    without = copy.deepcopy(tractor)
    del without["lateral"]
    with pytest.raises(ModelError, match="give `vertical` or `lateral`"):
        LinkageModel(model.mechanism, half=cast("Any", "sideways"))
    with pytest.raises(ModelError, match="has no lateral half"):
        LinkageModel(mechanism_from_mapping(without), half="lateral")
