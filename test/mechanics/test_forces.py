# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Forces in pins, sections and cylinders, against statics, closed forms and finer models."""

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from linkage_vibration.drawing.geometry import curves, mode_curves
from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.description import LossFactor, Mechanism, MechanismError
from linkage_vibration.mechanics.forces import ForceError, reference
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from test.support.bob import ARM, BOB, INERTIA, MASS
from test.support.free_bodies import forces_by_cuts, static_forces_by_cuts
from test.support.in_plane import plane_mechanism

Array = NDArray[np.float64]
G = 9.80665
STEEL = {"youngs_modulus": 210e9, "density": 7800.0, "poisson_ratio": 0.3}
SECTION = {"shape": "rectangle", "width": 0.02, "height": 0.03}
CANTILEVER: dict[str, Any] = {
    "name": "cantilever",
    "ground": {"P": [0.0, 0.0]},
    "links": {
        "bar": {
            "points": {"P": 0.0, "M": 0.3, "E": 0.8},
            "clamped": "P",
            "section": SECTION,
            "material": STEEL,
        }
    },
    "input": {"link": "bar", "range_deg": [10.0, 60.0]},
    "assembly": {"alpha3_deg": 30.0},
    "damping": {"ratio": 0.02, "at_hz": [5.0, 500.0]},
    "response": {"drive_point": "E", "direction": "z", "band_hz": [0.0, 200.0], "modes": 1},
}
STIFFNESS, DAMPING = 61e3, 1900.0  # of a coil-over
LEVER: dict[str, Any] = {
    "name": "lever",
    "ground": {"P": [0.0, 0.0], "Q": [1.0, 2.0]},
    "links": {},
    "rigid_bodies": {"bob": BOB},
    "springs": {"strut": {"between": ["Q", "E"], "stiffness": STIFFNESS}},
    "input": {"link": "bob", "range_deg": [-10.0, 10.0]},
    "assembly": {"alpha3_deg": 0.0},
    "damping": {"ratio": 0.02, "at_hz": [1.0, 10.0]},
    "response": {"drive_point": "E", "direction": "z", "band_hz": [0.0, 20.0], "modes": 1},
}


def model_of(mapping: dict[str, Any], path: str = "", value: Any = None) -> LinkageModel:
    """Return the model of a mapping with one value changed; the path has dots."""
    mapping = copy.deepcopy(mapping)
    *folders, last = path.split(".") if path else [""]
    place = mapping
    for folder in folders:
        place = place[folder]
    if path:
        place[last] = value
    return LinkageModel(mechanism_from_mapping(mapping))


@pytest.fixture(scope="module")
def tractor() -> LinkageModel:
    """Return the model of the linkage on its tractor, in the plane."""
    return LinkageModel(plane_mechanism())


def meeting(a: Array, radius: float, b: Array, other: float, *, left: bool) -> Array:
    """Return where circles about a and b meet, on the left of the way from a to b or right."""
    way = b - a
    distance = math.hypot(*way)
    along = (distance**2 + radius**2 - other**2) / (2.0 * distance)
    across = math.sqrt(radius**2 - along**2) * (1.0 if left else -1.0)
    unit = way / distance
    return np.asarray(a + along * unit + across * np.array([-unit[1], unit[0]]))


def rigid_statics(alpha3: float) -> dict[str, float]:
    """Return the pin and cylinder forces of one side of the tractor's linkage, of rigid bodies.

    Three equations for each of five bodies have as unknowns the forces of seven pins and the moment
    of the cylinders on the crank.
    """
    p1, p2, p3 = np.array([0.0, 0.0]), np.array([-0.334, 0.403]), np.array([-0.064, 0.385])
    v2 = p3 + 0.203 * np.array([math.cos(alpha3), math.sin(alpha3)])
    v1 = meeting(p1, 0.366, v2, 0.534, left=True)
    e1 = p1 + (v1 - p1) * 0.810 / 0.366
    e2 = meeting(p2, 0.520, e1, 0.438, left=False)
    centre = meeting(e1, 1.020, e2, 1.095, left=True)
    pins = {"P1": p1, "P2": p2, "P3": p3, "V1": v1, "V2": v2, "E1": e1, "E2": e2}
    steel = 7800.0
    bodies: list[tuple[float, Array, dict[str, float]]] = [  # mass, centre, and signs of pins
        (2 * steel * 0.05 * 0.032 * 0.81, (p1 + e1) / 2, {"P1": 1, "V1": 1, "E1": 1}),
        (steel * math.pi / 4 * (0.08**2 - 0.04**2) * 0.52, (p2 + e2) / 2, {"P2": 1, "E2": 1}),
        (2 * steel * 0.02 * 0.036 * 0.203, (p3 + v2) / 2, {"P3": 1, "V2": 1}),
        (2 * steel * math.pi / 4 * 0.029**2 * 0.534, (v2 + v1) / 2, {"V2": -1, "V1": -1}),
        (800.0, centre, {"E1": -1, "E2": -1}),
    ]
    names, matrix, load = list(pins), np.zeros((15, 15)), np.zeros(15)
    for i, (mass, middle, signs) in enumerate(bodies):
        for name, sign in signs.items():
            x, z = pins[name]
            column = 2 * names.index(name)
            matrix[3 * i, column] = matrix[3 * i + 1, column + 1] = sign
            matrix[3 * i + 2, column : column + 2] = -sign * z, sign * x
        load[3 * i + 1], load[3 * i + 2] = mass * G, mass * G * middle[0]
    matrix[8, 14] = 1.0
    forces = np.linalg.solve(matrix, load)
    sizes = np.hypot(forces[:14:2], forces[1:14:2])
    shares = {"P2": 1.0, "E2": 1.0}
    result = {name: size * shares.get(name, 0.5) for name, size in zip(names, sizes, strict=True)}
    turn = np.array([[math.cos(alpha3), -math.sin(alpha3)], [math.sin(alpha3), math.cos(alpha3)]])
    foot, head = np.array([0.100, 0.050]), p3 + turn @ np.array([0.030, 0.100])
    way, arm = head - foot, head - p3
    lever = abs(arm[0] * way[1] - arm[1] * way[0]) / math.hypot(*way)
    return {**result, "lift_cylinders": abs(forces[14]) / lever / 2.0}


@pytest.mark.parametrize("angle", [92.0, 120.0, 150.0, 178.0])
def test_static_forces_are_those_of_rigid_statics(tractor: LinkageModel, angle: float) -> None:
    """Under the weight, rigid bodies in equilibrium give the same forces of pins and cylinders."""
    expected = rigid_statics(math.radians(angle))
    static = tractor.static_forces(math.radians(angle))
    assert tractor.force_places == (
        "lower_link:P1",
        "lower_link:V1",
        "lower_link:E1",
        "upper_link:P2",
        "upper_link:E2",
        "input_crank:P3",
        "input_crank:V2",
        "lift_cylinders",
        "base:rear_axle",
        "base:front_axle",
    )
    for name, force in zip(tractor.force_places[:-2], static, strict=False):
        assert force == pytest.approx(expected[name.split(":")[-1]], rel=1e-6), name


def test_forces_hold_the_implement(tractor: LinkageModel) -> None:
    """At 0 Hz the pins E1 and E2 pass a force on the implement into the links."""
    solution = tractor.solve(math.radians(120.0))
    outputs = [(pin, f"force_{d}") for pin in ("lower_link:E1", "upper_link:E2") for d in "xz"]
    lower_x, lower_z, upper_x, upper_z = (
        solution.frf(outputs, [("E1", "z")]).frf(np.array([0.0]))[0, :, 0].real
    )
    assert 2.0 * lower_x + upper_x == pytest.approx(0.0, abs=1e-6)
    assert 2.0 * lower_z + upper_z == pytest.approx(1.0, abs=1e-6)


def test_forces_accelerate_a_link(tractor: LinkageModel) -> None:
    """In each mode the pin forces on a link are its mass times its acceleration."""
    solution = tractor.solve(math.radians(120.0))
    pins = [f"lower_link:{point}" for point in ("P1", "V1", "E1")]
    for i, direction in enumerate("xz"):
        forces = solution.participation([(pin, f"force_{direction}") for pin in pins]).sum(axis=0)
        places = curves(tractor, solution.configuration)["lower_link"]
        for mode in range(2, 8):
            moved = mode_curves(solution, mode)["lower_link"]
            along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
            width = np.convolve(np.diff(along), [0.5, 0.5])
            mass = 7800.0 * 0.05 * 0.032 * width
            expected = -(solution.modes.omega[mode] ** 2) * float(mass @ moved[:, i])
            size = solution.modes.omega[mode] ** 2 * float(mass @ np.abs(moved).max(axis=1))
            assert forces[mode] == pytest.approx(expected, abs=2e-3 * size), (direction, mode)


def test_reduction_keeps_the_forces(tractor: LinkageModel) -> None:
    """Twenty modes of each link give the forces of unreduced links."""
    full = LinkageModel(tractor.mechanism, reduced=False)
    lines, errors = np.linspace(0.5, 200.0, 200), []
    for angle in np.radians([95.0, 140.0, 175.0]):
        outputs, into = tractor.forces.places, [("E1", "z"), ("rear_axle", "z")]
        exact = full.solve(angle).frf(outputs, into).frf(lines)
        reduced = tractor.solve(angle).frf(outputs, into).frf(lines)
        size = np.linalg.norm(exact, axis=0)
        off = np.linalg.norm(reduced - exact, axis=0)
        pins = slice(0, 14, 2), slice(1, 14, 2)  # both components of each
        off, size = (np.vstack([np.hypot(*(v[pin] for pin in pins)), v[14:]]) for v in (off, size))
        errors.append(off / size)
    assert np.max(errors) < 1e-5


@pytest.mark.parametrize("damping", [0.0, DAMPING])
def test_spring_passes_a_force_on(damping: float) -> None:
    """A lever on a strut: (k + i w c) / (k + i w c - (w^2 - i w a) J / L^2); m g d / L at rest."""
    model = model_of(LEVER, "springs.strut.damping", damping)
    inertia = INERTIA + MASS * ARM**2
    first, second = 2.0 * math.pi * 1.0, 2.0 * math.pi * 10.0
    decay = 2.0 * 0.02 * first * second / (first + second)
    lines = np.linspace(0.0, 20.0, 41)
    omega = 2.0 * math.pi * lines
    frf = model.solve(0.0).frf([("strut", "force")], [("E", "z")]).frf(lines)[:, 0, 0]
    strut = (STIFFNESS + 1j * omega * damping) * 1.0**2
    expected = strut / (strut - inertia * omega**2 + 1j * omega * decay * inertia)
    np.testing.assert_allclose(frf, -expected, rtol=1e-9)  # it shortens the strut
    assert model.force_places == ("strut",)
    assert model.static_forces(0.0)[0] == pytest.approx(MASS * G * ARM, rel=1e-9)


def test_a_damper_carries_more_than_the_spring_beside_it() -> None:
    """At 12 Hz the damper of a coil-over carries w c / k = 2.3 times as much."""
    strut = LEVER["springs"]["strut"]
    apart = {"damper": {"between": strut["between"], "damping": DAMPING}}
    model = model_of(LEVER, "springs", {"strut": strut, **apart})
    assert model.force_places == ("strut", "damper")
    places, line = [(name, "force") for name in model.force_places], np.array([12.0])
    elastic, viscous = model.solve(0.0).frf(places, [("E", "z")]).frf(line)[0, :, 0]
    ratio = 2.0 * math.pi * 12.0 * DAMPING / STIFFNESS
    assert viscous / elastic == pytest.approx(1j * ratio, rel=1e-9)
    both = model_of(LEVER, "springs.strut.damping", DAMPING).solve(0.0)
    [[[one]]] = both.frf(places[:1], [("E", "z")]).frf(line)
    assert abs(one / elastic) == pytest.approx(math.hypot(1.0, ratio), rel=1e-9)
    assert ratio == pytest.approx(2.35, abs=0.01)
    assert model.static_forces(0.0)[1] == 0.0


def loaded(name: str) -> Mechanism:
    """Return a shipped linkage with a mass at a pin, and dampers or losses that couple modes."""
    mechanism = read_mechanism(config_file(f"{name}.yaml"))
    first, *rest = mechanism.links
    heavy = replace(first, masses=((first.points[-1][0], 14.0),))
    if name == "three_point_linkage":
        heavy = replace(heavy, damping=LossFactor(0.1))
        rest = [replace(link, damping=LossFactor(0.02)) for link in rest]
        mechanism = replace(mechanism, damping=LossFactor(0.02))
    springs = tuple(
        spring if len(spring.points) == 1 else replace(spring, stiffness=61e3, damping=1900.0)
        for spring in mechanism.springs
    )
    return replace(mechanism, links=(heavy, *rest), springs=springs)


@pytest.mark.parametrize(
    "name", ["three_point_linkage_on_tractor", "stephenson_six_bar", "three_point_linkage"]
)
def test_forces_are_those_on_bodies_cut_free(name: str) -> None:
    """Unreduced links that are cut free at their pins are in equilibrium, at rest and in motion."""
    model = LinkageModel(loaded(name), reduced=False)
    alpha3, band = np.mean(model.mechanism.stroke), model.mechanism.response.band
    lines, into = np.linspace(*band, 41)[1:], [(model.mechanism.response.point, d) for d in "xz"]
    exact = forces_by_cuts(model, alpha3, lines, into)
    forces = model.solve(alpha3).frf(model.forces.places, into).frf(lines)
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert (np.abs(forces - exact) / size).max() < 1e-6
    static = model.forces.at_rest(*_where(model, alpha3))
    np.testing.assert_allclose(static, static_forces_by_cuts(model, alpha3), rtol=1e-6, atol=1e-3)


def _where(model: LinkageModel, alpha3: float) -> tuple[Configuration, Joining]:
    """Return the configuration at an angle, and what joins the components there."""
    configuration = model.kinematics.at(alpha3)
    return configuration, model.interface.join(configuration)


# Two parallel bars without mass carry a body that only goes up and down, on a spring at B.
HOLD, BODY = 4e4, 50.0  # N/m, kg
LIGHT = {"section": {"shape": "rectangle", "width": 0.2, "height": 0.2}, "material": STEEL}
LIGHT = LIGHT | {"material": STEEL | {"density": 1e-6}}
PARALLELOGRAM: dict[str, Any] = {
    "name": "parallelogram",
    "ground": {"P": [0.0, 0.0], "Q": [0.0, 0.5], "S": [1.0, 3.0]},
    "links": {
        "bar": {"points": {"P": 0.0, "B": 1.0}, **LIGHT},
        "upper_bar": {"points": {"Q": 0.0, "C": 1.0}, **LIGHT},
    },
    "rigid_bodies": {
        "body": {
            "points": {"B": [0.0, 0.0], "C": [0.5, 0.0]},
            "centre_of_gravity": [0.2, -0.3],
            "mass": BODY,
            "inertia": 4.0,
        }
    },
    "springs": {"hold": {"between": ["S", "B"], "stiffness": HOLD}},
    "input": {"link": "bar", "range_deg": [-10.0, 10.0]},
    "assembly": {"alpha3_deg": 0.0, "angles_deg": {"upper_bar": 0.0, "body": 90.0}},
    "damping": {"ratio": 1e-9, "at_hz": [1.0, 10.0]},
    "response": {"drive_point": "B", "direction": "z", "band_hz": [0.0, 20.0], "modes": 1},
}


@pytest.mark.parametrize("mass", [0.0, 14.0])
def test_mass_at_a_pin_belongs_to_its_link(mass: float) -> None:
    """The pin B carries m g at rest, and F + m w^2 u in motion; the link's own mass is beyond it.

    F lifts the body, which the spring holds together with the mass: u = F / (k - (m + M) w^2).
    """
    masses = {"masses": {"B": mass}} if mass else {}
    bar = PARALLELOGRAM["links"]["bar"] | masses
    model = model_of(PARALLELOGRAM, "links.bar", bar)
    static = dict(zip(model.forces.places, model.forces.at_rest(*_where(model, 0.0)), strict=True))
    assert static["hold", "force"] == pytest.approx((BODY + mass) * G, rel=1e-5)
    assert static["bar:B", "force_z"] == pytest.approx(-BODY * G, rel=1e-5)
    lines = np.array([0.0, 2.0, 5.0, 12.0])
    squared = (2.0 * math.pi * lines) ** 2
    moved = 1.0 / (HOLD - (BODY + mass) * squared)
    places = [("bar:B", "force_z"), ("hold", "force")]
    force, tension = model.solve(0.0).frf(places, [("B", "z")]).frf(lines)[:, :, 0].T
    np.testing.assert_allclose(tension, -HOLD * moved, rtol=1e-4)
    np.testing.assert_allclose(force, 1.0 + BODY * squared * moved, rtol=1e-4)


def test_sections_of_a_cantilever() -> None:
    """A force F across the tip: shear F, and moment F times the distance."""
    model, angle = model_of(CANTILEVER), math.radians(30.0)
    solution, zero = model.solve(angle), np.array([0.0])

    def by_force(point: str, direction: str, along: tuple[float, float]) -> float:
        frf = solution.frf([(f"bar:{point}", direction)], [("E", "x"), ("E", "z")]).frf(zero)
        return float(frf[0, 0].real @ along)

    along, across = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
    for point, distance in (("P", 0.8), ("M", 0.5)):
        assert abs(by_force(point, "moment", across)) == pytest.approx(distance, rel=1e-6)
        assert abs(by_force(point, "shear", across)) == pytest.approx(1.0, rel=1e-6)
        assert by_force(point, "axial", along) == pytest.approx(1.0, rel=1e-6)
    assert by_force("P", "force_x", along) == pytest.approx(-math.cos(angle), rel=1e-6)
    assert by_force("P", "force_z", across) == pytest.approx(-math.cos(angle), rel=1e-6)


def test_forces_of_equal_links_are_those_of_one() -> None:
    """Of two equal links each carries half."""
    angle, output = math.radians(30.0), [("bar:P", "force_z")]
    single, double = (model_of(CANTILEVER, "links.bar.count", count) for count in (1, 2))
    first, half = (
        float(model.solve(angle).frf(output, [("E", "z")]).frf(np.array([0.0]))[0, 0, 0].real)
        for model in (single, double)
    )
    assert half == pytest.approx(first / 2.0, rel=1e-9)
    assert double.static_forces(angle) == pytest.approx(single.static_forces(angle), rel=1e-9)


def test_reference_is_a_tenth_of_the_largest_at_least(tractor: LinkageModel) -> None:
    """The force in a pin that carries little is compared with a tenth of the largest."""
    expected = reference([(x, "force") for x in "abcd"], np.array([50.0, 2e3, 200.0, 199.0]), None)
    np.testing.assert_allclose(expected, [200.0, 2000.0, 200.0, 200.0])
    static = tractor.static_forces(2.0)
    np.testing.assert_array_equal(
        tractor.reference_forces(2.0), np.maximum(static, 0.1 * static.max())
    )


def test_linkage_that_nothing_carries_has_no_static_forces() -> None:
    """A lever that swings freely has NaN, unless its file gives a reference."""
    links = {"bar": {key: v for key, v in CANTILEVER["links"]["bar"].items() if key != "clamped"}}
    free = model_of(CANTILEVER, "links", links)
    assert free.force_places == ("bar:P",)
    assert np.isnan(free.static_forces(0.5)).all()
    assert np.isnan(free.reference_forces(0.5)).all()
    given = model_of({**CANTILEVER, "links": links}, "response.reference_force", 5000.0)
    np.testing.assert_array_equal(given.reference_forces(0.5), [5000.0])
    assert np.isnan(given.static_forces(0.5)).all()
    some = model_of(LEVER, "response.reference_force", {"strut": 70.0})
    np.testing.assert_array_equal(some.reference_forces(0.0), [70.0])
    with pytest.raises(MechanismError, match="rope has no force; give some of: strut"):
        _ = model_of(LEVER, "response.reference_force", {"rope": 70.0}).force_places
    for wrong in (0.0, -1.0, "much", {"bar:P": -1.0}):
        with pytest.raises(MechanismError, match=r"response\.reference_force"):
            model_of(CANTILEVER, "response.reference_force", wrong)


def test_a_reference_force_changes_the_hash() -> None:
    """Tables contain it."""
    plain = model_of(CANTILEVER).mechanism.model_hash
    given = model_of(CANTILEVER, "response.reference_force", 5e3).mechanism
    assert given.model_hash != plain


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (("bar:Q", "force_x"), "no force at bar:Q; give one of: bar:P"),
        (("rod:P", "force_x"), "no force at rod:P"),
        (("bar:P", "force"), "bar:P has no force; it has: force_x, force_z, axial"),
    ],
)
def test_places_without_a_force_are_refused(place: tuple[str, str], message: str) -> None:
    """The error names the place, and what there is."""
    with pytest.raises(ForceError, match=message):
        model_of(CANTILEVER).solve(0.5).frf([place], [("E", "z")])


def test_places_by_their_names() -> None:
    """A place is a pair or a text, everywhere; what is neither is refused with the fix."""
    model, lines = model_of(CANTILEVER), np.array([5.0])
    solution, texts = model.solve(0.5), ["E.z", "bar:P.force_x"]
    places = [("E", "z"), ("bar:P", "force_x")]
    for function in (solution.participation, solution.mode_shapes):
        np.testing.assert_array_equal(function(texts), function(places))
    receptances = solution.frf(texts, ["E.z"]).frf(lines)
    np.testing.assert_array_equal(receptances, solution.frf(places, [("E", "z")]).frf(lines))
    receptances = model.coupled_frf(0.5, lines, ["E.x"], ["E.z"]).values
    np.testing.assert_array_equal(
        receptances, model.coupled_frf(0.5, lines, [("E", "x")], [("E", "z")]).values
    )
    for wrong in ("E.z", ("E", "z"), [".z"], [("E", "x", "z")]):
        with pytest.raises(
            ModelError, match=r'not a place; give a list of places, such as \["E1.z'
        ):
            solution.frf(wrong, ["E.z"])


def test_forces_are_no_inputs() -> None:
    """A force inside the linkage is refused as an input, and as an output of LM-FBS."""
    model, force = model_of(CANTILEVER), ("bar:P", "force_z")
    with pytest.raises(ModelError, match="force_z at bar:P is an output"):
        model.solve(0.5).frf([("E", "z")], [force])
    with pytest.raises(ModelError, match="force_z at bar:P is an output"):
        model.coupled_frf(0.5, np.array([5.0]), [force], [("E", "z")])


def test_springs_without_a_force_are_refused() -> None:
    """A spring on a joint has a moment, and is left out of the names."""
    spring = {"hinge": {"joint": "P", "stiffness": 1e4}}
    bar = {key: v for key, v in CANTILEVER["links"]["bar"].items() if key != "clamped"}
    model = model_of({**CANTILEVER, "springs": spring}, "links", {"bar": bar})
    assert model.force_places == ("bar:P",)
    with pytest.raises(ForceError, match="There is no force at hinge; give one of: bar:P"):
        model.solve(0.5).frf([("hinge", "force")], [("E", "z")])
    assert model.static_forces(0.5)[0] == pytest.approx(7800 * 0.02 * 0.03 * 0.8 * G, rel=1e-6)


def test_pin_of_three_links() -> None:
    """Each of its links has a force of its own there, and the three are in equilibrium."""
    mapping = yaml.safe_load(config_file("four_bar.yaml").read_text())
    bar = {key: mapping["links"]["rocker"][key] for key in ("section", "material")}
    mapping["ground"]["R"] = [1.0, 0.0]
    mapping["links"]["stay"] = bar | {"points": {"C": 0.0, "Q": 0.4}}
    mapping["links"]["post"] = bar | {"points": {"R": 0.0, "Q": 0.35}}
    mapping["assembly"]["angles_deg"] |= {"stay": 0.0, "post": 100.0}
    mapping["input"]["range_deg"] = [80.0, 100.0]
    model = LinkageModel(mechanism_from_mapping(mapping))
    pins = [f"{link}:C" for link in ("coupler", "rocker", "stay")]
    assert set(pins) < set(model.forces.names)
    for direction in ("force_x", "force_z"):
        forces = [(pin, direction) for pin in pins]
        frf = model.solve(1.5).frf(forces, [("B", "x")]).frf(np.array([3.0, 90.0]))[:, :, 0]
        assert (np.abs(frf).min(axis=1) > 0.01 * np.abs(frf).max(axis=1)).all()
        assert np.abs(frf.sum(axis=1)).max() < 1e-6 * np.abs(frf).min()
