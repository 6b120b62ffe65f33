# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated photographs: the crank angle, its deviation, and a pin that is wrong."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.description import Mechanism, Point
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.studies.pose import (
    PoseError,
    angle_rows,
    described,
    fit_photo,
    pin_places,
    read_pins,
    wrong_pin,
)

PINS = ("P1", "P2", "P3", "V2", "V1", "E1", "E2")
MM_PER_PIXEL = 1.3


@pytest.fixture(scope="module")
def kinematics(mechanism: Mechanism) -> Kinematics:
    """Return the kinematics of the paper's linkage."""
    return Kinematics(mechanism)


def photographed(
    mechanism: Mechanism,
    kinematics: Kinematics,
    alpha3: float,
    rng: np.random.Generator,
    *,
    noise: float = 0.002,
    mirrored: bool = False,
) -> dict[str, Point]:
    """Return the pixels of pins in a photograph that is turned by 3 deg, with errors in m."""
    places = pin_places(mechanism, kinematics.at(alpha3))
    c, s = math.cos(0.05), math.sin(0.05)
    found = {}
    for name in PINS:
        x, z = places[name] + noise * rng.normal(size=2)
        x = -x if mirrored else x
        scale = 1000.0 / MM_PER_PIXEL
        found[name] = (900.0 + scale * (c * x - s * z), 700.0 - scale * (s * x + c * z))
    return found


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_exact_photograph(mechanism: Mechanism, kinematics: Kinematics, mirrored: bool) -> None:
    """The angle, the scale and the side are those of the photograph."""
    for degrees in (90.0, 120.0, 180.0):
        rng = np.random.default_rng(0)
        pixels = photographed(
            mechanism, kinematics, math.radians(degrees), rng, noise=0.0, mirrored=mirrored
        )
        photo = fit_photo(mechanism, kinematics, pixels)
        assert math.degrees(photo.alpha3) == pytest.approx(degrees, abs=1e-3)
        assert photo.mirrored is mirrored
        assert photo.scale == pytest.approx(MM_PER_PIXEL / 1000.0, rel=1e-4)
        assert photo.off.max() < 1e-4


@pytest.mark.parametrize("count", [4, 5, 7])
def test_the_deviation_of_the_angle(
    mechanism: Mechanism, kinematics: Kinematics, count: int
) -> None:
    """The intervals of 95 % contain the angle, whatever the number of pins, and are not wide."""
    rng, ratios = np.random.default_rng(1), []
    for _ in range(60):
        alpha3 = math.radians(rng.uniform(95.0, 175.0))
        pixels = photographed(mechanism, kinematics, alpha3, rng)
        chosen = rng.choice(PINS[3:], size=min(count, 4) - 1, replace=False).tolist()
        names = [*PINS[: count - len(chosen)], *chosen]
        photo = fit_photo(mechanism, kinematics, {name: pixels[name] for name in names})
        ratios.append((photo.alpha3 - alpha3) / photo.stddev)
    assert (np.abs(ratios) < 1.96).mean() > 0.9
    assert np.median(np.abs(ratios)) > 0.15


@pytest.mark.parametrize("wrong", PINS)
def test_a_wrong_pin_is_named(mechanism: Mechanism, kinematics: Kinematics, wrong: str) -> None:
    """A pin that is 60 mm off is named, and without it the angle is right."""
    rng = np.random.default_rng(3)
    pixels = photographed(mechanism, kinematics, 2.1, rng, noise=0.001)
    x, y = pixels[wrong]
    pixels[wrong] = (x + 30.0, y + 35.0)
    photo = fit_photo(mechanism, kinematics, pixels)
    found = wrong_pin(mechanism, kinematics, pixels, photo)
    assert found is not None
    assert found[0] == wrong
    assert found[1].alpha3 == pytest.approx(2.1, abs=3.0 * found[1].stddev)
    assert f"measure {wrong} again" in described(photo, found)


def test_sound_pins_are_not_blamed(mechanism: Mechanism, kinematics: Kinematics) -> None:
    """Of eight photographs with seven pins, none has a wrong one."""
    rng = np.random.default_rng(4)
    for _ in range(8):
        pixels = photographed(mechanism, kinematics, rng.uniform(1.6, 3.0), rng)
        photo = fit_photo(mechanism, kinematics, pixels)
        assert wrong_pin(mechanism, kinematics, pixels, photo) is None


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["P1=1"], "P1=1: write PIN=X,Y in pixels"),
        (["P1=1,nan"], "write PIN=X,Y in pixels"),
        (["Q=1,2"], "there is no pin Q; name one of E1, E2, P1"),
        (["P1=1,2", "P1=3,4"], "the pin P1 is given twice"),
        (["P1=1e300,2"], "write PIN=X,Y in pixels"),
        (["P1=1,2", "P2=3,4"], "2 pins do not show the angle; give three or more"),
        (["P1=1,2", "P2=1,2", "P3=1,2"], "All pins lie within one pixel"),
        (["P1=900,800", "P2=566,397", "P3=836,415"], "P1, P2, P3 do not move against one another"),
    ],
)
def test_pins_that_show_nothing(
    mechanism: Mechanism, kinematics: Kinematics, words: list[str], why: str
) -> None:
    """Words of another form, unknown pins and too few pins are refused."""
    with pytest.raises(PoseError) as raised:
        fit_photo(mechanism, kinematics, read_pins(words, mechanism))
    assert why in str(raised.value)


def test_three_pins_have_no_known_deviation(mechanism: Mechanism, kinematics: Kinematics) -> None:
    """With three pins the deviation is unknown, and says so."""
    pixels = photographed(mechanism, kinematics, 2.0, np.random.default_rng(0))
    few = {name: pixels[name] for name in ("P1", "P3", "V2")}
    photo = fit_photo(mechanism, kinematics, few)
    assert math.isnan(photo.stddev)
    assert "standard deviation unknown deg" in described(photo, None)
    assert wrong_pin(mechanism, kinematics, few, photo) is None


def test_the_table_of_angles(mechanism: Mechanism, kinematics: Kinematics) -> None:
    """Its numbers are those of the kinematics."""
    lines = angle_rows(mechanism, kinematics, [math.radians(90.0)]).splitlines()
    assert lines[1].split()[:5] == ["90.00", "158.90", "141.14", "238.69", "87.80"]
