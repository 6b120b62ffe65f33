# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Parsing: what is read, and that every wrong description is told by its path and mend."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping


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
    """A number that differs in its last bit makes no other model."""
    crank = mapping["links"]["input_crank"]["points"]
    crank["V2"] = math.nextafter(crank["V2"], 1.0)
    assert mechanism_from_mapping(mapping).model_hash == mechanism.model_hash


def change(*path: str, to: Any) -> Callable[[Any], None]:
    """Return what sets a key of a nested mapping."""

    def spoil(mapping: Any) -> None:
        for key in path[:-1]:
            mapping = mapping[key]
        mapping[path[-1]] = to

    return spoil


def remove(*path: str) -> Callable[[Any], None]:
    """Return what removes a key of a nested mapping."""

    def spoil(mapping: Any) -> None:
        for key in path[:-1]:
            mapping = mapping[key]
        del mapping[path[-1]]

    return spoil


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
        (change("links", "upper_link", "points", to={"P2": 0, "E3": 0.5}), "links", "freedom"),
        (change("links", "upper_link", "modes", to=0), "upper_link.modes", "whole number"),
        (change("links", "upper_link", "modes", to=2.5), "upper_link.modes", "whole number"),
        (change("links", "input_crank", "clamped", to="V2"), "input_crank.clamped", "P3"),
        (change("links", "lift_rod", "section", "shape", to="hexagon"), "shape", "rectangle"),
        (change("links", "lift_rod", "section", "diameter", to=0), "diameter", "zero"),
        (change("links", "upper_link", "section", "inner_diameter", to=0.1), "inner", "fit"),
        (change("links", "lift_rod", "material", "poisson_ratio", to=0.7), "poisson", "0.5"),
        (
            change("rigid_bodies", "implement", "centre_of_gravity", "E1", to=0.1),
            "gravity",
            "no po",
        ),
        (change("rigid_bodies", "implement", "centre_of_gravity", to=[1]), "gravity", "point [x"),
        (change("ground", "P4", to=[0, 0]), "ground.P4", "no body"),
        (change("ground", "P1", to=[0, 0, 0]), "ground.P1", "[x, z]"),
        (change("ground", "P1", to=["a", 0]), "ground.P1[0]", "text"),
        (change("input", "link", to="implement"), "input.link", "lower_link"),
        (change("input", "link", to="lift_rod"), "input.link", "input_crank"),
        (change("input", "range_deg", to=[180, 90]), "input.range_deg", "ascend"),
        (change("response", "drive_point", to="E9"), "response.drive_point", "E1"),
        (change("response", "direction", to="y"), "response.direction", "x, z"),
        (change("response", "band_hz", to=[-1, 200]), "response.band_hz", "negative"),
        (change("damping", "at_hz", to=[0, 10]), "damping.at_hz", "zero"),
        (change("name", to=""), "name", "text"),
        (change("links", "implement", to={}), "implement", "missing"),
        (change(7, to=1), "(top)", "quotes"),
    ],
)
def test_wrong_descriptions_are_told(
    mapping: Any, spoil: Callable[[Any], None], path: str, words: str
) -> None:
    """Each wrong key gives an error that names its path and what is wrong."""
    spoil(mapping)
    with pytest.raises(MechanismError) as raised:
        mechanism_from_mapping(mapping)
    assert path in raised.value.path
    assert words in raised.value.problem


def test_misspelt_key_is_suggested(mapping: Any) -> None:
    """A key that is missing because it is misspelt is pointed at."""
    mapping["respons"] = mapping.pop("response")
    with pytest.raises(MechanismError, match="response: .*respons stands there"):
        mechanism_from_mapping(mapping)


@pytest.mark.parametrize("nonsense", [None, 3, "text", [], [1], {}])
def test_not_even_a_mechanism(nonsense: Any) -> None:
    """Whatever YAML may hold is refused in words."""
    with pytest.raises(MechanismError):
        mechanism_from_mapping(nonsense)
