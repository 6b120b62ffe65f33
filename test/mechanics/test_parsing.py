# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parsing: valid descriptions are read, and invalid ones are refused with path and fix."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.doubts import linkage_doubts
from test.mechanics.test_forces import LEVER


def test_table_1_is_read(mechanism: Mechanism) -> None:
    """The lengths that the paper's Table 1 prints are those of the parsed mechanism."""
    implement = mechanism.rigid_bodies[0]
    points = dict(implement.points)
    m = implement.centre_of_gravity
    assert math.dist(m, points["E1"]) == pytest.approx(1.020, rel=1e-14)
    assert math.dist(m, points["E2"]) == pytest.approx(1.095, rel=1e-14)
    assert math.dist(points["E1"], points["E2"]) == pytest.approx(0.438, rel=1e-14)
    lengths = {link.name: link.points[-1][1][0] for link in mechanism.links}
    assert lengths == {
        "lower_link": 0.810,
        "upper_link": 0.520,
        "input_crank": 0.203,
        "lift_rod": 0.534,
    }


@pytest.mark.parametrize("where", ["name", "key"])
def test_names_that_look_like_a_line_of_a_log(mapping: Any, where: str) -> None:
    """A name with a line break is refused, as it is printed."""
    if where == "name":
        mapping["name"] = "hitch\n[ERROR]"
    else:
        mapping["links"]["boom\n[ERROR]"] = mapping["links"].pop("lift_rod")
    with pytest.raises(MechanismError, match=r"n\[ERROR\]' cannot be read in a sentence"):
        mechanism_from_mapping(mapping)


def test_pins_follow_from_shared_names(mechanism: Mechanism) -> None:
    """A Watt six-bar has seven pins, three of them on the ground."""
    joints = mechanism.joints
    assert sorted(point for point, _, _ in joints) == ["E1", "E2", "P1", "P2", "P3", "V1", "V2"]
    assert sum(first == "ground" for _, first, _ in joints) == 3


def test_hash_ignores_order_but_no_number(mapping: Any, mechanism: Mechanism) -> None:
    """The model hash changes with a mass, and not with the order of keys."""
    shuffled = dict(reversed(list(mapping.items())))
    assert mechanism_from_mapping(shuffled).model_hash == mechanism.model_hash
    mapping["rigid_bodies"]["implement"]["mass"] += 1e-6
    assert mechanism_from_mapping(mapping).model_hash != mechanism.model_hash


def test_hash_survives_another_machines_last_bit(mapping: Any, mechanism: Mechanism) -> None:
    """A number that differs in its last bit does not change the model."""
    crank = mapping["links"]["input_crank"]["points"]
    crank["V2"] = math.nextafter(crank["V2"], 1.0)
    assert mechanism_from_mapping(mapping).model_hash == mechanism.model_hash


def change(*path: str, to: Any) -> Callable[[Any], None]:
    """Return a function that sets a key of a nested mapping."""

    def spoil(mapping: Any) -> None:
        for key in path[:-1]:
            mapping = mapping[key]
        mapping[path[-1]] = to

    return spoil


def remove(*path: str) -> Callable[[Any], None]:
    """Return a function that removes a key of a nested mapping."""

    def spoil(mapping: Any) -> None:
        for key in path[:-1]:
            mapping = mapping[key]
        del mapping[path[-1]]

    return spoil


def i_section(web: float = 0.005, flange: float = 0.006) -> dict[str, Any]:
    """Return the keys of an I-section."""
    sizes = {"height": 0.1, "width": 0.05, "web_thickness": web, "flange_thickness": flange}
    return {"shape": "i_section", **sizes}


def test_i_section_is_read(mapping: Any) -> None:
    """A link takes the keys of an I-section."""
    mapping["links"]["upper_link"]["section"] = i_section()
    body = next(x.body for x in mechanism_from_mapping(mapping).links if x.name == "upper_link")
    assert isinstance(body, Beam)
    assert body.segments[0].section.area == pytest.approx(2 * 0.05 * 0.006 + 0.088 * 0.005)


@pytest.mark.parametrize(
    ("spoil", "path", "words"),
    [
        (remove("damping"), "damping", "missing"),
        (remove("links", "lower_link", "section"), "links.lower_link.section", "missing"),
        (change("links", "lower_link", "width", to=1), "links.lower_link.width", "not known"),
        (change("dampng", to={}), "dampng", "did you mean damping"),
        (change("rigid_bodies", "implement", "mass", to=-1.0), "rigid_bodies.implement.mass", "-1"),
        (change("rigid_bodies", "implement", "mass", to=0), "rigid_bodies.implement.mass", "zero"),
        (change("rigid_bodies", "implement", "mass", to="8e2"), "implement.mass", "text"),
        (change("rigid_bodies", "implement", "mass", to=float("nan")), "implement.mass", "finite"),
        (change("rigid_bodies", "implement", "mass", to=10**400), "implement.mass", "finite"),
        (change("rigid_bodies", "implement", "mass", to=True), "implement.mass", "not a number"),
        (change("links", "upper_link", "points", to={"P2": 0, "E2": -0.52}), "E2", "beyond"),
        (change("links", "upper_link", "points", to={"P2": 0}), "upper_link.points", "two points"),
        (change("links", "upper_link", "points", to=[0, 1]), "upper_link.points", "mapping"),
        (
            change("links", "upper_link", "points", to={"P2": 0, "E3": 0.5}),
            "links",
            "leave 3 degrees of freedom where one input angle needs exactly 1; points are joined "
            "where their names are the same (points that only one body has: E3 of upper_link, E2 "
            "of implement).",
        ),
        (
            change("links", "upper_link", "points", to={"P4": 0, "E2": 0.5}),
            "ground.P2",
            "correct a name (points that only one body has: P4 of upper_link)",
        ),
        (
            change("springs", to={"lift": {"joint": "P3", "stiffness": 3e5}}),
            "links.input_crank.clamped",
            "locks the joint on which springs.lift acts; remove one",
        ),
        (change("rigid_bodies", "implement", "mass", to="2200 kg"), "mass", "its unit, with a"),
        (change("rigid_bodies", "implement", "mass", to="21e10"), "mass", "powers as 2.1e+11."),
        (change("ground", "P1", to=[0, 25, 0, 5]), "ground.P1", "write decimals with a point"),
        (
            change("input", "range_deg", to=[1.571, 3.1416]),
            "input.range_deg",
            "a stroke of 1.57 deg; if these are radians, write [90.012, 180]",
        ),
        (change("links", "upper_link", "modes", to=-1), "upper_link.modes", "whole number"),
        (change("links", "upper_link", "modes", to=2.5), "upper_link.modes", "whole number"),
        (change("links", "input_crank", "clamped", to="V2"), "input_crank.clamped", "P3"),
        (change("links", "lift_rod", "section", "shape", to="hexagon"), "shape", "rectangle"),
        (change("links", "lift_rod", "section", "diameter", to=0), "diameter", "zero"),
        (change("links", "lift_rod", "section", to=i_section(web=0.05)), "web_thickness", "below"),
        (change("links", "lift_rod", "section", to=i_section(flange=0.06)), "flange", "below"),
        (change("links", "lift_rod", "section", to=i_section(web=0.0)), "web_thickness", "zero"),
        (change("links", "upper_link", "section", "inner_diameter", to=0.1), "inner", "fit"),
        (change("links", "lift_rod", "material", "poisson_ratio", to=0.7), "poisson", "0.5"),
        (
            change("rigid_bodies", "implement", "centre_of_gravity", "E1", to=0.65),
            "gravity",
            "no po",
        ),
        (change("rigid_bodies", "implement", "centre_of_gravity", to=[1]), "gravity", "point [x"),
        (change("ground", "P4", to=[0, 0]), "ground.P4", "no body"),
        (change("ground", "P1", to=[0, 0, 0]), "ground.P1", "[x, z]"),
        (change("ground", "P1", to=[0, 102]), "ground", "m apart; lengths are in m"),
        (change("ground", "P1", to=["a", 0]), "ground.P1[0]", "text"),
        (change("input", "link", to="implement"), "input.link", "lower_link"),
        (
            change("links", "input_crank", "points", to={"P33": 0.0, "V2": 0.203}),
            "links.input_crank.clamped",
            "none of its points (P33, V2) is one of the ground (P1, P2, P3); correct a name.",
        ),
        (change("input", "link", to="lift_rod"), "input.link", "input_crank"),
        (change("input", "range_deg", to=[180, 90]), "input.range_deg", "ascend"),
        (change("gravity", to=9.81), "gravity", "not known here; remove it."),
        (change("response", "drive_point", to="E9"), "response.drive_point", "E1"),
        (change("response", "direction", to="y"), "response.direction", "x, z"),
        (
            change("response", "band_hz", to=[-1, 200]),
            "response.band_hz",
            "-1 is below 0; begin at 0 Hz",
        ),
        (change("response", "peak_band_hz", to=[9, 3]), "response.peak_band_hz", "ascend"),
        (change("response", "peak_band_hz", to=[-1, 200]), "peak_band_hz", "-1 is below 0; FRFs"),
        (change("response", "peak_band_hz", to=[3, 201]), "peak_band_hz", "201 is above 200; FRFs"),
        (change("damping", "at_hz", to=[0, 10]), "damping.at_hz", "zero"),
        (change("name", to=""), "name", "text"),
        (change("links", "implement", to={}), "implement", "missing"),
        (change(7, to=1), "(top)", "quotes"),
    ],
)
def test_wrong_descriptions_are_refused(
    mapping: Any, spoil: Callable[[Any], None], path: str, words: str
) -> None:
    """Each wrong key gives an error that names its path and what is wrong."""
    spoil(mapping)
    with pytest.raises(MechanismError) as raised:
        mechanism_from_mapping(mapping)
    assert path in raised.value.path
    assert words in raised.value.problem


def test_the_largest_whole_number() -> None:
    """Ten thousand elements or modes may be given, and not one more."""
    keys = CheckedMapping("", {"modes": 10_000, "elements": 10_001})
    assert keys.integer("modes") == 10_000
    with pytest.raises(MechanismError, match="10001 is not a whole number from 1 to 10000"):
        keys.integer("elements")


def test_a_misspelt_ground_point_of_the_crank(mapping: Any) -> None:
    """The error of a crank that a spring holds names the points of both."""
    del mapping["links"]["input_crank"]["clamped"]
    mapping["ground"]["P33"] = mapping["ground"].pop("P3")
    with pytest.raises(MechanismError) as raised:
        mechanism_from_mapping(mapping)
    assert raised.value.path == "input.link"
    assert raised.value.problem == (
        "none of its points (P3, V2) is one of the ground (P1, P2, P33); correct a name, or give "
        "one of: lower_link, upper_link."
    )


def test_band_of_the_peak(mapping: Any) -> None:
    """It is the whole band unless the file states a part of it; the ends of the band are inside."""
    whole = mechanism_from_mapping(mapping)
    assert whole.response.peak_band == whole.response.band == (0.0, 200.0)
    mapping["response"]["peak_band_hz"] = [0.0, 200.0]
    assert mechanism_from_mapping(mapping) == whole
    mapping["response"]["peak_band_hz"] = [3.5, 200.0]
    part = mechanism_from_mapping(mapping)
    assert (part.response.band, part.response.peak_band) == ((0.0, 200.0), (3.5, 200.0))
    assert part.model_hash != whole.model_hash


@pytest.mark.parametrize(
    ("band", "peak_band"),
    [
        ((0.0, 40.0), (3.5, 40.0)),
        ((2.0, 300.0), (3.5, 200.0)),
        ((5.0, 40.0), (5.0, 40.0)),
        ((0.0, 3.5), (0.0, 3.5)),  # it has no common part
    ],
)
def test_band_of_the_peak_within_another_band(
    mapping: Any, band: tuple[float, float], peak_band: tuple[float, float]
) -> None:
    """The peak is sought in the common part of both bands, or in the whole new one."""
    mapping["response"]["peak_band_hz"] = [3.5, 200.0]
    other = mechanism_from_mapping(mapping).response.with_band(band)
    assert (other.band, other.peak_band) == (band, peak_band)


def test_misspelt_key_is_suggested(mapping: Any) -> None:
    """The error of a missing key names the misspelt one."""
    mapping["respons"] = mapping.pop("response")
    with pytest.raises(MechanismError, match=r"response: .*respons is there"):
        mechanism_from_mapping(mapping)


@pytest.mark.parametrize("nonsense", [None, 3, "text", [], [1], {}])
def test_not_even_a_mechanism(nonsense: Any) -> None:
    """Anything else that YAML may contain is refused with an error."""
    with pytest.raises(MechanismError):
        mechanism_from_mapping(nonsense)


def times(value: Any, factor: float) -> Any:
    """Multiply every number in nested mappings and lists."""
    if isinstance(value, dict):
        return {key: times(item, factor) for key, item in value.items()}
    if isinstance(value, list):
        return [times(item, factor) for item in value]
    return value * factor if isinstance(value, int | float) else value


def enlarge(points: float, sections: float) -> Callable[[Any], None]:
    """Return a function that multiplies all points, and all dimensions of sections."""

    def spoil(mapping: Any) -> None:
        mapping["ground"] = times(mapping["ground"], points)
        for body in (*mapping["links"].values(), *mapping["rigid_bodies"].values()):
            body["points"] = times(body["points"], points)
            body["section"] = times(body.get("section", {}), sections)
        implement = mapping["rigid_bodies"]["implement"]
        del implement["section"]
        implement["centre_of_gravity"] = times(implement["centre_of_gravity"], points)

    return spoil


def implement(**values: float) -> Callable[[Any], None]:
    """Return a function that changes the implement."""
    return lambda mapping: mapping["rigid_bodies"]["implement"].update(values)


def material(key: str, value: float) -> Callable[[Any], None]:
    """Return a function that changes the material of the lift rod."""
    return change("links", "lift_rod", "material", key, to=value)


@pytest.mark.parametrize(
    ("spoil", "path", "words"),
    [
        (enlarge(1e3, 1.0), "ground", "523.417 m apart; lengths are in m"),
        (enlarge(1e3, 1e3), "ground", "523.417 m apart; lengths are in m"),
        (enlarge(50.0, 50.0), "links.lower_link", "40.5 m long .*millimetres"),
        (enlarge(1.0, 1e3), "links.lower_link.section", "32 m deep and 0.81 m long is not a beam"),
        (material("youngs_modulus", 210.0), "material.youngs_modulus", "write it in Pa"),
        (material("youngs_modulus", 210e3), "material.youngs_modulus", "write it in Pa"),
        (material("youngs_modulus", 2.1e20), "material.youngs_modulus", "rigid_bodies"),
        (material("density", 7.8), "material.density", "write it in kg/m3"),
        (material("density", 0.99e-9), "material.density", "write it in kg/m3"),
        (implement(mass=0.8), "rigid_bodies.implement.inertia", "15.8 m .* write kg and kg m2"),
        (implement(inertia=2e8), "rigid_bodies.implement.inertia", "500 m .* write kg and kg m2"),
        (change("links", "input_crank", "section", "height", to=0.21), "section", "not a beam"),
    ],
)
def test_wrong_units_are_refused(
    mapping: Any, spoil: Callable[[Any], None], path: str, words: str
) -> None:
    """Millimetres, tonnes and gigapascals, where SI belongs, name the key and the fix."""
    spoil(mapping)
    with pytest.raises(MechanismError, match=words) as raised:
        mechanism_from_mapping(mapping)
    assert raised.value.path.endswith(path)


@pytest.mark.parametrize(
    "spoil",
    [
        implement(mass=1e-3, inertia=2.5e-4),
        implement(mass=1e5, inertia=1e5),
        implement(inertia=1e-6),
        enlarge(0.01, 0.01),
        enlarge(25.0, 25.0),
        enlarge(100.0, 25.0),
        material("youngs_modulus", 1e15),
        material("youngs_modulus", 5e6),
        material("density", 1e-3),
        material("density", 1e-9),
        material("density", 22_600.0),
        change("links", "input_crank", "section", "height", to=0.2),
        change("links", "lift_rod", "section", "diameter", to=1e-4),
    ],
)
def test_large_and_small_is_not_refused(mapping: Any, spoil: Callable[[Any], None]) -> None:
    """A mechanism of any size and weight that somebody may build, or idealise, is read."""
    spoil(mapping)
    assert mechanism_from_mapping(mapping).links


def test_joint_that_is_closed_twice(mapping: Any) -> None:
    """Two bodies joined at two points are named, with both points and the fix."""
    mapping["links"]["lift_rod"]["points"]["E9"] = 0.6
    mapping["links"]["lower_link"]["points"]["E9"] = 0.9
    with pytest.raises(MechanismError, match="lower_link and lift_rod are joined at V1 and E9"):
        mechanism_from_mapping(mapping)


def test_damper_without_a_spring(mapping: Any) -> None:
    """LM-FBS, in which it has the compliance 1 / (i w c), agrees with the modes, also at 0 Hz."""
    mapping["springs"] = {"damper": {"joint": "P1", "damping": 100.0}}
    model = LinkageModel(mechanism_from_mapping(mapping))
    lines, places = np.array([0.0, 0.5, 3.0, 20.0, 100.0]), [("E1", "z"), ("E2", "x")]
    exact = model.solve(2.3).frf(places, places).frf(lines)
    np.testing.assert_allclose(
        model.coupled_frf(2.3, lines, places, places).values, exact, rtol=1e-8
    )


@pytest.mark.parametrize(
    ("spring", "place"),
    [
        ({}, "stiffness"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"stiffness": -1.0, "damping": 1.0}, "stiffness"),
        ({"stiffness": 1e3, "damping": -2.0}, "damping"),
    ],
)
def test_springs_that_are_refused(mapping: Any, spring: dict[str, float], place: str) -> None:
    """The error names the place: no force at all, and constants that are negative."""
    mapping["springs"] = {"one": {"joint": "P1", **spring}}
    with pytest.raises(MechanismError, match=rf"springs\.one\.{place}"):
        mechanism_from_mapping(mapping)


def test_stroke_in_radians_beside_an_assembly_in_radians(mapping: Any) -> None:
    """It is refused, too; a small stroke around the crank's zero is read, as one above a turn."""
    mapping["input"]["range_deg"] = [1.571, 3.1416]
    degrees = dict(mapping["assembly"]["angles_deg"])
    radians = {name: math.radians(value) for name, value in degrees.items()}
    mapping["assembly"] = {"alpha3_deg": 2.4435, "angles_deg": radians}
    with pytest.raises(MechanismError, match="if these are radians"):
        mechanism_from_mapping(mapping)
    mapping["input"]["range_deg"] = [0.0, 6.2832]
    with pytest.raises(MechanismError, match=r"write \[0, 360\]"):
        mechanism_from_mapping(mapping)
    mapping["assembly"] = {"alpha3_deg": 0.0, "angles_deg": degrees}
    for stroke in ([-3.0, 3.0], [-6.28, 6.28], [0.0, 6.2833]):
        mapping["input"]["range_deg"] = stroke
        assert mechanism_from_mapping(mapping).stroke[1] == math.radians(stroke[1])


def test_spring_beside_a_clamp_on_another_joint(mapping: Any) -> None:
    """A clamp and a spring are not refused where both act: on other bodies, or along a line."""
    other = {"joint": "V2", "stiffness": 1e3}
    mapping["springs"] = {"other": other, "line": {"between": ["P3", "V1"], "stiffness": 1e3}}
    assert len(mechanism_from_mapping(mapping).springs) == 2


def test_second_input_is_named(mapping: Any) -> None:
    """Without the upper link, 4 bodies and 5 pins leave 12 - 10 = 2; a missing pin leaves 3."""
    for table in (mapping["links"], mapping["assembly"]["angles_deg"]):
        del table["upper_link"]
    mapping["springs"] = {"top": {"between": ["P2", "E2"], "stiffness": 1e6}}
    with pytest.raises(
        MechanismError, match=r"leave 2 degrees.*: none\)\. Describe a second input"
    ):
        mechanism_from_mapping(mapping)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        # A uniform bar of 2 x 1.020 m about E1 has 1.020 m / sqrt(3) = 0.589 m; half is doubted.
        ({"inertia": 800.0 * 0.295**2}, ""),
        ({"inertia": 800.0 * 0.294**2}, "with its mass and pins, 0.59 m"),
        ({"mass": 950.0, "inertia": 950.0 * 0.17**2}, "is plausible, an inertia of 329 kg m2"),
        # A solid bar of steel, 6 m wide: J / m = r^2 / 2 = m / (2 pi rho 6 m), 0.0520 m for 800 kg.
        ({"centre_of_gravity": [0.0, 0.0], "inertia": 800.0 * 0.0521**2}, ""),
        ({"centre_of_gravity": [0.0, 0.0], "inertia": 800.0 * 0.0519**2}, "and pins, 0.052 m is"),
        ({"centre_of_gravity": {"E1": 1.020, "E2": 1.095, "side": "right"}}, "1 m from the line"),
        ({"centre_of_gravity": [0.2, 0.6]}, ""),
        ({"centre_of_gravity": [0.2, -0.6]}, "0.6 m from the line of its pins towards the ground"),
        # Between the pins, a little ahead of the mast: half the mast of 0.438 m is the limit.
        ({"centre_of_gravity": [0.2, -0.218]}, ""),
        ({"centre_of_gravity": [0.2, -0.220]}, "0.22 m from the line"),
    ],
)
def test_rigid_bodies_are_doubted(mapping: Any, changes: Any, words: str) -> None:
    """The doubt names a body that is too compact, or that lies where the tractor is."""
    mapping["rigid_bodies"]["implement"].update(changes)
    notice = " ".join(linkage_doubts(LinkageModel(mechanism_from_mapping(mapping))))
    assert words in notice
    assert bool(notice) == bool(words)


@pytest.mark.parametrize("rule", ["rayleigh", "modal_ratio"])
def test_a_damping_ratio_in_percent_is_refused(mapping: Any, rule: str) -> None:
    """Above 1 nothing oscillates, and the error names the ratio rather than the number of modes."""
    ends = {"at_hz": [4.0, 180.0]} if rule == "rayleigh" else {}
    mapping["damping"] = {"rule": rule, "ratio": 1.0, **ends}
    mechanism_from_mapping(mapping)
    mapping["damping"]["ratio"] = 2
    with pytest.raises(MechanismError, match=r"damping.ratio: 2 is above 1; .* write 2 % as 0.02"):
        mechanism_from_mapping(mapping)


def test_a_single_body_has_no_other_angles() -> None:
    """Without another body, `angles_deg` may be empty or absent, but names no body."""
    mechanisms = [
        mechanism_from_mapping({**LEVER, "assembly": {"alpha3_deg": 0.0, **given}})
        for given in ({}, {"angles_deg": dict[str, float]()})
    ]
    assert mechanisms[0] == mechanisms[1]
    with pytest.raises(MechanismError, match=r"angles_deg\.rod: this key is not known"):
        other = {"alpha3_deg": 0.0, "angles_deg": {"rod": 1.0}}
        mechanism_from_mapping({**LEVER, "assembly": other})
