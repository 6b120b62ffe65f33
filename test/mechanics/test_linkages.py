# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Other linkages than the default one: nothing in the code knows which linkage it is."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file

FloatArray = NDArray[np.float64]


@pytest.fixture(scope="module")
def four_bar() -> Mechanism:
    """Return the shipped four-bar."""
    return read_mechanism(config_file("four_bar.yaml"))


@pytest.fixture(scope="module")
def stephenson() -> Mechanism:
    """Return the shipped Stephenson six-bar."""
    return read_mechanism(config_file("stephenson_six_bar.yaml"))


@pytest.fixture
def stephenson_mapping() -> Any:
    """Return the Stephenson six-bar as a mapping that a test may spoil."""
    return yaml.safe_load(config_file("stephenson_six_bar.yaml").read_text())


@pytest.mark.parametrize("alpha3_deg", range(-90, 450, 30))
def test_four_bar_positions_in_closed_form(four_bar: Mechanism, alpha3_deg: float) -> None:
    """Rocker and coupler angles by Freudenstein's half-angle formula, all the way round."""
    a, b, c, d = 0.150, 0.450, 0.350, 0.500
    alpha3 = math.radians(alpha3_deg)
    k1, k2, k3 = d / a, d / c, (a**2 - b**2 + c**2 + d**2) / (2 * a * c)
    cosine = math.cos(alpha3)
    p, q = cosine - k1 - k2 * cosine + k3, -2 * math.sin(alpha3)
    r = k1 - (k2 + 1) * cosine + k3
    rocker = 2 * math.atan2(-q - math.sqrt(q**2 - 4 * p * r), 2 * p)
    end = d + c * math.cos(rocker) - a * cosine, c * math.sin(rocker) - a * math.sin(alpha3)
    configuration = Kinematics(four_bar).at(alpha3)
    for body, angle in (("rocker", rocker), ("coupler", math.atan2(end[1], end[0]))):
        assert math.cos(configuration.angle(body) - angle) == pytest.approx(1.0, abs=1e-14)
    assert configuration.toggle_distance == math.inf


def test_stephenson_closes_at_every_pin(stephenson: Mechanism) -> None:
    """Over the stroke the two sides of every pin lie together."""
    kinematics = Kinematics(stephenson)
    for alpha3 in np.linspace(*stephenson.stroke, 9):
        configuration = kinematics.at(alpha3)
        for point, first, second in stephenson.joints:
            ends = [
                configuration.place(body, stephenson.local_points(body)[point])
                for body in (first, second)
            ]
            assert math.dist(*ends) < 1e-13


def test_stephenson_toggles(stephenson: Mechanism) -> None:
    """Its second dyad locks the linkage where the drag link and the pendulum are in line."""
    toggles = Kinematics(stephenson).toggles
    assert toggles is not None
    assert [toggle.aligned for toggle in toggles] == [("P", "E", "F")] * 2
    for toggle in toggles:
        configuration = Kinematics(stephenson).at(
            toggle.alpha3 - math.copysign(1e-9, toggle.alpha3)
        )
        across = math.sin(configuration.angle("drag_link") - configuration.angle("pendulum"))
        assert abs(across) < 1e-3


def test_stephenson_reduced_equals_unreduced(stephenson: Mechanism) -> None:
    """The reduction holds with offset pins, stepped sections, point masses and springs too."""
    reduced, full = LinkageModel(stephenson), LinkageModel(stephenson, reduced=False)
    for alpha3 in np.linspace(*stephenson.stroke, 3):
        frequencies = reduced.solve(alpha3).natural_frequencies[:3]
        np.testing.assert_allclose(
            frequencies, full.solve(alpha3).natural_frequencies[:3], rtol=1e-5
        )


def test_mass_lowers_and_spring_raises(stephenson_mapping: Any) -> None:
    """A heavier point mass lowers every natural frequency, a stiffer spring raises it."""
    alpha3 = math.radians(100.0)

    def frequencies() -> FloatArray:
        return (
            LinkageModel(mechanism_from_mapping(stephenson_mapping))
            .solve(alpha3)
            .natural_frequencies[:6]
        )

    before = frequencies()
    stephenson_mapping["links"]["coupler"]["masses"]["P"] = 0.8
    heavier = frequencies()
    assert (heavier <= before * (1 + 1e-12)).all()
    assert heavier[0] < 0.9999 * before[0]
    stephenson_mapping["springs"]["stay"]["stiffness"] *= 2
    assert (frequencies() >= heavier * (1 - 1e-12)).all()
    assert frequencies()[0] > 1.001 * heavier[0]


@settings(max_examples=15)
@given(angle=st.floats(-math.pi, math.pi), x=st.floats(-5.0, 5.0), z=st.floats(-5.0, 5.0))
def test_turning_and_moving_the_whole_changes_nothing(
    mechanism: Mechanism, angle: float, x: float, z: float
) -> None:
    """A linkage set up elsewhere and aslant has the same frequencies."""
    c, s = math.cos(angle), math.sin(angle)
    turned = dataclasses.replace(
        mechanism,
        ground=tuple(
            (n, (c * px - s * pz + x, s * px + c * pz + z)) for n, (px, pz) in mechanism.ground
        ),
        stroke=(mechanism.stroke[0] + angle, mechanism.stroke[1] + angle),
        assembly_alpha3=mechanism.assembly_alpha3 + angle,
        assembly_angles=tuple((n, a + angle) for n, a in mechanism.assembly_angles),
    )
    alpha3 = math.radians(125.0)
    frequencies = LinkageModel(mechanism).solve(alpha3).natural_frequencies[:4]
    other = LinkageModel(turned).solve(alpha3 + angle).natural_frequencies[:4]
    np.testing.assert_allclose(other, frequencies, rtol=1e-8)


def test_the_order_of_bodies_changes_nothing(mapping: Any, model: LinkageModel) -> None:
    """Bodies and points renamed and listed in another order give the same frequencies."""
    mapping["links"] = dict(reversed(list(mapping["links"].items())))
    mapping["ground"] = dict(reversed(list(mapping["ground"].items())))
    other = LinkageModel(mechanism_from_mapping(mapping))
    for alpha3 in (1.6, 2.4, 3.1):
        np.testing.assert_allclose(
            other.solve(alpha3).natural_frequencies[:5],
            model.solve(alpha3).natural_frequencies[:5],
            rtol=1e-9,
        )


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("springs", "stay", "between"), ["S"], "two points"),
        (("springs", "stay", "between"), ["A", "D"], "both points are on ground"),
        (("springs", "stay", "between"), ["S", "Q"], "two points"),
        (("springs", "drive", "joint"), "S", "not one of"),
        (("springs", "drive", "stiffness"), -1, "-1 is below 0"),
        (("links", "coupler", "masses"), {"Q": 1.0}, "not one of: B, P, C"),
        (("links", "coupler", "sections"), [], "list"),
        (("links", "coupler", "section"), {}, "not known"),
        (("damping", "rule"), "magic", "rayleigh"),
        (("links", "coupler", "points", "C"), -0.1, "beyond"),
    ],
)
def test_wrong_descriptions_are_reported(
    stephenson_mapping: Any, path: tuple[str, ...], value: Any, words: str
) -> None:
    """Each wrong key of what the paper's linkage does not use names its path."""
    below = stephenson_mapping
    for key in path[:-1]:
        below = below[key]
    below[path[-1]] = value
    with pytest.raises(MechanismError, match=words) as raised:
        mechanism_from_mapping(stephenson_mapping)
    assert ".".join(path[:2]) in raised.value.path


def test_sections_have_an_order(stephenson_mapping: Any) -> None:
    """Stepped sections ascend along the link and reach its last point."""
    sections = stephenson_mapping["links"]["coupler"]["sections"]
    backwards, short, outside = (0.2, 0.1, 5.0), (0.2, 0.3, 0.4), (-0.1, 0.3, 5.0)
    for ends in (backwards, short, outside):
        for section, end in zip(sections, ends, strict=True):
            section["until"] = end
        with pytest.raises(MechanismError, match=r"links\.coupler\.sections: they do not ascend"):
            mechanism_from_mapping(stephenson_mapping)
